//! The modes, and one epoch of the computer (`docs/firmware.md`, "Modes").

use crate::contract::{self as c, Frame};
use crate::intake::{Heard, Intake};
use crate::maths::{IDENTITY, Matrix, Vector, gimbal, product};
use crate::navigation::{Alignment, Fusion, Strapdown};
use crate::scheme::{AXIS_FAULT, Command, Scheme};
use crate::setup::{GROUPS, HeightChannel, Setup};

const SOUND_S: f64 = 0.5;
const SELF_TEST_LIMIT_S: f64 = 10.0;
const UNSOUND: i64 = 10; // sound epochs that an unsound one costs
const STANDS_DPS: f64 = 0.05;
const STAND_LIMIT_S: f64 = 10.0;
const GYRO_UNUSABLE: i64 = 0b0101; // saturated or absent
const ACCELEROMETER_UNUSABLE: i64 = 0b1010;

#[derive(Clone, Copy, PartialEq)]
pub enum Mode {
    PowerOn = 0,
    SelfTest = 1,
    Standby = 2,
    Alignment = 3,
    Strapdown = 4,
    Rotating = 5,
    Fault = 6,
    Shutdown = 7,
}

#[derive(Clone, Copy)]
pub enum Fault {
    None = 0,
    SelfTestFailed = 1,
    SensorsLost = 2,
    AlignmentFailed = 3,
    NavigationDiverged = 4,
}

/// What an epoch's sensors measure along their axes, where they are usable.
struct Measured {
    dtheta: [Option<f64>; GROUPS],
    dv: [Option<f64>; GROUPS],
}

impl Measured {
    fn of(sensors: &[Heard; GROUPS]) -> Self {
        let values = |unusable: i64, signal: &c::Signal| {
            sensors.map(|heard| {
                let data = heard.data().filter(|&data| c::SENSOR_STATUS.raw(data) & unusable == 0);
                data.map(|data| signal.value(data))
            })
        };
        Self {
            dtheta: values(GYRO_UNUSABLE, &c::GYRO_DTHETA),
            dv: values(ACCELEROMETER_UNUSABLE, &c::ACCELEROMETER_DV),
        }
    }
}

pub struct Firmware {
    pub setup: Setup,
    pub intake: Intake,
    pub mode: Mode,
    pub fault: Fault,
    pub scheme: Scheme,
    pub navigation: Option<Strapdown>,
    pub c_s_b: Matrix,
    pub usable_sensors: usize,
    pub bridged_epochs: i64,
    pub overruns: i64,
    pub load_percent: f64,
    pub steps: i64,
    /// How often status, navigation and heartbeat have been sent.
    pub sent: [i64; 3],
    pending: Option<Mode>,
    request: i64,
    mode_epochs: i64,
    sound_epochs: i64,
    gyros: Fusion,
    accelerometers: Fusion,
    dtheta: Vector,
    dv: Vector,
    consecutive_bridged: i64,
    alignment: Alignment,
    aligned: Option<Matrix>,
    altimeter_epochs: i64,
}

impl Firmware {
    pub fn new(setup: Setup) -> Self {
        Self {
            intake: Intake::new(&setup),
            setup,
            mode: Mode::PowerOn,
            fault: Fault::None,
            scheme: Scheme::default(),
            navigation: None,
            c_s_b: IDENTITY,
            usable_sensors: 0,
            bridged_epochs: 0,
            overruns: 0,
            load_percent: 0.0,
            steps: 0,
            sent: [0; 3],
            pending: None,
            request: 0,
            mode_epochs: 0,
            sound_epochs: 0,
            gyros: Fusion::default(),
            accelerometers: Fusion::default(),
            dtheta: [0.0; 3],
            dv: [0.0; 3],
            consecutive_bridged: 0,
            alignment: Alignment::default(),
            aligned: None,
            altimeter_epochs: 0,
        }
    }

