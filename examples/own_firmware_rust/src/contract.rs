//! The bus contract: identifiers, signals, end-to-end protection (`docs/bus-contract.md`).

/// A frame; byte 0 of its data is the lowest of `data`.
#[derive(Clone, Copy)]
pub struct Frame {
    pub id: u32,
    pub length: u8,
    pub data: u64,
    /// When it came, by this computer's clock.
    pub at_ns: i64,
}

/// Where a signal lies in a frame, and what its bits mean.
pub struct Signal {
    start: u32,
    bits: u32,
    is_signed: bool,
    scale: f64,
    largest: f64,
}

impl Signal {
    const fn unsigned(start: u32, bits: u32, scale: f64) -> Self {
        Self { start, bits, is_signed: false, scale, largest: f64::INFINITY }
    }

    const fn signed(start: u32, bits: u32, scale: f64) -> Self {
        Self { start, bits, is_signed: true, scale, largest: f64::INFINITY }
    }

    /// The same with a range smaller than its bits allow, on both sides of 0.
    const fn within(self, largest: f64) -> Self {
        Self { largest, ..self }
    }

    pub const fn raw(&self, data: u64) -> i64 {
        let high = data << (64 - self.start - self.bits);
        let down = 64 - self.bits;
        if self.is_signed { high as i64 >> down } else { (high >> down) as i64 }
    }

    pub fn value(&self, data: u64) -> f64 {
        self.raw(data) as f64 * self.scale
    }

    /// The bits of a raw value; what does not fit wraps.
    pub const fn wrapped(&self, raw: i64) -> u64 {
        ((raw as u64) << (64 - self.bits)) >> (64 - self.bits - self.start)
    }

    /// The bits of a value, rounded and limited to the signal's range.
    pub fn bits(&self, value: f64) -> u64 {
        let steps = 1_i64 << (self.bits - u32::from(self.is_signed));
        let lowest = if self.is_signed { -steps } else { 0 };
        let value = value.max(-self.largest).min(self.largest);
        let raw = (value / self.scale).round_ties_even().max(lowest as f64).min((steps - 1) as f64);
        self.wrapped(raw as i64)
    }

    /// The raw value nearest to a value, without a limit.
    pub fn nearest(&self, value: f64) -> i64 {
        (value / self.scale).round_ties_even() as i64
    }

    /// The span after which a wrapping value repeats.
    pub fn span(&self) -> f64 {
        2.0_f64.powi(self.bits as i32) * self.scale
    }
}

pub const SYNC: u32 = 0x010;
pub const MODE_COMMAND: u32 = 0x018;
pub const AXIS_COMMAND: u32 = 0x020; // the inner one; the outer follows
pub const SENSOR: u32 = 0x040; // the first of 16
pub const ALTIMETER: u32 = 0x050;
pub const AXIS_STATUS: u32 = 0x060; // the inner one; the outer follows
pub const FIRMWARE_STATUS: u32 = 0x100;
pub const FIRMWARE_FAULTS: u32 = 0x101;
pub const NAV_LATITUDE: u32 = 0x120;
pub const NAV_LONGITUDE: u32 = 0x121;
pub const NAV_VELOCITY: u32 = 0x122;
pub const NAV_HEIGHT: u32 = 0x123;
pub const NAV_ATTITUDE: u32 = 0x124;
pub const HEARTBEAT_FIRMWARE: u32 = 0x701;

pub const COUNTER: Signal = Signal::unsigned(8, 4, 1.0);
pub const SYNC_EPOCH: Signal = Signal::unsigned(12, 24, 1.0);
pub const MODE_REQUEST: Signal = Signal::unsigned(12, 4, 1.0);
pub const SENSOR_STATUS: Signal = Signal::unsigned(12, 4, 1.0);
pub const GYRO_DTHETA: Signal = Signal::signed(16, 24, 4e-9);
pub const ACCELEROMETER_DV: Signal = Signal::signed(40, 24, 1.25e-7);
pub const ALTIMETER_HEIGHT: Signal = Signal::signed(12, 28, 1e-3);
pub const AXIS_STATE: Signal = Signal::unsigned(12, 4, 1.0);
pub const ENCODER_ANGLE_DEG: Signal = Signal::signed(16, 32, 23040.0 / 4_294_967_296.0);
pub const ENCODER_RATE_DPS: Signal = Signal::signed(48, 16, 0.002);

