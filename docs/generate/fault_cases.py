"""The faults that the page `docs/faults.md` shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Case:
    """A fault to be observed.

    Attributes
    ----------
    injected : str
        In words.
    fault : dict
        As in a scenario's `[[faults]]`, without `at_s`.
    modelled : bool
        Whether the wire's timing is modelled.
    """

    injected: str
    fault: dict[str, Any]
    modelled: bool = False


ON_WIRE = (
    Case("SENSOR_3 lost for 5 s", {"kind": "drop", "message": "SENSOR_3", "for_s": 5}),
    Case("1 % of all frames lost", {"kind": "drop", "probability": 0.01}),
    Case("SENSOR_2 10 ms late for 1 s", {"kind": "delay", "message": "SENSOR_2", "for_s": 1}),
    Case("every frame twice for 5 s", {"kind": "duplicate", "for_s": 5}),
    Case("every epoch's frames reordered for 5 s", {"kind": "reorder", "for_s": 5}),
    Case(
        "an error frame in every epoch for 5 s", {"kind": "corrupt_wire", "for_s": 5}, modelled=True
    ),
    Case(
        "SENSOR_1 with a bit error that passes CRC-15, for 5 s",
        {"kind": "corrupt", "message": "SENSOR_1", "for_s": 5},
    ),
    Case(
        "10 % of all frames with a bit error that passes CRC-15",
        {"kind": "corrupt", "probability": 0.1},
    ),
    Case(
        "SENSOR_4 with a wrong counter for 5 s",
        {"kind": "wrong_counter", "message": "SENSOR_4", "for_s": 5},
    ),
    Case(
        "SENSOR_1 repeats an old frame for 5 s",
        {"kind": "stale", "message": "SENSOR_1", "for_s": 5},
    ),
    Case("SYNC lost for 5 s", {"kind": "drop", "message": "SYNC", "for_s": 5}),
    Case("hardware silent for 50 ms", {"kind": "silence", "node": "hardware", "for_s": 0.05}),
    Case("hardware silent for 1 s", {"kind": "silence", "node": "hardware", "for_s": 1}),
    Case(
        "inner encoder silent for 5 s",
        {"kind": "silence", "message": "AXIS_INNER_STATUS", "for_s": 5},
    ),
    Case("firmware silent for 5 s", {"kind": "silence", "node": "firmware", "for_s": 5}),
    Case(
        "a node babbles, 8 frames per epoch",
        {"kind": "babble", "frames_per_epoch": 8},
        modelled=True,
    ),
    Case(
        "a node babbles, 40 frames per epoch for 1 s",
        {"kind": "babble", "frames_per_epoch": 40, "for_s": 1},
        modelled=True,
    ),
    Case("hardware bus-off", {"kind": "bus_off", "node": "hardware", "for_s": 0.02}, modelled=True),
    Case("firmware bus-off", {"kind": "bus_off", "node": "firmware", "for_s": 0.02}, modelled=True),
    Case("bus cut for 50 ms", {"kind": "cut", "for_s": 0.05}, modelled=True),
    Case("bus cut for 1 s", {"kind": "cut", "for_s": 1}, modelled=True),
    Case("no power for 0.3 s", {"kind": "power_off", "for_s": 0.3}),
)
"""On the wire."""

OF_HARDWARE = (
    Case("inner axis stalls for 3 s", {"kind": "axis_stall", "axis": "inner", "for_s": 3}),
    Case("inner axis stalls permanently", {"kind": "axis_stall", "axis": "inner"}),
    Case(
        "outer axis runs away at 5 °/s for 5 s",
        {"kind": "axis_runaway", "axis": "outer", "rate_dps": 5, "for_s": 5},
    ),
    Case(
        "inner encoder repeats its last angle for 5 s",
        {"kind": "encoder_stuck", "axis": "inner", "for_s": 5},
    ),
    Case("inner encoder jumps by 1°", {"kind": "encoder_offset", "axis": "inner", "offset_deg": 1}),
    Case(
        "inner encoder jumps by 10°", {"kind": "encoder_offset", "axis": "inner", "offset_deg": 10}
    ),
    Case(
        "inner encoder slips by 1 %", {"kind": "encoder_slip", "axis": "inner", "slip_percent": 1}
    ),
    Case("gyro 2 repeats its last increment", {"kind": "gyro_stuck", "sensor": 2}),
    Case("gyro 2 biased by 10 °/h", {"kind": "gyro_bias", "sensor": 2, "bias_dph": 10}),
    Case(
        "gyro 2 noisy, 1 °/√h",
        {"kind": "gyro_noise", "sensor": 2, "angle_random_walk_deg_per_sqrt_h": 1},
    ),
    Case(
        "gyro 2 drifts, 600 °/h per minute",
        {"kind": "gyro_ramp", "sensor": 2, "bias_dph_per_min": 600},
    ),
    Case("gyro 2 scales 1 % too high", {"kind": "gyro_scale", "sensor": 2, "scale_ppm": 10_000}),
    Case(
        "gyro 2 turns in its mount, δu of 5′",
        {"kind": "gyro_shift_u", "sensor": 2, "shift_arcsec": 300},
    ),
    Case(
        "gyro 2 turns in its mount, δv of 5′",
        {"kind": "gyro_shift_v", "sensor": 2, "shift_arcsec": 300},
    ),
    Case("gyro 2 reads zero", {"kind": "gyro_dead", "sensor": 2}),
    Case("gyro 2 at full scale", {"kind": "gyro_full_scale", "sensor": 2}),
    Case("gyro 2 absent for 5 s", {"kind": "gyro_absent", "sensor": 2, "for_s": 5}),
    Case("all gyros absent for 1 s", {"kind": "gyro_absent", "for_s": 1}),
    Case(
        "accelerometer 3 repeats its last increment for 5 s",
        {"kind": "accelerometer_stuck", "sensor": 3, "for_s": 5},
    ),
    Case(
        "accelerometer 3 biased by 1000 µg",
        {"kind": "accelerometer_bias", "sensor": 3, "bias_ug": 1000},
    ),
    Case(
        "accelerometer 3 noisy, 1000 µg/√Hz",
        {"kind": "accelerometer_noise", "sensor": 3, "white_noise_ug_per_sqrt_hz": 1000},
    ),
    Case(
        "accelerometer 3 drifts, 1000 µg per minute",
        {"kind": "accelerometer_ramp", "sensor": 3, "bias_ug_per_min": 1000},
    ),
    Case(
        "accelerometer 3 scales 1 % too high",
        {"kind": "accelerometer_scale", "sensor": 3, "scale_ppm": 10_000},
    ),
    Case(
        "accelerometer 3 turns in its mount, δu of 5′",
        {"kind": "accelerometer_shift_u", "sensor": 3, "shift_arcsec": 300},
    ),
    Case(
        "accelerometer 3 turns in its mount, δv of 5′",
        {"kind": "accelerometer_shift_v", "sensor": 3, "shift_arcsec": 300},
    ),
    Case("accelerometer 3 reads zero", {"kind": "accelerometer_dead", "sensor": 3}),
    Case("accelerometer 3 at full scale", {"kind": "accelerometer_full_scale", "sensor": 3}),
    Case(
        "accelerometer 3 absent for 5 s", {"kind": "accelerometer_absent", "sensor": 3, "for_s": 5}
    ),
    Case("odometer slips by 10 %", {"kind": "odometer_slip", "slip_percent": 10}),
    Case("odometer locked", {"kind": "odometer_lock"}),
    Case("odometer does not count for 5 s", {"kind": "odometer_lost", "for_s": 5}),
    Case("GNSS jumps by 100 m", {"kind": "gnss_jump", "jump_m": 100}),
    Case("GNSS pulled at 1 m/s to the north", {"kind": "gnss_pull", "direction": "north"}),
    Case("no GNSS fix for 30 s", {"kind": "gnss_lost", "for_s": 30}),
    Case("the altimeter reads 100 m too high", {"kind": "altimeter_jump"}),
    Case("the altimeter drifts away at 1 m/s", {"kind": "altimeter_pull"}),
)
"""In the hardware itself."""
