"""Position, velocity, attitude and increments of a trajectory agree with each other.

The firmware's navigation, which is held by closed forms of its own, follows what the RIMU feels.
"""

from __future__ import annotations

import numpy as np
import pytest

from rrins.host_tools.motion.trajectory import knot_ns


@pytest.mark.slow
@pytest.mark.parametrize("name", ["drive", "sway"])
def test_an_ideal_navigator_follows(name, request, followed):
    trajectory = request.getfixturevalue(name)
    off = np.abs(followed(trajectory)).max(axis=0)
    assert off[:2].max() < 0.005
    assert off[2] < 0.05  # unaided, the vertical channel grows by e every 570 s


@pytest.mark.parametrize("name", ["drive", "sway"])
def test_it_begins_exactly_at_rest_and_nothing_jumps(name, request):
    trajectory = request.getfixturevalue(name)
    pieces = trajectory.pieces
    assert not pieces[:4, :, 1:].any()
    assert not pieces[:4, 9:12].any()
    ends = pieces.sum(axis=2)
    following = pieces[1:, :, 0]
    jumps = np.abs(ends[:-1] - following).max(axis=0)
    assert jumps[:3].max() < 1e-10  # rad/s
    assert jumps[3:6].max() < 1e-8  # m/s²
    assert jumps[6:8].max() < 1e-15
    assert jumps[8:].max() < 1e-12


def test_it_ends_at_rest_and_stays(drive):
    trajectory = drive
    assert trajectory.loop_from is None
    assert not trajectory.pieces[-4:, :, 1:].any()
    end, later = trajectory.at(trajectory.duration_s + np.array([0.0, 1000.0]))
    assert not end[9:12].any()
    assert (end == later).all()


@pytest.mark.parametrize("rate_hz", [50, 64, 100, 125, 128, 200, 250, 400, 500, 1000])
def test_a_piece_is_a_whole_number_of_epochs(rate_hz):
    period = 1_000_000_000 // rate_hz
    assert knot_ns(period) % period == 0
    assert knot_ns(period) == pytest.approx(250_000_000, rel=0.05)


def test_a_trajectory_cannot_be_changed(drive):
    with pytest.raises(ValueError, match="read-only"):
        drive.pieces[0, 0, 0] = 1.0
    with pytest.raises(AttributeError):
        drive.knot_ns = 1
