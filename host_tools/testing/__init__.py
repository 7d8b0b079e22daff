"""A test kit for pytest: benches in virtual or real time."""
