//! Fusion, alignment and strapdown navigation, east-north-up on WGS-84 (`docs/firmware.md`).

use std::array::from_fn;
use std::f64::consts::PI;

use crate::maths::{
    EARTH_RATE, GRAVITY_EQUATOR, Matrix, SEMI_MAJOR_AXIS, Vector, applied, cross, earth_radii,
    gravity, inverse, length, orthonormal, plus, product, rotation, scaled,
};
use crate::setup::{GROUPS, HeightChannel, Sensor, Setup};

const LARGEST_CONDITION: f64 = 300.0;
const FORCE_TOLERANCE: f64 = 0.02; // of gravity
const SMALLEST_HORIZONTAL: f64 = 1e-3; // of the Earth's rate
const DAMPING_TIME: f64 = 100.0;
const LONGEST_INTERVAL: f64 = 1.0;
const LARGEST_SPEED: f64 = 3000.0;
const LARGEST_LATITUDE_DEG: f64 = 89.99;

/// Weighted least squares over the sensors that are valid.
#[derive(Default)]
pub struct Fusion {
    used: u32,
    gain: Option<[Vector; GROUPS]>,
}

impl Fusion {
    /// The vector of what the sensors measure along their axes; None if they do not span the space.
    pub fn fuse(&mut self, sensors: &[Sensor], measured: &[Option<f64>; GROUPS]) -> Option<Vector> {
        let valid = |k: usize| measured[k].is_some();
        let used = (0..sensors.len()).filter(|&k| valid(k)).fold(0, |bits, k| bits | 1 << k);
        if used != self.used {
            *self = Self { used, gain: Self::gain(sensors, valid) };
        }
        let terms = self.gain.as_ref()?.iter().zip(measured);
        Some(terms.fold([0.0; 3], |sum, (gain, value)| plus(sum, value.unwrap_or(0.0), *gain)))
    }

    fn gain(sensors: &[Sensor], valid: impl Fn(usize) -> bool) -> Option<[Vector; GROUPS]> {
        let normal = |is_weighted: bool| {
            let used = sensors.iter().enumerate().filter(|(k, _)| valid(*k));
            used.fold([[0.0; 3]; 3], |sum: Matrix, (_, sensor)| {
                let weight = if is_weighted { sensor.weight } else { 1.0 };
                from_fn(|i| plus(sum[i], weight * sensor.axis[i], sensor.axis))
            })
        };
        let trace = |a: Matrix| a[0][0] + a[1][1] + a[2][2];
        let plain = normal(false);
        if (trace(plain) * trace(inverse(plain)?)).sqrt() > LARGEST_CONDITION {
            return None;
        }
        let covariance = inverse(normal(true))?;
        Some(from_fn(|k| match sensors.get(k) {
            Some(sensor) if valid(k) => scaled(applied(covariance, sensor.axis), sensor.weight),
            _ => [0.0; 3],
        }))
    }
}

/// The sums of the increments at standstill.
#[derive(Default)]
pub struct Alignment {
    pub epochs: i64,
    dtheta: Vector,
    dv: Vector,
    angle_sum: Vector,
    angle_moment: Vector,
}

impl Alignment {
    pub fn add(&mut self, dtheta: Vector, dv: Vector) {
        self.epochs += 1;
        self.dtheta = plus(self.dtheta, 1.0, dtheta);
        self.dv = plus(self.dv, 1.0, dv);
        self.angle_sum = plus(self.angle_sum, 1.0, self.dtheta);
        self.angle_moment = plus(self.angle_moment, self.epochs as f64, self.dtheta);
    }

    /// `C_s_n` from gravity and the Earth's rate; None if it is not to be found.
    pub fn find(&self, setup: &Setup) -> Option<Matrix> {
        let seconds = self.epochs as f64 * setup.dt();
        let expected = gravity(setup.latitude, setup.height) * seconds;
        let felt = length(self.dv);
        if (felt - expected).abs() >= FORCE_TOLERANCE * expected {
            return None;
        }
        let up = scaled(self.dv, 1.0 / felt);
        let east = cross(self.dtheta, up);
        let horizontal = length(east);
        (horizontal > SMALLEST_HORIZONTAL * EARTH_RATE * seconds).then(|| {
            let east = scaled(east, 1.0 / horizontal);
            [east, cross(up, east), up]
        })
    }

    /// Counted angles scatter about the true ones: begin on the line through them.
    pub fn without_remainder(&self, c_s_n: Matrix, count: f64) -> Matrix {
        let n = self.epochs as f64;
        if self.epochs < 3 {
            return c_s_n;
        }
        let held_back: Vector = from_fn(|i| {
            let mean = self.angle_sum[i] / n;
            let moment = self.angle_moment[i] - mean * n * (n + 1.0) / 2.0;
            let slope = moment / (n * (n * n - 1.0) / 12.0);
            (self.dtheta[i] - mean - slope * (n - 1.0) / 2.0).clamp(-count, count)
        });
        c_s_n.map(|row| plus(row, 1.0, cross(row, held_back)))
    }
}

