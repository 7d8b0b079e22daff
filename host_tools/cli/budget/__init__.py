"""Commands that split an error by its sources."""