    /// Run an epoch on frames; write its frames, and return how many of those given it has used.
    pub fn step(&mut self, inbox: &[Frame], outbox: &mut Vec<Frame>) -> usize {
        self.steps += 1;
        let used = self.intake.receive(inbox);
        self.intake.close(&self.setup);
        let measured = Measured::of(&self.intake.sensors);
        self.fuse(&measured);
        let [inner, outer] = self.intake.axes.map(|axis| axis.angle_deg.to_radians());
        self.c_s_b = gimbal(inner, outer);
        self.follow_request();
        self.run_mode(&measured);
        self.transmit(outbox);
        used
    }

    pub const fn navigates(&self) -> bool {
        matches!(self.mode, Mode::Strapdown | Mode::Rotating)
    }

    /// Fuse the sensors, or bridge with the increments of the epoch before.
    fn fuse(&mut self, measured: &Measured) {
        let Measured { dtheta, dv } = measured;
        self.usable_sensors =
            dtheta.iter().zip(dv).filter(|(a, b)| a.is_some() && b.is_some()).count();
        let dtheta = self.gyros.fuse(&self.setup.gyros, dtheta);
        let dv = self.accelerometers.fuse(&self.setup.accelerometers, dv);
        if dtheta.is_some() && dv.is_some() {
            self.consecutive_bridged = 0;
        } else if self.intake.clock.is_synchronised {
            self.bridged_epochs += 1;
            self.consecutive_bridged += 1;
        }
        self.dtheta = dtheta.unwrap_or(self.dtheta);
        self.dv = dv.unwrap_or(self.dv);
    }

    /// Act once on a request that differs from the one before.
    fn follow_request(&mut self) {
        let request = self.intake.request;
        if request == self.request || self.mode == Mode::Shutdown {
            return;
        }
        self.request = request;
        let wanted = match request {
            1 => Mode::Standby,
            2 => Mode::Alignment,
            3 => Mode::Strapdown,
            4 => Mode::Rotating,
            5 => return self.enter(Mode::Shutdown),
            _ => return,
        };
        let is_in_fault = self.mode == Mode::Fault;
        if is_in_fault && wanted != Mode::Standby {
            return;
        }
        self.pending = Some(wanted);
        match wanted {
            Mode::Standby if is_in_fault => self.enter(Mode::SelfTest),
            Mode::Standby if matches!(self.mode, Mode::PowerOn | Mode::SelfTest) => {}
            Mode::Standby => self.enter(wanted),
            Mode::Strapdown | Mode::Rotating if self.navigates() && self.mode != wanted => {
                self.enter(wanted);
            }
            _ => {}
        }
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.mode_epochs = 0;
        self.sound_epochs = 0;
        match mode {
            Mode::Rotating => self.scheme = Scheme::start(&self.setup, &self.intake.axes),
            Mode::Shutdown => self.scheme.stop(Command::Off),
            _ => self.scheme.stop(Command::Hold),
        }
        if !matches!(mode, Mode::Fault | Mode::Shutdown) {
            self.fault = Fault::None;
        }
        if mode == Mode::Alignment {
            self.alignment = Alignment::default();
            self.aligned = None;
        }
    }

    fn fail(&mut self, fault: Fault) {
        self.pending = None;
        self.enter(Mode::Fault);
        self.fault = fault;
    }

    fn seconds_in_mode(&self) -> f64 {
        self.mode_epochs as f64 * self.setup.dt()
    }

    fn run_mode(&mut self, measured: &Measured) {
        let mode = self.mode;
        self.mode_epochs += 1;
        match mode {
            Mode::PowerOn => self.enter(Mode::SelfTest),
            Mode::SelfTest => self.test(measured),
            Mode::Standby => self.stand_by(),
            Mode::Alignment => self.align(),
            Mode::Strapdown | Mode::Rotating => self.navigate(),
            Mode::Fault | Mode::Shutdown => {}
        }
        if mode == Mode::Rotating && self.mode == mode {
            self.rotate();
        } else if self.scheme.is_interrupted {
            self.try_again();
        }
    }

