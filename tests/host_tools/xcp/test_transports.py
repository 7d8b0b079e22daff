"""pyxcp as the master over python-can's other buses; also run by `.ci/socketcan`."""

from __future__ import annotations

import socket

import numpy as np
import pytest

pytest.importorskip("pyxcp")

from rrins.host_tools.bus.address import Address
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.xcp.master import XcpMaster, values_of
from rrins.host_tools.xcp.recording import Recording, record
from rrins.host_tools.xcp.signals import signals_of
from tests.host_tools.xcp.conftest import rehearse

IS_VCAN_MISSING = "vcan0" not in [name for _, name in socket.if_nameindex()]
SOCKETCAN = pytest.mark.skipif(IS_VCAN_MISSING, reason="the kernel has no vcan0")


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    [
        Address("virtual", "xcp"),
        pytest.param(Address("socketcan", "vcan0"), marks=SOCKETCAN),
    ],
    ids=lambda address: address.interface,
)
def test_signals_are_written_read_and_recorded(address):
    signals = signals_of(["epoch", "navigation.velocity_n", "modes.mode"])
    recordings: list[Recording] = []

    def guest(address: Address) -> None:
        with XcpMaster(address, timeout_s=60.0) as master:
            (height,) = signals_of(["parameters.height"])
            master.write(height, 12.5)
            assert values_of(master, [height]) == {"parameters.height": 12.5}
            recordings.append(record(master, signals, 1.0))

    scenario = load("ideal").varied(duration_s=600.0, rate_hz=50, xcp={})
    watch = [(signal.address, signal.size) for signal in signals]
    rehearsed = rehearse(scenario, guest, watch, address)
    (recording,) = recordings
    assert recording.count == 50
    assert np.all(np.diff(recording.values["epoch"]) == 1)
    for k, epoch in enumerate(recording.values["epoch"].tolist()):
        row = b"".join(column[k].tobytes() for column in recording.values.values())
        assert row == rehearsed.watched[epoch]
