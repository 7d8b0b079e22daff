"""Options of a campaign on the command line, as plain values."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from typing import Any

from rrins.host_tools.campaigns.distributions import is_distribution
from rrins.host_tools.campaigns.errors import CampaignError

_PARTS = re.compile(r",(?![^()]*\))")
"""Commas that are not inside brackets."""


def _pair(option: str, text: str) -> tuple[str, str]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise CampaignError(f"--{option} {text!r}: is not KEY=…")
    return key.strip(), value.strip()


def _plain(text: str) -> Any:
    """Return a value as TOML has it; a word that is none is text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def settings_of(texts: Iterable[str], option: str = "set") -> dict[str, Any]:
    """Return the keys of `--set`, or of another option.

    Raises
    ------
    CampaignError
    """
    return {key: _plain(value) for key, value in (_pair(option, text) for text in texts)}


def variations_of(texts: Iterable[str]) -> dict[str, str]:
    """Return the keys of `--vary`.

    Raises
    ------
    CampaignError
    """
    found: dict[str, str] = {}
    for text in texts:
        key, value = _pair("vary", text)
        if key in found:
            raise CampaignError(f"--vary {key}: is there twice")
        found[key] = value
    return found


def fault_of(text: str) -> dict[str, Any]:
    """Return the keys of a `--fault`: ``kind=gyro_bias, at_s=uniform(10, 20), size=5``.

    Raises
    ------
    CampaignError
    """
    pairs = (_pair("fault", part) for part in _PARTS.split(text))
    return {key: value if is_distribution(value) else _plain(value) for key, value in pairs}


def correlation_of(text: str) -> tuple[str, str, float]:
    """Return the two keys of a `--correlate` and their correlation.

    Raises
    ------
    CampaignError
    """
    keys, value = _pair("correlate", text)
    names = [name.strip() for name in keys.split(",")]
    try:
        number = float(value)
    except ValueError:
        number = 2.0
    if len(names) != 2 or not -1.0 < number < 1.0:
        raise CampaignError(f"--correlate {text!r}: is not 'KEY, KEY = ρ' with -1 < ρ < 1")
    return names[0], names[1], number
