"""Logs of the bus by signal, and their replay through the firmware."""

from __future__ import annotations

import html
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrins.compiled.record import Floats
from rrins.dbc.frame import FrameArray
from rrins.host_tools.files import JsonObject
from rrins.host_tools.logs.reader import Log
from rrins.host_tools.logs.signals import (
    did_you_mean,
    find_signals,
    message_names,
    name_of_identifier,
    signals_of,
)
from rrins.host_tools.recording.errors import RecordError
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class BusLog:
    """A log of the bus: signals by name, over the time of the log.

    Parameters
    ----------
    path : Path
    channel : str, optional
        The only channel whose frames are read, as the log names it; all without it.

    Raises
    ------
    RecordError
        When there is no such log, or it cannot be read.

    Examples
    --------
    >>> log = open_log("bus.blf")  # doctest: +SKIP
    >>> log["NAV_HEIGHT.height_m"].plot()  # doctest: +SKIP
    >>> log["AXIS_INNER_STATUS"]  # doctest: +SKIP
    """

    def __init__(self, path: Path, channel: str | None = None) -> None:
        self.path = path
        self._channel = channel
        self._log = Log(path, channel)

    @cached_property
    def _frames(self) -> dict[str, tuple[FrameArray, Floats]]:
        """The frames of each message, and their times."""
        pieces = list(self._log.pieces())
        if not pieces:
            return {}
        frames = np.concatenate([piece.frames for piece in pieces])
        time_s = np.concatenate([piece.time_s for piece in pieces])
        found = {}
        for identifier in np.unique(frames["can_id"]).tolist():
            name = name_of_identifier(identifier)
            if name is not None:
                mine = frames["can_id"] == identifier
                found[name] = (frames[mine], time_s[mine])
        return found

    @property
    def messages(self) -> dict[str, int]:
        """How many frames of each message there are."""
        return {name: len(frames) for name, (frames, _) in sorted(self._frames.items())}

    @property
    def signals(self) -> list[str]:
        """The signals that there are, as ``MESSAGE.signal``, a unit at the end of the name."""
        return [f"{name}.{one.column}" for name in self.messages for one in signals_of(name)]

    @property
    def damage(self) -> str | None:
        """The part that could not be read; None while all is well."""
        return self._log.damage

    def __getitem__(self, name: str) -> xr.DataArray | Any:
        """Return a signal over time, or a message: the dataset of its signals.

        Parameters
        ----------
        name : str
            ``MESSAGE``, ``MESSAGE.signal``, or a signal's name where that is enough; with the
            unit at its end, as in `signals`, or as the DBC has it.

        Raises
        ------
        RecordError
            When there is no such signal, there are several, or the log has no frame of it.
        """
        from rrins.datasets import signals_over_time

        if name in message_names():
            frames, time_s = self._of(name)
            return signals_over_time(name, time_s, frames["data"], signals_of(name))
        found = find_signals((name,))
        if len(found) != 1:
            raise RecordError(f"{name}: {', '.join(one.full_name for one in found)}; which?")
        frames, time_s = self._of(found[0].message)
        dataset = signals_over_time(found[0].message, time_s, frames["data"], found)
        return dataset[found[0].column]

    def _of(self, message: str) -> tuple[FrameArray, Floats]:
        if message not in self._frames:
            raise RecordError(
                f"{self.path}: has no frame of {message}{did_you_mean(message, self._frames)}"
            )
        return self._frames[message]

    def to_pandas(self, message: str) -> pd.DataFrame:
        """Return all signals of a message over `time_s`, a column each, units in the names.

        Raises
        ------
        RecordError
            When there is no such message, or the log has no frame of it.
        """
        import pandas as pd

        frames, time_s = self._of(message)
        columns = {one.column: one.values(frames["data"]) for one in signals_of(message)}
        return pd.DataFrame(columns, index=pd.Index(time_s, name="time_s"))

    def export(
        self, to: str | Path, kind: Literal["parquet", "csv", "mcap", "pcapng"] = "parquet"
    ) -> dict[str, int]:
        """Write tables into a folder, one per message, or one file; return rows by name.

        Of pcapng, which has no names, the number of `frames`.

        Raises
        ------
        RecordError
            When the log cannot be read, or the files not be written.
        """
        log = Log(self.path, self._channel)
        if kind == "mcap":
            from rrins.host_tools.dashboard.mcap_file import export_mcap

            return dict(export_mcap(log, Path(to)).messages)
        if kind == "pcapng":
            from rrins.host_tools.logs.pcapng import export_pcapng

            export_pcapng(log, Path(to))
            return {"frames": log.frames}
        from rrins.host_tools.logs import tables

        return dict(tables.export(log, Path(to), kind).rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __repr__(self) -> str:
        return f"<rrins.BusLog {self.path}: {sum(self.messages.values())} frames>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{html.escape(name)}</td><td>{count}</td></tr>"
            for name, count in self.messages.items()
        )
        head = f"<b>{html.escape(str(self.path))}</b>"
        return f"{head}<table><tr><th>message</th><th>frames</th></tr>{rows}</table>"


def open_log(path: str | Path, channel: str | None = None) -> BusLog:
    """Return a log of the bus, of any format: see `BusLog`."""
    return BusLog(Path(path), channel)


def replay(path: str | Path, scenario: str | Path | None = None) -> JsonObject:
    """Navigate a recorded log again; return the firmware's summary, and what differs.

    Parameters
    ----------
    path : str or Path
    scenario : str or Path, optional
        Without it that of the note beside the log.

    Returns
    -------
    dict
        `firmware` (with `navigation_sha256`), `first_epoch`, `last_epoch`, and `comparison`: what
        the firmware sends now beside what it sent then.

    Raises
    ------
    RecordError
        When the log cannot be read, or nothing says by which scenario it was recorded.
    """
    from rrins.host_tools.logs.replay import replay as replay_log

    log = Log(Path(path))
    recorded = None if log.note is None else log.note.loaded_scenario(log.path)
    loaded = recorded if scenario is None else load_scenario(scenario)
    if loaded is None:
        raise RecordError(f"{path}: no note beside it says by which scenario it was recorded")
    replayed = replay_log(log, loaded, with_comparison=True)
    comparison = replayed.comparison
    return {
        "firmware": replayed.firmware,
        "first_epoch": replayed.first_epoch,
        "last_epoch": replayed.last_epoch,
        "comparison": None if comparison is None else comparison.summary(),
    }
