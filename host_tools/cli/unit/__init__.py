"""Commands that examine a unit: its calibration, and the rules for a navigation computer."""
