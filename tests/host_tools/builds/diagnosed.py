"""A build's navigation computer beside Python's: both get the same frames and requests."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rrins.dbc.frame import Frame, frame_array
from rrins.firmware_py.core.frames_in.clock import own_clock_ns
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.store import Stores
from rrins.firmware_py.loop import Firmware, open_memories
from rrins.host_tools.builds import navigator
from rrins.host_tools.builds.build import Build
from rrins.host_tools.builds.variants import shortened
from rrins.host_tools.hardware.loop import Hardware
from rrins.host_tools.hardware.step import hardware_step
from rrins.host_tools.runs.set_up.settings import firmware_settings, hardware_settings
from rrins.host_tools.scenario.scenario import Scenario

REQUEST, FUNCTIONAL, RESPONSE = table.request_id(), table.functional_id(), table.response_id()
_HEAD = struct.Struct("<qq")
SANITISED = ("gcc", "-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def program(built: Build, folder: Path, compiler: Sequence[str] = ()) -> Path:
    """Return the program of `answers.c` for this processor, of a build with its diagnostics."""
    sources = navigator.write_sources(folder / "c", built.images)
    kept = [
        name for name in sources if name not in ("main.c", "port.c", "rrins_bus.c", "entropy.c")
    ]
    path = folder / "answers"
    words = compiler or (sys.executable, "-m", "ziglang", "cc", "-O2")
    subprocess.run(
        [
            *words, "-std=c11", *navigator.STRICT, "-I", built.folder, "-I", folder / "c",
            Path(__file__).with_name("answers.c"), *(folder / "c" / name for name in kept),
            built.folder / "rrins_firmware.o", built.folder / "rrins_images.o", "-lm", "-pthread",
            "-o", path,
        ],
        check=True,
    )  # fmt: skip
    return path


class _Random:
    """The seeds of `answers.c`."""

    def __init__(self) -> None:
        self._drawn = 0

    def __call__(self, size: int) -> bytes:
        self._drawn = (self._drawn + 0x9E3779B97F4A7C15) % (1 << 64)
        return self._drawn.to_bytes(8, "little")[:size]


class Beside:
    """Both computers and the hardware, in lockstep; `step` fails at the first difference."""

    def __init__(
        self, scenario: Scenario, program: Path, memories: tuple[Path, Path] | None = None
    ) -> None:
        stores = Stores() if memories is None else open_memories(memories[0])
        self.firmware = Firmware(firmware_settings(scenario), stores=stores)
        lock = self.firmware.diagnostics.server.parts[0]
        lock._keys._random_bytes = _Random()  # type: ignore[attr-defined]
        self._hardware = Hardware(hardware_settings(scenario))
        self._sent = self.epoch = 0
        words = [str(program)] + ([] if memories is None else [str(memories[1])])
        self._theirs = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._inbox = frame_array(1024)

    def step(self, frames: Sequence[tuple[int, bytes]] = ()) -> list[bytes]:
        """Run an epoch with frames of a tool; return those of the response."""
        firmware, hardware = self.firmware, self._hardware
        up = hardware.outbox
        came = hardware_step(
            hardware.plant, hardware.pieces, firmware.contract, firmware.outbox, self._sent, up
        )
        count = len(frames)
        for k, (can_id, data) in enumerate(frames):
            self._inbox["can_id"][k], self._inbox["length"][k] = can_id, len(data)
            self._inbox["data"][k] = int.from_bytes(data.ljust(8, b"\0"), "little")
        self._inbox[count : count + came] = up[:came]
        count += came
        arrival_ns = own_clock_ns(self.epoch * firmware.period_ns, 0.0)
        self._sent = firmware.step_whole(self._inbox, count, arrival_ns)
        ours = firmware.outbox[: self._sent]
        theirs = self._exchange(self._inbox[:count], arrival_ns)
        assert theirs.tobytes() == ours.tobytes(), (
            f"epoch {self.epoch}: {[_shown(f) for f in theirs if f not in ours]}, "
            f"not {[_shown(f) for f in ours if f not in theirs]}"
        )
        self.epoch += 1
        return [_payload(frame) for frame in ours if frame["can_id"] == RESPONSE]

    def _exchange(self, inbox: Any, arrival_ns: int) -> Any:
        assert self._theirs.stdin is not None
        assert self._theirs.stdout is not None
        self._theirs.stdin.write(_HEAD.pack(len(inbox), arrival_ns) + inbox.tobytes())
        self._theirs.stdin.flush()
        (sent,) = struct.unpack("<q", self._theirs.stdout.read(8))
        return np.frombuffer(self._theirs.stdout.read(sent * Frame.dtype.itemsize), Frame.dtype)

    def close(self, dtype: np.dtype[np.void]) -> tuple[bytes, bytes]:
        """Switch both off; return their memories."""
        assert self._theirs.stdin is not None
        assert self._theirs.stdout is not None
        self.firmware.close()
        self._theirs.stdin.write(_HEAD.pack(-1, 0))
        self._theirs.stdin.close()
        with self._theirs.stdout as rest:
            memory = rest.read()[: dtype.itemsize]  # the digest of the navigation is behind it
        assert self._theirs.wait() == 0
        return shortened(self.firmware.ram, dtype).tobytes(), memory


def _payload(frame: Any) -> bytes:
    return int(frame["data"]).to_bytes(8, "little")[: int(frame["length"])]


def _shown(frame: Any) -> str:
    return f"{int(frame['can_id']):03x}: {_payload(frame).hex(' ')}"


class Tool:
    """Somebody who asks both the same."""

    def __init__(self, beside: Beside) -> None:
        self.beside = beside
        self._new: list[bytes] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / self.beside.firmware.period_ns)):
            self._step()

    def _step(self, frames: Sequence[bytes] = (), can_id: int = REQUEST) -> list[bytes]:
        found = self.beside.step([(can_id, data) for data in frames])
        self._new += found
        return found

    def _next(self, epochs: int = 30) -> bytes | None:
        for _ in range(epochs):
            if self._new:
                return self._new.pop(0)
            self._step()
        return self._new.pop(0) if self._new else None

    def ask(
        self, request: bytes, flow: bytes = b"\x30\0\0", functional: bool = False
    ) -> bytes | None:
        """Return the final response to a request, as the tool gets it; None without one."""
        self._new.clear()
        if functional or len(request) < 8:
            single = bytes([len(request)]) + request
            self._step([single[:8].ljust(8, b"\xaa")], FUNCTIONAL if functional else REQUEST)
        elif not self._send_long(request):
            return None
        response = self._receive(flow)
        while response is not None and len(response) == 3 and response[::2] == b"\x7f\x78":
            response = self._receive(flow)
        return response

    def _send_long(self, request: bytes) -> bool:
        size = len(request).to_bytes(2, "big")
        self._step([bytes([0x10 | size[0], size[1]]) + request[:6]])
        rest = [request[k : k + 7] for k in range(6, len(request), 7)]
        frames = [bytes([0x20 | (k + 1) & 15]) + part for k, part in enumerate(rest)]
        while frames:
            flow = self._next()
            if flow is None:
                return False
            block, frames = frames[: flow[1]], frames[flow[1] :]
            for k in range(0, len(block), 8):
                self._step(block[k : k + 8])
        return True

    def _receive(self, flow: bytes) -> bytes | None:
        frame = self._next()
        if frame is None or frame[0] >> 4 == 3:
            return None
        if frame[0] >> 4 == 0:
            return frame[1 : 1 + frame[0]]
        length, found = (frame[0] & 15) << 8 | frame[1], frame[2:]
        blocks = flow[1]
        self._step([flow])
        received = 0
        while len(found) < length:
            frame = self._next(300)
            if frame is None:
                return None
            found += frame[1:]
            received += 1
            if blocks and received % blocks == 0 and len(found) < length:
                self._step([flow])
        return found[:length]
