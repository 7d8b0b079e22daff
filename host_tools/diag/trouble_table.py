"""Trouble codes as a computer reports them: one, and a table of many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from rrins.firmware_py.core.records.troubles import Status, Trouble

if TYPE_CHECKING:
    import pandas as pd

REMEMBERED: Final = Status.TEST_FAILED | Status.PENDING | Status.CONFIRMED
"""Status bits of a trouble code that has something to tell."""

_COLUMNS = ["code", "name", "state", "text"]


@dataclass(frozen=True)
class TroubleReport:
    """A trouble code as reported by the computer."""

    trouble: Trouble | None  #: None if the number is not in the table
    number: int
    status: int  #: its status byte

    @property
    def code(self) -> str:
        """The code as in SAE J2012, or the number."""
        return self.trouble.code if self.trouble else f"0x{self.number:06X}"

    @property
    def name(self) -> str:
        """Its name in the diagnostic table."""
        return self.trouble.name if self.trouble else "not in this tool's table"

    @property
    def text(self) -> str:
        """Its meaning."""
        return self.trouble.text if self.trouble else ""

    @property
    def status_bits(self) -> list[str]:
        """Names of the status bits that are set."""
        return [bit.name.lower() for bit in Status if self.status & bit]

    @property
    def state(self) -> str:
        """Its state in words, such as ``failed now, confirmed``."""
        if self.status & Status.TEST_FAILED:
            now = "failed now"
        elif self.status & Status.TEST_NOT_COMPLETED_THIS_OPERATION_CYCLE:
            now = "not tested yet"
        else:
            now = "passed now"
        marks = (b.name.lower() for b in (Status.PENDING, Status.CONFIRMED) if self.status & b)
        return ", ".join((now, *marks))


class TroubleTable(list[TroubleReport]):
    """Trouble codes of a computer, shown as a table of those that fail or have failed."""

    @property
    def failing(self) -> TroubleTable:
        """Those that fail now, are pending or confirmed."""
        return TroubleTable(one for one in self if one.status & REMEMBERED)

    def to_pandas(self, *, passed: bool = False) -> pd.DataFrame:
        """Return `name`, `state` and `text` by `code`.

        Parameters
        ----------
        passed : bool
            Whether those that have never failed are included.
        """
        import pandas as pd

        rows = [
            [getattr(one, key) for key in _COLUMNS]
            for one in self
            if passed or one.status & REMEMBERED
        ]
        return pd.DataFrame(rows, columns=_COLUMNS).set_index("code")

    def __repr__(self) -> str:
        failing = self.failing
        rows = [[getattr(one, key) for key in _COLUMNS] for one in failing]
        widths = [max(len(row[k]) for row in rows) for k in range(3)] if rows else []
        lines = ["  ".join([*(row[k].ljust(widths[k]) for k in range(3)), row[3]]) for row in rows]
        return "\n".join([*lines, self._rest])

    @property
    def _rest(self) -> str:
        sound = len(self) - len(self.failing)
        return f"{sound} trouble codes have not failed" if sound else f"{len(self)} trouble codes"

    def _repr_html_(self) -> str:
        return f"{self.to_pandas().to_html()}<p>{self._rest}</p>"