    fn test(&mut self, measured: &Measured) {
        let (gyros, accelerometers) = (self.setup.gyros.len(), self.setup.accelerometers.len());
        let is_sound = self.intake.clock.is_seen
            && measured.dtheta[..gyros].iter().all(Option::is_some)
            && measured.dv[..accelerometers].iter().all(Option::is_some)
            && self.intake.axes.iter().all(|a| a.heard.data().is_some() && a.state != AXIS_FAULT);
        self.sound_epochs = (self.sound_epochs + if is_sound { 1 } else { -UNSOUND }).max(0);
        if self.sound_epochs as f64 * self.setup.dt() >= SOUND_S {
            self.enter(Mode::Standby);
        } else if self.seconds_in_mode() >= SELF_TEST_LIMIT_S {
            self.fail(Fault::SelfTestFailed);
        }
    }

    /// Begin the alignment when one is asked for, once the axes stand.
    fn stand_by(&mut self) {
        let turns = self.intake.axes.iter().any(|axis| axis.rate_dps.abs() > STANDS_DPS);
        let may_begin = !turns || self.seconds_in_mode() >= STAND_LIMIT_S;
        if may_begin && self.pending.is_some_and(|mode| mode != Mode::Standby) {
            self.enter(Mode::Alignment);
        }
    }

    fn align(&mut self) {
        if self.aligned.is_none() {
            self.alignment.add(self.dtheta, self.dv);
            if self.alignment.epochs < self.setup.epochs(self.setup.alignment_s).max(1) {
                return;
            }
            let given = self.setup.body_attitude.map(|c_b_n| product(c_b_n, self.c_s_b));
            let Some(found) = given.or_else(|| self.alignment.find(&self.setup)) else {
                return self.fail(Fault::AlignmentFailed);
            };
            let count = c::GYRO_DTHETA.value(1 << 16);
            self.aligned = Some(self.alignment.without_remainder(found, count));
        }
        if let (Some(c_s_n), Some(mode @ (Mode::Strapdown | Mode::Rotating))) =
            (self.aligned, self.pending)
        {
            self.navigation = Some(Strapdown::new(c_s_n, &self.setup));
            self.enter(mode);
        }
    }

    fn navigate(&mut self) {
        let Some(navigation) = &mut self.navigation else { return };
        let (setup, dt) = (&self.setup, self.setup.dt());
        navigation.update(self.dtheta, self.dv, dt, setup.height_channel);
        self.altimeter_epochs += 1;
        let reference = if setup.has_altimeter {
            let data = self.intake.altimeter.data();
            data.map(|data| c::ALTIMETER_HEIGHT.value(data))
        } else {
            Some(setup.height)
        };
        if let Some(reference) = reference {
            if setup.height_channel == HeightChannel::Damped {
                navigation.damp(reference, self.altimeter_epochs as f64 * dt);
            }
            self.altimeter_epochs = 0;
        }
        if self.consecutive_bridged > setup.epochs(setup.bridge_s) {
            self.fail(Fault::SensorsLost);
        } else if !navigation.is_plausible() {
            self.fail(Fault::NavigationDiverged);
        }
    }

    fn rotate(&mut self) {
        if self.scheme.watch(&self.setup, &self.intake.axes) {
            self.scheme.advance(&self.setup);
        } else {
            self.enter(Mode::Strapdown);
            self.scheme.interrupt(&self.setup);
        }
    }

    /// Go back to the scheme after an interruption.
    fn try_again(&mut self) {
        if self.mode == Mode::Strapdown
            && self.pending == Some(Mode::Rotating)
            && self.scheme.wait(&self.setup, &self.intake.axes)
        {
            self.mode = Mode::Rotating;
            self.mode_epochs = 0;
            self.scheme.resume(&self.intake.axes);
        }
    }
}
