"""Runs a scenario: settings for both sides, processes, the direct ways, results."""
