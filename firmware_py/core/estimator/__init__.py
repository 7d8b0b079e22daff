"""The error-state filter's formulas: transition, noise and measurement, over fixed arrays."""
