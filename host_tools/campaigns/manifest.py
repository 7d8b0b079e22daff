"""The manifest of a campaign's folder: what decides about its rows, and digests of its parts."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.files import JsonObject, content_of, write_text
from rrins.host_tools.scenario.wrong_keys import first_line

MANIFEST: Final = "_manifest.json"
_FORMAT: Final = 1
_LARGEST = 64 << 20

_Digest = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Campaign(_Table):
    """The definition of a campaign, as JSON has it."""

    name: str
    title: str
    scenario: str
    runs: int = Field(ge=1)
    seed: int = Field(ge=0)
    design: str
    vary: dict[str, str]
    correlate: list[tuple[str, str, float]]
    faults: list[dict[str, Any]]


class Manifest(_Table):
    """All that a campaign's folder says of itself."""

    format: Literal[1] = _FORMAT
    campaign: Campaign
    sources: str
    versions: dict[str, str]
    schema_: dict[str, str] = Field(alias="schema")
    times_s: list[float]
    stopped_at: int | None = Field(default=None, ge=0)
    until: str | None = None
    parts: dict[str, _Digest] = Field(default_factory=dict)
    merged: dict[str, list[str]] = Field(default_factory=dict)
    """The parts for which one stands as soon as it is there; they are being deleted."""
    digest: _Digest | None = None
    """Of all the rest; those of earlier versions have none."""

    def write(self, folder: Path) -> None:
        """Write it into a folder, with its digest.

        Raises
        ------
        RehearsalError
            When it cannot be written.
        """
        values = self.model_dump(by_alias=True, exclude_none=True, exclude={"digest"})
        if not self.merged:
            del values["merged"]
        values["digest"] = _digest_of(values)
        write_text(folder / MANIFEST, json.dumps(values, indent=1, ensure_ascii=False) + "\n")


def _digest_of(values: JsonObject) -> str:
    text = json.dumps(values, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def read_manifest(folder: Path) -> Manifest:
    """Return what a campaign's folder says of itself.

    Raises
    ------
    CampaignError
        One line: it is missing, damaged, or of another version.
    """
    path = folder / MANIFEST
    try:
        values = json.loads(content_of(path, _LARGEST))
    except FileNotFoundError as error:
        raise CampaignError(f"{folder}: not a campaign folder: {MANIFEST} is missing") from error
    except (OSError, ValueError, RecursionError) as error:
        why = getattr(error, "strerror", None) or error
        raise CampaignError(f"{path}: cannot be read: {why}") from error
    if not isinstance(values, dict) or values.get("format") != _FORMAT:
        raise CampaignError(f"{path}: is not of this version of rrins")
    digest = values.get("digest")
    rest = {key: value for key, value in values.items() if key != "digest"}
    if digest is not None and digest != _digest_of(rest):
        raise CampaignError(
            f"{path}: is damaged: it does not match its digest; restore it from a copy, or run the "
            "campaign in another folder"
        )
    try:
        return Manifest.model_validate_json(json.dumps(values))
    except ValidationError as error:
        raise CampaignError(f"{path}: {first_line(error, Manifest)}") from None
