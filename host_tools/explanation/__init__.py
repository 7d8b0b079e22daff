"""Splits the error of a run at an instant by its sources, through exact reruns."""
