"""Filters the lines of a Vector ASCII log for python-can's reader.

That reader silently skips unknown lines, gives up at a line with damaged numbers, and treats
relative times as absolute. It therefore receives only lines with valid frames, with relative times
already summed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from typing import IO

from can.util import dlc2len

from rrins.host_tools.recording.text_lines import TextLines

_FLAGS = re.IGNORECASE | re.ASCII
_BASE = re.compile(r"base\s+(hex|dec)\b(\s+timestamps\s+(absolute|relative))?", _FLAGS)
_BEGIN = re.compile(r"begin\s+trigger\s?block", _FLAGS)
_END = re.compile(r"end\s+trigger\s?block", _FLAGS)
_TIME = re.compile(r"(\d+\.\d+)(\s.+)", _FLAGS)
_FRAME = re.compile(
    r"\s+\d+\s+(?P<identifier>[\dA-F]+)x?\s+(Rx|Tx|TxRq)\s+"
    r"(r(\s.*)?|d\s+(?P<length>[\dA-F])(?P<data>(\s.*)?))$",
    _FLAGS,
)
_USUAL = re.compile(  # as python-can writes it
    r"\s*\d+\.\d+\s+\d+\s+([\dA-F]{1,7}|1[\dA-F]{7})x?\s+[RT]x\s+"
    r"d\s+(?P<length>[0-8])(?P<data>(\s[\dA-F]{2})*)\s*\n",
    _FLAGS,
)
_ERROR_FRAME = re.compile(r"\s+\d+\s+ErrorFrame\b", _FLAGS)
_FD_FRAME = re.compile(r"\s+CANFD\s+\d+\s+(Rx|Tx|TxRq)\s", _FLAGS)
_J1939 = re.compile(r"\s+\d+\s+J1939", _FLAGS)
_EVENT = re.compile(r"(\s+CAN)?(\s+\d+)?\s+(?![\dA-F]+\b)[A-Z_]{2}", _FLAGS)  # begins with a word
_HEADER = re.compile(r"[A-Z_]{2}", _FLAGS)
_DIRECTION = re.compile(r"\s(Rx|Tx|TxRq)\s", re.ASCII)
_BYTES = 8
_LARGEST_IDENTIFIER = 0x1FFF_FFFF


class AscLines(TextLines):
    """The lines of a Vector ASCII log: a header, then valid frames in absolute time."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._base = 16
        self._is_relative = False
        self._time_s = Decimal(0)
        self._is_headed = False
        super().__init__(stream)

    def begin_again(self) -> None:
        """Supply a header next, as a new reader expects one."""
        super().begin_again()
        self._is_headed = False

    def _sound(self) -> Iterator[str]:
        for line in self._all():
            if self._is_usual(line):
                self.frames += 1
                yield line
                continue
            text = line.strip()
            if not text or text.startswith("//"):
                continue
            timed = _TIME.match(text)
            if timed is None:
                self._read_header(text)
                continue
            time, rest = timed.groups()
            if self._is_relative:
                self._time_s += Decimal(time)
                time = str(self._time_s)
            if self._is_for_reader(rest, is_whole=line.endswith("\n")):
                if not self._is_headed:
                    yield f"base {'hex' if self._base == 16 else 'dec'}  timestamps absolute\n"
                    yield "internal events logged\n"
                    self._is_headed = True
                self.frames += 1
                yield f"{time}{rest}\n"

    def _is_usual(self, line: str) -> bool:
        """Return whether a line can be passed on as it is."""
        if not self._is_headed or self._base != 16 or self._is_relative:
            return False
        usual = _USUAL.fullmatch(line)
        return usual is not None and len(usual["data"]) == 3 * int(usual["length"])

    def _read_header(self, text: str) -> None:
        """Parse a line without a time."""
        if base := _BASE.match(text):
            self._base = 10 if base[1].lower() == "dec" else 16
            self._is_relative = (base[3] or "").lower() == "relative"
        elif _BEGIN.match(text):
            self.is_open = True
        elif _END.match(text):
            self.is_open = False
        elif not _HEADER.match(text) or _DIRECTION.search(text):
            self.bad_lines += 1

    def _is_for_reader(self, rest: str, is_whole: bool) -> bool:
        """Return whether the text after a time is a valid frame; count anything else."""
        if frame := _FRAME.match(rest):
            if self._is_sound(frame, is_whole):
                return True
            self.bad_lines += 1
        elif _ERROR_FRAME.match(rest):
            return True
        elif _FD_FRAME.match(rest):
            self.fd_frames += 1
        elif not _J1939.match(rest) and (not _EVENT.match(rest) or _DIRECTION.search(rest)):
            self.bad_lines += 1
        return False

    def _is_sound(self, frame: re.Match[str], is_whole: bool) -> bool:
        """Return whether a frame has all its bytes; `is_whole`: its line is terminated."""
        try:
            if int(frame["identifier"], self._base) > _LARGEST_IDENTIFIER:
                return False
            if frame["length"] is None:  # a remote frame
                return is_whole
            length = min(dlc2len(int(frame["length"], 16)), _BYTES)
            numbers = frame["data"].split()
            bytes(int(number, self._base) for number in numbers[:length])
        except ValueError:
            return False
        if len(numbers) < length or _DIRECTION.search(frame["data"]):  # two lines run together
            return False
        return is_whole or len(numbers) > length or not self._may_be_cut(numbers)

    def _may_be_cut(self, numbers: list[str]) -> bool:
        """Return whether the last number of an unterminated line may lack a digit."""
        return not numbers or self._base != 16 or len(numbers[-1]) < 2