/// An angle that keeps what rounding loses (Kahan): an epoch moves less than a float's step.
#[derive(Default)]
struct Angle {
    value: f64,
    carry: f64,
}

impl Angle {
    fn add(&mut self, step: f64) {
        let step = step + self.carry;
        let sum = self.value + step;
        self.carry = step - (sum - self.value);
        self.value = sum;
    }
}

pub struct Strapdown {
    latitude: Angle,
    longitude: Angle,
    pub height: f64,
    pub velocity: Vector,
    pub c_s_n: Matrix,
    velocity_change: Vector,
    before: Option<(Vector, Vector)>,
    height_error_integral: f64,
}

impl Strapdown {
    pub fn new(c_s_n: Matrix, setup: &Setup) -> Self {
        Self {
            latitude: Angle { value: setup.latitude, carry: 0.0 },
            longitude: Angle { value: setup.longitude, carry: 0.0 },
            height: setup.height,
            velocity: [0.0; 3],
            c_s_n,
            velocity_change: [0.0; 3],
            before: None,
            height_error_integral: 0.0,
        }
    }

    pub const fn latitude(&self) -> f64 {
        self.latitude.value
    }

    pub const fn longitude(&self) -> f64 {
        self.longitude.value
    }

    /// Navigate over an epoch.
    pub fn update(&mut self, dtheta: Vector, dv: Vector, dt: f64, channel: HeightChannel) {
        let (dtheta_before, dv_before) = self.before.replace((dtheta, dv)).unwrap_or((dtheta, dv));
        let (sine, cosine) = self.latitude.value.sin_cos();
        let (meridian, across) = earth_radii(self.latitude.value);
        let (meridian, across) = (meridian + self.height, across + self.height);

        // Rates at mid-epoch
        let middle = plus(self.velocity, 0.5, self.velocity_change);
        let omega_ie = [0.0, EARTH_RATE * cosine, EARTH_RATE * sine];
        let omega_en =
            [-middle[1] / meridian, middle[0] / across, middle[0] / across * sine / cosine];
        let zeta = scaled(plus(omega_ie, 1.0, omega_en), dt);

        // Velocity: sculling (Savage 1998, part 2), then Titterton and Weston (3.25)
        let once = cross(dtheta, dv);
        let sculling = plus(cross(dtheta_before, dv), 1.0, cross(dv_before, dtheta));
        let start = plus(plus(dv, 0.5, once), 1.0 / 6.0, cross(dtheta, once));
        let dv_n = applied(self.c_s_n, plus(start, 1.0 / 12.0, sculling));
        let coriolis = cross(plus(omega_en, 2.0, omega_ie), middle);
        let mut change = plus(plus(dv_n, -0.5, cross(zeta, dv_n)), -dt, coriolis);
        change[2] -= gravity(self.latitude.value, self.height) * dt;
        if channel == HeightChannel::Held {
            change[2] = 0.0;
        }

        // Position: the trapezoid of the velocity
        let way = scaled(plus(self.velocity, 0.5, change), dt);
        let north = way[1] / meridian;
        self.longitude.add(way[0] / (across * (cosine - sine * 0.5 * north)));
        if self.longitude.value.abs() > PI {
            self.longitude.value -= self.longitude.value.signum() * 2.0 * PI;
        }
        self.latitude.add(north);
        self.height += way[2];
        self.velocity = plus(self.velocity, 1.0, change);
        self.velocity_change = change;

        // Attitude: coning (Savage 1998, part 1)
        let phi = plus(dtheta, 1.0 / 12.0, cross(dtheta_before, dtheta));
        let turned = product(rotation(scaled(zeta, -1.0)), product(self.c_s_n, rotation(phi)));
        self.c_s_n = orthonormal(turned);
    }

    /// Draw the height to a reference, `seconds` after the last one (Siouris, section 5.4).
    pub fn damp(&mut self, reference: f64, seconds: f64) {
        let (dt, error) = (seconds.min(LONGEST_INTERVAL), self.height - reference);
        let stiffness = 3.0 / DAMPING_TIME.powi(2) + 2.0 * GRAVITY_EQUATOR / SEMI_MAJOR_AXIS;
        self.height_error_integral += error * dt;
        self.height -= 3.0 / DAMPING_TIME * error * dt;
        self.velocity[2] -=
            (stiffness * error + self.height_error_integral / DAMPING_TIME.powi(3)) * dt;
    }

    pub fn is_plausible(&self) -> bool {
        length(self.velocity) < LARGEST_SPEED
            && self.latitude.value.abs() < LARGEST_LATITUDE_DEG.to_radians()
    }
}
