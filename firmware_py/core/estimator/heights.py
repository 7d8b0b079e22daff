"""An altimeter beside a receiver: whose heights are right once they disagree.

The filter holds the altimeter's bias for constant but for the weather's walk, so a jump of it is
refused by the gate. If the receiver's positions pass all the while, they and the sensors stand
against the altimeter, and its bias is learned anew. Groves (2nd ed., 2013), section 17.3.2.
"""

from __future__ import annotations

from rrins.compiled.compilation import compiled
from rrins.firmware_py.core.estimator import refusals
from rrins.firmware_py.core.records.estimator_records import Aid
from rrins.firmware_py.core.records.integrity_records import ALTIMETER
from rrins.firmware_py.core.records.memory import Ram

PATIENCE = 30
"""Heights refused in a row: in as many seconds the receiver has the say of the height."""

_RECENT = 2
"""Intervals of fixes, or seconds if longer, in which a height of the receiver has passed."""

_GNSS_POSITION, _ALTIMETER = int(Aid.GNSS_POSITION), int(Aid.ALTIMETER)


@compiled
def refuse(state: Ram, innovation: float) -> None:
    """Note that the gate has refused a height of the altimeter; learn its bias anew in time."""
    estimator, sources = state.estimator, state.estimator.sources
    since = state.epoch - estimator.fix_height_epoch
    recent = _RECENT * max(state.gnss.interval_epochs, estimator.second_epochs)
    passes = estimator.fix_height_epoch >= 0 and since <= recent
    if not passes or sources[_GNSS_POSITION].distrust > 0:
        estimator.heights_refused = 0
        return
    estimator.heights_refused += 1
    if estimator.heights_refused < PATIENCE:
        return
    at = estimator.altimeter_state
    estimator.P[at, at] += innovation * innovation
    estimator.heights_refused = 0
    refusals.forget(state.integrity, ALTIMETER)
