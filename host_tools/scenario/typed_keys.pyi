"""Keys of scenarios and faults as type checkers and editors read them; by `make docs`."""

from collections.abc import Sequence
from typing import Any, Literal, Required, TypedDict

from numpy.typing import NDArray

PerSensor = float | Sequence[float] | NDArray[Any]

FaultKind = Literal[
    "drop",
    "delay",
    "duplicate",
    "reorder",
    "corrupt_wire",
    "corrupt",
    "wrong_counter",
    "babble",
    "silence",
    "bus_off",
    "cut",
    "stale",
    "power_off",
    "axis_stall",
    "axis_runaway",
    "encoder_stuck",
    "encoder_offset",
    "gyro_stuck",
    "gyro_bias",
    "gyro_noise",
    "gyro_absent",
    "accelerometer_stuck",
    "accelerometer_bias",
    "accelerometer_noise",
    "accelerometer_absent",
    "gyro_ramp",
    "gyro_scale",
    "gyro_shift_u",
    "gyro_shift_v",
    "gyro_dead",
    "gyro_full_scale",
    "accelerometer_ramp",
    "accelerometer_scale",
    "accelerometer_shift_u",
    "accelerometer_shift_v",
    "accelerometer_dead",
    "accelerometer_full_scale",
    "encoder_slip",
    "odometer_slip",
    "odometer_lock",
    "odometer_lost",
    "gnss_jump",
    "gnss_pull",
    "gnss_lost",
    "altimeter_jump",
    "altimeter_pull",
]

class FaultKeys(TypedDict, total=False):
    """Keys of a fault; each kind has some."""

    for_s: float | None
    """Duration in simulated seconds.  [default: until removed] Unit: s."""
    message: str | None
    """Wire: message concerned, such as SENSOR_3.  [default: all]"""
    node: Literal["any", "firmware", "hardware"]
    """Wire: sender concerned: any, firmware or hardware.  [default: any]"""
    probability: float
    """Wire: fraction of the frames affected."""
    delay_s: float
    """s. Unit: s."""
    bit: int | None
    """bit of the payload."""
    frames_per_epoch: int
    """frames."""
    period_s: float | None
    """Hardware: intermittent, period in s. Unit: s."""
    duty: float
    """Share of the period with the fault.  [default: 0.5]"""
    axis: Literal["inner", "outer"]
    """axis: inner, outer."""
    rate_dps: float
    """°/s. Unit: °/s."""
    offset_deg: float
    """°. Unit: °."""
    sensor: int | None
    """Gyro or accelerometer that fails, from 1.  [default: all]"""
    bias_dph: float
    """°/h. Unit: °/h."""
    angle_random_walk_deg_per_sqrt_h: float
    """°/√h. Unit: °/√h."""
    bias_ug: float
    """µg. Unit: µg."""
    white_noise_ug_per_sqrt_hz: float
    """µg/√Hz. Unit: µg/√Hz."""
    bias_dph_per_min: float
    """°/h per minute."""
    scale_ppm: float
    """ppm. Unit: ppm."""
    shift_arcsec: float
    """″. Unit: ″."""
    bias_ug_per_min: float
    """µg per minute."""
    slip_percent: float
    """%."""
    direction: Literal["east", "north", "up"]
    """direction: east, north, up.  [default: east]"""
    jump_m: float
    """m. Unit: m."""
    pull_mps: float
    """m/s. Unit: m/s."""

class FaultTable(FaultKeys, total=False):
    """A fault of a scenario."""

    kind: Required[FaultKind]
    at_s: float
    """After power-on of the hardware. Unit: s."""

class SiteTable(TypedDict, total=False):
    """Keys of `Site` and of calls."""

    latitude_deg: float
    """Geodetic latitude, north positive. Unit: °."""
    longitude_deg: float
    """Longitude, east positive. Unit: °."""
    height_m: float
    """Above the ellipsoid. Unit: m."""

class BodyTable(TypedDict, total=False):
    """Keys of `Body` and of calls."""

    roll_deg: float
    """Right side down positive. Unit: °."""
    pitch_deg: float
    """Nose up positive. Unit: °."""
    heading_deg: float
    """Clockwise from north. Unit: °."""

class RimuTable(TypedDict, total=False):
    """Keys of `Rimu` and of calls."""

    geometry: Literal[
        "tetrahedron", "orthogonal", "dodecahedron", "cone", "orthogonal-plus-one", "custom"
    ]
    """A built-in arrangement of the sensors, or `custom` with the two keys below."""
    gyro_axes_deg: Sequence[Sequence[float]] | None
    """Polar angle from z and azimuth from x of each gyro's input axis. Unit: °."""
    accelerometer_axes_deg: Sequence[Sequence[float]] | None
    """The same of the accelerometers. Unit: °."""

