"""The table `[motion]`: what it takes, and what it refuses."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from rrins.host_tools.scenario.motion import Motion


def test_a_vehicle_stands_unless_told_otherwise(make):
    assert make() is None


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"kind": "fly"}, "'stationary', 'drive', 'sway' or 'file'"),
        ({"kind": "file"}, "needs path"),
        ({"kind": "drive", "path": "a.csv"}, 'path is for kind = "file"'),
        ({"kind": "file", "path": "a.csv", "wave_height_m": 1}, 'for kind = "sway"'),
        ({"kind": "drive", "duration_s": 5}, "greater than or equal to 30"),
        ({"kind": "drive", "speed": 5}, "Extra inputs"),
        ({"kind": "sway", "wave_height_m": 5, "wave_period_s": 5}, "break above 2.60 m"),
        ({"kind": "sway", "wave_height_m": float("nan")}, "finite number"),
        ({"seed": -1}, "greater than or equal to 0"),
    ],
)
def test_what_cannot_be_is_refused(keys, words):
    with pytest.raises(ValidationError) as caught:
        Motion(**keys)
    assert words in str(caught.value)


def test_a_path_is_relative_to_the_scenario(make, write, exported):
    path = write(exported["pos"])
    assert make(path.parent, kind="file", path=path.name).duration_s > 150
