"""Records and functions of the steps as machine code: what makes it, keeps it and loads it."""
