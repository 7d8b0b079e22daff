"""The generator of random cases."""

from __future__ import annotations

import pytest

from rrins.host_tools.integrity import cases
from rrins.host_tools.scenario import scenario


@pytest.fixture(scope="module")
def drawn():
    return [cases.draw(5, number) for number in range(200)]


def test_a_case_depends_on_seed_and_number_alone(drawn):
    assert cases.draw(5, 17) == drawn[17]
    assert cases.draw(6, 17) != drawn[17]


def test_all_kinds_of_faults_sites_and_motions_are_drawn(drawn):
    assert {case.kind for case in drawn} == {*cases.DRAWN, cases.TABLE, cases.ALTIMETER}
    assert {c.scenario.motion.kind for c in drawn} == {"stationary", "drive", "sway"}
    latitudes = [abs(case.scenario.site.latitude_deg) for case in drawn]
    assert min(latitudes) < 5
    assert 85 < max(latitudes) <= 89
    assert all(case.scenario.integrity.enabled for case in drawn)


def test_what_fails_is_what_the_scenario_has(drawn):
    for case in drawn:
        faults = case.scenario.faults
        assert len(faults) == {"healthy": 0, "pair": 2}.get(case.kind, 1)
        named = {
            f"{fault.kind.partition('_')[0]}_{fault.sensor}"
            for fault in faults
            if getattr(fault, "sensor", None) is not None
        }
        assert case.failing == named or case.kind == "wire"
        assert case.kind != "common" or faults[0].sensor is None
        assert all(fault.kind in case.words for fault in faults)


def test_a_scenario_keeps_all_but_seed_and_faults():
    base = scenario.load("drive_outage")
    found = [cases.draw(1, number, base).scenario for number in range(20)]
    same = {"seed": 1, "faults": (), "integrity": base.integrity}
    assert {one.model_copy(update=same).model_dump_json() for one in found} == {
        base.model_dump_json()
    }
    assert len({one.seed for one in found}) == 20
