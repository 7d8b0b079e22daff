"""Writes a recording as an MCAP file: signals, the table as transforms, position, events.

MCAP (mcap.dev) is read by Foxglove, Rerun and others. Messages are JSON, each with its JSON Schema;
transforms, positions and events have the schemas that Foxglove knows by name.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from rrins.compiled.record import Integers, Words
from rrins.host_tools.dashboard import events
from rrins.host_tools.dashboard.quantities import rows_of
from rrins.host_tools.logs.diagnosis import Diagnosis
from rrins.host_tools.logs.reader import Log, Piece
from rrins.host_tools.logs.signals import (
    PROTECTION,
    crc_of_frames_holds,
    has_its_length,
    name_of_identifier,
    signals_of,
)
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.recording.errors import RecordError

_NS: Final = 1_000_000_000
_EVENTS_EVERY_NS: Final = 100_000_000
_NAVIGATION, _BODY, _GIMBAL, _SENSORS = "navigation", "body", "gimbal", "sensors"
_LEVELS: Final = {"note": 2, "good": 2, "order": 2, "warning": 3, "bad": 4}  # of foxglove.Log

_TIME: Final = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
_STRING: Final = {"type": "string"}
_NUMBER: Final = {"type": "number"}


def _vector(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _NUMBER)}


_KNOWN: Final = {
    "foxglove.FrameTransform": {
        "timestamp": _TIME,
        "parent_frame_id": _STRING,
        "child_frame_id": _STRING,
        "translation": _vector("x", "y", "z"),
        "rotation": _vector("x", "y", "z", "w"),
    },
    "foxglove.LocationFix": {
        "timestamp": _TIME,
        "frame_id": _STRING,
        "latitude": _NUMBER,
        "longitude": _NUMBER,
        "altitude": _NUMBER,
        "position_covariance_type": {"type": "integer"},
    },
    "foxglove.Log": {
        "timestamp": _TIME,
        "level": {"type": "integer"},
        "message": _STRING,
        "name": _STRING,
        "file": _STRING,
        "line": {"type": "integer"},
    },
}
"""Properties of Foxglove's schemas."""

_TOPICS: Final = {
    "/tf": "foxglove.FrameTransform",
    "/position": "foxglove.LocationFix",
    "/events": "foxglove.Log",
    "/diagnosis": "foxglove.Log",
}


@dataclass
class McapExported:
    """Result of an export.

    Attributes
    ----------
    unknown, wrong_length : int
        Frames that were skipped: not in the DBC, or not of their message's length.
    """

    messages: dict[str, int]  #: messages written, by topic
    unknown: int = 0
    wrong_length: int = 0


def _schema(title: str, properties: dict[str, Any]) -> bytes:
    return json.dumps({"title": title, "type": "object", "properties": properties}).encode()


def _time(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _NS, "nsec": time_ns % _NS}


def _turn(axis: str, angle_deg: float) -> dict[str, float]:
    """Return the quaternion of a turn about an axis."""
    half = math.radians(angle_deg) / 2
    return {"x": 0.0, "y": 0.0, "z": 0.0} | {axis: math.sin(half), "w": math.cos(half)}


def attitude_quaternion(roll_deg: float, pitch_deg: float, heading_deg: float) -> dict[str, float]:
    """Return the quaternion of ``C_b_n = Rz(-heading) Rx(pitch) Ry(roll)``."""
    (sr, cr), (sp, cp), (sh, ch) = (
        (math.sin(math.radians(a) / 2), math.cos(math.radians(a) / 2))
        for a in (roll_deg, pitch_deg, -heading_deg)
    )
    # (ch + sh k)(cp + sp i)(cr + sr j)
    return {
        "x": ch * sp * cr - sh * cp * sr,
        "y": ch * cp * sr + sh * sp * cr,
        "z": sh * cp * cr + ch * sp * sr,
        "w": ch * cp * cr - sh * sp * sr,
    }


class _File:
    """An MCAP file under way."""

    def __init__(self, file: IO[bytes]) -> None:
        from mcap.writer import Writer

        self._writer = Writer(file)
        self._writer.start(profile="", library="rrins")
        self._channels: dict[str, int] = {}
        self.counts: dict[str, int] = {}

    def add(self, topic: str, time_ns: int, data: dict[str, Any]) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._new_channel(topic)
            self.counts[topic] = 0
        count = self.counts[topic] = self.counts[topic] + 1
        text = json.dumps(data, separators=(",", ":")).encode()
        self._writer.add_message(self._channels[topic], time_ns, text, time_ns, count)

    def _new_channel(self, topic: str) -> int:
        name = _TOPICS.get(topic)
        if name is None:
            name = topic.removeprefix("/")
            properties = _properties(name)
        else:
            properties = _KNOWN[name]
        schema = self._writer.register_schema(name, "jsonschema", _schema(name, properties))
        return int(self._writer.register_channel(topic, "json", schema))

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap's


def _properties(message: str) -> dict[str, Any]:
    """Return the properties of a message's schema: a number for each signal, a name for some."""
    found: dict[str, Any] = {}
    for signal in signals_of(message):
        words = " ".join(part for part in (signal.comment, signal.unit) if part)
        found[signal.column] = {"type": "number", "description": words}
        if signal.choices:
            found[f"{signal.name}_name"] = _STRING
    return found | {"crc_holds": {"type": "boolean"}}


def _decoded(message: str, words: Words) -> list[dict[str, Any]]:
    """Return the signals of each payload, by column name; without those of the protection."""
    columns: dict[str, list[Any]] = {}
    for signal in signals_of(message):
        if signal.name in PROTECTION:
            continue
        values = signal.values(words).tolist()
        if signal.valid_row is not None:  # JSON knows no NaN
            values = [None if math.isnan(value) else value for value in values]
        columns[signal.column] = values
        if signal.choices:
            raws = signal.raw(words).tolist()
            columns[f"{signal.name}_name"] = [signal.choices.get(raw, str(raw)) for raw in raws]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


