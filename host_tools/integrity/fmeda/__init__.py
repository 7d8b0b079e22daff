"""Failure modes, effects and diagnostics (FMEDA), from runs."""