class _SensorsTable(TypedDict, total=False):
    """Keys of `_Sensors`."""

    scale_error_ppm: PerSensor
    asymmetric_scale_error_ppm: PerSensor
    installation_u_arcsec: PerSensor
    installation_v_arcsec: PerSensor
    scale_repeatability_ppm: PerSensor
    scale_temperature_ppm_per_k: PerSensor
    bandwidth_hz: float | None
    latency_ms: float

class _GyrosKeys(TypedDict, total=False):
    """Keys of `Gyros` and of calls."""

    bias_dph: PerSensor
    """Bias b. Unit: °/h."""
    bias_repeatability_dph: PerSensor
    """Standard deviation of the bias change at each power-up. Unit: °/h."""
    bias_instability_dph: PerSensor
    """Coefficient B of IEEE 952; the floor of the Allan deviation is 0.664 B. Unit: °/h."""
    bias_temperature_dph_per_k: PerSensor
    """Temperature coefficient of the bias, see `[thermal]`. Unit: °/h/K."""
    angle_random_walk_deg_per_sqrt_h: PerSensor
    """White noise. Unit: °/√h."""
    rate_random_walk_dph_per_sqrt_h: PerSensor
    """Random walk of the bias. Unit: °/h/√h."""
    g_sensitivity_dph_per_g: PerSensor
    """Bias per g of specific force along the input axis. Unit: °/h/g."""
    dead_zone_dph: PerSensor
    """Input below this has no effect. Unit: °/h."""
    resolution_arcsec: float
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over. Unit:
    ″."""
    range_dps: float
    """Measuring range. Unit: °/s."""

class GyrosTable(_SensorsTable, _GyrosKeys, total=False):
    """Keys of `Gyros`."""

class _AccelerometersKeys(TypedDict, total=False):
    """Keys of `Accelerometers` and of calls."""

    bias_ug: PerSensor
    """Bias b. Unit: µg."""
    bias_repeatability_ug: PerSensor
    """Standard deviation of the bias change at each power-up. Unit: µg."""
    bias_instability_ug: PerSensor
    """Coefficient B of IEEE 952. Unit: µg."""
    bias_temperature_ug_per_k: PerSensor
    """Temperature coefficient of the bias, see `[thermal]`. Unit: µg/K."""
    white_noise_ug_per_sqrt_hz: PerSensor
    """White noise. Unit: µg/√Hz."""
    random_walk_ug_per_sqrt_h: PerSensor
    """Random walk of the bias. Unit: µg/√h."""
    dead_zone_ug: PerSensor
    """Input below this has no effect. Unit: µg."""
    resolution_um_per_s: float
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over. Unit:
    µm/s."""
    range_g: float
    """Measuring range. Unit: g."""
    position_x_mm: PerSensor
    """Position in the sensor frame, measured from the intersection of the table's axes: [size
    effect](error-model.md#size-effect). Unit: mm."""
    position_y_mm: PerSensor
    """The same along y. Unit: mm."""
    position_z_mm: PerSensor
    """The same along z. Unit: mm."""

class AccelerometersTable(_SensorsTable, _AccelerometersKeys, total=False):
    """Keys of `Accelerometers`."""

class ThermalTable(TypedDict, total=False):
    """Keys of `Thermal` and of calls."""

    ambient_offset_k: float
    """Ambient temperature relative to the calibration temperature. Unit: K."""
    warm_up_k: float
    """Temperature rise of the sensors after switch-on. Unit: K."""
    time_constant_s: float
    """Time constant of the warm-up. Unit: s."""

class AltimeterTable(TypedDict, total=False):
    """Keys of `Altimeter` and of calls."""

    bias_m: float
    """Constant error. Unit: m."""
    noise_m: float
    """Standard deviation. Unit: m."""
    random_walk_m_per_sqrt_h: float
    """Random walk of the bias, by the weather. Unit: m/√h."""

class OutageTable(TypedDict, total=False):
    """Keys of `Outage`."""

    at_s: float
    for_s: float

class TunnelTable(TypedDict, total=False):
    """Keys of `Tunnel`."""

    from_m: float
    to_m: float

class PeriodicTable(TypedDict, total=False):
    """Keys of `Periodic`."""

    rate_hz: int
    latency_s: float

class _GnssReceiverKeys(TypedDict, total=False):
    """Keys of `GnssReceiver` and of calls."""

    position_noise_m: float
    """Standard deviation of each component. Unit: m."""
    velocity_noise_mps: float
    """Standard deviation of each component. Unit: m/s."""
    position_correlated_noise_m: float
    """Standard deviation of each component's time-correlated error. Unit: m."""
    position_correlation_s: float
    """Its time constant. Unit: s."""

