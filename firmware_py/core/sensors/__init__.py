"""Sensor counts to one specific force and angular rate: calibration, fusion, size effect."""
