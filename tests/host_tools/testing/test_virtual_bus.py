"""Tools at a bench in virtual time: a python-can bus whose receiving lets time pass, and UDS."""

from __future__ import annotations

import can
import pytest

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import table
from rrins.host_tools.testing.errors import BenchError


@pytest.fixture
def bench(rrins_bench):
    bench = rrins_bench("rimu_rotating", way="direct")
    bench.advance(5.0)
    return bench


def test_time_passes_while_it_receives(bench):
    sync = load().frame_id("SYNC")
    bench.bus.set_filters([{"can_id": sync, "can_mask": 0x7FF}])
    begun_s = bench.time_s
    epochs = [load().database.decode_message(sync, bench.bus.recv().data)["epoch"] for _ in "abc"]
    assert epochs == [1000, 1001, 1002]
    assert bench.time_s == pytest.approx(begun_s + 0.015)


def test_its_timeouts_and_timestamps_are_simulated_seconds(bench):
    bench.bus.set_filters([{"can_id": 0x7FF, "can_mask": 0x7FF}])
    begun_s = bench.time_s
    assert bench.bus.recv(7.5) is None
    assert bench.time_s == pytest.approx(begun_s + 7.5)
    bench.bus.set_filters(None)
    assert bench.bus.recv().timestamp >= begun_s


def test_it_takes_nothing_from_another_or_from_itself(bench):
    one, other = bench.attach(), bench.attach()
    one.send(can.Message(arbitration_id=0x6AB, is_extended_id=False, data=b"own"))
    heard = [one.recv() for _ in range(50)]
    assert 0x6AB not in {message.arbitration_id for message in heard}
    assert [str(message) for message in heard] == [str(other.recv()) for _ in range(50)]
    assert bench.bus.recv(0) is None  # opened later: it has missed them


def test_it_says_when_the_scenario_is_over(rrins_bench):
    bench = rrins_bench("rimu_rotating", way="direct", duration_s=1.0)
    bench.bus.set_filters([{"can_id": 0x7FF, "can_mask": 0x7FF}])
    with pytest.raises(BenchError, match="the scenario is over"):
        bench.bus.recv()


def overruns(tester):
    return tester.read([table.identifier("fault_counters")])["fault_counters"]["overruns"]


@pytest.mark.parametrize("way", ["direct", "lockstep", "realtime"])
def test_a_tester_finds_what_is_wrong(rrins_bench, way):
    bench = rrins_bench("rimu_rotating", way=way)
    bench.advance(5.0)
    bench.inject("silence", message="SENSOR_3")
    bench.advance(0.5)
    with bench.tester(is_securing=True) as tester:
        found = {one.trouble.name for one in tester.troubles(0x08)}
        after = overruns(tester)
        assert after == 0 or way == "realtime"
        stalls = {"overrun", "clock_jump"} if way == "realtime" else set()
        assert found - stalls == {"sensor_3_silent"}
        assert ("overrun" in found) <= (after > 0)  # those of the start are counted only
        bridge = table.identifier("bridge")
        tester.write(bridge, {"bridge_s": 0.3})
        assert tester.read([bridge]) == {"bridge": {"bridge_s": 0.3}}
