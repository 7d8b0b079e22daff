"""Modes, their transitions, and the routines that tools request."""
