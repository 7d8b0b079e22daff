"""The command `rrins scheme`."""
