"""Calibration of the sensors on the table: least squares of all constants."""
