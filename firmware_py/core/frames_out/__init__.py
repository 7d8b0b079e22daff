"""Frames out: status, navigation and the estimator's results."""
