"""A test kit: benches that a pytest drives, in virtual time or in real time."""
