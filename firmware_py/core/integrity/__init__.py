"""Protection levels: how far the navigation can be trusted, also with a fault not yet found."""
