"""Speed of reading logs and of python-can: ``python -m rrins.host_tools.benchmarks.log_reading``.

Writes a log of each format, reads it with `rrins.host_tools.logs.reader.Log` and with python-can's
own reader in turn, and prints thousands of frames a second: the best of three.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import can

from rrins.dbc.codec import load
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.recording.formats import open_writer

_ENDINGS = (".log", ".asc", ".trc", ".csv", ".blf")
_ROUNDS = 3
_EPOCH_S = 0.005
_GAP_S = 1e-4


def _write(path: Path, count: int) -> None:
    """Write frames of all messages of the contract, epoch by epoch."""
    messages = load().database.messages
    writer = open_writer(path)
    for k in range(count):
        epoch, place = divmod(k, len(messages))
        message = messages[place]
        writer.on_message_received(
            can.Message(
                timestamp=1.7e9 + epoch * _EPOCH_S + place * _GAP_S,
                arbitration_id=message.frame_id,
                is_extended_id=False,
                data=(k * 0x9E37_79B9_7F4A_7C15 % 2**64).to_bytes(8, "little")[: message.length],
                channel=0,
            )
        )
    writer.stop()


def _by_us(path: Path) -> int:
    return sum(len(piece) for piece in Log(path).pieces())


def _by_python_can(path: Path) -> int:
    with can.LogReader(path) as reader:
        return sum(1 for _ in reader)


def _rate(read: Callable[[Path], int], path: Path, count: int) -> float:
    """Return frames a second."""
    begin_s = time.perf_counter()
    found = read(path)
    took_s = time.perf_counter() - begin_s
    if found != count:
        raise RuntimeError(f"{path}: {found} frames read of {count}")
    return count / took_s


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=200_000)
    count = parser.parse_args().frames
    print(f"{'':5} {'rrins':>8} {'python-can':>11}   thousand frames a second")
    with tempfile.TemporaryDirectory() as folder:
        for ending in _ENDINGS:
            path = Path(folder) / f"bus{ending}"
            _write(path, count)
            _by_us(path)  # compiles, or loads what is compiled
            rates = [(_rate(_by_us, path, count), _rate(_by_python_can, path, count))
                     for _ in range(_ROUNDS)]  # fmt: skip
            ours, theirs = (max(column) / 1000 for column in zip(*rates, strict=True))
            print(f"{ending:5} {ours:8.0f} {theirs:11.0f}", flush=True)


if __name__ == "__main__":
    main()
