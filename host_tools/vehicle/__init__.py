"""Recordings of real vehicles: read, put on the firmware's epochs, written as a bus recording."""
