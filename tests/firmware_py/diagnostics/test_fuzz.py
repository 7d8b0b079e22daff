"""No request of a tool causes an exception, a missed step or a write to locked memory.

``RRINS_FUZZ`` scales the requests, 20000 by default; ``RRINS_FUZZ=1000000`` takes some minutes. Run
with ``pytest -s`` it prints its figures.
"""

from __future__ import annotations

import os
import random
from collections import Counter

import pytest

from rrins.firmware_py.core.modes.modes import Mode
from rrins.firmware_py.diagnostics import calibration_image as image
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import key_of
from rrins.firmware_py.diagnostics.responses import NEGATIVE, Code
from rrins.firmware_py.diagnostics.services.data import MOST_IDENTIFIERS

CASES = int(os.environ.get("RRINS_FUZZ", "20000"))
SERVICES = [service.number for service in table.SERVICES]
NUMBERS = [thing.number for thing in (*table.IDENTIFIERS, *table.ROUTINES)]

pytestmark = pytest.mark.timeout(120 + CASES // 500)


class Requests:
    """Random and mutated requests, most of them nearly right."""

    def __init__(self, seed, node):
        self.rng = random.Random(seed)
        self.node = node
        self.seed = b""  # the last that was given
        self.file = image.encode(node.parameters.effective())

    def number(self):
        return self.rng.choice(NUMBERS).to_bytes(2, "big")

    def whole(self):
        """Return a request as a tool would send it."""
        rng = self.rng
        service = rng.choice(SERVICES)
        blob = rng.randbytes(rng.choice((0, 1, 2, 4, 8, 9, 24, 40)))
        address = b"\x44\x10\0\0\0" + len(self.file).to_bytes(4, "big")
        did = rng.choice(table.IDENTIFIERS)
        values = bytes(did.layout.size)
        routine = rng.choice(table.ROUTINES)
        start = rng.randrange(1 << 16).to_bytes(2, "big")
        trouble = rng.choice(table.TROUBLES).number.to_bytes(3, "big")
        data = {
            0x10: bytes([rng.choice((1, 2, 3, 3, 3, 4))]),
            0x11: bytes([rng.choice((1, 3))]),
            0x14: rng.choice((trouble, b"\xff\xff\xff")),
            0x19: bytes([rng.choice((1, 2, 3, 4, 6, 10, 20))])
            + rng.choice((b"\xff", b"", trouble + b"\xff")),
            0x22: b"".join(self.number() for _ in range(rng.randrange(1, MOST_IDENTIFIERS + 2))),
            0x23: b"\x12" + start + bytes([rng.randrange(256)]),
            0x27: rng.choice((b"\x01", b"\x02" + rng.randbytes(8))),
            0x28: bytes([rng.randrange(2), rng.randrange(1, 4)]),
            0x2E: did.number.to_bytes(2, "big") + values,
            0x2F: did.number.to_bytes(2, "big") + bytes([rng.randrange(4)]) + values,
            0x31: bytes([rng.randrange(1, 4)])
            + routine.number.to_bytes(2, "big")
            + bytes(routine.argument_layout.size),
            0x34: b"\0" + address,
            0x35: b"\0" + address,
            0x36: bytes([rng.randrange(4)]) + rng.choice((b"", self.file, self.file[:100], blob)),
            0x37: rng.choice((b"", blob)),
            0x3E: b"\0",
            0x85: bytes([rng.randrange(1, 3)]),
        }[service]
        return bytes([service]) + data

    def mutated(self, request):
        rng, out = self.rng, bytearray(request)
        for _ in range(rng.choice((1, 1, 2, 4))):
            at = rng.randrange(len(out) + 1)
            way = rng.randrange(5)
            if way == 0 and at < len(out):
                out[at] ^= 1 << rng.randrange(8)
            elif way == 1 and at < len(out):
                out[at] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
            elif way == 2:
                del out[at:]
            elif way == 3:
                out[at:at] = rng.randbytes(rng.choice((1, 2, 8)))
            elif at < len(out):
                out[0] = rng.choice(SERVICES)
        return bytes(out)

    def next(self):
        way = self.rng.randrange(10)
        if way == 0:
            return self.rng.randbytes(self.rng.randrange(40))
        if way == 1:
            return self.rng.randbytes(self.rng.choice((1, 100, 1000, 4095)))
        whole = self.whole()
        return whole if way < 6 else self.mutated(whole)


def assert_well_formed(request, response):
    if response is None:
        return
    assert 2 <= len(response) <= 4095 or response[0] in (0x54, 0x77)
    if response[0] == NEGATIVE:
        assert response[1] == request[0] or response[2] == Code.RESPONSE_PENDING
        Code(response[2])
    elif response[0] != request[0] + 0x40:
        raise AssertionError(f"{request.hex()} answered {response[:8].hex()}")


@pytest.mark.slow
@pytest.mark.parametrize("is_unlocked", [False, True], ids=["locked", "unlocked"])
def test_any_request(tool_at, is_unlocked):
    tool = tool_at(Mode.NAVIGATION_STRAPDOWN, bridge_s=10.0)
    node, server = tool.node, tool.server
    requests = Requests(1 + is_unlocked, node)
    before = node.parameters.effective()
    answers = Counter()
    for case in range(CASES // 2):
        if is_unlocked and case % 50 == 0:
            server.handle(b"\x10\x03", False, node.now_ns)
            if case % 100 == 0:
                server.handle(b"\x10\x02", False, node.now_ns)
            seed = server.handle(b"\x27\x01", False, node.now_ns)
            if seed is not None and seed[0] == 0x67:
                server.handle(b"\x27\x02" + key_of(seed[2:]), False, node.now_ns)
        request = requests.next()
        response = server.handle(request, requests.rng.random() < 0.1, node.now_ns)
        assert_well_formed(request, response)
        refused = response is not None and response[0] == NEGATIVE
        answers[response[:3].hex() if refused else "yes" if response else "silent"] += 1
        server.poll(node.now_ns)
        if server.reset_wanted is not None:
            node.restart()
        if case % 20 == 0:
            tool.bench.step()
        if not is_unlocked:
            assert not server.is_unlocked
            assert node.parameters.stored == {}
    print(f"\n{CASES // 2} requests: {answers['yes']} positive, {len(answers)} kinds of answers")
    assert answers["yes"] > CASES // 50
    if not is_unlocked:
        assert node.parameters.effective() == before
        monitor = tool.state["diagnostics"]
        assert (monitor["excluded_gyros"], monitor["routine_request"]) == (0, 0)
    tool.run(6.0)  # and it is itself again
    assert tool.ask("3e00") == "7e00"
    assert tool.ask("1001") == "5001003201f4"


@pytest.mark.slow
def test_any_frames_on_the_bus_disturb_no_step(tools, tool_at):
    """Frames of all kinds, in any order: every epoch is stepped, and navigation is the same."""
    tool, quiet = (tool_at(Mode.NAVIGATION_STRAPDOWN) for _ in range(2))
    rng = random.Random(5)
    requests = Requests(6, tool.node)
    begin = tool.bench.epoch
    flow_control = [bytes([0x30, n, st]) for n in (0, 1, 8) for st in (0, 1, 20, 0x80, 0xF3, 0xFF)]
    for _ in range(CASES // 4):
        frames = []
        for _ in range(rng.choice((0, 1, 1, 2, 8))):
            way = rng.randrange(6)
            if way == 0:
                frames.append(rng.randbytes(rng.randrange(9)))
            elif way == 1:
                frames.append(rng.choice(flow_control))
            elif way == 2:
                length = rng.randrange(512)
                frames.append(bytes([0x10 | length >> 8, length & 0xFF]) + rng.randbytes(6))
            elif way == 3:
                frames.append(bytes([0x20 | rng.randrange(16)]) + rng.randbytes(7))
            else:
                request = requests.whole()[:7] if way == 4 else b"\x22\x02\x02"
                frames.append(bytes([len(request)]) + request)
        if any(frame[:3] == b"\x02\x11\x01" for frame in frames):
            continue
        tool.step(frames, rng.choice((0x7E0, 0x7E0, 0x7DF)))
        quiet.bench.step()
        if tool.node.reset_due:
            tool.node.reset_due = False
            tool.server.reset_wanted = None
    assert tool.bench.epoch - begin == quiet.bench.epoch - begin
    assert tool.bench.firmware.trace.sha256() == quiet.bench.firmware.trace.sha256()
    tool.run(12.0)  # what waited is answered, and nobody lets it go on
    assert tool.node._transport.is_idle
