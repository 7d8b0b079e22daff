"""The commands as processes beside a rehearsal under way."""

from __future__ import annotations

import json
import os
import signal

import can

from rrins.dbc.codec import load


def test_a_rehearsal_recorded_to_mf4_is_navigated_again(run, tmp_path):
    record = tmp_path / "bus.mf4"
    rehearsed = run("rehearse", "rimu_rotating", "--duration", 3, "--record", record)
    again = run("replay", record, "--firmware", "--compare")
    assert again["navigation_sha256"] == rehearsed["navigation_sha256"]
    assert again["recording"]["navigation_sha256"] == rehearsed["navigation_sha256"]
    assert again["comparison"]["is_same"]
    for key in ("max_abs_position_error_m", "max_abs_velocity_error_mps", "end_position_error_m"):
        assert again[key] == rehearsed[key]


def test_a_recorder_beside_a_rehearsal_ends_by_ctrl_c(start, tmp_path):
    channel = f"test-{os.getpid()}"
    rehearsal = start("rehearse", "ideal", "--channel", channel, "--speed", "3", "--out", "out")
    rehearsal.wait_for_line("running")
    record = tmp_path / "bus.mf4"
    recorder = start("record", record, "--channel", channel, "--json")
    recorder.wait_for_line("Ctrl-C stops")
    while not (tmp_path / "bus.mf4.json").exists():  # the first frame has come
        os.sched_yield()
    recorder.process.send_signal(signal.SIGINT)
    status, out = recorder.finish()
    assert status == 0, "\n".join(recorder.said)
    found = json.loads(out)
    assert found["frames"] > 0
    assert found["time"] == "simulated"
    export = start("export", record, "tables", "--json")
    status, out = export.finish()
    assert status == 0, "\n".join(recorder.said)
    assert json.loads(out)["frames"] == found["frames"]
    rehearsal.process.send_signal(signal.SIGINT)
    assert rehearsal.finish()[0] == 130
    assert not any("Traceback" in line for line in recorder.said)


def test_a_rehearsal_at_full_speed_waits_for_the_recorder(start, tmp_path):
    channel = f"test-{os.getpid()}"
    rehearsal = start("rehearse", "rimu_rotating", "--channel", channel, "--out", "out")
    rehearsal.wait_for_line("running")
    record = tmp_path / "bus.log"
    recorder = start("record", record, "--channel", channel, "--for", "30")
    assert recorder.finish()[0] == 0, "\n".join(recorder.said)
    rehearsal.process.send_signal(signal.SIGINT)
    assert rehearsal.finish()[0] == 130
    sync = load().frame_id("SYNC")
    with can.CanutilsLogReader(record) as frames:
        epochs = [
            load().database.decode_message(sync, frame.data)["epoch"]
            for frame in frames
            if frame.arbitration_id == sync
        ]
    assert len(epochs) >= 30 * 200 - 1  # it may have begun after the SYNC of an epoch
    assert epochs == list(range(epochs[0], epochs[0] + len(epochs)))
