"""Commands that read a recording of a bus."""
