"""`rrins bench`: every figure is there and can be true; how large it is depends on the machine."""

from __future__ import annotations

import dataclasses
import io
import json

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from rrins.host_tools.benchmarks import estimator, suite
from rrins.host_tools.cli.main import rrins

KEYS = {
    "quick", "wall_s", "machine", "samples", "frames_lost",
    "floor_epochs_per_s", "floor_datagram_bytes", "lockstep_epochs_per_s", "lockstep_over_floor",
    "python_can_epochs_per_s", "direct_epochs_per_s",
    "firmware_step_us", "hardware_step_us", "timer_overhead_us",
    "fast_path_us_per_epoch", "fast_path_comparing_us_per_epoch", "fast_path_limit_us_per_epoch",
    "fast_path_shared_us_per_epoch",
    "navigation_step_us",
    "estimator_step_us", "pyins_filter_us", "pyins_filter_reason", "pyins_over_step",
    "codec_us_per_frame", "crc_us_per_frame", "cantools_us_per_frame",
    "virtual", "virtual_reason", "udp_multicast", "udp_multicast_reason",
    "lateness_us", "lateness_while_read_us", "start_to_first_epoch_s",
}  # fmt: skip


def assert_speeds(result):
    for key, samples in result["samples"].items():
        assert len(samples) > 2
        assert 0 < min(samples) <= result[key] <= max(samples)
    ratio = result["floor_epochs_per_s"] / result["lockstep_epochs_per_s"]
    assert result["lockstep_over_floor"] == ratio > 0
    assert result["frames_lost"] == 0
    assert result["floor_datagram_bytes"] == {"up": 32 + 7 * 16, "down": 32 + 3 * 16}


def assert_costs(result):
    keys = ("fast_path", "fast_path_comparing", "fast_path_limit", "fast_path_shared")
    costs = [result[f"{key}_us_per_epoch"] for key in keys]
    costs += [result["navigation_step_us"], result["crc_us_per_frame"]]
    for codec in ("codec", "cantools"):
        costs += [result[f"{codec}_us_per_frame"][way] for way in ("decode", "encode")]
    assert min(costs) > 0
    names = ("plain", "filter", "filter_bank_faults", "integrity")
    cases = [result["estimator_step_us"][name] for name in names]
    for step in (result["firmware_step_us"], result["hardware_step_us"], *cases):
        assert 0 < step["median"] <= step["p99"] <= step.get("max", np.inf)
    assert (result["pyins_filter_us"] is None) == isinstance(result["pyins_filter_reason"], str)
    if result["pyins_filter_us"] is not None:
        assert result["pyins_over_step"] > 0
    assert result["virtual"]["lost_share"] == 0
    for interface in ("virtual", "udp_multicast"):
        figures, reason = result[interface], result[f"{interface}_reason"]
        assert (figures is None) == isinstance(reason, str)
        if figures is not None:
            assert figures["us_per_frame"] > 0
            assert 0 <= figures["lost_share"] <= 1


def assert_lateness(result):
    assert result["lateness_us"] == {}
    read = result["lateness_while_read_us"]["400"]
    assert read["times_read"] >= 1
    assert read["epochs"] > 100
    assert 0 < read["p50"] <= read["p99"] <= read["p999"]
    assert read["max"] >= 0
    assert 0 <= read["overruns"] <= read["epochs"]
    assert isinstance(read["completed"], bool)


@pytest.mark.soak
def test_a_quick_bench_measures_everything(monkeypatch):
    short = dataclasses.replace(
        suite.QUICK, lockstep_s=40.0, direct_s=20.0, floor_epochs=1000, message_epochs=50,
        step_samples=500, pyins_s=0.5, frames=100, bus_frames=140, realtime_s=1.8,
    )  # fmt: skip
    monkeypatch.setattr(suite, "QUICK", short)
    monkeypatch.setattr(suite, "RATES_HZ", ())  # real time is measured once: while it is read
    monkeypatch.setattr(estimator, "RATE_HZ", 100)
    ended = CliRunner().invoke(rrins, ["bench", "--quick", "--json"])
    assert ended.exit_code == 0, ended.stderr
    result = json.loads(ended.stdout)
    assert set(result) == KEYS
    assert result["wall_s"] > 0
    facts = {"python", "numba", "cpus", "cpus_permitted", "load_average", "sched_fifo"}
    assert facts <= set(result["machine"])
    assert_speeds(result)
    assert_costs(result)
    assert_lateness(result)
    start = result["start_to_first_epoch_s"]
    assert start["cold"] is None
    assert start["warm"] > 0
    shown = io.StringIO()
    suite.print_result(result, Console(file=shown, width=80))
    for word in ("floor", "lockstep", "cantools", "400 Hz", "SCHED_FIFO", "quick"):
        assert word in shown.getvalue()
    assert "…" not in shown.getvalue()
