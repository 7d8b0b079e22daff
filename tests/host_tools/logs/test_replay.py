"""A recorded rehearsal through the firmware: bit-identical, or told where it is not."""

from __future__ import annotations

import json
import threading

import can
import numpy as np
import pytest

from rrins.dbc.codec import load
from rrins.dbc.frame import frame_array
from rrins.firmware_py.core.records.redundancy_records import Found
from rrins.firmware_py.loop import Firmware
from rrins.firmware_py.loop import run_lockstep as run_firmware
from rrins.host_tools.bus.address import Address
from rrins.host_tools.bus.message_port import MessagePort
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.loop import run_lockstep as run_hardware
from rrins.host_tools.logs.alignment import compare_logs
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.replay import firmware_messages, replay
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.recording.formats import READ, open_writer
from rrins.host_tools.runs.direct import run_direct, run_without_frames
from rrins.host_tools.runs.results.results import read_errors
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import load as load_scenario

FIRMWARE = [load().frame_id(name) for name in sorted(firmware_messages())]


@pytest.mark.parametrize("ending", READ)
def test_every_format_replays_bit_identically(recordings, tmp_path, ending):
    recorded = recordings(ending)
    log = Log(recorded.path)
    assert log.note is not None
    replayed = replay(log, log.note.loaded_scenario(log.path), tmp_path, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] == recorded.sha256
    assert log.note.navigation_sha256 == recorded.sha256
    assert replayed.comparison.is_same
    assert replayed.comparison.frames == recorded.firmware.frames_sent
    assert replayed.steps == recorded.scenario.epochs + 1
    # Even the truth is back: the errors are those of the run itself.
    assert replayed.why_no_truth is None
    errors = read_errors(tmp_path, recorded.scenario.rate_hz)
    assert len(errors) > 10
    assert np.max(np.abs(errors.position_east_m)) < 0.1


@pytest.mark.soak
@pytest.mark.timeout(600)
@pytest.mark.parametrize("ending", READ)
def test_ten_minutes_replay_bit_identically(run, tmp_path, ending):
    record = tmp_path / f"bus{ending}"
    rehearsed = run("rehearse", "rimu_rotating", "--duration", 600, "--record", record)
    again = run("replay", record, "--firmware", "--compare")
    assert again["navigation_sha256"] == rehearsed["navigation_sha256"]
    assert again["comparison"]["is_same"]
    assert again["max_abs_position_error_m"] == rehearsed["max_abs_position_error_m"]


