"""A rehearsal that somebody else runs: watched only, or, with `--control`, given orders."""

from __future__ import annotations

import json

import pytest

from rrins.host_tools.bus.address import Address
from rrins.host_tools.dashboard import bus_control
from rrins.host_tools.dashboard.bus_control import BusControl
from rrins.host_tools.dashboard.page_orders import Order
from tests.host_tools.dashboard.test_server import answer_to, feed, state

pytestmark = pytest.mark.slow


def modes_until(client, mode):
    """Wait for a mode of the firmware."""
    for _ in range(300):
        if (state(client)["firmware"] or {}).get("mode") == mode:
            return
    raise AssertionError(f"never {mode}")


@pytest.fixture(scope="module")
def attached(rehearsal, serving):
    """Return a second dashboard, attached to the bus of the first with `--control`."""
    with feed(rehearsal) as client:
        modes_until(client, "NAVIGATION_ROTATING")
    with serving("--channel", "rrins0", "--control", runtime=rehearsal.runtime) as served:
        yield served


def test_a_fault_is_put_in_listed_and_removed_on_an_attached_bus(attached):
    with feed(attached) as client:
        hello = json.loads(client.recv(timeout=120.0))
        assert hello["may_control"]
        assert {"inject", "mode", "clear_codes"} <= set(hello["orders"])
        assert not {"stop", "pause", "speed"} & set(hello["orders"])  # these are its starter's
        fault = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 5.0}
        given = answer_to(client, order="inject", fault=fault)
        assert given["is_done"], given
        assert given["text"].startswith("gyro_bias")
        gone = answer_to(client, order="remove", fault=fault)
        assert gone["is_done"], gone
        assert not answer_to(client, order="stop")["is_done"]


def read_residuals(client):
    """Return the residuals of the last second, each with its threshold, by kind of sensor."""
    client.send(json.dumps({"id": 5, "order": "read_residuals"}))
    told = ""
    while not told.startswith('{"kind":"report"'):
        message = client.recv(timeout=120.0)
        told = message if isinstance(message, str) else ""
    return json.loads(told)["residuals"]


def test_residuals_and_their_thresholds_are_read_for_each_sensor(attached):
    with feed(attached) as client:
        for _ in range(30):  # the first seconds may still have the fault of the test before
            found = read_residuals(client)
            assert found.keys() == {"gyros", "accelerometers"}
            for pairs in found.values():
                assert [bool(pair[1]) for pair in pairs] == [True] * 4 + [False] * (len(pairs) - 4)
            compared = [pair for pairs in found.values() for pair in pairs[:4]]
            if all(0 <= abs(residual) < threshold for residual, threshold in compared):
                return
            state(client)
    raise AssertionError(f"never below their thresholds: {found}")


def test_modes_are_requested_on_an_attached_bus(attached):
    with feed(attached) as client:
        for mode, reported in (
            ("no rotation", "NAVIGATION_STRAPDOWN"),
            ("rotation", "NAVIGATION_ROTATING"),
            ("standby", "STANDBY"),
        ):
            answer = answer_to(client, order="mode", mode=mode)
            assert answer["is_done"], answer["text"]
            modes_until(client, reported)
        for _ in range(12):  # a machine that stalls changes the mode after the answer's 5 s
            answer = answer_to(client, order="mode", mode="navigate")
            if "no change of mode" not in answer["text"]:
                break
        modes = ((state(client)["firmware"] or {}).get("mode") for _ in range(300))
        assert any(mode not in (None, "STANDBY") for mode in modes)
        refused = answer_to(client, order="mode", mode="navigate")
        assert "goes from STANDBY only" in refused["text"]


@pytest.mark.parametrize("last_counter", range(15))
def test_navigate_is_heard_whatever_the_counter_of_the_operators_last_command(
    monkeypatch, last_counter
):
    """A frame with the same counter as the one before is a repetition, which E2E forbids to use."""
    modes = ["STANDBY"]

    class Bus:
        def send(self, message, timeout):
            if message.data[1] & 0xF != last_counter:
                modes.append("ALIGNMENT")

        def shutdown(self):
            pass

    control = BusControl(Address("rrins", "nowhere"), lambda: modes[-1])
    monkeypatch.setattr(bus_control, "open_bus", lambda *_, **__: Bus())
    monkeypatch.setattr(bus_control, "_ANSWER_S", 0.3)
    answer = control.carry_out(Order(order="mode", id=1, mode="navigate"))
    assert answer == {"text": "the mode is ALIGNMENT"}
