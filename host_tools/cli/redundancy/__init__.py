"""The command `rrins redundancy`."""
