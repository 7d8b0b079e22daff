"""Two logs side by side: whatever is in only one of them, or differs, is found where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rrins.dbc.codec import load
from rrins.host_tools.logs.alignment import compare_logs
from rrins.host_tools.logs.comparison import Comparison
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.replay import firmware_messages
from rrins.host_tools.recording.errors import RecordError

FIRMWARE = [load().frame_id(name) for name in sorted(firmware_messages())]
SYNC, SENSOR_1, SENSOR_3 = (load().frame_id(name) for name in ("SYNC", "SENSOR_1", "SENSOR_3"))
GYRO_BIT = np.uint64(1 << 20)


class Two:
    """Two logs, cut in the same way from a recording; the second one is changed."""

    def __init__(self, piece: Any, folder: Any, write: Any) -> None:
        self.frames, self.time_s = piece.frames.copy(), piece.time_s.copy()
        self._changed: Any = None
        self._folder = folder
        self._write = write

    @property
    def ids(self) -> Any:
        return self.frames["can_id"]

    def keep(self, mask: Any) -> None:
        self.frames, self.time_s = self.frames[mask], self.time_s[mask]

    def nth(self, identifier: int, number: int) -> int:
        return int(np.flatnonzero(self.ids == identifier)[number])

    def compare(self, flipped: int | None = None, without: Any = None) -> Comparison:
        frames = self.frames.copy()
        if flipped is not None:
            frames["data"][flipped] ^= GYRO_BIT
        kept = np.ones(len(frames), dtype=bool)
        if without is not None:
            kept[without] = False
        ours, theirs = self._folder / "ours.log", self._folder / "theirs.log"
        self._write(ours, self.frames, self.time_s)
        self._write(theirs, frames[kept], self.time_s[kept])
        same = compare_logs(Log(ours), Log(ours))
        assert same.is_same
        assert same.frames == len(frames)
        return compare_logs(Log(ours), Log(theirs))


@pytest.fixture
def two(recordings, read, write_candump, tmp_path):
    return Two(read(recordings().path), tmp_path, write_candump)


def test_without_sync_frames_are_counted_by_their_messages(two):
    two.keep(two.ids != SYNC)
    for identifier, number in ((SENSOR_1, 0), (SENSOR_1, 300), (SENSOR_3, 517)):
        found = two.compare(flipped=two.nth(identifier, number))
        assert found.first.epoch < 0
        assert f"before the first SYNC, in frame {number + 1} of its message" in found.text()
        assert found.first.signal == "gyro_dtheta"
        assert found.summary()["first_epoch"] is None


def test_without_sync_frames_that_are_missing_are_found(two):
    two.keep(two.ids == SENSOR_1)
    found = two.compare(without=slice(-100, None))
    assert found.first.values == ("there", "missing")
    assert [row["frames"] for row in found.summary()["signals"]] == [100]
    assert not two.compare(without=[7]).is_same


@pytest.mark.parametrize("names", [("FIRMWARE_STATUS", "FIRMWARE_FAULTS"), ("HEARTBEAT_FIRMWARE",)])
def test_the_firmware_s_slow_messages_alone(two, names):
    two.keep(np.isin(two.ids, [load().frame_id(name) for name in names]))
    assert not two.compare(without=[len(two.frames) // 2]).is_same
    assert not two.compare(without=[-1]).is_same


def test_a_firmware_that_falls_silent_does_not_end_the_comparison(two):
    two.keep(~np.isin(two.ids, FIRMWARE) | (two.time_s < 1.0))
    hit = two.nth(SENSOR_1, 600)
    found = two.compare(flipped=hit)
    assert found.first.epoch == 600
    assert (found.first.message, found.first.signal) == ("SENSOR_1", "gyro_dtheta")
    found = two.compare(without=np.flatnonzero(two.time_s > 3.2))
    assert found.first.epoch == 640 or found.first.epoch == 641
    assert found.first.values == ("there", "missing")


def test_a_gap_of_the_firmware_leaves_the_epochs_of_the_hardware_as_they_are(two):
    is_gap = (two.time_s > 1.0) & (two.time_s < 2.6)
    two.keep(~np.isin(two.ids, FIRMWARE) | ~is_gap)
    for number in (210, 350, 519, 521, 700):
        assert two.compare(flipped=two.nth(SENSOR_1, number)).first.epoch == number


def test_what_comes_before_the_first_sync_is_compared(two):
    two.keep(slice(two.nth(SYNC, 3) + 1, None))
    found = two.compare(flipped=two.nth(SENSOR_1, 0))
    assert "before the first SYNC, in frame 1 of its message" in found.text()
    assert two.compare(flipped=two.nth(SENSOR_1, 5)).first.epoch == 8


def test_the_first_epoch_of_a_message_that_each_lacks_once(two, tmp_path, write_candump):
    ours, theirs = tmp_path / "a.log", tmp_path / "b.log"
    for path, number in ((ours, 505), (theirs, 510)):
        kept = np.delete(np.arange(len(two.frames)), two.nth(SENSOR_1, number))
        write_candump(path, two.frames[kept], two.time_s[kept])
    for pair in ((ours, theirs), (theirs, ours)):
        found = compare_logs(*map(Log, pair))
        assert found.first.epoch == 505
        (row,) = found.summary()["signals"]
        assert (row["first_epoch"], row["frames"]) == (505, 2)


def test_strangers_are_counted_and_alone_they_are_nothing_to_compare(two, tmp_path, write_candump):
    frames = two.frames[two.ids == SENSOR_1].copy()
    frames["can_id"][::2] = 0x555
    path = tmp_path / "half.log"
    write_candump(path, frames, np.arange(len(frames)) * 0.005)
    found = compare_logs(Log(path), Log(path))
    assert found.text() == (
        f"no difference in {len(frames) // 2} frames; {len(frames)} unknown to the DBC were not "
        "compared"
    )
    frames["can_id"] = 0x555
    write_candump(path, frames, np.arange(len(frames)) * 0.005)
    with pytest.raises(RecordError, match="nothing to compare: no DBC frames"):
        compare_logs(Log(path), Log(path))
