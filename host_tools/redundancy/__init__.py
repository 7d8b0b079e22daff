"""Faults that redundant sensors can find: by theory, and by a Monte Carlo of whole runs."""
