"""The steps as machine code for other processors: `rrins build`."""
