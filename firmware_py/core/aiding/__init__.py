"""Lever arms: antenna and wheel."""
