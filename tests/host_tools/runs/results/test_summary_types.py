"""The declared keys of a summary are those that runs give."""

from __future__ import annotations

import json
import types
from typing import Any, Literal, NotRequired, get_args, get_origin, get_type_hints, is_typeddict

import pytest

import rrins
from rrins.firmware_py.loop import Firmware
from rrins.host_tools.runs.results.summary import hash_words
from rrins.host_tools.runs.set_up.settings import firmware_settings
from rrins.host_tools.runs.sides.firmware_job import firmware_summary


def fits(value: object, kind: Any) -> bool:
    """Return whether a JSON value is of a declared type."""
    origin, of = get_origin(kind), get_args(kind)
    if is_typeddict(kind):
        hints = get_type_hints(kind, include_extras=True)
        required = {name for name, hint in hints.items() if get_origin(hint) is not NotRequired}
        assert isinstance(value, dict)
        assert set(value) <= set(hints), set(value) - set(hints)
        assert not kind.__total__ or required <= set(value), required - set(value)
        return all(fits(one, hints[name]) for name, one in value.items())
    if origin is types.UnionType:
        return any(fits(value, one) for one in sorted(of, key=is_typeddict))
    if origin is NotRequired:
        return fits(value, *of)
    if origin is Literal:
        return value in of
    if origin is dict:
        return isinstance(value, dict) and all(fits(one, of[1]) for one in value.values())
    if origin is not None:
        return isinstance(value, list) and all(fits(one, of[0]) for one in value)
    return kind is Any or isinstance(value, kind)


@pytest.mark.parametrize("scenario", ["ideal", "rimu_rotating", "drive_aided"])
def test_a_run_has_the_declared_keys_and_types(scenario):
    summary = json.loads(json.dumps(rrins.simulate(scenario, duration_s=5, progress=False).summary))
    for name, kind in get_type_hints(rrins.Summary, include_extras=True).items():
        if name in summary:
            assert fits(summary[name], kind), name
    assert fits(summary, rrins.Summary)


def test_a_firmware_that_did_not_navigate_has_no_hash_of_it():
    firmware = Firmware(firmware_settings(rrins.load_scenario("ideal")))
    summary = firmware_summary(firmware)
    assert summary["navigation_sha256"] is None
    assert hash_words(summary) == "nothing was navigated"
    assert hash_words({"mode": "STANDBY", "navigation_sha256": None}) == ""  # a user's own