class GnssReceiverTable(PeriodicTable, _GnssReceiverKeys, total=False):
    """Keys of `GnssReceiver`."""

    rate_hz: int
    latency_s: float
    lever_arm_m: Sequence[float]

class _GnssKeys(TypedDict, total=False):
    """Keys of `Gnss` and of calls."""

    tunnels: Sequence[TunnelTable]
    """Stretches of the route without a fix: `[{ from_m = 1200, to_m = 1500 }]`, distance driven
    since the motion began."""
    tunnel_map: str | None
    """No fix inside its polygons or on its lines."""
    tunnel_width_m: float
    """Width of the lines. Unit: m."""

class GnssTable(GnssReceiverTable, _GnssKeys, total=False):
    """Keys of `Gnss`."""

    outages: Sequence[OutageTable]

class _OdometerKeys(TypedDict, total=False):
    """Keys of `Odometer` and of calls."""

    pulse_mm: float
    """Nominal distance per pulse, which the firmware uses. Unit: mm."""
    noise_mps: float
    """Standard deviation of the mean speed over an interval while the wheel turns. Unit: m/s."""
    mounting_heading_deg: float
    """Heading of the vehicle's forward axis in the body frame, clockwise. Unit: °."""
    mounting_pitch_deg: float
    """Its pitch, upwards. Unit: °."""

class OdometerTable(PeriodicTable, _OdometerKeys, total=False):
    """Keys of `Odometer`."""

    rate_hz: int
    latency_s: float
    scale_error_ppm: float
    lever_arm_m: Sequence[float]

class MasterTable(PeriodicTable, total=False):
    """Keys of `Master`."""

    rate_hz: int
    latency_s: float
    outages: Sequence[OutageTable]

class AxisTable(TypedDict, total=False):
    """Keys of `Axis`."""

    rate_limit_dps: float
    acceleration_limit_dps2: float
    jerk_limit_dps3: float | None
    encoder_bits: int
    encoder_offset_deg: float
    ripple_arcsec: float
    ripple_per_turn: float
    stiction_arcsec: float
    run_out_um: float

class TurntableTable(TypedDict, total=False):
    """Keys of `Turntable` and of calls."""

    inner: AxisTable
    """Limits, encoder and imperfections of one axis of the turntable."""
    outer: AxisTable
    """Limits, encoder and imperfections of one axis of the turntable."""
    non_orthogonality_arcsec: float
    """Deviation of the axes from a right angle. Unit: ″."""
    wobble_arcsec: float
    """Wobble of the inner axis as it turns. Unit: ″."""
    wobble_per_turn: float
    """Wobble periods per turn."""

class _MotionKeys(TypedDict, total=False):
    """Keys of `Motion` and of calls."""

    begins_s: float | None
    """When it begins, after power-on of the hardware; negative: it is under way by then. Default:
    with navigation. Unit: s."""
    wave_spectrum: Literal["jonswap", "pierson-moskowitz"]
    """A developing sea (peak factor 3.3), or a fully developed one."""
    wave_height_m: float
    """Significant wave height. Unit: m."""
    wave_period_s: float
    """Period of the spectrum's peak. Unit: s."""
    wave_from_deg: float
    """Where the waves come from, clockwise from the bow. Unit: °."""
    roll_period_s: float
    """Natural period of the ship's roll. Unit: s."""
    path: str | None
    """The recording: .csv or .pos, relative to the scenario's folder."""
    irregularities: Literal["mend", "refuse"]
    """How to treat gaps, jumps, wrong timestamps and unreadable lines."""
    speed_limit_mps: float
    """Speed above which the recording must be wrong. Unit: m/s."""
    jerk_density_mps3_per_sqrt_hz: float
    """Agility of the recorded vehicle: a larger value follows the file more closely. Unit: Hz."""
    position_deviation_m: float
    """Standard deviation of positions, where the file does not give it. Unit: m."""
    velocity_deviation_mps: float
    """Likewise for velocities. Unit: m/s."""
    attitude_deviation_deg: float
    """Likewise for angles. Unit: °."""

class MotionTable(_MotionKeys, total=False):
    """Keys of `Motion`."""

    kind: Literal["stationary", "drive", "sway", "file"]
    duration_s: float | None
    seed: int

class TurnTable(TypedDict, total=False):
    """Keys of `Turn`."""

    axis: Literal["inner", "outer"]
    angle_deg: float

