"""Reproduces the paper's experiments and compares the results with its figures."""
