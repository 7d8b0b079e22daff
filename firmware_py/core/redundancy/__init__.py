"""Redundant sensors: finds the one that fails, and leaves it out without loss."""
