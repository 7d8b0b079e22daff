"""Words for how a faulty sensor was found; the keys are the values of `how` in the DBC."""

from __future__ import annotations

from typing import Final

FOUND_BY: Final = {
    "PARITY": "comparison with the others",
    "FULL_SCALE": "its end of range, where the others measure little",
    "STANDING": "comparison with encoders, Earth rate and gravity",
    "STUCK": "its repeated increments",
    "ABSENT": "its flag",
    "REFERENCE": "a reference of velocity",
    "OPERATOR": "the operator",
}