class KeysTable(TypedDict, total=False):
    """Keys of `Keys` and of calls."""

    initial_attitude: Literal[
        "given", "self-aligned", "self-aligned-swaying", "self-aligned-moving", "transferred"
    ]
    """Self-aligned at standstill, of a vehicle that sways about its place, or one that moves and
    has GNSS. Transferred: another unit's, with velocity and position, also of a vehicle that
    moves."""
    alignment_s: float
    """Length of the alignment; of a vehicle that sways or moves its minimum. Unit: s."""
    height_channel: Literal["held", "damped", "free"]
    """`damped` follows the altimeter, or the initial height if there is none."""
    bridge_s: float
    """Longest gap in the sensor data that is bridged. Unit: s."""
    follow_tolerance_deg: float
    """Permitted distance between an axis and its expected angle. Unit: °."""
    axis_silence_s: float
    """Longest permitted silence of an axis. Unit: s."""
    gyro_consistency_dph: float
    """Permitted disagreement between redundant gyros. Unit: °/h."""
    accelerometer_consistency_ug: float
    """The same of accelerometers. Unit: µg."""

class _FirmwareKeys(TypedDict, total=False):
    """Keys of `Firmware` and of calls."""

    roll_error_arcsec: float
    """Of the given or transferred attitude, as are all of these errors: given minus true. Unit:
    ″."""
    pitch_error_arcsec: float
    """Nose up positive. Unit: ″."""
    heading_error_arcsec: float
    """Clockwise positive. Unit: ″."""
    level_error_sigma_arcsec: float
    """Standard deviation of what a run draws for roll and pitch, on top. Unit: ″."""
    heading_error_sigma_arcsec: float
    """The same of the heading. Unit: ″."""
    velocity_error_sigma_mps: float
    """The same of each component of a transferred velocity. Unit: m/s."""
    position_error_sigma_m: float
    """The same of each component of a transferred position. Unit: m."""
    calibration: str | None
    """TOML file of calibrated errors, relative to the scenario's folder."""
    scheme: (
        Literal["16-position", "8-position", "4-position", "single-axis-4-position", "calibration"]
        | Sequence[TurnTable]
    )
    """Rotation scheme: a built-in one, or its turns."""
    turn_rate_dps: float
    """Commanded rate of the axes. Unit: °/s."""
    stand_s: float
    """Time at rest after each turn. Unit: s."""
    isolate_heading: bool
    """Whether the inner axis takes the vehicle's turn out, too."""
    gyro_weights: PerSensor
    """Of the fusion: 1/σ² of the gyros up to a common factor. Paper, (54)."""
    accelerometer_weights: PerSensor
    """The same of the accelerometers."""
    clock_error_ppm: float
    """How much the firmware's own clock runs fast. Unit: ppm."""

class FirmwareTable(KeysTable, _FirmwareKeys, total=False):
    """Keys of `Firmware`."""

class ReadmissionTable(TypedDict, total=False):
    """Keys of `Readmission`."""

    at_s: float
    kind: Literal["gyro", "accelerometer"]
    sensor: int
    test_s: int
    anew: bool

class _RedundancyKeys(TypedDict, total=False):
    """Keys of `Redundancy` and of calls."""

    false_alarms_per_1000_h: float
    """The promise from which, with the sensors' data sheet, the thresholds follow."""
    readmit: Sequence[ReadmissionTable]
    """Sensors to take back into use, in order of time."""

class RedundancyTable(_RedundancyKeys, total=False):
    """Keys of `Redundancy`."""

    enabled: bool

class _EstimatorKeys(TypedDict, total=False):
    """Keys of `Estimator` and of calls."""

    fine_alignment_s: float
    """Between the alignment and navigation, while the table turns; 0: none. Unit: s."""
    constants: bool | None
    """Estimate scale factors, asymmetries and installation errors, too, not only biases. By default
    where asymmetries are large."""
    heading_sigma_enough_arcsec: float
    """Ends the fine alignment before its time once the heading is known this well; 0: never. Unit:
    ″."""
    zero_velocity_sigma_mps: float
    """Of the velocity of a vehicle that stands, each component. Unit: m/s."""
    detects_standing: bool
    """Find standing by the sensors themselves, and take it for zero velocity."""
    position_sigma_m: float
    """Of the position where navigation begins, each component. Unit: m."""
    gate: float
    """Standard deviations beyond which a measurement is not used."""
    level_sigma_arcsec: float | None
    """Of a given roll and pitch; by default what `[firmware]` draws for them. Unit: ″."""
    heading_sigma_arcsec: float | None
    """Of a given heading; by default what `[firmware]` draws for it. Unit: ″."""

class EstimatorTable(_EstimatorKeys, total=False):
    """Keys of `Estimator`."""

    enabled: bool

