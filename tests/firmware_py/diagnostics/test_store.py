"""Parameter memory that survives power loss at any moment."""

from __future__ import annotations

import os
import random

import pytest

from rrins.firmware_py.diagnostics.store import (
    PAGE,
    Condition,
    FileMedium,
    StoreError,
    TwoCopyStore,
    open_stores,
)
from rrins.firmware_py.diagnostics.writer import DirectWriter, ThreadWriter

CAPACITY = 2000
MOMENTS = 1000


class PowerLossError(Exception):
    """The power fails."""


class Bytes:
    """A medium in memory whose power fails after so many bytes; what was written by then stays."""

    def __init__(self, content=b"", fails_after=10**9, torn=None):
        self.content = bytearray(content)
        self.left = fails_after
        self.torn = torn  # what becomes of the bytes of a page that was being written

    def read(self, start, length):
        return bytes(self.content[start : start + length])

    def write(self, start, data):
        kept = data[: self.left]
        self.left -= len(data)
        end = start + len(kept)
        self.content[start:end] = kept
        if self.left < 0:
            if self.torn is not None:  # the rest of its page is anybody's guess
                page_end = min(-(-(end + 1) // PAGE) * PAGE, len(self.content))
                self.content[end:page_end] = self.torn.randbytes(page_end - end)
            raise PowerLossError

    def create(self, data):
        self.left -= len(data)
        if self.left < 0:  # the new file has not got its name yet
            raise PowerLossError
        self.content[:] = data

    def close(self): ...


def image_of(number, length=CAPACITY):
    return (f"{number:08d}" * (length // 8 + 1)).encode()[:length]


@pytest.mark.parametrize("torn", [False, True])
def test_whenever_the_power_fails_one_copy_is_whole(torn):
    rng = random.Random(8)
    for _ in range(MOMENTS):
        medium = Bytes(fails_after=rng.randrange(12 * CAPACITY), torn=rng if torn else None)
        done = begun = 0
        try:
            for number in range(1, 50):
                begun = number
                TwoCopyStore(medium, CAPACITY).write(image_of(number, rng.randrange(9, CAPACITY)))
                done = number
        except PowerLossError:
            pass
        after = TwoCopyStore(Bytes(medium.content), CAPACITY)
        found = after.read()
        if done == 0:
            assert found.condition in (Condition.BLANK, Condition.WHOLE)
            continue
        number = int(found.image[:8])
        assert number in (done, begun)
        assert found.image == image_of(number, len(found.image))
        after.write(image_of(77))  # and it goes on
        assert after.read().image == image_of(77)


def test_at_every_byte_of_one_write():
    medium = Bytes()
    store = TwoCopyStore(medium, 64)
    store.write(b"first")
    store.write(b"second")
    before = bytes(medium.content)
    length = 28 + len(b"third")
    conditions = set()
    for moment in range(length + 1):
        cut = Bytes(before, fails_after=moment)
        try:
            TwoCopyStore(cut, 64).write(b"third")
        except PowerLossError:
            found = TwoCopyStore(Bytes(cut.content), 64).read()
            assert found.image in (b"second", b"third")
            conditions.add(found.condition)
        else:
            assert moment == length
    assert Condition.ONE_DAMAGED in conditions


def test_the_newer_copy_counts_and_the_older_is_replaced():
    medium = Bytes()
    store = TwoCopyStore(medium, CAPACITY)
    assert store.read().condition is Condition.BLANK
    for number in range(1, 6):
        store.write(image_of(number))
        assert store.read().image == image_of(number)
        assert store.read().condition is Condition.WHOLE
    slots = {bytes(medium.content[k : k + 40]) for k in (0, store.slot_size)}
    assert len(slots) == 2
    assert store.read().sequence == 6  # the first write made two copies


def test_more_than_there_is_room_for_is_refused():
    store = TwoCopyStore(Bytes(), 10)
    with pytest.raises(StoreError, match="11 bytes, limit 10"):
        store.write(b"x" * 11)
    assert store.read().condition is Condition.BLANK


# Files


def test_a_file_is_made_whole_and_read_again(tmp_path):
    path = tmp_path / "parameters.bin"
    for number in (1, 2):
        store = TwoCopyStore(FileMedium(path), CAPACITY)
        if number == 2:
            assert store.read().image == image_of(1)
        store.write(image_of(number))
        store.close()
    assert [entry.name for entry in tmp_path.iterdir()] == ["parameters.bin"]


def test_a_file_of_something_else_is_left_as_it_is(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text("duration_s = 4\n")
    with pytest.raises(StoreError, match=r"scenario\.toml: not a memory of this kind"):
        TwoCopyStore(FileMedium(path), CAPACITY).read()
    assert path.read_text() == "duration_s = 4\n"


def test_a_device_is_no_memory(tmp_path):
    path = tmp_path / "parameters.bin"
    path.symlink_to("/dev/null")
    with pytest.raises(StoreError, match=r"parameters\.bin: is not a file"):
        FileMedium(path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(StoreError, match="pipe: is not a file"):
        FileMedium(tmp_path / "pipe")


def test_two_firmwares_cannot_have_the_same_new_file(tmp_path):
    path = tmp_path / "parameters.bin"
    store = TwoCopyStore(FileMedium(path), CAPACITY)
    with pytest.raises(StoreError, match="in use by another firmware process"):
        FileMedium(path)
    store.write(image_of(1))
    with pytest.raises(StoreError, match="in use by another firmware process"):
        FileMedium(path)
    store.write(image_of(2))
    store.close()
    assert TwoCopyStore(FileMedium(path), CAPACITY).read().image == image_of(2)


def test_a_first_write_that_fails_leaves_the_file_as_it_was(tmp_path):
    path = tmp_path / "parameters.bin"
    store = TwoCopyStore(FileMedium(path), CAPACITY)
    (tmp_path / f".parameters.bin.{os.getpid()}").mkdir()  # where it would be made
    with pytest.raises(StoreError, match="cannot be created"):
        store.write(image_of(1))
    assert store.read().condition is Condition.BLANK
    (tmp_path / f".parameters.bin.{os.getpid()}").rmdir()
    store.write(image_of(1))
    assert store.read().image == image_of(1)


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(StoreError, match="no such folder"):
        open_stores(tmp_path / "none" / "parameters.bin", 10, 10)


@pytest.mark.parametrize("writer", [DirectWriter, ThreadWriter])
def test_writers_store_in_order_and_tell_when_they_are_done(writer):
    store = TwoCopyStore(Bytes(), CAPACITY)
    writer = writer()
    jobs = [writer.submit(store, image_of(number)) for number in range(20)]
    failing = writer.submit(store, b"x" * (CAPACITY + 1))
    writer.close()
    assert all(job.done and not job.failed for job in jobs)
    assert failing.done
    assert failing.failed
    assert store.read().image == image_of(19)
