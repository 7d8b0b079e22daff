"""The folder of a campaign: what it is, and its rows in Parquet parts that are whole.

::

    _manifest.json         what decides about the rows, and the digest of each part and of itself;
                           readers of Parquet pass it over
    part-00000000.parquet  some rows; the number is that of the first of its runs, and with a second
                           one, that of the last: parts that were merged
    _report/               what `report` writes
    _reruns/17/            a run that was run again with everything kept

A part is written under another name and renamed, so that it is there whole or not at all. What is
left to do is what is planned less what is stored. Its digest is in the manifest before it is there;
when it is read, the digest and the checksums of its pages must hold. In the end parts are merged:
the manifest says for which ones the new one stands, until those are deleted.
"""

from __future__ import annotations

import fcntl
import hashlib
import io
import json
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rrins.host_tools.campaigns import design
from rrins.host_tools.campaigns.definition import Definition
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.manifest import MANIFEST, Campaign, Manifest, read_manifest
from rrins.host_tools.campaigns.row import OK, OUTPUTS, SERIES, Row, times_of
from rrins.host_tools.campaigns.sources import sources_digest, versions
from rrins.host_tools.errors import RehearsalError
from rrins.host_tools.files import make_folder

if TYPE_CHECKING:
    import pyarrow as pa

REPORTS: Final = "_report"
RERUNS: Final = "_reruns"
_LOCK: Final = ".lock"
_MOST_MERGED: Final = 50_000  # rows
_REPAIR: Final = "delete it to run its runs again"


def schema_of(definition: Definition) -> pa.Schema:
    """Return the columns of a campaign's table."""
    import pyarrow as pa

    fields = [pa.field("run", pa.int64()), pa.field("seed", pa.int64())]
    fields += [
        pa.field(one.column, pa.type_for_alias(one.distribution.stored_as))
        for one in definition.plan.inputs
    ]
    fields += [pa.field("status", pa.string()), pa.field("error", pa.string())]
    fields += [pa.field(name, pa.float64()) for name in OUTPUTS]
    fields += [pa.field(name, pa.list_(pa.float32())) for name in SERIES]
    return pa.schema([*fields, pa.field("wall_s", pa.float64())])


