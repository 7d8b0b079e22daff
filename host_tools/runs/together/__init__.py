"""Runs that share a loop: the same motion and table, sensors and noise of their own."""
