"""Monitors of the computer: parity of the sensors, stuck sensors, trouble codes."""