class IntegritySettingsTable(TypedDict, total=False):
    """Keys of `IntegritySettings` and of calls."""

    risk_per_h: float
    """Probability per hour of an error beyond its bound."""
    horizontal_alert_m: float
    """A larger bound makes the navigation not available. 556 m: 0.3 miles, as of RNP 0.3. Unit:
    m."""
    vertical_alert_m: float
    """The same of the height, where the filter estimates it. 50 m: as of APV-I. Unit: m."""
    heading_alert_deg: float
    """The same of the heading. Unit: °."""
    gyro_faults_per_h: float
    """Of each gyro."""
    accelerometer_faults_per_h: float
    """Of each accelerometer."""
    gnss_faults_per_h: float
    """Wrong fixes that the receiver does not notice. Below 1e-11 only what the innovations show
    counts; 1e-7 also covers what they would not, and makes the bound several times as large."""
    odometer_faults_per_h: float
    """Changes of its scale: slip, another tyre."""
    altimeter_faults_per_h: float
    """Changes of its bias beyond those of the weather; that it drifts is a thousandth of that."""
    common_faults_per_h: float
    """Of the scale of all gyros, or of all accelerometers, alike, and of their biases: by a supply,
    or the temperature. 1e-8: a few hundredths, as of IEC 61508-6, of a sensor's own changes."""

class IntegrityTable(IntegritySettingsTable, total=False):
    """Keys of `Integrity`."""

    enabled: bool

class XcpSettingsTable(TypedDict, total=False):
    """Keys of `XcpSettings` and of calls."""

    frames_hz: int
    """Most frames of XCP that the navigation computer sends in a second, responses and measured
    data. Unit: Hz."""

class XcpTable(XcpSettingsTable, total=False):
    """Keys of `Xcp`."""

class ZeroVelocityTable(TypedDict, total=False):
    """Keys of `ZeroVelocity`."""

    at_s: float
    for_s: float
    velocity_sigma_mps: float

class OperatorRequestTable(TypedDict, total=False):
    """Keys of `OperatorRequest`."""

    at_s: float
    request: Literal["STANDBY", "ALIGN", "NAVIGATE_STRAPDOWN", "NAVIGATE_ROTATING"]

class EastNorthTable(TypedDict, total=False):
    """Keys of `EastNorth`."""

    east: float
    north: float

class PaperTable(TypedDict, total=False):
    """Keys of `Paper`."""

    source: str
    duration_s: float | None
    max_abs_position_error_m: EastNorthTable | None
    max_abs_velocity_error_mps: EastNorthTable | None
    end_position_error_m: float | None

class BusTable(TypedDict, total=False):
    """Keys of `Bus`."""

    bitrate: Literal[125000, 250000, 500000, 1000000] | None

