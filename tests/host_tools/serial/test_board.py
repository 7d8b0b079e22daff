"""A board on an slcan adapter, played by a thread: what the hardware makes of one that is late."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import can
import pytest

from rrins.dbc.e2e import COUNTER_MODULUS
from rrins.host_tools.bus.port import message_of_frame
from rrins.host_tools.testing.recording import Contract
from rrins.host_tools.testing.slcan import SlcanPair

CONTRACT = Contract()
LAST = CONTRACT.can_id("AXIS_OUTER_STATUS")


def frame(message: str, counter: int, **values: str) -> can.Message:
    return message_of_frame(CONTRACT.encode(message, values, counter)[0])


@contextmanager
def board(port: str, epochs_late: int) -> Iterator[None]:
    """Answer each epoch on the bus with the commands of an earlier one, both axes at HOLD."""
    ends = threading.Event()

    def run() -> None:
        with can.Bus(interface="slcan", channel=port, bitrate=1_000_000, sleep_after_open=0) as bus:
            while not ends.is_set():
                came = bus.recv(0.1)
                if came is None:  # the hardware waits for a sign of life
                    bus.send(frame("HEARTBEAT_FIRMWARE", 0))
                elif came.arbitration_id == LAST:
                    counter = ((came.data[1] & 0xF) - epochs_late) % COUNTER_MODULUS
                    for axis in ("INNER", "OUTER"):
                        bus.send(frame(f"AXIS_{axis}_COMMAND", counter, command="HOLD"))

    thread = threading.Thread(target=run, name="board")
    thread.start()
    try:
        yield
    finally:
        ends.set()
        thread.join()


@pytest.mark.parametrize(("epochs_late", "is_used"), [(1, True), (2, False)])
def test_a_command_is_used_until_the_second_epoch_after_its_own(
    start, scenario, epochs_late: int, is_used: bool
) -> None:
    with SlcanPair() as pair, board(pair.ports[1], epochs_late):
        hardware = start(
            *("hardware", scenario, "--duration", 0.1, "--speed", "max", "--json"),
            *("--interface", "slcan", "--channel", pair.ports[0], "--bitrate", 1_000_000),
        )
        status, out = hardware.finish()
    assert status == 0, hardware.said
    summary = json.loads(out)
    faults, commands = summary["faults"], 2 * (summary["epochs"] - 3)
    assert faults["crc_errors"] == 0
    if is_used:
        assert faults["counter_errors"] == 0
        assert faults["missing_commands"] <= 4 * epochs_late
    else:
        assert faults["counter_errors"] >= commands
        assert faults["missing_commands"] >= commands
