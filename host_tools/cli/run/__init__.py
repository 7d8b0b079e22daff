"""Commands that run a scenario or one side of it."""