class _Paths(TypedDict, total=False):
    """Keys with their tables."""

    site__latitude_deg: float
    site__longitude_deg: float
    site__height_m: float
    body__roll_deg: float
    body__pitch_deg: float
    body__heading_deg: float
    rimu__geometry: Literal[
        "tetrahedron", "orthogonal", "dodecahedron", "cone", "orthogonal-plus-one", "custom"
    ]
    rimu__gyro_axes_deg: Sequence[Sequence[float]] | None
    rimu__accelerometer_axes_deg: Sequence[Sequence[float]] | None
    gyros__scale_error_ppm: PerSensor
    gyros__asymmetric_scale_error_ppm: PerSensor
    gyros__installation_u_arcsec: PerSensor
    gyros__installation_v_arcsec: PerSensor
    gyros__scale_repeatability_ppm: PerSensor
    gyros__scale_temperature_ppm_per_k: PerSensor
    gyros__bandwidth_hz: float | None
    gyros__latency_ms: float
    gyros__bias_dph: PerSensor
    gyros__bias_repeatability_dph: PerSensor
    gyros__bias_instability_dph: PerSensor
    gyros__bias_temperature_dph_per_k: PerSensor
    gyros__angle_random_walk_deg_per_sqrt_h: PerSensor
    gyros__rate_random_walk_dph_per_sqrt_h: PerSensor
    gyros__g_sensitivity_dph_per_g: PerSensor
    gyros__dead_zone_dph: PerSensor
    gyros__resolution_arcsec: float
    gyros__range_dps: float
    accelerometers__scale_error_ppm: PerSensor
    accelerometers__asymmetric_scale_error_ppm: PerSensor
    accelerometers__installation_u_arcsec: PerSensor
    accelerometers__installation_v_arcsec: PerSensor
    accelerometers__scale_repeatability_ppm: PerSensor
    accelerometers__scale_temperature_ppm_per_k: PerSensor
    accelerometers__bandwidth_hz: float | None
    accelerometers__latency_ms: float
    accelerometers__bias_ug: PerSensor
    accelerometers__bias_repeatability_ug: PerSensor
    accelerometers__bias_instability_ug: PerSensor
    accelerometers__bias_temperature_ug_per_k: PerSensor
    accelerometers__white_noise_ug_per_sqrt_hz: PerSensor
    accelerometers__random_walk_ug_per_sqrt_h: PerSensor
    accelerometers__dead_zone_ug: PerSensor
    accelerometers__resolution_um_per_s: float
    accelerometers__range_g: float
    accelerometers__position_x_mm: PerSensor
    accelerometers__position_y_mm: PerSensor
    accelerometers__position_z_mm: PerSensor
    thermal__ambient_offset_k: float
    thermal__warm_up_k: float
    thermal__time_constant_s: float
    altimeter__bias_m: float
    altimeter__noise_m: float
    altimeter__random_walk_m_per_sqrt_h: float
    gnss__rate_hz: int
    gnss__latency_s: float
    gnss__position_noise_m: float
    gnss__velocity_noise_mps: float
    gnss__position_correlated_noise_m: float
    gnss__position_correlation_s: float
    gnss__lever_arm_m: Sequence[float]
    gnss__outages: Sequence[OutageTable]
    gnss__tunnels: Sequence[TunnelTable]
    gnss__tunnel_map: str | None
    gnss__tunnel_width_m: float
    odometer__rate_hz: int
    odometer__latency_s: float
    odometer__pulse_mm: float
    odometer__scale_error_ppm: float
    odometer__noise_mps: float
    odometer__mounting_heading_deg: float
    odometer__mounting_pitch_deg: float
    odometer__lever_arm_m: Sequence[float]
    master__rate_hz: int
    master__latency_s: float
    master__outages: Sequence[OutageTable]
    turntable__inner: AxisTable
    turntable__inner__rate_limit_dps: float
    turntable__inner__acceleration_limit_dps2: float
    turntable__inner__jerk_limit_dps3: float | None
    turntable__inner__encoder_bits: int
    turntable__inner__encoder_offset_deg: float
    turntable__inner__ripple_arcsec: float
    turntable__inner__ripple_per_turn: float
    turntable__inner__stiction_arcsec: float
    turntable__inner__run_out_um: float
    turntable__outer: AxisTable
    turntable__outer__rate_limit_dps: float
    turntable__outer__acceleration_limit_dps2: float
    turntable__outer__jerk_limit_dps3: float | None
    turntable__outer__encoder_bits: int
    turntable__outer__encoder_offset_deg: float
    turntable__outer__ripple_arcsec: float
    turntable__outer__ripple_per_turn: float
    turntable__outer__stiction_arcsec: float
    turntable__outer__run_out_um: float
    turntable__non_orthogonality_arcsec: float
    turntable__wobble_arcsec: float
    turntable__wobble_per_turn: float
    motion__kind: Literal["stationary", "drive", "sway", "file"]
    motion__duration_s: float | None
    motion__begins_s: float | None
    motion__seed: int
    motion__wave_spectrum: Literal["jonswap", "pierson-moskowitz"]
    motion__wave_height_m: float
    motion__wave_period_s: float
    motion__wave_from_deg: float
    motion__roll_period_s: float
    motion__path: str | None
    motion__irregularities: Literal["mend", "refuse"]
    motion__speed_limit_mps: float
    motion__jerk_density_mps3_per_sqrt_hz: float
    motion__position_deviation_m: float
    motion__velocity_deviation_mps: float
    motion__attitude_deviation_deg: float
    firmware__initial_attitude: Literal[
        "given", "self-aligned", "self-aligned-swaying", "self-aligned-moving", "transferred"
    ]
    firmware__alignment_s: float
    firmware__height_channel: Literal["held", "damped", "free"]
    firmware__bridge_s: float
    firmware__follow_tolerance_deg: float
    firmware__axis_silence_s: float
    firmware__gyro_consistency_dph: float
    firmware__accelerometer_consistency_ug: float
    firmware__roll_error_arcsec: float
    firmware__pitch_error_arcsec: float
    firmware__heading_error_arcsec: float
    firmware__level_error_sigma_arcsec: float
    firmware__heading_error_sigma_arcsec: float
    firmware__velocity_error_sigma_mps: float
    firmware__position_error_sigma_m: float
    firmware__calibration: str | None
    firmware__scheme: (
        Literal["16-position", "8-position", "4-position", "single-axis-4-position", "calibration"]
        | Sequence[TurnTable]
    )
    firmware__turn_rate_dps: float
    firmware__stand_s: float
    firmware__isolate_heading: bool
    firmware__gyro_weights: PerSensor
    firmware__accelerometer_weights: PerSensor
    firmware__clock_error_ppm: float
    redundancy__enabled: bool
    redundancy__false_alarms_per_1000_h: float
    redundancy__readmit: Sequence[ReadmissionTable]
    estimator__enabled: bool
    estimator__fine_alignment_s: float
    estimator__constants: bool | None
    estimator__heading_sigma_enough_arcsec: float
    estimator__zero_velocity_sigma_mps: float
    estimator__detects_standing: bool
    estimator__position_sigma_m: float
    estimator__gate: float
    estimator__level_sigma_arcsec: float | None
    estimator__heading_sigma_arcsec: float | None
    integrity__risk_per_h: float
    integrity__horizontal_alert_m: float
    integrity__vertical_alert_m: float
    integrity__heading_alert_deg: float
    integrity__gyro_faults_per_h: float
    integrity__accelerometer_faults_per_h: float
    integrity__gnss_faults_per_h: float
    integrity__odometer_faults_per_h: float
    integrity__altimeter_faults_per_h: float
    integrity__common_faults_per_h: float
    integrity__enabled: bool
    xcp__frames_hz: int
    paper__source: str
    paper__duration_s: float | None
    paper__max_abs_position_error_m: EastNorthTable | None
    paper__max_abs_position_error_m__east: float
    paper__max_abs_position_error_m__north: float
    paper__max_abs_velocity_error_mps: EastNorthTable | None
    paper__max_abs_velocity_error_mps__east: float
    paper__max_abs_velocity_error_mps__north: float
    paper__end_position_error_m: float | None
    bus__bitrate: Literal[125000, 250000, 500000, 1000000] | None

