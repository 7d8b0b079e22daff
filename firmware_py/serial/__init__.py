"""The serial lines of the firmware: NMEA output and a line console."""
