"""Measured data by name in the monitor and the dashboard, live and from a recording."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from pathlib import Path

import pytest

from rrins.dbc.frame import frame_array
from rrins.firmware_py.core.settings import XcpSettings
from rrins.firmware_py.xcp.layout import by_path
from rrins.host_tools.dashboard.bus_table import message_of
from rrins.host_tools.dashboard.log_source import LogSource
from rrins.host_tools.dashboard.page_orders import Order
from rrins.host_tools.dashboard.view import View
from rrins.host_tools.diag.trace import Trace
from rrins.host_tools.monitor.dialogue import Dialogue
from rrins.host_tools.monitor.once import as_dict, table_of
from rrins.host_tools.monitor.screen.app import MonitorApp
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.xcp.trace import MeasuredData
from tests.firmware_py.conftest import Bench
from tests.firmware_py.xcp.conftest import COMMAND, RESPONSE, Master

START = bytes.fromhex("de010000")
PERIOD_NS = 5_000_000


class Recorded(Master):
    """A master whose packets, and those of the computer, are kept with their times."""

    def __init__(self) -> None:
        super().__init__(Bench(xcp=XcpSettings()))
        self.frames: list[tuple[int, int, bytes]] = []

    def step(self, packets: Sequence[bytes] = ()) -> list[bytes]:
        answers = super().step(packets)
        time_ns = self.bench.epoch * PERIOD_NS
        self.frames += [(time_ns, COMMAND, packet) for packet in packets]
        self.frames += [(time_ns, RESPONSE, packet) for packet in answers]
        return answers

    def watch(self, *paths: str) -> int:
        """Measure signals for half a second; return the last epoch."""
        places = [by_path()[path].address for path in paths]
        self.measure(*(part for at in places for part in ((at, 7), (at + 7, 1))))
        self.step([START])
        for _ in range(100):
            self.step()
        self.step([b"\xdd\0"])
        return int(self.bench.ram[0].epoch)


@pytest.fixture(scope="module")
def recorded() -> tuple[Recorded, int, int]:
    """A recording of two lists, and the last epoch of each."""
    master = Recorded()
    master.step()
    master.connect()
    return (
        master,
        master.watch("epoch", "modes.mode"),
        master.watch("steps", "modes.mode", "navigation.velocity_n"),
    )


@pytest.fixture
def watch(recorded) -> Watch:
    watch = Watch()
    for time_ns, can_id, packet in recorded[0].frames:
        frames = frame_array(1)
        frames["can_id"], frames["length"] = can_id, len(packet)
        frames["data"] = int.from_bytes(packet, "little")
        watch.add_frames(frames, 1, time_ns)
    return watch


def test_in_the_monitor_as_a_table_as_json_and_on_the_screen(recorded, watch):
    dialogue = Dialogue(watch, Trace(), MeasuredData())
    dialogue.look()
    state = watch.state()
    lines = table_of("bus", state, dialogue=dialogue)
    shown = lines[lines.index("MEASURED") + 1 :]
    assert [line.split()[0] for line in shown] == [
        "steps",
        "modes.mode",
        "navigation.velocity_n[0]",
    ]
    assert shown[1].split()[1] == "STANDBY"
    assert shown[2].endswith(" m/s")
    measured = as_dict("bus", state, dialogue=dialogue)["measured"]
    assert measured["steps"]["value"] == recorded[2]

    async def session():
        app = MonitorApp("bus", watch, refresh_hz=0, dialogue=dialogue)
        async with app.run_test(size=(100, 24)) as pilot:
            await pilot.press("x")
            await pilot.pause()
            return app.screen.lines.plain.splitlines()

    assert [line.strip() for line in asyncio.run(session())] == [line.strip() for line in shown]


def shown_by_page(view: View) -> dict[str, str]:
    """Return what the page shows of XCP_RESPONSE beside its bytes."""
    found = message_of(view.state(True), "XCP_RESPONSE", None, 0, view.dialogue.measured)
    assert found is not None
    assert len(found["sparks"]) == len(found["signals"])
    return {row[0]: row[1] for row in found["signals"][8:]}


def test_on_the_dashboard_live(recorded, watch):
    view = View(watch, None)
    view.look()
    shown = shown_by_page(view)
    assert shown["steps"] == str(recorded[2])
    assert shown["modes.mode"] == "STANDBY"


def test_on_the_dashboard_at_any_time_of_a_recording(recorded, tmp_path: Path):
    master, first, second = recorded
    path = tmp_path / "bus.log"
    path.write_text(
        "".join(f"({t / 1e9:.6f}) can0 {i:03X}#{p.hex().upper()}\n" for t, i, p in master.frames)
    )
    with contextlib.closing(LogSource(path, clock=lambda: 0.0)) as source:
        for epoch in (second, first - 20, second - 9, first - 9):
            source.carry_out(Order(id=1, order="seek", time_s=(epoch + 1) * PERIOD_NS / 1e9))
            shown = shown_by_page(source.view)
            assert ("epoch" in shown) == (epoch < first)
            wanted = {"epoch": epoch, "steps": min(epoch, second - 1) + 1}
            assert all(shown[name] == str(wanted[name]) for name in wanted if name in shown)
