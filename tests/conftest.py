"""Settings for every test."""

from __future__ import annotations

from hypothesis import settings

# The first example of a property may compile code.
settings.register_profile("rrins", deadline=None)
settings.load_profile("rrins")
