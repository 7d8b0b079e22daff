"""Measurement and calibration of the navigation computer: `rrins xcp`, an XCP master (pyxcp)."""
