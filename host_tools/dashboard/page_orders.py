"""Orders from a page: what they may be, and their checks."""

from __future__ import annotations

from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rrins.host_tools.dashboard.errors import DashboardError

Kind = Literal[
    "inject",
    "remove",
    "list_faults",
    "clear_faults",
    "mode",
    "read_codes",
    "clear_codes",
    "read_residuals",
    "start",
    "stop",
    "pause",
    "speed",
    "play",
    "seek",
    "show",
    "explain",
]

LONGEST: Final = 4096
"""Characters of a message from a page."""

OF_BUS: Final = frozenset(
    {"inject", "remove", "list_faults", "clear_faults", "mode"}
    | {"read_codes", "clear_codes", "read_residuals"}
)
"""Orders that go onto a bus."""

READING: Final = frozenset({"list_faults", "read_codes", "read_residuals"})
"""Orders that change nothing."""

OF_REHEARSAL: Final = OF_BUS | {"start", "stop", "pause", "speed"}
"""Orders to a rehearsal that the dashboard has started."""

OF_RECORDING: Final = frozenset({"play", "pause", "speed", "seek"})
"""Orders to a playback."""

MODES: Final = ("standby", "navigate", "rotation", "no rotation")
"""Modes that can be asked for."""


class Order(BaseModel):
    """An order.

    Attributes
    ----------
    id : int
        Of the page, for the answer.
    order : str
    fault : dict
        Keys of a scenario's `[[faults]]`, of `inject` and `remove`.
    mode : str
        One of `MODES`.
    speed : float
        Factor of real time; 0 for as fast as it goes.
    time_s : float
        Where a playback goes on; of `explain`: the instant on the bus.
    name, signal : str
        Message and signal that this page shows; of `show`.
    level : int
        Time span of that signal.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    id: int = Field(ge=0, lt=2**53)
    order: Kind
    fault: dict[str, str | int | float | None] | None = None
    mode: Literal["standby", "navigate", "rotation", "no rotation"] | None = None
    speed: float | None = Field(default=None, ge=0, le=1e6, allow_inf_nan=False)
    time_s: float | None = Field(default=None, ge=0, le=1e9, allow_inf_nan=False)
    name: str | None = Field(default=None, max_length=64)
    signal: str | None = Field(default=None, max_length=64)
    level: int = Field(default=0, ge=0, le=2)


_NEEDS: Final = {"inject": "fault", "remove": "fault", "mode": "mode", "speed": "speed"}
_NEEDS_ALSO: Final = {"seek": "time_s", "explain": "time_s"}


def parse_order(text: str) -> Order:
    """Return an order.

    Raises
    ------
    DashboardError
        One line: what is wrong with the message.
    """
    if len(text) > LONGEST:
        raise DashboardError(f"{len(text)} characters, at most {LONGEST} are allowed")
    try:
        order = Order.model_validate_json(text)
    except ValidationError as error:
        first: Any = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "not an order"
        raise DashboardError(f"{where}: {first['msg']}") from None
    key = (_NEEDS | _NEEDS_ALSO).get(order.order)
    if key is not None and getattr(order, key) is None:
        raise DashboardError(f"{order.order}: needs {key}")
    return order