pub const COMMAND: Signal = Signal::unsigned(12, 4, 1.0);
pub const TARGET_ANGLE_DEG: Signal = Signal::signed(16, 32, 23040.0 / 4_294_967_296.0);
pub const RATE_LIMIT_DPS: Signal = Signal::unsigned(48, 16, 0.001);
pub const MODE: Signal = Signal::unsigned(12, 4, 1.0);
pub const FAULT: Signal = Signal::unsigned(16, 4, 1.0);
pub const SCHEME_POSITION: Signal = Signal::unsigned(20, 8, 1.0);
pub const SCHEME_CYCLE: Signal = Signal::unsigned(28, 12, 1.0);
pub const LOAD_PERCENT: Signal = Signal::unsigned(40, 8, 0.5);
pub const NOT_FOLLOWING: Signal = Signal::unsigned(48, 2, 1.0); // a bit for each axis
pub const SYNC_LOST: Signal = Signal::unsigned(50, 1, 1.0);
pub const USABLE_SENSORS: Signal = Signal::unsigned(51, 5, 1.0);
pub const CLOCK_ERROR_PPM: Signal = Signal::signed(56, 8, 1.0);
pub const CRC_ERRORS: Signal = Signal::unsigned(12, 10, 1.0);
pub const COUNTER_ERRORS: Signal = Signal::unsigned(22, 10, 1.0);
pub const MISSING_FRAMES: Signal = Signal::unsigned(32, 10, 1.0);
pub const BRIDGED_EPOCHS: Signal = Signal::unsigned(42, 10, 1.0);
pub const OVERRUNS: Signal = Signal::unsigned(52, 12, 1.0);
pub const LATITUDE_DEG: Signal = Signal::signed(12, 40, 1e-9).within(90.0);
pub const LONGITUDE_DEG: Signal = Signal::signed(12, 40, 1e-9).within(180.0);
pub const NAV_EPOCH: Signal = Signal::unsigned(52, 12, 1.0);
pub const VELOCITY_EAST: Signal = Signal::signed(12, 26, 1e-5);
pub const VELOCITY_NORTH: Signal = Signal::signed(38, 26, 1e-5);
pub const HEIGHT: Signal = Signal::signed(12, 28, 1e-3);
pub const VELOCITY_UP: Signal = Signal::signed(40, 24, 1e-4);
pub const ROLL_DEG: Signal = Signal::signed(12, 18, 360.0 / 262_144.0);
pub const PITCH_DEG: Signal = Signal::signed(30, 16, 180.0 / 65536.0);
pub const HEADING_DEG: Signal = Signal::unsigned(46, 18, 360.0 / 262_144.0);
pub const BEGAN_LATE: Signal = Signal::unsigned(12, 1, 1.0);
pub const UPTIME: Signal = Signal::unsigned(16, 32, 0.1);

/// Counters of frames run from 0 to 14.
pub const COUNTS: i64 = 15;

/// CRC-8 of AUTOSAR E2E profile 1 over the data ID, which is 0x5200 + identifier, and bytes 1 to 7.
fn crc(id: u32, data: u64) -> u8 {
    let data_id = (0x5200 + id).to_le_bytes();
    let bytes = data.to_le_bytes();
    data_id[..2].iter().chain(&bytes[1..]).fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc, _| (crc << 1) ^ if crc & 0x80 == 0 { 0 } else { 0x1D })
    })
}

impl Frame {
    /// A frame to send, with its counter and CRC.
    pub fn protected(id: u32, counter: i64, signals: u64) -> Self {
        let data = signals | COUNTER.wrapped(counter.rem_euclid(COUNTS));
        Self { id, length: 8, data: data | u64::from(crc(id, data)), at_ns: 0 }
    }

    pub fn is_intact(&self) -> bool {
        self.length == 8 && self.data as u8 == crc(self.id, self.data)
    }

    pub const fn counter(&self) -> i64 {
        COUNTER.raw(self.data)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The frames of `docs/own-firmware.md`, epoch 37.
    #[test]
    fn frames_are_those_of_the_documentation() {
        let command =
            COMMAND.wrapped(2) | TARGET_ANGLE_DEG.wrapped(TARGET_ANGLE_DEG.nearest(-180.0));
        let frame = Frame::protected(0x021, 37, command | RATE_LIMIT_DPS.bits(2.0));
        assert_eq!(frame.data.to_le_bytes(), [0x84, 0x27, 0, 0, 0, 0xFE, 0xD0, 0x07]);
        let sensor = u64::from_le_bytes([0xCA, 0x07, 0xFB, 0xFF, 0xFF, 0x40, 0xFB, 0x05]);
        let sensor = Frame { id: 0x041, length: 8, data: sensor, at_ns: 0 };
        assert!(sensor.is_intact());
        assert_eq!(GYRO_DTHETA.raw(sensor.data), -5);
        assert_eq!(ACCELEROMETER_DV.raw(sensor.data), 392_000);
    }
}
