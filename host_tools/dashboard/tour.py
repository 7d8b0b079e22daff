"""The steps of `rrins tour`: what is seen, the command that does it, and when the next one comes.

The page and the terminal tell the same story. What the firmware and the hardware do is never
played: each figure that is shown comes from the rehearsal.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Final

from rrins.host_tools.files import JsonObject

SCENARIO: Final = "tour"
SPEED: Final = 5.0
"""Factor of real time: the story takes some three minutes."""

STANDS_UNTIL_S: Final = 300.0
TURNS_UNTIL_S: Final = 605.0
"""Bus times: five minutes standing, then as long with the table turning."""

FAULT: Final[JsonObject] = {"kind": "gyro_ramp", "sensor": 3, "bias_dph_per_min": 0.7}


@dataclass(frozen=True)
class Step:
    """A step of the tour.

    Attributes
    ----------
    title, text, command : str
    """

    title: str
    text: str
    command: str
    look: str  #: selector of the part of the page to look at
    until_s: float = 0.0  #: bus time at which the next step comes; 0: not by time
    until_event: str = ""  #: words of the event with which it comes
    dwell_s: float = 8.0  #: how long it stays at least, s of the wall clock
    order: str = ""  #: to the rehearsal, when the step begins
    tab: str = ""  #: to be opened
    keeps: str = ""  #: name of the position error at the end of the step, for later texts


STEPS: Final = (
    Step(
        title="It stands still, and drifts",
        text="Four gyros that are wrong by 0.1 °/h, four accelerometers that are wrong by 50 µg. "
        "Nothing moves, yet the position error grows, ever faster: constant errors add up.",
        command="rrins rehearse tour --speed 5",
        look="#plot-position",
        until_s=STANDS_UNTIL_S,
        keeps="standing",
    ),
    Step(
        title="It aligns again, and the table turns",
        text="The operator asks for rotation. The same sensors, with the same errors; but each "
        "turn takes them round, and what one half of the cycle adds the other takes away. After "
        "five minutes at rest it was {standing} off.",
        command="rrins scenarios show tour",
        look=".scene",
        until_s=TURNS_UNTIL_S,
        keeps="turning",
    ),
    Step(
        title="Gyro 3 begins to fail",
        text="{standing} at rest, {turning} with rotation. Now a bias grows in gyro 3, by 0.7 °/h "
        "each minute. It is small, and three sensors would never show it. Four do: one combination "
        "of their readings must be zero, whatever the vehicle does. This is the parity.",
        command="rrins inject gyro_ramp --sensor 3 --bias-dph-per-min 0.7",
        look="#plot-parity",
        until_event="gyro 3 left out",
        order="inject",
        tab="control",
    ),
    Step(
        title="It is found, and left out",
        text="The firmware compares the gyros with each other and, as the table turns, with the "
        "encoders, the rate of the Earth and gravity: all point at gyro 3. From this epoch on "
        "three gyros navigate.",
        command="rrins monitor",
        look="#chips",
        dwell_s=12.0,
    ),
    Step(
        title="The track is repaired",
        text="The firmware knows when the fault began, and what gyro 3 has done to the navigation "
        "since. It takes that out again. Three gyros are left: the next fault could not be found, "
        "and it says so.",
        command="rrins diag dtc read gyro_3_left_out",
        look=".map",
        dwell_s=12.0,
    ),
    Step(
        title="The code is read",
        text="Like any control unit the navigation computer keeps trouble codes, with freeze "
        "frames of the first and the latest occurrence, and gives them over UDS.",
        command="rrins diag dtc read",
        look=".tabs",
        dwell_s=14.0,
        order="read_codes",
        tab="codes",
    ),
    Step(
        title="And why is it off at all?",
        text="Click the position error at the top of the page: the run is repeated with and "
        "without each source of error, and each gets its part.",
        command="rrins explain tour --at 290 --by source",
        look="#error",
        dwell_s=0.0,
    ),
)


def told() -> list[JsonObject]:
    """Return the steps as the page gets them."""
    return [
        asdict(step) | {"speed": SPEED, "fault": FAULT if step.order == "inject" else None}
        for step in STEPS
    ]
