"""The diagnosis on a watched bus, live: in the screen, in the table, and as JSON."""

from __future__ import annotations

import asyncio

import can
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.diag.trace import Trace
from rrins.host_tools.monitor.dialogue import Dialogue
from rrins.host_tools.monitor.once import as_dict, table_of
from rrins.host_tools.monitor.screen.app import MonitorApp
from rrins.host_tools.monitor.tally import DIAGNOSTIC

ASK, ANSWER = (load().frame_id(name) for name in ("DIAG_REQUEST", "DIAG_RESPONSE"))
SAID = ["read_mode", "read_mode: mode STANDBY, fault NONE", "write_bridge: bridge_s 0.5 s",
    "write_bridge refused: securityAccessDenied (0x33): the computer is locked"]  # fmt: skip


def put(played, can_id, data, time_s):
    message = can.Message(arbitration_id=can_id, is_extended_id=False, data=bytes.fromhex(data))
    played.put_message(message, time_s)


@pytest.fixture
def talked(played):
    """A bus on which a tool has asked."""
    played.send("SYNC", 0.0)
    put(played, ASK, "03220102cccccccc", 0.5)
    put(played, ANSWER, "0562010202 00cccc", 0.51)
    put(played, ASK, "100b2e10043fe000", 1.0)
    put(played, ASK, "210000000000cccc", 1.01)
    put(played, ANSWER, "037f2e33cccccccc", 1.02)
    return played


def test_messages_and_their_times(talked):
    dialogue = Dialogue(talked.watch, Trace())
    found = dialogue.look()
    assert [one.text for one in found] == SAID
    assert [one.sender for one in found] == ["tool", "computer"] * 2
    assert [one.time_s for one in found] == [0.5, 0.51, 1.01, 1.02]
    assert [one.is_warning for one in found] == [False, False, False, True]
    assert dialogue.look() == []
    assert [*dialogue.spoken] == found


def test_frames_that_came_too_fast_are_told(talked):
    dialogue = Dialogue(talked.watch, Trace())
    dialogue.look()
    put(talked, ASK, "100b2e10043fe000", 1.5)
    for k in range(DIAGNOSTIC + 8):
        put(talked, ANSWER, "027e00cccccccccc", 2 + k * 1e-3)
    first, *others = dialogue.look()
    assert first.text.startswith("9 frames were not seen")
    assert first.is_warning
    assert {one.text for one in others} == {"tester_present_zero_sub_function"}


def test_in_the_table_and_as_json(talked):
    dialogue = Dialogue(talked.watch, Trace())
    dialogue.look()
    state = talked.watch.state()
    lines = table_of("bus", state, dialogue=dialogue)
    assert lines[lines.index("DIAGNOSIS") + 1].split(maxsplit=2) == ["0.500", "tool", SAID[0]]
    told = as_dict("bus", state, dialogue=dialogue)["diagnosis"]
    assert [one["text"] for one in told] == SAID


def test_on_the_screen(talked):
    async def session():
        app = MonitorApp(
            "bus", talked.watch, refresh_hz=0, dialogue=Dialogue(talked.watch, Trace())
        )
        async with app.run_test(size=(100, 24)) as pilot:
            app.look()
            await pilot.press("d")
            await pilot.pause()
            return app.screen.lines.plain.splitlines()

    assert [line.split(maxsplit=2)[2] for line in asyncio.run(session())] == SAID


def test_on_the_dashboard(talked):
    """A page shows what says something: neither bare confirmations nor bytes by the hundred."""
    view = View(talked.watch, None)
    put(talked, ASK, "023601cccccccccc", 1.1)
    view.look()
    told = [(event.text, event.weight) for event in view.log.events if ": " in event.text]
    assert told == [
        (f"computer: {SAID[1]}", "note"),
        (f"tool: {SAID[2]}", "order"),
        (f"computer: {SAID[3]}", "warning"),
    ]
