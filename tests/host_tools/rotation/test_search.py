"""The search: it keeps its principles, judges as the analysis does, and knows table 1."""

from __future__ import annotations

import numpy as np
import pytest

from rrins.firmware_py.core.settings import Scheme
from rrins.host_tools.rotation.enumeration import Limits, SearchError, candidates
from rrins.host_tools.rotation.half_turns import HalfTurns
from rrins.host_tools.rotation.search import candidate_of, search
from rrins.host_tools.scenario.schemes import SCHEMES

from .conftest import paper_rimu

TABLE_1 = Scheme(turns=SCHEMES["16-position"])


def as_moves(scheme):
    return [2 * (turn.axis == "outer") + (turn.angle_deg < 0) for turn in scheme.turns]


def test_table_1_keeps_the_principles():
    moves, _ = candidates(Limits())
    assert as_moves(TABLE_1) in moves.tolist()


def test_the_eight_positions_need_a_slip_ring():
    eight = as_moves(Scheme(turns=SCHEMES["8-position"]))
    assert eight not in candidates(Limits(positions=8))[0].tolist()
    assert eight in candidates(Limits(positions=8, slip_ring=True, inner_range_deg=0))[0].tolist()


def test_no_eight_positions_without_a_slip_ring_leave_as_little_as_table_1():
    assert search(Limits(positions=8), paper_rimu(), TABLE_1).best[0].remaining > 2
    assert search(Limits(positions=8, slip_ring=True), paper_rimu(), TABLE_1).best[0].remaining == 2


@pytest.mark.parametrize("loose", [False, True])
def test_every_candidate_is_one(loose):
    limits = Limits(positions=12, inner_range_deg=540, outer_range_deg=180, loose=loose)
    moves, _ = candidates(limits)
    assert len(np.unique(moves, axis=0)) == len(moves)
    for sequence in moves:
        steps = [(move // 2, 1 if move % 2 == 0 else -1) for move in sequence]
        for axis, widest in ((0, 3), (1, 1)):
            angles = np.cumsum([0, *(sense for a, sense in steps if a == axis)])
            assert np.ptp(angles) <= widest
            assert angles[-1] == 0
        half = [axis for axis, _ in steps[:6]]
        assert all(len(set(half[k : k + 3])) > 1 for k in range(4))
        if not loose:
            assert all(half[k] != half[k + 1] for k in range(5) if k != 3)


@pytest.mark.slow
@pytest.mark.parametrize("stand_s", [0.0, 10.0])
def test_half_turns_are_judged_as_by_the_analysis(random, stand_s):
    rimu = paper_rimu("cone")
    moves, _ = candidates(Limits(positions=8, loose=True))
    half_turns = HalfTurns(rimu, 3.0, stand_s)
    chosen = moves[random.choice(len(moves), 12, replace=False)]
    remaining, rms_mps = half_turns.judge(chosen)
    for k, sequence in enumerate(chosen):
        one = candidate_of(half_turns.scheme(sequence), rimu)
        assert remaining[k] == one.remaining
        assert rms_mps[k] == pytest.approx(one.velocity_rms_mps, rel=1e-6)


@pytest.mark.parametrize("geometry", ["tetrahedron", "dodecahedron", "cone"])
def test_the_best_is_at_least_as_good_as_table_1(geometry):
    found = search(Limits(), paper_rimu(geometry), TABLE_1)
    assert found.best[0].order <= found.reference.order
    assert found.reference.remaining == 2  # z of the accelerometers' MESSF and MEIE
    assert found.equal is not None
    assert found.equal >= 1
    assert (found.better == 0) == (found.best[0].order[:2] >= found.reference.order[:2])
    orders = [candidate.order for candidate in found.best]
    assert orders == sorted(orders)


@pytest.mark.slow
def test_loosening_never_makes_the_best_worse():
    strict = search(Limits(positions=12), paper_rimu(), TABLE_1).best[0]
    loose = search(Limits(positions=12, loose=True), paper_rimu(), TABLE_1).best[0]
    assert loose.order <= strict.order


def test_schemes_of_another_cycle_are_not_ranked_against_the_reference():
    found = search(Limits(positions=8), paper_rimu(), TABLE_1)
    assert found.better is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits(positions=7), "even"),
        (Limits(positions=66), "4 to 64"),
        (Limits(inner_range_deg=90), "wider"),
        (Limits(positions=64, loose=True), "fewer positions"),
    ],
)
def test_impossible_limits_are_told(limits, words):
    with pytest.raises(SearchError, match=words):
        search(limits, paper_rimu(), TABLE_1)
