"""The note that accompanies a recording: scenario, run mode, parts and time base.

The note of `bus.blf` is `bus.blf.json`. A recording without a note can be read as well, but its
replay through the firmware then needs an explicit scenario.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator

from rrins.host_tools.errors import RehearsalError, ScenarioError
from rrins.host_tools.files import JsonObject, content_of, write_whole
from rrins.host_tools.recording.errors import RecordError
from rrins.host_tools.scenario.scenario import Scenario
from rrins.host_tools.scenario.wrong_keys import first_line

_LONGEST_NAME = 255  # bytes
_LARGEST = 16 << 20  # bytes; a hundred for each part of the recording


class Part(BaseModel):
    """One file of a recording."""

    file: str
    """File name, in the folder of the note."""
    first_s: float | None = None
    """Time of its first frame."""

    @field_validator("file")
    @classmethod
    def _is_name(cls, name: str) -> str:
        if name in ("", ".", "..") or set(name) & {"/", "\0"} or len(name.encode()) > _LONGEST_NAME:
            raise ValueError(f"no name of a file in this folder: {name[:20]!r}")
        return name


class Note(BaseModel):
    """The note of a recording."""

    model_config = ConfigDict(extra="ignore")

    interface: str
    channel: str
    time: Literal["simulated", "unix"] | None = None
    """Seconds since the hardware's power-on, with SYNC of epoch k at k T; or seconds since 1970."""
    frames: int = 0
    parts: tuple[Part, ...] = ()
    scenario_name: str | None = None
    scenario: JsonObject | None = None
    speed: float | Literal["max"] | None = None
    """Speed of the rehearsal; 1 is real time, anything else lockstep."""
    navigation_sha256: str | None = None
    origin: Literal["vehicle"] | None = None
    """Where it is not of a rehearsal: a real vehicle, whose truth no hardware can repeat."""
    truth: str | None = None
    """CSV file beside the note with the truth, for a recording of a vehicle."""

    @field_validator("parts")
    @classmethod
    def _are_different(cls, parts: tuple[Part, ...]) -> tuple[Part, ...]:
        if len({part.file for part in parts}) < len(parts):
            raise ValueError("a file is named twice")
        return parts

    @field_validator("truth")
    @classmethod
    def _truth_is_name(cls, name: str | None) -> str | None:
        return None if name is None else Part(file=name).file

    @property
    def is_lockstep(self) -> bool:
        """Whether the firmware is known to have run in lockstep."""
        return self.speed is not None and self.speed != 1

    def loaded_scenario(self, where: Path) -> Scenario | None:
        """Return the recorded scenario, if the note has one.

        Raises
        ------
        ScenarioError
            If it is not valid in this version.
        """
        if self.scenario is None:
            return None
        try:
            return Scenario.model_validate(self.scenario)
        except ValidationError as error:
            raise ScenarioError(
                f"{path_beside(where)}: its scenario is not valid in this version "
                f"({first_line(error, Scenario)}); name the scenario"
            ) from None


def path_beside(recording: Path) -> Path:
    """Return the path of a recording's note."""
    return recording.with_name(recording.name + ".json")


def write_note(recording: Path, note: Note) -> None:
    """Write the note of a recording atomically.

    Raises
    ------
    RecordError
        If it cannot be written.
    """

    def write(file: IO[str]) -> None:
        file.write(json.dumps(note.model_dump(mode="json"), indent=1) + "\n")

    try:
        write_whole(path_beside(recording), write)
    except RehearsalError as error:
        raise RecordError(str(error)) from error


def read_note(recording: Path) -> Note | None:
    """Return the note of a recording; None if there is none.

    Raises
    ------
    RecordError
        If a file with its name is not a valid note.
    """
    path = path_beside(recording)
    if not path.is_file():
        return None
    try:
        return Note.model_validate_json(content_of(path, _LARGEST))
    except (OSError, ValidationError) as error:
        why = error.strerror if isinstance(error, OSError) else first_line(error, Note)
        raise RecordError(
            f"{path}: not a recording's note, or damaged ({why}); move it away to read {recording} "
            "without it"
        ) from None