class Store:
    """The folder of a campaign.

    Parameters
    ----------
    folder : Path
    definition : Definition
    """

    def __init__(self, folder: Path, definition: Definition) -> None:
        self.folder = folder
        self.definition = definition
        self.schema = schema_of(definition)
        self._digests: dict[str, str] = {}
        self._merged: dict[str, list[str]] = {}
        self._end: dict[str, Any] = {}
        self._sound: set[tuple[str, int, int]] = set()

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Return the store of a folder that has one.

        Raises
        ------
        CampaignError
        """
        manifest = read_manifest(folder)
        try:
            store = cls(folder, Definition.of(manifest.campaign.model_dump()))
        except (RehearsalError, ValueError) as error:
            raise CampaignError(f"{folder / MANIFEST}: {error}") from error
        store._know_parts(manifest)
        return store

    @classmethod
    def create(cls, folder: Path, definition: Definition) -> Store:
        """Return the store of a campaign: a new one, or the one that it goes on with.

        More runs than before are welcome where the design leaves those before as they are.

        Raises
        ------
        CampaignError
            When the folder has another campaign, or cannot be written.
        """
        store = cls(folder, definition)
        make_folder(folder)
        if (folder / MANIFEST).exists():
            manifest = read_manifest(folder)
            store._check(manifest)
            store._know_parts(manifest)
        elif any(folder.glob("*.parquet")):
            raise CampaignError(f"{folder}: has Parquet files without {MANIFEST}; name another")
        store._write_manifest()
        return store

    def _know_parts(self, manifest: Manifest) -> None:
        self._digests, self._merged = dict(manifest.parts), dict(manifest.merged)

    def _check(self, manifest: Manifest) -> None:
        """Refuse to go on with a campaign that is another one."""
        mine = self._mine
        before, now = manifest.campaign.model_dump(), mine.campaign.model_dump()
        runs, wanted = before.pop("runs"), now.pop("runs")
        for key in before:
            if before[key] != now[key]:
                raise CampaignError(
                    f"{self.folder}: has a campaign with another {key}; name another folder"
                )
        if wanted < runs:
            raise CampaignError(f"{self.folder}: has a campaign of {runs} runs, not {wanted}")
        if wanted > runs and self.definition.design not in design.EXTENDABLE:
            raise CampaignError(
                f"{self.folder}: a design {self.definition.design} of {runs} runs cannot grow"
            )
        for key in ("sources", "versions", "schema_"):
            was, now = getattr(manifest, key), getattr(mine, key)
            if was != now:
                raise CampaignError(
                    f"{self.folder}: its rows come of other {key.rstrip('_')} "
                    f"({_difference(was, now)}); name another folder"
                )

    @cached_property
    def _mine(self) -> Manifest:
        return Manifest(
            campaign=Campaign.model_validate_json(json.dumps(self.definition.values())),
            sources=sources_digest(),
            versions=versions(),
            schema={field.name: str(field.type) for field in self.schema},
            times_s=[float(time_s) for time_s in times_of(self.definition.scenario)],
        )

    def _write_manifest(self) -> None:
        now = {"parts": self._digests, "merged": self._merged, **self._end}
        self._mine.model_copy(update=now).write(self.folder)

    def note_end(self, runs: int, words: str) -> None:
        """Note that a campaign is complete before its last run."""
        self._end = {"stopped_at": runs, "until": words}
        self._write_manifest()

    @property
    def stopped_at(self) -> int | None:
        """The number of runs with which it was narrow enough; None if it goes to its end."""
        return read_manifest(self.folder).stopped_at

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other processes from writing to the folder.

        Raises
        ------
        CampaignError
            When another process writes to it.
        """
        path = self.folder / _LOCK
        try:
            file = path.open("w")
        except OSError as error:
            raise CampaignError(f"{path}: cannot be written: {error.strerror}") from error
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise CampaignError(f"{self.folder}: another campaign writes there") from error
            for left in self.folder.glob(".part-*"):  # of a client that was killed
                left.unlink(missing_ok=True)
            self._delete_merged()
            yield

    def parts(self) -> list[Path]:
        """Return the parts, in order."""
        found = {path.name: path for path in self.folder.glob("part-*.parquet")}
        gone = [name for new in self._merged.keys() & found for name in self._merged[new]]
        return [found[name] for name in sorted(found.keys() - set(gone))]

    def stored(self) -> NDArray[np.int64]:
        """Return the numbers of the runs that are stored, sorted.

        Raises
        ------
        CampaignError
            When a part is unreadable, or a run is there twice.
        """
        columns = [self._read(path, ["run"])["run"].to_numpy() for path in self.parts()]
        runs = np.sort(np.concatenate([np.zeros(0, np.int64), *columns]))
        double = runs[:-1][runs[1:] == runs[:-1]]
        if len(double):
            raise CampaignError(f"{self.folder}: has run {double[0]} twice")
        return runs

    def values(self, column: str) -> dict[int, float]:
        """Return a column of the runs that came to their end, by run."""
        rows = self.table(["status", column]).to_pylist()
        return {
            row["run"]: math.nan if row["status"] != OK or row[column] is None else row[column]
            for row in rows
        }

    def table(self, columns: Sequence[str] | None = None) -> pa.Table:
        """Return the rows in order of their runs.

        Raises
        ------
        CampaignError
        """
        import pyarrow as pa

        names = None if columns is None else list(dict.fromkeys(["run", *columns]))
        tables = [self._read(path, names) for path in self.parts()]
        schema = self.schema if names is None else pa.schema([self.schema.field(n) for n in names])
        table = pa.concat_tables([schema.empty_table(), *tables])
        return table.sort_by("run")

    def _read(self, path: Path, columns: Sequence[str] | None) -> pa.Table:
        import pyarrow as pa
        from pyarrow import parquet

        try:
            self._check_digest(path)
            with parquet.ParquetFile(path, page_checksum_verification=True) as file:
                found = file.read(columns=columns)
            return found.select(self.schema.names if columns is None else columns)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            why = (str(error).splitlines() or ["damaged"])[0].strip("'\"").rstrip(". ")
            raise CampaignError(f"{path}: cannot be read: {why}; {_REPAIR}") from error

    def _check_digest(self, path: Path) -> None:
        """Raise `CampaignError` unless a part is as it was written; without a digest it passes."""
        state = path.stat()
        seen = (path.name, state.st_size, state.st_mtime_ns)
        wanted = self._digests.get(path.name)
        if wanted is None or seen in self._sound:
            return
        if hashlib.sha256(path.read_bytes()).hexdigest() != wanted:
            raise CampaignError(f"{path}: is damaged: not as it was written; {_REPAIR}")
        self._sound.add(seen)

    def write(self, rows: Sequence[Row]) -> None:
        """Write rows as a part; after that they are stored whatever comes.

        Raises
        ------
        CampaignError
            When they cannot be written.
        """
        import pyarrow as pa

        if not rows:
            return
        inorder = sorted(rows, key=lambda row: row["run"])
        arrays = [
            pa.array([_cell(row.get(field.name), field) for row in inorder], type=field.type)
            for field in self.schema
        ]
        table = pa.Table.from_arrays(arrays, schema=self.schema)
        self._put(self.folder / f"part-{inorder[0]['run']:08d}.parquet", table)

    def merge(self) -> None:
        """Merge the parts into few; whenever that ends, nothing is missing or double.

        Raises
        ------
        CampaignError
            When a part is unreadable, or the new one cannot be written.
        """
        import pyarrow as pa

        for group in self._groups():
            table = pa.concat_tables([self._read(path, None) for path in group]).sort_by("run")
            first, last = table["run"][0].as_py(), table["run"][-1].as_py()
            path = self.folder / f"part-{first:08d}-{last:08d}.parquet"
            self._merged = {path.name: [one.name for one in group]}
            self._put(path, table)
            self._delete_merged()

    def _groups(self) -> Iterator[list[Path]]:
        """Yield parts that are to be merged."""
        from pyarrow import parquet

        group: list[Path] = []
        rows = 0
        for path in self.parts():
            more = parquet.read_metadata(path).num_rows
            if group and rows + more > _MOST_MERGED:
                if len(group) > 1:
                    yield group
                group, rows = [], 0
            group.append(path)
            rows += more
        if len(group) > 1:
            yield group

    def _delete_merged(self) -> None:
        """Delete the parts for which another stands; that one itself, if it never came."""
        if not self._merged:
            return
        for new, olds in self._merged.items():
            for name in olds if (self.folder / new).exists() else [new]:
                (self.folder / name).unlink(missing_ok=True)
                self._digests.pop(name, None)
        self._merged = {}
        self._write_manifest()

    def _put(self, path: Path, table: pa.Table) -> None:
        """Write a part, whole or not at all."""
        from pyarrow import parquet

        part = path.with_name(f".{path.stem}.{os.getpid()}")
        content = io.BytesIO()
        parquet.write_table(table, content, write_page_checksum=True)
        self._digests[path.name] = hashlib.sha256(content.getbuffer()).hexdigest()
        self._write_manifest()
        try:
            with part.open("wb") as file:
                file.write(content.getbuffer())
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except OSError as error:
            raise CampaignError(
                f"{path}: cannot be written: {error.strerror or error}; what is stored stays, "
                "the same command goes on"
            ) from error
        finally:
            part.unlink(missing_ok=True)


def _cell(value: Any, field: pa.Field) -> Any:
    """Return a value as its column holds it."""
    import pyarrow as pa

    if value is not None and pa.types.is_string(field.type) and not isinstance(value, str):
        return str(value)
    return value


def _difference(before: Any, now: Any) -> str:
    if not isinstance(before, dict):
        return f"{before}, here {now}"
    keys = [key for key in (before | now) if before.get(key) != now.get(key)]
    return f"{keys[0]} {before.get(keys[0])}, here {now.get(keys[0])}"


def is_campaign(folder: Path) -> bool:
    """Return whether a folder has a campaign."""
    return (folder / MANIFEST).is_file()
