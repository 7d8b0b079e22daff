"""Users' own programs in place of a side, and what follows them."""
