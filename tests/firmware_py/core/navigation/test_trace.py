"""The digest of a run's navigation, and what is handed on of it."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from rrins.firmware_py.core.navigation.trace import NavigationTrace
from rrins.firmware_py.core.records.memory import blank_ram


def add(trace, ram):
    """Add the navigation output of a RAM image."""
    trace.room[0] = ram["navigation"][0]
    trace.add(1)


def fed(epochs, **arguments):
    """Return a trace that has had so many records, and their bytes."""
    trace, ram, everything = NavigationTrace(**arguments), blank_ram(), b""
    for epoch in range(epochs):
        ram[0]["navigation"]["epoch"] = epoch
        ram[0]["navigation"]["velocity_n"][0] = 0.1 * epoch
        everything += ram["navigation"][0].tobytes()
        add(trace, ram)
    return trace, everything


@pytest.mark.parametrize("epochs", [0, 1, 4095, 4096, 4097, 9000])
def test_the_digest_is_over_every_record(epochs):
    trace, everything = fed(epochs)
    assert trace.sha256() == hashlib.sha256(everything).hexdigest()
    assert trace.epochs == epochs


def test_asking_for_the_digest_does_not_change_it():
    trace, everything = fed(10)
    assert trace.sha256() == trace.sha256() == hashlib.sha256(everything).hexdigest()


def test_the_smallest_change_changes_the_digest():
    one, ram = NavigationTrace(), blank_ram()
    other = NavigationTrace()
    add(one, ram)
    ram[0]["navigation"]["latitude"] = np.nextafter(0.0, 1.0)
    add(other, ram)
    assert one.sha256() != other.sha256()


@pytest.mark.parametrize("every", [1, 7, 5000])
def test_rows_are_thinned_by_their_epoch(every):
    kept: list[int] = []
    trace, _ = fed(9000, keep_every=every, sink=lambda rows: kept.extend(rows["epoch"].tolist()))
    trace.flush()
    assert kept == list(range(0, 9000, every))
