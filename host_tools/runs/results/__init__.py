"""Results of a run: logs, summaries, plots."""
