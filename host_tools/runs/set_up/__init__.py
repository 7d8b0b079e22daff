"""Turns a scenario into the settings of both sides."""
