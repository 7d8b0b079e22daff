"""Two emulated slcan adapters on one CAN bus, each behind a pseudo-terminal.

They behave like serial CAN adapters with the LAWICEL protocol, for tests and experiments without
hardware. ``python -m rrins.host_tools.testing.slcan`` prints two ports and relays between them.

A frame sent to one adapter is delivered to the other, without an echo. An adapter loses the frames
that arrive while its channel is closed.
"""

from __future__ import annotations

import contextlib
import os
import selectors
import signal
import threading
import tty
from types import FrameType
from typing import NoReturn, Self

from rrins.host_tools.closing import Closing

_CR, _BELL = b"\r", b"\a"
_BITRATES = b"012345678"
_LONGEST_COMMAND = 32
_HEX = frozenset(b"0123456789ABCDEFabcdef")
_HEAD = {"t": (3, True), "T": (8, True), "r": (3, False), "R": (8, False)}
"""Frames by their letter: digits of the identifier, whether data follow."""


def is_frame(command: bytes) -> bool:
    """Return whether a command is a well-formed classic frame."""
    digits, has_data = _HEAD.get(command[:1].decode("latin-1"), (0, False))
    length = command[1 + digits : 2 + digits]
    if not digits or not length.isdigit() or int(length) > 8:
        return False
    whole = 2 + digits + (2 * int(length) if has_data else 0)
    return len(command) == whole and _HEX.issuperset(command[1:])


class Adapter:
    """One adapter: its pseudo-terminal and its state.

    Attributes
    ----------
    port : str
        Name of the port to open.
    bitrate : bytes
        Digit of the last ``S`` command; empty if there was none.
    frames : int
        Frames received from the host.
    refused : int
        Commands answered with BEL.
    """

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()  # the slave stays open: no hang-up between users
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self._slave)
        self.bitrate = b""
        self.is_open = False
        self.frames = 0
        self.refused = 0
        self.out = bytearray()
        self._command = bytearray()
        self._has_frames = threading.Condition()

    def feed(self, data: bytes) -> list[bytes]:
        """Process bytes from the host and answer them; return the frames for the bus."""
        frames = []
        for byte in data:
            if byte != _CR[0]:
                if len(self._command) < _LONGEST_COMMAND:
                    self._command.append(byte)
                continue
            command = bytes(self._command)
            self._command.clear()
            if command[:1].decode("latin-1") in _HEAD:
                if self.is_open and is_frame(command):
                    frames.append(command + _CR)
                    with self._has_frames:
                        self.frames += 1
                        self._has_frames.notify_all()
                    self.out += (b"z" if command[:1] in b"tr" else b"Z") + _CR
                else:
                    self._refuse()
            else:
                self._obey(command)
        return frames

    def _refuse(self) -> None:
        self.refused += 1
        self.out += _BELL

    def _obey(self, command: bytes) -> None:
        letter, rest = command[:1], command[1:]
        if letter == b"S" and rest in tuple(bytes([b]) for b in _BITRATES) and not self.is_open:
            self.bitrate = rest
            self.out += _CR
        elif letter in (b"O", b"L") and not rest and self.bitrate and not self.is_open:
            self.is_open = True
            self.out += _CR
        elif command == b"C" and self.is_open:
            self.is_open = False
            self.out += _CR
        elif command == b"V":
            self.out += b"V1013" + _CR
        elif command == b"N":
            self.out += b"NEMUL" + _CR
        elif command == b"F" and self.is_open:
            self.out += b"F00" + _CR
        elif command:
            self._refuse()
        else:
            self.out += _CR

    def hear(self, frame: bytes) -> None:
        """Pass a frame of the bus on to the host."""
        if self.is_open:
            self.out += frame

    def wait_for_frames(self, count: int, timeout_s: float) -> None:
        """Wait until the adapter has received `count` frames from the host.

        Raises
        ------
        TimeoutError
            If it has not received them in time.
        """
        with self._has_frames:
            if not self._has_frames.wait_for(lambda: self.frames >= count, timeout_s):
                raise TimeoutError(f"{self.port}: {self.frames} frames of {count}")

    def close(self) -> None:
        """Remove the adapter: its port hangs up."""
        os.close(self._slave)
        os.close(self.master)


class SlcanPair(Closing):
    """Two adapters on one bus, served by a thread.

    ::

        with SlcanPair() as pair:
            one, other = pair.ports
    """

    def __init__(self) -> None:
        self.adapters = (Adapter(), Adapter())
        self._stop_read, self._stop_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="slcan adapters", daemon=True)

    @property
    def ports(self) -> tuple[str, str]:
        """The names of the two serial ports."""
        return self.adapters[0].port, self.adapters[1].port

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def close(self) -> None:
        """Remove both adapters. Idempotent."""
        if self._stop_write < 0:
            return
        os.close(self._stop_write)
        self._stop_write = -1
        self._thread.join()
        os.close(self._stop_read)
        for adapter in self.adapters:
            adapter.close()

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._stop_read, selectors.EVENT_READ)
            for adapter in self.adapters:
                selector.register(adapter.master, selectors.EVENT_READ, adapter)
            while True:
                for key, events in selector.select():
                    if key.data is None:
                        return
                    self._move(key.data, events)
                for adapter in self.adapters:
                    wanted = selectors.EVENT_READ
                    if adapter.out:
                        wanted |= selectors.EVENT_WRITE
                    selector.modify(adapter.master, wanted, adapter)

    def _move(self, adapter: Adapter, events: int) -> None:
        other = self.adapters[1 - self.adapters.index(adapter)]
        if events & selectors.EVENT_READ:
            for frame in adapter.feed(os.read(adapter.master, 4096)):
                other.hear(frame)
        for each in self.adapters:
            if each.out:
                with contextlib.suppress(BlockingIOError):
                    del each.out[: os.write(each.master, each.out)]


def main() -> None:
    """Serve until Ctrl-C or SIGTERM."""

    def stop(number: int, frame: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    with SlcanPair() as pair:
        print(*pair.ports, flush=True)
        try:
            signal.pause()
        except KeyboardInterrupt:
            return


if __name__ == "__main__":
    main()