class _Poses:
    """Makes transforms and positions of messages."""

    def __init__(self) -> None:
        self._place: dict[str, float] = {}

    def of(self, message: str, time_ns: int, data: dict[str, Any]) -> Iterator[tuple[str, Any]]:
        if message == "AXIS_OUTER_STATUS":
            yield "/tf", _transform(time_ns, _BODY, _GIMBAL, _turn("x", data["encoder_angle_deg"]))
        elif message == "AXIS_INNER_STATUS":
            turned = _turn("z", data["encoder_angle_deg"])
            yield "/tf", _transform(time_ns, _GIMBAL, _SENSORS, turned)
        elif message == "NAV_ATTITUDE":
            attitude = (data[f"{name}_deg"] for name in ("roll", "pitch", "heading"))
            yield "/tf", _transform(time_ns, _NAVIGATION, _BODY, attitude_quaternion(*attitude))
        elif message in ("NAV_LATITUDE", "NAV_LONGITUDE"):
            self._place |= data
        elif message == "NAV_HEIGHT" and len(self._place) > 2:
            yield (
                "/position",
                {
                    "timestamp": _time(time_ns),
                    "frame_id": _NAVIGATION,
                    "latitude": self._place["latitude_deg"],
                    "longitude": self._place["longitude_deg"],
                    "altitude": data["height_m"],
                    "position_covariance_type": 0,
                },
            )


def _transform(time_ns: int, parent: str, child: str, rotation: dict[str, float]) -> dict[str, Any]:
    return {
        "timestamp": _time(time_ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
        "rotation": rotation,
    }


def _entry(time_ns: int, weight: events.Weight, text: str, name: str = "rrins") -> dict[str, Any]:
    """Return an entry of a log."""
    return {
        "timestamp": _time(time_ns),
        "level": _LEVELS[weight],
        "message": text,
        "name": name,
        "file": "",
        "line": 0,
    }


class _Events:
    """Makes events of the frames, ten times a second of the recording."""

    def __init__(self) -> None:
        self._watch = Watch()
        self._log = events.EventLog()
        self._rows = rows_of(events.SIGNALS)

    def of(self, piece: Piece, times_ns: Integers) -> Iterator[tuple[int, dict[str, Any]]]:
        first, last = int(times_ns[0]), int(times_ns[-1])
        edges = np.arange(first, last + _EVENTS_EVERY_NS, _EVENTS_EVERY_NS)
        begin = 0
        for end in np.searchsorted(times_ns, edges, side="right").tolist():
            self._watch.add_timed_frames(piece.frames[begin:end], times_ns[begin:end])
            begin = end
            latest = self._watch.latest(self._rows)
            for event in self._log.follow(latest.values, latest.changed_ns / _NS):
                time_ns = round(event.time_s * _NS)
                yield time_ns, _entry(time_ns, event.weight, event.text)


def export_mcap(
    log: Log, path: Path, on_progress: Callable[[int], None] = lambda position: None
) -> McapExported:
    """Write a recording as an MCAP file, which appears once it is complete.

    Raises
    ------
    RecordError
        If the package is missing, the log cannot be read or the file cannot be written.
    """
    if importlib.util.find_spec("mcap") is None:
        raise RecordError("MCAP needs the package mcap: pip install mcap")
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as file:
            exported = _write(log, _File(file), on_progress)
        part.replace(path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    return exported


def _write(log: Log, file: _File, on_progress: Callable[[int], None]) -> McapExported:
    exported = McapExported(file.counts)
    poses, told, diagnosis = _Poses(), _Events(), Diagnosis()
    for piece in log.pieces():
        times_ns = np.round(piece.time_s * _NS).astype(np.int64)
        decoded: list[tuple[str, dict[str, Any]] | None] = [None] * len(piece)
        for identifier in np.unique(piece.frames["can_id"]).tolist():
            _decode_into(decoded, piece, identifier, exported)
        for time_ns, one in zip(times_ns.tolist(), decoded, strict=True):
            if one is None:
                continue
            message, data = one
            file.add(f"/{message}", time_ns, data)
            if data["crc_holds"]:
                for topic, pose in poses.of(message, time_ns, data):
                    file.add(topic, time_ns, pose)
        for time_ns, event in told.of(piece, np.maximum.accumulate(times_ns)):
            file.add("/events", time_ns, event)
        for k, said in diagnosis.messages(piece.frames):
            time_ns = int(times_ns[k])
            weight: events.Weight = "warning" if said.is_warning else "note"
            file.add("/diagnosis", time_ns, _entry(time_ns, weight, said.text, said.sender))
        on_progress(log.position)
    file.finish()
    return exported


def _decode_into(
    decoded: list[tuple[str, dict[str, Any]] | None],
    piece: Piece,
    identifier: int,
    exported: McapExported,
) -> None:
    """Decode the frames of an identifier to their places."""
    places = np.flatnonzero(piece.frames["can_id"] == identifier)
    message = name_of_identifier(identifier)
    if message is None:
        exported.unknown += len(places)
        return
    is_whole = has_its_length(piece.frames[places], message)
    exported.wrong_length += int(np.count_nonzero(~is_whole))
    places = places[is_whole]
    frames = piece.frames[places]
    holds = crc_of_frames_holds(frames, message).tolist()
    for place, data, crc_holds in zip(
        places.tolist(), _decoded(message, frames["data"]), holds, strict=True
    ):
        decoded[place] = message, data | {"crc_holds": crc_holds}
