"""gallia, a scanner by others, at a firmware whose time is virtual: all there can be is tried.

With RRINS_SCAN_ALL set, all 65,536 identifiers and routines, which takes some minutes; else those
of the ranges that are in use. On a real vcan0: `tests/socketcan`.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from udsoncan.exceptions import TimeoutException

from rrins.firmware_py.diagnostics import table
from rrins.host_tools.diag.connection import Connection
from rrins.host_tools.diag.tester import Tester as Tool

ALL = ((0x0000, 0xFFFF),)
IS_FULL = "RRINS_SCAN_ALL" in os.environ
IDENTIFIERS = ALL if IS_FULL else ((0x00F0, 0x040F), (0x0FF0, 0x130F), (0xF180, 0xF19F))
ROUTINES = ALL if IS_FULL else ((0x01F0, 0x020F),)

RESPONSE_PENDING = b"\x78"

pytestmark = pytest.mark.timeout(900)


def serve(listener: socket.socket, connection: Connection) -> None:
    """Pass requests on, a line each in hexadecimal, and the answers back."""
    while True:
        try:
            end, _ = listener.accept()
        except OSError:
            return  # the test is over
        with end, end.makefile("rb") as lines:
            for line in lines:
                connection.specific_send(bytes.fromhex(line.decode()))
                with contextlib.suppress(TimeoutException):
                    is_last = False
                    while not is_last:
                        answer = connection.specific_wait_frame(1.0)
                        is_last = answer[:1] != b"\x7f" or answer[2:] != RESPONSE_PENDING
                        end.sendall(answer.hex().encode() + b"\n")


@pytest.fixture
def tester(rrins_bench) -> Iterator[Tool]:
    """A tool at a computer that navigates, whose time goes on as it is asked."""
    bench = rrins_bench("rimu_rotating", way="direct", duration_s=36_000.0)
    bench.advance(6.0)
    with bench.tester() as tester:
        yield tester


@pytest.fixture
def scan(gallia: Callable[..., str], tester: Tool, tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Return what scans the computer and returns what gallia said."""
    path = tmp_path / "computer"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen()
        thread = threading.Thread(target=serve, args=(listener, tester.conversation.connection))
        thread.start()
        try:
            yield lambda *words: gallia(f"unix-lines://{path}", *words)
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join()


def numbers(pattern: str, said: str) -> set[int]:
    return {int(found, 16) for found in re.findall(pattern, said)}


@pytest.mark.parametrize(("first", "last"), IDENTIFIERS)
def test_of_all_identifiers_there_are_those_of_the_table_only(scan, tester, first, last):
    known = {did.number for did in tester.has(table.IDENTIFIERS)}
    there = {number for number in known if first <= number <= last}
    said = scan("identifiers", "--start", hex(first), "--end", hex(last))
    assert len(re.findall(r"requestOutOfRange", said)) == last - first + 1 - len(there)
    assert numbers(r"(0x[0-9a-fA-F]+): .*Response", said) == there
    assert "Abnormal replies: 0" in said
    assert "Timeouts: 0" in said


@pytest.mark.parametrize(("first", "last"), ROUTINES)
def test_of_all_routines_there_are_those_of_the_table_only(scan, first, last):
    """They are locked, which is said of those that there are only."""
    said = scan(
        *("identifiers", "--service", "0x31", "--sessions", "3"),
        *("--start", hex(first), "--end", hex(last)),
    )
    assert "Timeouts: 0" in said
    there = {routine.number for routine in table.ROUTINES}
    assert numbers(r"(0x[0-9a-fA-F]+): .*[sS]ecurityAccessDenied", said) == there


def test_the_ranges_that_are_tried_hold_the_whole_table():
    for tried, numbered in ((IDENTIFIERS, table.IDENTIFIERS), (ROUTINES, table.ROUTINES)):
        for one in numbered:
            assert any(first <= one.number <= last for first, last in tried)
