"""The numbers that the guide on other people's tools gives are those of a rehearsal."""

from __future__ import annotations

from pathlib import Path

from rrins.host_tools.diag.connection import LibraryConnection
from rrins.host_tools.testing.diagnostics import BenchTransport

GUIDE = (Path(__file__).parents[2] / "docs/attach.md").read_text(encoding="utf-8")
ALL_CODES = b"\x19\x0a"


def test_what_a_listener_and_a_tester_see(rrins_bench):
    bench = rrins_bench("rimu_rotating", way="direct")
    bench.expect("FIRMWARE_STATUS", within=10, where={"mode": "NAVIGATION_ROTATING"})
    bench.advance(5)
    heard = {int(one) for one in bench._ring._frames["can_id"][bench._ring._places(0)]}
    assert f"`listener` lists {len(heard)} identifiers." in " ".join(GUIDE.split())
    asked_s = bench.time_s
    with LibraryConnection(BenchTransport(bench, bench._ring), "bench").open() as connection:
        connection.send(ALL_CODES)
        answer = connection.wait_frame(timeout=5)
        while answer[:1] == b"\x7f":
            answer = connection.wait_frame(timeout=5)
    frames = bench.messages("DIAG_RESPONSE")
    took_ms = 1000 * (frames[-1]["time_s"] - asked_s)
    words = f"whose {len(answer)} bytes take {round(took_ms, -1):.0f} ms, returns"
    assert f"{words} {(len(answer) - 3) // 4} codes" in " ".join(GUIDE.split())
