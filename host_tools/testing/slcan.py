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
from collections.abc import Callable
from types import FrameType
from typing import NoReturn, Self

from rrins.host_tools.bridges.adapter import Adapter
from rrins.host_tools.closing import Closing


class PortAdapter(Adapter):
    """An adapter behind a pseudo-terminal.

    Parameters
    ----------
    deliver : callable
        Gets the frames that the host sends.

    Attributes
    ----------
    port : str
        Name of the port to open.
    frames : int
        Frames received from the host.
    """

    def __init__(self, deliver: Callable[[bytes], None]) -> None:
        super().__init__(self._take)
        self._deliver = deliver
        self.master, self._slave = os.openpty()  # the slave stays open: no hang-up between users
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self._slave)
        self.frames = 0
        self._has_frames = threading.Condition()

    def _take(self, command: bytes) -> bool:
        self._deliver(command)
        with self._has_frames:
            self.frames += 1
            self._has_frames.notify_all()
        return True

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
        self.adapters = (PortAdapter(self._to_second), PortAdapter(self._to_first))
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

    def _to_second(self, frame: bytes) -> None:
        self.adapters[1].hear(frame)

    def _to_first(self, frame: bytes) -> None:
        self.adapters[0].hear(frame)

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

    def _move(self, adapter: PortAdapter, events: int) -> None:
        if events & selectors.EVENT_READ:
            adapter.feed(os.read(adapter.master, 4096))
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