FAULTS = {
    "drop": {"kind": "drop", "probability": 0.05},
    "silence": {"kind": "silence", "node": "hardware", "for_s": 0.05},
    "silence for long": {"kind": "silence", "node": "hardware", "for_s": 0.3},
    "no SYNC": {"kind": "drop", "message": "SYNC", "for_s": 1},
    "delay": {"kind": "delay", "probability": 0.1},
    "duplicate": {"kind": "duplicate", "probability": 0.3},
    "reorder": {"kind": "reorder"},
    "corrupt": {"kind": "corrupt", "probability": 0.05},
    "wrong counter": {"kind": "wrong_counter", "probability": 0.05},
    "firmware silent": {"kind": "silence", "node": "firmware", "for_s": 1},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_was_late_lost_or_damaged_is_so_again(rehearse, short, tmp_path, fault):
    scenario = short(duration_s=1.2, faults=[FAULTS[fault] | {"at_s": 1.6}])
    recorded = rehearse(scenario, tmp_path / "bus.log")
    assert_same(recorded, tmp_path)


def test_a_wire_at_its_limit_is_so_again(rehearse, short, tmp_path):
    babble = {"kind": "babble", "at_s": 1, "for_s": 1}  # epochs late by seconds, in bursts
    scenario = short(duration_s=1.5, bus={"bitrate": 500_000}, faults=[babble])
    assert_same(rehearse(scenario, tmp_path / "bus.log"), None)


@pytest.mark.parametrize(
    "fault",
    [{"kind": "gyro_bias", "bias_dph": 1000}, {"kind": "accelerometer_bias", "bias_ug": 20_000}],
    ids=lambda fault: fault["kind"],
)
def test_a_fault_that_gnss_tells_is_found_and_undone_alike_in_every_way(rehearse, tmp_path, fault):
    """Over the bus, with frames and no bus, without frames, and again from the log."""
    scenario = load_scenario(
        "drive_rotating",
        rate_hz=50,
        duration_s=24,
        gnss={"rate_hz": 5},
        gyros={"angle_random_walk_deg_per_sqrt_h": 0.005},
        accelerometers={"white_noise_ug_per_sqrt_hz": 10},
        faults=[fault | {"sensor": 2, "at_s": 20}],
    )
    recorded = rehearse(scenario, tmp_path / "bus.log")
    found = recorded.firmware.ram[0]["redundancy"][fault["kind"].split("_")[0] + "s"]
    assert (found["excluded"], found["how"]) == (0b0010, Found.REFERENCE)
    assert found["repaired_epoch"] > 0
    assert_same(recorded, None)
    for run in (run_direct, run_without_frames):
        assert run(scenario).firmware["navigation_sha256"] == recorded.sha256


def assert_same(recorded, folder):
    log = Log(recorded.path)
    replayed = replay(log, recorded.scenario, folder, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] == recorded.sha256
    assert replayed.comparison.is_same
    assert replayed.comparison.frames == recorded.firmware.frames_sent
    assert replayed.firmware["faults"] == {
        name: int(recorded.firmware.ram[0]["faults"][name]) for name in replayed.firmware["faults"]
    }
    assert replayed.why_no_truth is None or folder is None


def test_frame_by_frame_on_any_bus_recorded_by_another_tool(short, tmp_path):
    scenario = short(duration_s=1)
    address = Address("virtual", "candump")
    firmware = Firmware(firmware_settings(scenario))
    hardware = Hardware(hardware_settings(scenario))
    listener = can.Bus(interface="virtual", channel="candump")
    own, other = MessagePort(address, "firmware"), MessagePort(address, "hardware")

    def navigate():
        own.meet()
        run_firmware(firmware, own)

    thread = threading.Thread(target=navigate)
    thread.start()
    other.meet()
    run_hardware(hardware, other, scenario.epochs + 1)
    thread.join()
    writer = can.CanutilsLogWriter(tmp_path / "theirs.log")
    while message := listener.recv(0):
        writer.on_message_received(message)
    writer.stop()
    for one in (own, other, listener):
        (one.close if isinstance(one, MessagePort) else one.shutdown)()
    log = Log(tmp_path / "theirs.log")
    assert log.note is None
    replayed = replay(log, scenario, tmp_path, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] == firmware.trace.sha256()
    assert replayed.comparison.is_same
    assert replayed.comparison.frames == firmware.frames_sent
    assert replayed.why_no_truth is None


def test_only_the_hardware_s_frames_are_enough(recordings, read, write_candump, tmp_path):
    recorded = recordings()
    piece = read(recorded.path)
    kept = ~np.isin(piece.frames["can_id"], FIRMWARE)
    path = tmp_path / "hardware.log"
    write_candump(path, piece.frames[kept], piece.time_s[kept])
    replayed = replay(Log(path), recorded.scenario)
    assert replayed.firmware["navigation_sha256"] == recorded.sha256
    assert not replayed.has_firmware
    with pytest.raises(RecordError, match="nothing to compare with"):
        replay(Log(path), recorded.scenario, with_comparison=True)


def test_frames_of_strangers_and_a_clock_that_jumps_change_nothing(
    recordings, read, write_candump, tmp_path
):
    recorded = recordings()
    piece = read(recorded.path)
    random = np.random.default_rng(5)
    at = np.sort(random.integers(0, len(piece.frames), 500))
    strangers = frame_array(500)
    strangers["can_id"] = random.choice([0x001, 0x300, 0x7DE, 0x7E9, 0x7FE], 500)
    strangers["length"] = random.integers(0, 9, 500)
    frames = np.insert(piece.frames, at, strangers)
    time_s = np.insert(piece.time_s, at, piece.time_s[at])
    time_s[len(time_s) // 2 :] -= 1.0
    path = tmp_path / "strangers.log"
    write_candump(path, frames, time_s)
    replayed = replay(Log(path), recorded.scenario, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] == recorded.sha256
    assert replayed.comparison.is_same


def test_answers_that_are_missing_in_the_log_are_named_and_the_rest_goes_on(
    recordings, read, write_candump, tmp_path
):
    recorded = recordings()
    piece = read(recorded.path)
    outer = np.flatnonzero(piece.frames["can_id"] == load().frame_id("AXIS_OUTER_COMMAND"))
    inner = np.flatnonzero(piece.frames["can_id"] == load().frame_id("AXIS_INNER_COMMAND"))
    lost = [outer[300], outer[401], inner[401]]
    kept = np.delete(np.arange(len(piece.frames)), lost)
    path = tmp_path / "lossy.log"
    write_candump(path, piece.frames[kept], piece.time_s[kept])
    replayed = replay(Log(path), recorded.scenario, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] == recorded.sha256
    rows = {row["signal"]: row for row in replayed.comparison.summary()["signals"]}
    assert replayed.comparison.first.epoch == 300
    assert rows["AXIS_OUTER_COMMAND (whole frames)"]["frames"] == 2
    assert rows["AXIS_INNER_COMMAND (whole frames)"]["first_epoch"] == 401


@pytest.mark.parametrize(
    ("message", "bit", "signal"),
    [
        ("NAV_LATITUDE", 20, "latitude_deg"),
        ("NAV_ATTITUDE", 63, "heading_deg"),
        ("FIRMWARE_STATUS", 12, "mode"),
        ("AXIS_INNER_COMMAND", 8, "alive_counter"),
        ("HEARTBEAT_FIRMWARE", 60, "(bits outside all signals)"),
    ],
)
def test_one_flipped_bit_is_named_by_its_epoch_and_signal(
    recordings, read, write_candump, tmp_path, message, bit, signal
):
    recorded = recordings()
    piece = read(recorded.path)
    of_message = np.flatnonzero(piece.frames["can_id"] == load().frame_id(message))
    hit = of_message[len(of_message) // 2]
    epoch = round(piece.time_s[hit] * recorded.scenario.rate_hz)
    frames = piece.frames.copy()
    frames["data"][hit] ^= np.uint64(1) << np.uint64(bit)
    path = tmp_path / "flipped.log"
    write_candump(path, frames, piece.time_s)
    with_replay = replay(Log(path), recorded.scenario, with_comparison=True).comparison
    with_log = compare_logs(Log(recorded.path), Log(path))
    across = replay(Log(recorded.path), recorded.scenario, None, True, Log(path)).comparison
    for found in (with_replay, with_log, across):
        assert (found.first.epoch, found.first.message, found.first.signal) == (
            epoch, message, signal,
        )  # fmt: skip
        assert [row["frames"] for row in found.summary()["signals"]] == [1]
        assert f"at epoch {epoch}: {message}.{signal}" in found.text()


def test_a_log_that_ends_earlier_is_told(recordings, read, write_candump, tmp_path):
    recorded = recordings()
    piece = read(recorded.path)
    half = int(np.flatnonzero(piece.time_s >= 1.0)[0])
    path = tmp_path / "half.log"
    write_candump(path, piece.frames[:half], piece.time_s[:half])
    for ours, theirs in ((recorded.path, path), (path, recorded.path)):
        found = compare_logs(Log(ours), Log(theirs))
        assert found.first.epoch == 200
        assert found.first.signal is None
        assert found.frames == half


def test_what_a_silent_firmware_leaves_unanswered_is_told(
    recordings, read, write_candump, tmp_path
):
    recorded = recordings()
    assert replay(Log(recorded.path), recorded.scenario).unanswered_s < 0.05
    piece = read(recorded.path)
    kept = ~np.isin(piece.frames["can_id"], FIRMWARE) | (piece.time_s < 1.0)
    path = tmp_path / "silent.log"
    write_candump(path, piece.frames[kept], piece.time_s[kept])
    replayed = replay(Log(path), recorded.scenario)
    assert replayed.unanswered_s == pytest.approx(piece.time_s[-1] - 1.0, abs=0.01)


def test_other_settings_show_what_would_have_been(recordings, tmp_path):
    recorded = recordings()
    free = recorded.scenario.firmware.model_copy(update={"gyro_weights": (1.0, 2.0, 3.0, 4.0)})
    other = recorded.scenario.model_copy(update={"firmware": free})
    replayed = replay(Log(recorded.path), other, tmp_path, with_comparison=True)
    assert replayed.firmware["navigation_sha256"] != recorded.sha256
    assert replayed.firmware["epochs_navigated"] == recorded.firmware.trace.epochs
    assert not replayed.comparison.is_same
    assert replayed.comparison.first.message.startswith("NAV_")
    assert replayed.why_no_truth is None  # it is the recorded one


def test_a_scenario_of_another_rate_is_refused(recordings, short):
    scenario = short(rate_hz=100)
    with pytest.raises(RecordError, match="the log runs at 200 Hz, the scenario at 100 Hz"):
        replay(Log(recordings().path), scenario)


def test_a_recording_from_a_hardware_that_differs_has_no_truth(recordings, short, tmp_path):
    path = tmp_path / "alone.log"
    path.write_bytes(recordings().path.read_bytes())
    replayed = replay(Log(path), short(seed=4), tmp_path)
    assert "from epoch 0 on" in replayed.why_no_truth
    assert replayed.firmware["navigation_sha256"] == recordings().sha256


@pytest.mark.parametrize("share", [0.03, 0.5, 0.97])
@pytest.mark.parametrize("ending", READ)
def test_a_log_that_is_cut_off_is_used_as_far_as_it_goes(copy, short, ending, share):
    path = copy(ending)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    log = Log(path)
    if ending in (".mf4", ".db"):  # whole, or nothing
        with pytest.raises(RecordError, match=str(path)) as error:
            replay(log, short(), with_comparison=True)
        assert "\n" not in str(error.value)
        return
    replayed = replay(log, short(), with_comparison=True)
    assert replayed.comparison.is_same
    assert replayed.steps > 0


@pytest.mark.parametrize("ending", [*READ, ".log.gz"])
def test_a_file_that_is_no_log_is_one_line(tmp_path, short, ending):
    path = tmp_path / f"noise{ending}"
    random = np.random.default_rng(7)
    for content in (b"", b"\n\n", b"hello\n", random.bytes(5000), b"\0" * 4000):
        path.write_bytes(content)
        with pytest.raises(RecordError, match=r"noise") as error:
            replay(Log(path), short())
        assert "\n" not in str(error.value)


def test_damaged_lines_of_a_candump_are_left_out_and_counted(copy, recordings, short):
    path = copy()
    lines = path.read_bytes().splitlines(keepends=True)
    lines[5000] = b"(1.0) rrins0 04\xff#00\n"
    lines[6000] = lines[6000][:10] + b"\n"
    path.write_bytes(b"".join(lines))
    log = Log(path)
    replayed = replay(log, short(), with_comparison=True)
    assert log.damage == f"{path}: 2 lines are not frames; skipped"
    assert log.frames == recordings().recorder.frames - 2
    assert not replayed.comparison.is_same


def test_a_note_that_is_damaged_is_one_line(copy):
    path = copy()
    path.with_name(path.name + ".json").write_text('{"interface": ')
    with pytest.raises(RecordError, match="not a recording's note, or damaged"):
        Log(path)


def test_the_note_says_how_it_was_run(recordings):
    path = recordings().path
    note = json.loads(path.with_name(path.name + ".json").read_text())
    assert note["time"] == "simulated"
    assert note["speed"] == "max"
    assert note["frames"] == recordings().recorder.frames
    assert note["scenario"]["seed"] == 3
    assert note["parts"] == [{"file": path.name, "first_s": 0.0}]


def test_a_run_that_is_longer_than_the_looking_ahead_is_cut_alike(recordings, read, monkeypatch):
    from rrins.host_tools.logs import epochs

    pieces = [read(recordings().path)]
    whole = list(epochs.EpochFinder().steps(pieces))
    small = []
    for first in range(0, len(pieces[0].frames), 97):
        part = slice(first, first + 97)
        small.append(type(pieces[0])(pieces[0].frames[part], pieces[0].time_s[part]))
    parts = list(epochs.EpochFinder().steps(small))
    for name in ("frames", "step", "is_sent", "epochs"):
        assert np.array_equal(
            np.concatenate([getattr(s, name) for s in whole]),
            np.concatenate([getattr(s, name) for s in parts]),
        )


def test_beyond_the_24_bits_of_sync_epochs_go_on(short, tmp_path):
    from rrins.host_tools.logs.tables import EpochCounter

    scenario = short(duration_s=0.2)
    hardware = Hardware(hardware_settings(scenario))
    hardware.plant[0]["epoch"] = 2**24 - 20
    writer = open_writer(tmp_path / "day.log")
    nothing = frame_array(1)
    counter = EpochCounter()
    seen = []
    for _ in range(40):
        sent = hardware.step(nothing, 0)
        seen += counter.epochs(hardware.outbox[:sent]).tolist()
    writer.stop()
    assert sorted(set(seen)) == list(range(2**24 - 20, 2**24 + 20))
