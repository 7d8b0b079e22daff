"""The keys of a run's summary: `run.summary`, and the object that ``--json`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, TypedDict

AnySummary = Mapping[str, Any]
"""A summary of a run, or one with further keys."""


class EastNorth(TypedDict):
    """Figures of the two horizontal axes."""

    east: float
    north: float


class MotionSummary(TypedDict):
    """Motion of the vehicle, and notes on how a recording was mended."""

    kind: str
    notes: list[str]


class StallSummary(TypedDict):
    """The machine's stall that made the firmware lose its sensors."""

    side: Literal["firmware", "hardware"]
    at_s: float
    late_ms: float


class PaperSummary(TypedDict):
    """The paper's figures for the scenario."""

    source: str
    duration_s: float
    max_abs_position_error_m: EastNorth | None
    max_abs_velocity_error_mps: EastNorth | None
    end_position_error_m: float | None


class SensorsFound(TypedDict):
    """Monitoring of one kind of redundant sensors; sensors count from 1."""

    alarm_s: float | None
    isolated_s: float | None
    sensor: int | None
    how: str | None
    excluded: list[int] | None
    repaired: float | None
    unresolved_s: float | None
    readmitted: int | None
    readmitted_s: float | None
    readmission_refused: str | None
    redundancy_left: bool


class RedundancySummary(TypedDict):
    """Monitoring of redundant sensors; None for a kind that is not redundant."""

    gyros: SensorsFound | None
    accelerometers: SensorsFound | None


class SigmaSummary(TypedDict):
    """The filter's σ at the end: roll, pitch, heading; east, north, up."""

    attitude_arcsec: list[float]
    velocity_mps: list[float]
    position_m: list[float]


class SourceSummary(TypedDict):
    """Measurements of one aiding source, and their mean normalised innovation squared."""

    used: int
    rejected: int
    nis: float | None


class EstimatorSummary(TypedDict):
    """The Kalman filter at the end, next to the truth where that is known."""

    aided_by: list[str]
    fine_alignment_s: float | None
    gate_openings: int
    sigma: SigmaSummary
    sensors: dict[str, Any]
    odometer: dict[str, Any] | None
    altimeter: dict[str, Any] | None
    sources: dict[str, SourceSummary]


class IntegritySummary(TypedDict):
    """Bounds of the error at the end; None: there is none. Shares of the time of navigation."""

    status: str
    horizontal_protection_m: float | None
    vertical_protection_m: float | None
    heading_protection_deg: float | None
    limited_by: list[str | None]
    suspected: bool
    available_share: float
    degraded_share: float


class LatenessSummary(TypedDict):
    """Lateness of a side in real time, µs."""

    epochs: int
    overruns: int
    p50: NotRequired[float]
    p99: NotRequired[float]
    p999: NotRequired[float]
    max: NotRequired[float]
    stalls: NotRequired[list[dict[str, Any]]]


class FirmwareSummary(TypedDict, total=False):
    """The firmware's own account; a program of the user's gives a part of it."""

    program: str
    mode: str
    fault: str
    epoch: int
    epochs_navigated: int
    navigation_sha256: str | None
    scheme_cycles: int
    axes_not_following: list[bool]
    axis_interruptions: list[int]
    axes_abandoned: list[bool]
    encoders: dict[str, Any]
    bridging: dict[str, Any]
    frames_received: int
    frames_sent: int
    calibration: Any
    calibrated: dict[str, Any] | None
    clock_jumps: int
    redundancy: RedundancySummary | None
    estimator: EstimatorSummary | None
    integrity: IntegritySummary | None
    faults: dict[str, int]
    lateness_us: LatenessSummary


class HardwareSummary(TypedDict, total=False):
    """The hardware's own account; a program of the user's gives a part of it."""

    epochs: int
    frames_received: int
    frames_sent: int
    faults: dict[str, int]
    wire: dict[str, Any] | None
    bus: dict[str, Any] | None
    biases: dict[str, Any]
    lateness_us: LatenessSummary


class Summary(TypedDict):
    """Results of a run, the same keys whichever way it was run.

    Errors are navigation minus truth; None where the firmware never navigated.
    """

    scenario: str
    title: str
    completed: bool
    stopped: str | None
    interface: str
    duration_s: float
    rate_hz: int
    seed: int
    initial_attitude: str
    given_attitude_error_arcsec: Sequence[float] | None
    height_channel: str
    motion: MotionSummary
    warnings: list[str]
    epochs: int
    wall_s: float
    epochs_per_s: float
    frames_lost: int | None
    overruns: int
    stall: StallSummary | None
    max_abs_velocity_error_mps: EastNorth | None
    max_abs_position_error_m: EastNorth | None
    end_position_error_m: float | None
    error_sample_interval_s: float
    navigation_sha256: str | None
    redundancy: RedundancySummary | None
    integrity: IntegritySummary | None
    estimator: EstimatorSummary | None
    paper: PaperSummary | None
    firmware: FirmwareSummary
    hardware: HardwareSummary
    speed: NotRequired[float | Literal["max"]]
    """Factor of real time; only of a rehearsal."""
