//! Frames out: axis commands in every epoch, the rest at their cycle times (`docs/firmware.md`).

use crate::contract::{self as c, Frame};
use crate::firmware::Firmware;
use crate::maths::{euler, product, transposed};

const STATUS_MS: i64 = 100;
const NAVIGATION_MS: i64 = 50;
const HEARTBEAT_MS: i64 = 1000;

impl Firmware {
    pub fn transmit(&mut self, outbox: &mut Vec<Frame>) {
        let is_due = |cycle_ms: i64| {
            let epochs = (cycle_ms * 1_000_000 / self.setup.period_ns()).max(1);
            self.intake.epoch % epochs == 0
        };
        let (heartbeat, status) = (is_due(HEARTBEAT_MS), is_due(STATUS_MS));
        let navigation = self.navigates() && is_due(NAVIGATION_MS);
        if heartbeat {
            outbox.push(self.heartbeat());
        }
        if status {
            outbox.extend([self.status(), self.fault_counters()]);
        }
        if navigation {
            outbox.extend(self.navigation());
        }
        for (sent, is_sent) in self.sent.iter_mut().zip([status, navigation, heartbeat]) {
            *sent += i64::from(is_sent);
        }
        outbox.extend([self.axis_command(0), self.axis_command(1)]); // the last closes the epoch
    }

    fn heartbeat(&self) -> Frame {
        let uptime = c::UPTIME.bits(self.steps as f64 * self.setup.dt());
        let began_late = c::BEGAN_LATE.wrapped(i64::from(self.intake.began_late));
        Frame::protected(c::HEARTBEAT_FIRMWARE, self.sent[2], uptime | began_late)
    }

    fn status(&self) -> Frame {
        let not_following = self.scheme.not_following;
        let signals = c::MODE.wrapped(self.mode as i64)
            | c::FAULT.wrapped(self.fault as i64)
            | c::SCHEME_POSITION.wrapped(self.scheme.number() as i64)
            | c::SCHEME_CYCLE.wrapped(self.scheme.cycle)
            | c::LOAD_PERCENT.bits(self.load_percent)
            | c::NOT_FOLLOWING
                .wrapped(i64::from(not_following[0]) + 2 * i64::from(not_following[1]))
            | c::SYNC_LOST.wrapped(i64::from(self.intake.clock.is_lost))
            | c::USABLE_SENSORS.wrapped(self.usable_sensors as i64)
            | c::CLOCK_ERROR_PPM.bits(self.intake.clock.error_ppm());
        Frame::protected(c::FIRMWARE_STATUS, self.sent[0], signals)
    }

    fn fault_counters(&self) -> Frame {
        let counters = &self.intake.counters;
        let signals = c::CRC_ERRORS.bits(counters.crc_errors as f64)
            | c::COUNTER_ERRORS.bits(counters.counter_errors as f64)
            | c::MISSING_FRAMES.bits(counters.missing_frames as f64)
            | c::BRIDGED_EPOCHS.bits(self.bridged_epochs as f64)
            | c::OVERRUNS.bits(self.overruns as f64);
        Frame::protected(c::FIRMWARE_FAULTS, self.sent[0], signals)
    }

    fn navigation(&self) -> Vec<Frame> {
        let Some(found) = &self.navigation else { return Vec::new() };
        let (roll, pitch, heading) = euler(product(found.c_s_n, transposed(self.c_s_b)));
        let epoch = c::NAV_EPOCH.wrapped(self.intake.epoch);
        let [east, north, up] = found.velocity;
        let messages = [
            (c::NAV_LATITUDE, c::LATITUDE_DEG.bits(found.latitude().to_degrees()) | epoch),
            (c::NAV_LONGITUDE, c::LONGITUDE_DEG.bits(found.longitude().to_degrees()) | epoch),
            (c::NAV_VELOCITY, c::VELOCITY_EAST.bits(east) | c::VELOCITY_NORTH.bits(north)),
            (c::NAV_HEIGHT, c::HEIGHT.bits(found.height) | c::VELOCITY_UP.bits(up)),
            (
                c::NAV_ATTITUDE,
                c::ROLL_DEG.bits(roll.to_degrees())
                    | c::PITCH_DEG.bits(pitch.to_degrees())
                    | c::HEADING_DEG.bits(heading.to_degrees()),
            ),
        ];
        messages.map(|(id, signals)| Frame::protected(id, self.sent[1], signals)).to_vec()
    }

    fn axis_command(&self, axis: u32) -> Frame {
        let target = c::TARGET_ANGLE_DEG.nearest(self.scheme.target_deg[axis as usize]);
        let signals = c::COMMAND.wrapped(self.scheme.command as i64)
            | c::TARGET_ANGLE_DEG.wrapped(target)
            | c::RATE_LIMIT_DPS.bits(self.setup.turn_rate_dps);
        Frame::protected(c::AXIS_COMMAND + axis, self.intake.epoch, signals)
    }
}
