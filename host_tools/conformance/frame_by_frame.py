"""Checks that compare every frame of a run with our own firmware's."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from rrins.host_tools.conformance import disturbances as d
from rrins.host_tools.conformance import set_ups as u
from rrins.host_tools.conformance.check import Check, Subject
from rrins.host_tools.conformance.trial import Stimuli, Trial

_IN, _QUICK, _SITE = u.IN, u.QUICK, u.SITE


def _run(subject: Subject, trials: tuple[Trial, ...]) -> None:
    # Of our own firmware one is enough to show that a process on a bus does the same.
    for trial in trials if subject.program is not None else trials[:1]:
        trial.compare(subject.program, subject.folder)


def _check(name: str, rule: str, page: str, requirements: str, *trials: Trial) -> Check:
    named = tuple(
        Trial(**(vars(trial) | {"name": f"{name}-{k}"})) for k, trial in enumerate(trials, 1)
    )
    return Check(name, rule, page, partial(_run, trials=named), tuple(requirements.split()))


def _of(seconds: float, *tables: dict[str, Any], stimuli: Any = tuple, **more: Any) -> Trial:
    late_s, scenario = more.pop("late_s", 0.0), more.pop("scenario", "rimu_rotating")
    steps = more.pop("position_steps", 3)
    return Trial("", seconds, u.of(*tables, **more), stimuli, scenario, late_s, steps)


def _firmware(**keys: Any) -> dict[str, Any]:
    return {"firmware": keys}


def _on(stimuli: Any, *words: Any) -> Any:
    def make() -> Stimuli:
        made: Stimuli = stimuli(*words)
        return made

    return make


_FRAMES_IN = "firmware.md#frames-in"

FRAMES_IN: Final = (
    _check(
        "every-crc",
        "A frame of any message with a wrong CRC is counted and has no other effect.",
        _FRAMES_IN,
        "RX-*-1",
        _of(12.0, _IN, stimuli=d.crc),
    ),
    _check(
        "every-length",
        "A frame of any message that is too short counts as one with a wrong CRC.",
        _FRAMES_IN,
        "RX-*-2",
        _of(9.5, _IN, stimuli=d.length),
    ),
    _check(
        "every-counter",
        "A frame of any message with another counter is counted and never used.",
        _FRAMES_IN,
        "RX-*-3",
        _of(9.5, _IN, stimuli=d.counter),
        _of(9.5, _IN, stimuli=d.late),
    ),
    _check(
        "every-repetition",
        "A second frame of any message in the epoch is counted and never used; a request "
        "whose counter stands still is not one.",
        _FRAMES_IN,
        "RX-*-4 IN-5",
        _of(7.5, _IN, stimuli=d.repetition),
    ),
    _check(
        "every-contradiction",
        "Of two frames of any message that disagree about an epoch neither is used.",
        "firmware.md#two-senders-of-one-message",
        "RX-*-5",
        _of(8.5, _IN, stimuli=d.contradiction),
    ),
    _check(
        "every-gap",
        "The loss of any message is counted; an axis' angle goes on at its rate.",
        _FRAMES_IN,
        "RX-*-6 IN-4",
        _of(9.5, _IN, stimuli=d.gap),
    ),
    _check(
        "strange-identifiers",
        "Unknown, extended and remote frames are ignored, as many as may come.",
        _FRAMES_IN,
        "IN-1",
        _of(6.0, _QUICK, u.ROTATING, stimuli=d.strange),
    ),
    _check(
        "chance",
        "With one frame in fifty lost, corrupted, repeated, late or contradicted at random, "
        "every output is that of the reference.",
        _FRAMES_IN,
        "IN-2 IN-3",
        *(_of(15.0, _IN, stimuli=_on(d.at_random, seed)) for seed in (1, 2)),
        _of(30.0, _IN, rate_hz=50, stimuli=_on(d.at_random, 3)),
    ),
)

TIME: Final = (
    _check(
        "without-sync",
        "Without SYNC the epochs go on; sync_lost from the tenth on, until the next SYNC.",
        "firmware.md#clock",
        "CLK-1 CLK-2",
        _of(13.0, _QUICK, u.ROTATING, stimuli=d.without_sync),
    ),
    _check(
        "stray-sync",
        "A SYNC of another epoch, ahead or behind, is counted and has no other effect.",
        _FRAMES_IN,
        "SYN-1 SYN-2",
        _of(11.0, _QUICK, u.ROTATING, stimuli=d.stray_sync),
    ),
    _check(
        "restarted-sync",
        "An epoch count far from the firmware's is adopted when it goes on, and only then.",
        _FRAMES_IN,
        "SYN-3",
        _of(11.0, _QUICK, u.ROTATING, stimuli=d.restarted_sync),
    ),
    _check(
        "wrapping-sync",
        "Epochs go on over the wrap of SYNC's 24 bits; its counter tells how often they have.",
        _FRAMES_IN,
        "SYN-4 SYN-5",
        _of(6.0, _QUICK, u.ROTATING, stimuli=d.wrapping),
        _of(4.0, _QUICK, u.ROTATING, stimuli=d.wrapped),
    ),
    _check(
        "late-start",
        "A program that comes while the hardware runs takes the first SYNC's epoch; before it "
        "nothing counts as missing.",
        _FRAMES_IN,
        "SYN-5 IN-4",
        _of(12.0, _QUICK, u.ROTATING, late_s=7.315),
        _of(4.0, _QUICK, u.ROTATING, stimuli=d.no_sync_at_first),
    ),
    _check(
        "other-rates",
        "At other rates the cycle times hold, rounded down to whole epochs.",
        "firmware.md#frames-out",
        "OUT-1",
        *(_of(6.0, _QUICK, u.ROTATING, rate_hz=rate) for rate in (64, 400)),
        _of(3.0, _QUICK, u.ROTATING, rate_hz=1000),
    ),
)

MODES: Final = (
    _check(
        "requests",
        "Each request has its effect in every mode, once, and at its epoch.",
        "firmware.md#modes",
        "MODE-3 MODE-4 MODE-5 MODE-6 MODE-7",
        _of(22.0, _QUICK, _SITE, u.REQUESTS, stimuli=d.in_motion, rate_hz=50),
        _of(9.5, _QUICK, u.ROTATING, stimuli=d.none_between),
    ),
    _check(
        "standing",
        "The alignment begins once both axes turn at no more than 0.05 °/s, or after 10 s.",
        "firmware.md#modes",
        "MODE-5",
        *(
            _of(15.0, _QUICK, u.ROTATING, stimuli=_on(d.turning, *rates), rate_hz=50)
            for rates in ((26, 0), (0, -26), (25, -25))
        ),
    ),
    _check(
        "self-test-epochs",
        "The self-test takes 0.5 s of sound epochs; each unsound one, of whatever kind, takes "
        "back ten.",
        "firmware.md#modes",
        "MODE-1",
        _of(9.5, _QUICK, u.ROTATING, stimuli=d.self_test, rate_hz=50),
        _of(6.0, _QUICK, u.ROTATING, stimuli=_on(d.bad_at_first, 2.0), rate_hz=50),
    ),
    _check(
        "self-test-fails",
        "After 10 s without success: FAULT, until STANDBY is requested; frames go on in FAULT.",
        "firmware.md#modes",
        "MODE-2 MODE-8",
        _of(15.0, _QUICK, u.AGAIN, stimuli=_on(d.bad_at_first, 11.0), rate_hz=50),
        _of(12.0, _QUICK, u.ROTATING, stimuli=_on(d.bad_at_first, 9.64), rate_hz=50),
        _of(10.0, _QUICK, u.ROTATING, stimuli=_on(d.bad_at_first, 9.45), rate_hz=50),
    ),
    _check(
        "fault-ends",
        "In FAULT requests are discarded but for STANDBY and SHUTDOWN; no NAV_ frames.",
        "firmware.md#modes",
        "MODE-8 MODE-9",
        _of(11.0, _QUICK, u.IN_FAULT, stimuli=_on(d.fault_then, 4.0)),
        _of(5.005, _QUICK, u.IN_FAULT, stimuli=d.fault_shutdown),
        _of(1.005, _QUICK, stimuli=_on(d.shutdown, 1.0)),
        _of(0.205, _QUICK, stimuli=_on(d.shutdown, 0.2)),
        _of(3.005, _QUICK, u.ROTATING, stimuli=_on(d.shutdown, 3.0)),
    ),
)

SENSORS: Final = (
    _check(
        "flagged-sensors",
        "A sensor that is saturated or absent is not used; the other one of its group is.",
        _FRAMES_IN,
        "SEN-1 SEN-2",
        _of(7.0, _QUICK, _SITE, u.ROTATING, _firmware(height_channel="free"), stimuli=d.flagged),
    ),
    _check(
        "bridging",
        "A gap of all gyros or accelerometers up to bridge_s is bridged with the increments "
        "before it, and ends navigation beyond.",
        "firmware.md#fusion",
        "SEN-3 SEN-4",
        _of(6.0, _QUICK, _SITE, u.ROTATING, _firmware(height_channel="free"), stimuli=d.gaps),
        *(
            _of(3.5, _QUICK, u.ROTATING, stimuli=_on(d.bridged, (20, None), (21, raw)))
            for raw in (None, 4, 8)
        ),
        _of(3.5, _QUICK, u.ROTATING, _firmware(bridge_s=0.02), stimuli=_on(d.bridged, (5, None))),
    ),
    _check(
        "saturated-counters",
        "Fault counters stay at their largest value.",
        "firmware.md#fault-counters",
        "CNT-1",
        _of(10.0, _QUICK, u.ROTATING, _firmware(bridge_s=8.0), stimuli=d.saturated_counters),
    ),
    _check(
        "other-sensors",
        "Any number, direction and weight of gyros and accelerometers of the set-up is fused.",
        "firmware.md#fusion",
        "SEN-5",
        _of(6.0, _QUICK, _SITE, u.ROTATING, u.WEIGHTED, stimuli=d.shaken),
        _of(6.0, _QUICK, _SITE, u.ROTATING, u.CUSTOM, stimuli=d.shaken),
        _of(6.0, _QUICK, u.ROTATING, u.CONE, stimuli=d.one_absent),
        _of(6.0, _QUICK, u.ROTATING, u.PLANE, stimuli=d.one_absent),
    ),
)

AXES: Final = (
    _check(
        "whole-cycle",
        "One cycle of the scheme and the beginning of the next: every target, dwell and rate.",
        "firmware.md#rotation-scheme",
        "AXS-1 AXS-2",
        _of(125.0, _QUICK, _SITE, u.ROTATING, rate_hz=50),
        _of(300.0, u.WINDING, u.ROTATING, rate_hz=50),
    ),
    _check(
        "axis-faults",
        "An axis that reports FAULT, lags or is silent is reported and both hold; the rotation "
        "is tried again when both stand, after 1, 2, 4 … s, eight times.",
        "firmware.md#rotation-scheme",
        "AXS-3 AXS-4 AXS-5",
        _of(42.0, _QUICK, u.ROTATING, stimuli=d.axis_faults, rate_hz=50),
        _of(24.0, _QUICK, u.ROTATING, u.SILENCE, stimuli=d.silent_axes, rate_hz=50),
        _of(24.0, _QUICK, u.ROTATING, stimuli=d.not_standing, rate_hz=50),
        _of(300.0, _QUICK, u.ROTATING, u.ABANDONED, rate_hz=50),
        _of(24.0, _QUICK, u.ROTATING, u.STALLED, rate_hz=50),
        _of(24.0, u.JERKY, u.ROTATING, u.RUNAWAY, rate_hz=50),
    ),
    _check(
        "homing",
        "The scheme begins at zero: both axes are turned back to it first.",
        "firmware.md#rotation-scheme",
        "AXS-6",
        _of(24.0, _QUICK, u.TWICE, rate_hz=50),
        _of(20.0, _QUICK, u.ROTATING, stimuli=_on(d.offset, 0.0099, -0.0099), rate_hz=50),
        _of(20.0, _QUICK, u.ROTATING, stimuli=_on(d.offset, 0.0, -0.0102), rate_hz=50),
        _of(20.0, _QUICK, u.ROTATING, stimuli=_on(d.offset, 25.0, -75.0), rate_hz=50),
    ),
)

NAVIGATION: Final = (
    _check(
        "shaken",
        "Under motion about all axes every output is that of the reference, with every height "
        "channel.",
        "firmware.md#strapdown",
        "NAV-1 NAV-2 NAV-3",
        *(
            _of(20.0, _QUICK, _SITE, u.ROTATING, _firmware(height_channel=one), stimuli=d.shaken)
            for one in ("held", "damped", "free")
        ),
        _of(30.0, _QUICK, u.NORTH, stimuli=d.shaken, rate_hz=50),
        _of(20.0, u.STRAPDOWN, u.RISING, stimuli=_on(d.pushed, (1, -0.01)), rate_hz=50),
    ),
    _check(
        "altimeter",
        "The damped height follows the altimeter: ten frames a second, and after a silence with "
        "at most 1 s of weight.",
        "firmware.md#height-channel",
        "NAV-4",
        _of(20.0, _QUICK, _SITE, u.ALTIMETER, u.ROTATING, stimuli=d.silent_altimeter),
    ),
    _check(
        "extremes",
        "Longitude wraps at 180°; outputs stay at the ends of their ranges; 3000 m/s and 89.99° "
        "of latitude end navigation.",
        "firmware.md#modes",
        "NAV-5 NAV-6",
        _of(12.0, u.STRAPDOWN, u.DATE_LINE, stimuli=_on(d.pushed, (2, 0.02), (3, -0.03))),
        _of(12.0, u.STRAPDOWN, u.DATE_LINE, stimuli=_on(d.pushed, (2, -0.02), (3, 0.03))),
        _of(26.0, u.STRAPDOWN, stimuli=_on(d.pushed, (1, -1.0), (2, 1.0))),
        _of(20.0, u.STRAPDOWN, u.RISING, stimuli=_on(d.pushed, (2, 1.0), (3, 1.0))),
        _of(18.0, u.STRAPDOWN, u.POLE, stimuli=_on(d.pushed, (3, 0.7), (4, -0.7))),
    ),
    _check(
        "self-alignment",
        "Level and heading are found at standstill; a specific force 2 % off ends in FAULT "
        "(ALIGNMENT_FAILED), and so does a rate that shows no north.",
        "firmware.md#alignment",
        "ALN-1 ALN-2",
        _of(66.0, u.ALIGNING, stimuli=d.without_north, rate_hz=50, scenario="ideal"),
        _of(140.0, u.ALIGNING, u.TWO_ALIGNMENTS, _SITE, rate_hz=50, scenario="ideal"),
        *(
            _of(66.0, u.ALIGNING, stimuli=_on(d.scaled, share), rate_hz=50, scenario="ideal")
            for share in (0.0195, 0.0205, -0.0205)
        ),
    ),
    _check(
        "rest",
        "At rest the quantisation remainder of the alignment is made up: 480 s are within 0.3 mm.",
        "firmware.md#alignment",
        "ALN-1",
        _of(480.0, u.STRAPDOWN, rate_hz=50),
    ),
    _check(
        "scale-errors",
        "Scale factor errors of 100 ppm act as they do on the reference.",
        "error-model.md",
        "NAV-1",
        _of(25.0, _QUICK, _SITE, u.ROTATING, u.SCALES),
    ),
    _check(
        "in-a-car",
        "In a drive every output is that of the reference, with and without rotation.",
        "firmware.md#strapdown",
        "NAV-1 NAV-4",
        _of(60.0, _QUICK, scenario="drive_rotating", rate_hz=100),
        _of(60.0, scenario="drive_strapdown", rate_hz=100),
    ),
    _check(
        "in-waves",
        "In waves every output is that of the reference.",
        "firmware.md#strapdown",
        "NAV-1 NAV-2",
        _of(40.0, _QUICK, u.ROTATING, u.WAVES, rate_hz=100),
    ),
)

SCENARIOS: Final = (
    "ideal",
    "rimu_rotating",
    "rimu_strapdown",
    "imu_rotating",
    "imu_strapdown",
    "imu_strapdown_self_aligned",
    "drive_strapdown",
    "drive_rotating",
)
"""Rest and motion, four sensors and three, with and without rotation, given and found attitude."""


def _as_it_is(scenario: str) -> Check:
    alignment_s = 60.0 if scenario.endswith("aligned") else 2.0
    return _check(
        f"navigation-{scenario.replace('_', '-')}",
        f"Over 20 s of `{scenario}` every output is that of the reference.",
        "firmware.md#strapdown",
        "NAV-1 TX-* OUT-2",
        _of(21.0 + alignment_s, _firmware(alignment_s=alignment_s), scenario=scenario),
    )


LONG: Final = (
    _check(
        "long-cycle",
        "Over a whole cycle of each scheme at its own rates every output is that of the reference.",
        "firmware.md#rotation-scheme",
        "AXS-1 AXS-2 NAV-1",
        _of(1610.0, u.ROTATING, rate_hz=50, position_steps=10),
        *(
            _of(seconds, u.ROTATING, _firmware(scheme=scheme), rate_hz=50, position_steps=10)
            for scheme, seconds in (
                ("8-position", 810.0),
                ("4-position", 410.0),
                ("single-axis-4-position", 410.0),
            )
        ),
    ),
    _check(
        "long-drive",
        "Over 900 s of a drive every output is that of the reference.",
        "firmware.md#strapdown",
        "NAV-1 NAV-4",
        _of(900.0, scenario="drive_rotating", rate_hz=50, position_steps=20),
    ),
    _check(
        "long-chance",
        "The same as chance, with more seeds.",
        _FRAMES_IN,
        "IN-2 IN-3",
        *(_of(60.0, _IN, rate_hz=50, stimuli=_on(d.at_random, seed)) for seed in range(10, 16)),
    ),
)
"""Only with `--long`."""

SHORT: Final = (
    *FRAMES_IN,
    *TIME,
    *MODES,
    *SENSORS,
    *AXES,
    *NAVIGATION,
    *map(_as_it_is, SCENARIOS),
)
