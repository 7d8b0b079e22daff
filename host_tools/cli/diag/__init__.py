"""The commands of `rrins diag`."""
