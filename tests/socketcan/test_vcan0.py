"""A rehearsal of two processes on the kernel's vcan0, with can-utils as independent peers.

Runs where vcan0 and can-utils are; with RRINS_REQUIRE_SOCKETCAN set, their lack is a failure.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess

import can
import pytest

from rrins.__main__ import main
from rrins.dbc.codec import load
from rrins.host_tools.runs.direct import run_direct
from rrins.host_tools.scenario.scenario import load as load_scenario
from tests.processes import draw_no_pictures
from tests.socketcan.conftest import forked

DURATION_S = 2


@pytest.fixture(autouse=True)
def _can_utils():
    if shutil.which("candump") is not None and shutil.which("cansend") is not None:
        return
    if "RRINS_REQUIRE_SOCKETCAN" in os.environ:
        pytest.fail("can-utils is not installed")
    pytest.skip("can-utils is not installed")


def rehearse() -> None:
    draw_no_pictures()
    main()


@pytest.mark.timeout(800)
def test_a_rehearsal_is_the_same_and_its_peers_see_every_frame(tmp_path):
    reference = run_direct(load_scenario("rimu_rotating", duration_s=DURATION_S)).firmware
    dump = tmp_path / "candump.log"
    with dump.open("wb") as file:
        candump = subprocess.Popen(
            ["stdbuf", "-oL", "candump", "-L", "vcan0"], stdout=file, stderr=subprocess.PIPE
        )
    try:
        words = ["rrins", "rehearse", "rimu_rotating", "--json"]
        words += ["--interface", "socketcan", "--channel", "vcan0", "--speed", "max"]
        words += ["--duration", str(DURATION_S), "--out", str(tmp_path / "out")]
        rehearsal = forked(rehearse, words, tmp_path / "said.txt")
        with can.Bus("vcan0", interface="socketcan") as bus:
            bus.set_filters([{"can_id": load().frame_id("SYNC"), "can_mask": 0x7FF}])
            assert bus.recv(300) is not None
        # A frame of sensor group 1 whose CRC is wrong.
        subprocess.run(["cansend", "vcan0", "040#1122334455667788"], check=True)
        rehearsal.join(300)
        said = (tmp_path / "said.txt").read_text()
        assert rehearsal.exitcode == 0, said
    finally:
        candump.terminate()
        candump.wait()
    summary = json.loads(said[said.index("{") :])
    assert summary["completed"]
    assert summary["frames_lost"] == 0
    assert summary["firmware"]["faults"]["crc_errors"] == 1
    assert summary["navigation_sha256"] == reference["navigation_sha256"]

    with can.LogReader(dump) as log:
        seen = [message for message in log if not message.is_error_frame]
    sides = (summary["firmware"]["frames_sent"], summary["hardware"]["frames_sent"])
    contract = load().database
    by_sides = [m for m in seen if m.data.hex() != "1122334455667788"]
    hellos = [m for m in by_sides if m.arbitration_id == load().frame_id("HEARTBEAT_FIRMWARE")]
    assert sum(sides) <= len(by_sides) <= sum(sides) + len(hellos)
    last = [m for m in seen if m.arbitration_id == load().frame_id("NAV_LATITUDE")][-1]
    decoded = contract.decode_message(last.arbitration_id, bytes(last.data))
    assert decoded["latitude_deg"] == pytest.approx(40.3554, abs=1e-6)


@pytest.mark.timeout(800)
def test_a_bus_that_is_not_there_is_told_in_one_line(tmp_path):
    words = ["rrins", "firmware", "ideal", "--interface", "socketcan", "--channel", "vcan9"]
    firmware = forked(main, words, tmp_path / "said.txt")
    firmware.join(300)
    assert firmware.exitcode == 4
    said = (tmp_path / "said.txt").read_text()
    assert said.splitlines()[-1].startswith("rrins: bus socketcan:vcan9:")
