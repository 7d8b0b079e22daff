"""Assembles lines from a terminal's keystrokes, with echo and correction."""

from __future__ import annotations

LONGEST_LINE = 80
"""Longest line, characters; further input rings the bell."""

_BELL, _BACKSPACE, _NEWLINE = b"\a", b"\b \b", b"\r\n"
_CTRL_C, _CTRL_U, _ESCAPE = 0x03, 0x15, 0x1B
_ERASE = (0x08, 0x7F)
_CR, _LF = 0x0D, 0x0A


class LineEditor:
    """Reads bytes one by one; CR, LF and CR LF each end one line.

    Attributes
    ----------
    echo : bytearray
        What the terminal should show; the user of the editor removes it.
    """

    def __init__(self) -> None:
        self.echo = bytearray()
        self._line = bytearray()
        self._after_cr = False
        self._in_escape = 0  # 1 after ESC, 2 within a sequence such as an arrow key's

    def feed(self, byte: int) -> str | None:
        """Process a byte; return the line that it ends, or None."""
        was_cr, self._after_cr = self._after_cr, byte == _CR
        if self._in_escape:
            self._skip_escape(byte)
        elif byte == _CR or (byte == _LF and not was_cr):
            return self._end()
        elif byte == _ESCAPE:
            self._in_escape = 1
        elif byte in _ERASE:
            if self._line:
                del self._line[-1]
                self.echo += _BACKSPACE
        elif byte == _CTRL_U:
            self.echo += _BACKSPACE * len(self._line)
            self._line.clear()
        elif byte == _CTRL_C:
            self._line.clear()
            self.echo += b"^C"
            return self._end()
        elif 0x20 <= byte < 0x7F:
            self._put(byte)
        return None

    def _put(self, byte: int) -> None:
        if len(self._line) < LONGEST_LINE:
            self._line.append(byte)
            self.echo.append(byte)
        else:
            self.echo += _BELL

    def _end(self) -> str:
        self.echo += _NEWLINE
        line = self._line.decode("ascii")
        self._line.clear()
        return line

    def _skip_escape(self, byte: int) -> None:
        if self._in_escape == 1:
            self._in_escape = 2 if byte in b"[O" else 0
        elif 0x40 <= byte < 0x7F:
            self._in_escape = 0