class SharedKeys(
    _Paths,
    SiteTable,
    BodyTable,
    RimuTable,
    _GyrosKeys,
    _AccelerometersKeys,
    ThermalTable,
    AltimeterTable,
    _GnssReceiverKeys,
    _GnssKeys,
    _OdometerKeys,
    TurntableTable,
    _MotionKeys,
    KeysTable,
    _FirmwareKeys,
    _RedundancyKeys,
    _EstimatorKeys,
    IntegritySettingsTable,
    XcpSettingsTable,
    total=False,
):
    """Keywords of every call that takes a scenario."""

    title: str
    """Heading of the table and the plots."""
    mode: Literal["strapdown", "rotating"]
    """Navigation that the operator asks for, unless `operator` says otherwise."""
    rate_hz: int
    """Epochs per second; the period is a whole number of ns. Unit: Hz."""
    navigate_at_s: float
    """When the operator asks for navigation, unless `operator` says otherwise. Unit: s."""
    site: SiteTable
    """Where the vehicle stands, on WGS-84."""
    body: BodyTable
    """The vehicle's attitude."""
    rimu: RimuTable
    """Design directions of the input axes: a built-in geometry, or angles for each kind."""
    sensors: str | None
    """Preset that the keys of `gyros` and `accelerometers` are changes to."""
    gyros: GyrosTable
    """Errors of the gyros. Paper, (16)."""
    accelerometers: AccelerometersTable
    """Errors of the accelerometers. Paper, (17)."""
    thermal: ThermalTable
    """Temperature of the sensors above that of their calibration."""
    altimeter: AltimeterTable | None
    """A barometric altimeter; fitted if the table is present."""
    gnss: GnssTable | None
    """A GNSS receiver, and where it has no fix; fitted if the table is present."""
    odometer: OdometerTable | None
    """An odometer; fitted if the table is present."""
    master: MasterTable | None
    """The master unit of a transferred start."""
    turntable: TurntableTable
    """The two axes, and their alignment to each other."""
    motion: MotionTable
    """The vehicle's motion since navigation began."""
    firmware: FirmwareTable
    """Settings of the navigation computer."""
    redundancy: RedundancyTable
    """The firmware's use of redundant sensors."""
    estimator: EstimatorTable
    """The firmware's error-state Kalman filter."""
    integrity: IntegrityTable
    """Bounds of the navigation's error for a stated risk, and the rates of faults they assume."""
    xcp: XcpTable | None
    """The measurement and calibration protocol XCP of the firmware."""
    zero_velocity: Sequence[ZeroVelocityTable]
    """Times in which the operator says that the vehicle stands."""
    operator: Sequence[OperatorRequestTable]
    """Modes that the operator requests, in order of time."""
    paper: PaperTable | None
    """The paper's figures for the same run, for comparison."""
    bus: BusTable
    """The wire between the two sides."""
    gyro_scale_error_ppm: PerSensor
    """Symmetric scale factor error λ. Unit: ppm."""
    gyro_asymmetric_scale_error_ppm: PerSensor
    """Asymmetric scale factor error μ: added for positive input, subtracted for negative. Unit:
    ppm."""
    gyro_installation_u_arcsec: PerSensor
    """Installation error δu. Unit: ″."""
    gyro_installation_v_arcsec: PerSensor
    """Installation error δv. Unit: ″."""
    gyro_scale_repeatability_ppm: PerSensor
    """Standard deviation of the scale factor's change at each power-up. Unit: ppm."""
    gyro_scale_temperature_ppm_per_k: PerSensor
    """Temperature coefficient of the scale factor, see `[thermal]`. Unit: ppm/K."""
    gyro_bandwidth_hz: float | None
    """-3 dB, first order. Unit: Hz."""
    gyro_latency_ms: float
    """Delay of the output. Unit: ms."""
    gyro_bias_dph: PerSensor
    """Bias b. Unit: °/h."""
    gyro_bias_repeatability_dph: PerSensor
    """Standard deviation of the bias change at each power-up. Unit: °/h."""
    gyro_bias_instability_dph: PerSensor
    """Coefficient B of IEEE 952; the floor of the Allan deviation is 0.664 B. Unit: °/h."""
    gyro_bias_temperature_dph_per_k: PerSensor
    """Temperature coefficient of the bias, see `[thermal]`. Unit: °/h/K."""
    gyro_angle_random_walk_deg_per_sqrt_h: PerSensor
    """White noise. Unit: °/√h."""
    gyro_rate_random_walk_dph_per_sqrt_h: PerSensor
    """Random walk of the bias. Unit: °/h/√h."""
    gyro_g_sensitivity_dph_per_g: PerSensor
    """Bias per g of specific force along the input axis. Unit: °/h/g."""
    gyro_dead_zone_dph: PerSensor
    """Input below this has no effect. Unit: °/h."""
    gyro_resolution_arcsec: float
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over. Unit:
    ″."""
    gyro_range_dps: float
    """Measuring range. Unit: °/s."""
    accelerometer_scale_error_ppm: PerSensor
    """Symmetric scale factor error λ. Unit: ppm."""
    accelerometer_asymmetric_scale_error_ppm: PerSensor
    """Asymmetric scale factor error μ: added for positive input, subtracted for negative. Unit:
    ppm."""
    accelerometer_installation_u_arcsec: PerSensor
    """Installation error δu. Unit: ″."""
    accelerometer_installation_v_arcsec: PerSensor
    """Installation error δv. Unit: ″."""
    accelerometer_scale_repeatability_ppm: PerSensor
    """Standard deviation of the scale factor's change at each power-up. Unit: ppm."""
    accelerometer_scale_temperature_ppm_per_k: PerSensor
    """Temperature coefficient of the scale factor, see `[thermal]`. Unit: ppm/K."""
    accelerometer_bandwidth_hz: float | None
    """-3 dB, first order. Unit: Hz."""
    accelerometer_latency_ms: float
    """Delay of the output. Unit: ms."""
    accelerometer_bias_ug: PerSensor
    """Bias b. Unit: µg."""
    accelerometer_bias_repeatability_ug: PerSensor
    """Standard deviation of the bias change at each power-up. Unit: µg."""
    accelerometer_bias_instability_ug: PerSensor
    """Coefficient B of IEEE 952. Unit: µg."""
    accelerometer_bias_temperature_ug_per_k: PerSensor
    """Temperature coefficient of the bias, see `[thermal]`. Unit: µg/K."""
    accelerometer_white_noise_ug_per_sqrt_hz: PerSensor
    """White noise. Unit: µg/√Hz."""
    accelerometer_random_walk_ug_per_sqrt_h: PerSensor
    """Random walk of the bias. Unit: µg/√h."""
    accelerometer_dead_zone_ug: PerSensor
    """Input below this has no effect. Unit: µg."""
    accelerometer_resolution_um_per_s: float
    """The sensor's own quantisation step, if coarser than the frame's; remainders carry over. Unit:
    µm/s."""
    accelerometer_range_g: float
    """Measuring range. Unit: g."""
    accelerometer_position_x_mm: PerSensor
    """Position in the sensor frame, measured from the intersection of the table's axes: [size
    effect](error-model.md#size-effect). Unit: mm."""
    accelerometer_position_y_mm: PerSensor
    """The same along y. Unit: mm."""
    accelerometer_position_z_mm: PerSensor
    """The same along z. Unit: mm."""

class TimedKeys(SharedKeys, total=False):
    """The same, with the duration."""

    duration_s: float
    """How long it navigates. Unit: s."""

class RunKeys(TimedKeys, total=False):
    """The same, with all that a run needs."""

    seed: int
    """Of all noise, and of what is drawn at each power-up."""
    faults: Sequence[FaultTable]
    """Faults of the hardware and on the wire."""

class ScenarioKeys(RunKeys, total=False):
    """All keys of a scenario as keywords."""

    kind: Literal["stationary", "drive", "sway", "file"]
    """`drive`: a synthetic car; `sway`: a ship in waves; `file`: a recording."""
    bitrate: Literal[125000, 250000, 500000, 1000000] | None
    """bit/s. Models the timing of the wire; without it the wire is ideal and takes no time."""
