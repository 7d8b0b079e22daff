//! Frames in: checks their protection and keeps those of an epoch (`docs/firmware.md`, "Frames in").

use crate::clock::Clock;
use crate::contract::{self as c, COUNTS, Frame};
use crate::setup::{GROUPS, Setup};

const EPOCHS: i64 = 1 << 24; // that SYNC counts
const ADOPT_BEYOND: i64 = 200;
const EARLY_NS: i64 = 1_000_000_000; // since the hardware's power-on

/// What an epoch brought of one message.
#[derive(Clone, Copy, Default)]
pub struct Heard {
    first: Option<u64>,
    is_disputed: bool,
}

impl Heard {
    /// The data, unless none came or two frames disagree.
    pub fn data(self) -> Option<u64> {
        self.first.filter(|_| !self.is_disputed)
    }
}

/// An axis of the table, by its frames.
#[derive(Clone, Copy, Default)]
pub struct Axis {
    pub heard: Heard,
    pub angle_deg: f64,
    pub rate_dps: f64,
    pub state: i64,
    pub silent_epochs: i64,
}

impl Axis {
    /// Take the frame of the epoch, or extrapolate; return whether there was one.
    fn close(&mut self, dt: f64) -> bool {
        if let Some(data) = self.heard.data() {
            let (angle, span) = (c::ENCODER_ANGLE_DEG.value(data), c::ENCODER_ANGLE_DEG.span());
            self.angle_deg = angle + span * ((self.angle_deg - angle) / span).round();
            self.rate_dps = c::ENCODER_RATE_DPS.value(data);
            self.state = c::AXIS_STATE.raw(data);
            self.silent_epochs = 0;
            return true;
        }
        self.angle_deg += self.rate_dps * dt;
        self.silent_epochs += 1;
        false
    }
}

#[derive(Default)]
pub struct Counters {
    pub crc_errors: i64,
    pub counter_errors: i64,
    pub missing_frames: i64,
}

pub struct Intake {
    /// -1 before the first SYNC.
    pub epoch: i64,
    /// Whether the frames of a step are one epoch's, as in lockstep.
    pub is_whole: bool,
    pub clock: Clock,
    pub sensors: [Heard; GROUPS],
    pub axes: [Axis; 2],
    pub altimeter: Heard,
    /// The operator's.
    pub request: i64,
    pub counters: Counters,
    /// Whether the first SYNC was of an epoch after the hardware's first second.
    pub began_late: bool,
    has_jumped: bool,
    command_counter: Option<i64>,
    /// Epoch that a SYNC far from the count would have by now.
    far_epoch: Option<i64>,
}

impl Intake {
    pub fn new(setup: &Setup) -> Self {
        Self {
            epoch: -1,
            is_whole: false,
            clock: Clock::new(setup.period_ns()),
            sensors: Default::default(),
            axes: Default::default(),
            altimeter: Heard::default(),
            request: 0,
            counters: Counters::default(),
            began_late: false,
            has_jumped: false,
            command_counter: None,
            far_epoch: None,
        }
    }

    /// Receive the frames of the next epoch; return how many, up to a SYNC of a later one.
    pub fn receive(&mut self, frames: &[Frame]) -> usize {
        self.epoch += 1;
        self.clock.is_seen = false;
        self.far_epoch = self.far_epoch.map(|epoch| epoch + 1);
        self.sensors = Default::default();
        self.altimeter = Heard::default();
        self.axes.iter_mut().for_each(|axis| axis.heard = Heard::default());
        frames.iter().position(|frame| !self.take(frame)).unwrap_or(frames.len())
    }

    /// Take a frame; false if it belongs to a later epoch.
    fn take(&mut self, frame: &Frame) -> bool {
        let heard = match frame.id {
            c::SYNC | c::MODE_COMMAND => None,
            c::SENSOR..c::ALTIMETER => Some(&mut self.sensors[(frame.id - c::SENSOR) as usize]),
            c::ALTIMETER => Some(&mut self.altimeter),
            c::AXIS_STATUS => Some(&mut self.axes[0].heard),
            id if id == c::AXIS_STATUS + 1 => Some(&mut self.axes[1].heard),
            _ => return true, // for others
        };
        if !frame.is_intact() {
            self.counters.crc_errors += 1;
        } else if let Some(heard) = heard {
            if frame.counter() != self.epoch.rem_euclid(COUNTS) {
                self.counters.counter_errors += 1;
            } else if let Some(first) = heard.first {
                self.counters.counter_errors += 1;
                heard.is_disputed |= first != frame.data;
            } else {
                heard.first = Some(frame.data);
            }
        } else if frame.id == c::SYNC {
            return self.take_sync(frame);
        } else if self.command_counter == Some(frame.counter()) {
            self.counters.counter_errors += 1;
        } else {
            self.command_counter = Some(frame.counter());
            self.request = c::MODE_REQUEST.raw(frame.data);
        }
        true
    }

    fn take_sync(&mut self, frame: &Frame) -> bool {
        let named = c::SYNC_EPOCH.raw(frame.data);
        // The counter, the whole epoch modulo 15, tells how often the 24 bits have wrapped.
        let whole = named + EPOCHS * (frame.counter() - named).rem_euclid(COUNTS);
        let mut ahead = (named - self.epoch + EPOCHS / 2).rem_euclid(EPOCHS) - EPOCHS / 2;
        if self.clock.is_synchronised && ahead.abs() > ADOPT_BEYOND {
            if !self.continues_jump(whole) {
                self.counters.counter_errors += 1;
                return true;
            }
            self.clock.is_synchronised = false;
            self.has_jumped = true;
        }
        if !self.clock.is_synchronised {
            if !self.has_jumped {
                self.began_late = whole * self.clock.nominal_ns > EARLY_NS;
            }
            self.epoch = whole;
            ahead = 0;
        }
        if ahead > 0 {
            let is_strange = self.is_whole || (self.clock.is_seen && ahead > 1);
            self.counters.counter_errors += i64::from(is_strange);
            return is_strange;
        }
        if ahead < 0 || self.clock.is_seen {
            self.counters.counter_errors += 1;
        }
        if ahead == 0 {
            if self.clock.is_seen {
                return true;
            }
            self.clock.is_seen = true;
            self.far_epoch = None;
        }
        self.clock.synchronise(frame.at_ns, -ahead);
        true
    }

    /// Whether a SYNC far from the count continues another one; else keep its epoch.
    fn continues_jump(&mut self, epoch: i64) -> bool {
        if self.clock.is_seen {
            return false;
        }
        let continues = self.far_epoch.is_some_and(|far| (far..=far + 1).contains(&epoch));
        self.far_epoch = Some(epoch);
        continues
    }

    /// End the epoch: count what is missing, once the hardware has been heard.
    pub fn close(&mut self, setup: &Setup) {
        if self.clock.is_synchronised {
            let groups = setup.gyros.len().max(setup.accelerometers.len());
            let silent =
                self.sensors[..groups].iter().filter(|heard| heard.data().is_none()).count();
            let mut missing = silent + usize::from(!self.clock.is_seen);
            for axis in &mut self.axes {
                missing += usize::from(!axis.close(setup.dt()));
            }
            self.counters.missing_frames += missing as i64;
        }
        self.clock.advance();
    }
}
