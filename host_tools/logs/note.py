"""What stands beside a recording: the scenario, how it was run, the parts, what time means.

`bus.blf` has its note in `bus.blf.json`. A recording without one can be read as well; its replay
through the firmware then needs the scenario named.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO, Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from host_tools.errors import RehearsalError, ScenarioError
from host_tools.logs.errors import RecordError
from host_tools.results import write_whole
from host_tools.scenario import Scenario


class Part(BaseModel):
    """One file of a recording."""

    file: str
    """Its name, in the folder of the note."""
    first_s: float | None = None
    """Time of its first frame."""


class Note(BaseModel):
    """The note beside a recording."""

    model_config = ConfigDict(extra="ignore")

    interface: str
    channel: str
    time: Literal["simulated", "unix"] | None = None
    """Seconds since the hardware's power-on, SYNC of epoch k at k T; or seconds since 1970."""
    frames: int = 0
    parts: tuple[Part, ...] = ()
    scenario_name: str | None = None
    scenario: dict[str, Any] | None = None
    speed: float | Literal["max"] | None = None
    """Of the rehearsal; 1 is real time, everything else lockstep."""
    navigation_sha256: str | None = None

    @property
    def is_lockstep(self) -> bool:
        """Whether it is known that the firmware ran in lockstep."""
        return self.speed is not None and self.speed != 1

    def loaded_scenario(self, where: Path) -> Scenario | None:
        """Return the scenario that was recorded, if the note has one.

        Raises
        ------
        ScenarioError
            When it is not one of this version.
        """
        if self.scenario is None:
            return None
        try:
            return Scenario.model_validate(self.scenario)
        except ValidationError as error:
            raise ScenarioError(
                f"{path_beside(where)}: its scenario is not one of this version "
                f"({error.errors()[0]['msg']}); name the scenario"
            ) from error


def path_beside(recording: Path) -> Path:
    """Return where the note of a recording is."""
    return recording.with_name(recording.name + ".json")


def write_note(recording: Path, note: Note) -> None:
    """Write the note of a recording, whole or not at all.

    Raises
    ------
    RecordError
        When it cannot be written.
    """

    def write(file: IO[str]) -> None:
        file.write(json.dumps(note.model_dump(mode="json"), indent=1) + "\n")

    try:
        write_whole(path_beside(recording), write)
    except RehearsalError as error:
        raise RecordError(str(error)) from error


def read_note(recording: Path) -> Note | None:
    """Return the note beside a recording; None without one.

    Raises
    ------
    RecordError
        When there is a file in its place that is none.
    """
    path = path_beside(recording)
    if not path.is_file():
        return None
    try:
        return Note.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise RecordError(
            f"{path}: no note of a recording, or a damaged one; move it away to read {recording} "
            "without it"
        ) from error
