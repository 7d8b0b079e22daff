"""Attitude, the Earth, and Wahba's problem."""
