"""The command `rrins campaign`."""
