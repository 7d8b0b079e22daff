//! The rotation scheme: commands the axes and watches that they follow (`docs/firmware.md`).

use crate::contract::TARGET_ANGLE_DEG;
use crate::intake::Axis;
use crate::setup::Setup;

const AT_ZERO_DEG: f64 = 0.01;
const SETTLE_S: f64 = 10.0;
const FOLLOWED_S: f64 = 0.5;
const TRIES: u32 = 8;
const STANDS: i64 = 1; // states of an axis
pub const AXIS_FAULT: i64 = 4;

/// What both axes are to do.
#[derive(Clone, Copy, Default, PartialEq)]
pub enum Command {
    #[default]
    Off = 0,
    Hold = 1,
    Position = 2,
}

#[derive(Default)]
pub struct Scheme {
    pub command: Command,
    pub target_deg: [f64; 2],
    pub not_following: [bool; 2],
    pub position: usize,
    pub cycle: i64,
    pub is_homing: bool,
    pub is_interrupted: bool,
    start_deg: [f64; 2],
    epochs: i64,
    turn_begun: i64,
    wait_epochs: i64,
    tries: u32,
}

/// The angle nearest to another that a wrapping field can mean.
fn unwrapped(angle_deg: f64, near: f64) -> f64 {
    let span = TARGET_ANGLE_DEG.span();
    angle_deg + span * ((near - angle_deg) / span).round_ties_even()
}

impl Scheme {
    /// Begin at the first position, from zero.
    pub fn start(setup: &Setup, axes: &[Axis; 2]) -> Self {
        let start_deg = axes.map(|axis| axis.angle_deg);
        let mut scheme = Self { command: Command::Position, start_deg, ..Self::default() };
        scheme.is_homing = start_deg.iter().any(|angle| angle.abs() > AT_ZERO_DEG);
        if !scheme.is_homing {
            scheme.enter(setup);
        }
        scheme
    }

    pub const fn stop(&mut self, command: Command) {
        self.command = command;
        self.is_interrupted = false;
    }

    /// The position for the status frame: from 1, 0 while there is none.
    pub const fn number(&self) -> usize {
        match self.command {
            Command::Position if !self.is_homing => self.position + 1,
            _ => 0,
        }
    }

    /// Command the turn of the current position.
    fn enter(&mut self, setup: &Setup) {
        let position = &setup.positions[self.position];
        (self.epochs, self.turn_begun) = (0, 0);
        self.start_deg = self.target_deg;
        self.target_deg[position.axis] += position.turn_deg;
    }

    fn position_epochs(&self, setup: &Setup) -> i64 {
        let turn = setup.positions[self.position].turn_deg.abs();
        setup.epochs(turn / setup.turn_rate_dps + setup.stand_s).max(1)
    }

    /// Seconds since the turn began.
    fn turning_s(&self, setup: &Setup) -> f64 {
        (self.epochs - self.turn_begun) as f64 * setup.dt()
    }

    fn largest_turn_deg(&self) -> f64 {
        let turn = |k: usize| (self.target_deg[k] - self.start_deg[k]).abs();
        turn(0).max(turn(1))
    }

    /// Go on by an epoch.
    pub fn advance(&mut self, setup: &Setup) {
        self.epochs += 1;
        let turn_s = self.largest_turn_deg() / setup.turn_rate_dps;
        if self.tries > 0 {
            let ramp_s = setup.turn_rate_dps / setup.axis_acceleration_dps2 + setup.axis_rise_s;
            if self.turning_s(setup) < turn_s + ramp_s + FOLLOWED_S {
                return;
            }
            self.tries = 0;
            self.not_following = [false; 2];
        }
        if self.is_homing {
            if self.epochs as f64 * setup.dt() >= turn_s + SETTLE_S {
                self.is_homing = false;
                self.enter(setup);
            }
        } else if self.epochs >= self.position_epochs(setup) {
            self.position += 1;
            if self.position == setup.positions.len() {
                self.position = 0;
                self.cycle += 1;
            }
            self.enter(setup);
        }
    }

    /// Wait before the next try, unless there have been enough.
    pub fn interrupt(&mut self, setup: &Setup) {
        if self.tries < TRIES {
            self.is_interrupted = true;
            self.wait_epochs = (1_i64 << self.tries) * 1_000_000_000 / setup.period_ns();
        }
    }

    /// Wait for an epoch; whether both axes stand and it is time.
    pub fn wait(&mut self, setup: &Setup, axes: &[Axis; 2]) -> bool {
        let is_time = self.wait_epochs == 0;
        self.wait_epochs = (self.wait_epochs - 1).max(0);
        if !self.is_homing && self.epochs < self.position_epochs(setup) {
            self.epochs += 1;
        }
        is_time && axes.iter().all(|axis| axis.state == STANDS && axis.silent_epochs == 0)
    }

    /// Turn from where the axes are to where they should be.
    pub fn resume(&mut self, axes: &[Axis; 2]) {
        self.command = Command::Position;
        self.is_interrupted = false;
        self.tries += 1;
        if self.is_homing {
            self.epochs = 0;
        }
        self.turn_begun = self.epochs;
        for (k, axis) in axes.iter().enumerate() {
            self.start_deg[k] = unwrapped(axis.angle_deg, self.target_deg[k]);
        }
    }

    /// Where an axis is expected: it ramps up, turns and ramps down.
    fn expected_deg(&self, setup: &Setup, k: usize) -> f64 {
        let (start, target) = (self.start_deg[k], self.target_deg[k]);
        let (turn, acceleration) = ((target - start).abs(), setup.axis_acceleration_dps2);
        let rate = setup.turn_rate_dps.min((turn * acceleration).sqrt());
        if rate == 0.0 {
            return target;
        }
        let ramp = rate / acceleration;
        let total = turn / rate + ramp;
        let t = (self.turning_s(setup) - 0.5 * setup.axis_rise_s).clamp(0.0, total);
        let done = if t > total - ramp {
            turn - 0.5 * acceleration * (total - t).powi(2)
        } else if t > ramp {
            rate * (t - 0.5 * ramp)
        } else {
            0.5 * acceleration * t * t
        };
        start + done.copysign(target - start)
    }

    /// Whether both axes follow; those that do not are marked.
    pub fn watch(&mut self, setup: &Setup, axes: &[Axis; 2]) -> bool {
        let mut follow = true;
        for (k, axis) in axes.iter().enumerate() {
            let expected = self.expected_deg(setup, k);
            let lag = unwrapped(axis.angle_deg, expected) - expected;
            if axis.silent_epochs > setup.epochs(setup.axis_silence_s)
                || axis.state == AXIS_FAULT
                || lag.abs() > setup.follow_tolerance_deg
            {
                self.not_following[k] = true;
                follow = false;
            }
        }
        follow
    }
}
