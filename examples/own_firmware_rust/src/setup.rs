//! The set-up file: a key and its values on each line (`docs/own-firmware.md`).

use std::collections::HashMap;

use crate::maths::{Matrix, Vector, body_attitude};

pub const GROUPS: usize = 16;

#[derive(Clone, Copy, PartialEq)]
pub enum HeightChannel {
    Held,
    Damped,
    Free,
}

/// A sensor's input axis and its weight.
pub struct Sensor {
    pub axis: Vector,
    pub weight: f64,
}

/// A position of the rotation scheme: which axis turns, how far.
pub struct Position {
    pub axis: usize,
    pub turn_deg: f64,
}

pub struct Setup {
    pub rate_hz: i64,
    pub latitude: f64,
    pub longitude: f64,
    pub height: f64,
    /// None if the computer has to find it.
    pub body_attitude: Option<Matrix>,
    pub alignment_s: f64,
    pub height_channel: HeightChannel,
    pub has_altimeter: bool,
    pub bridge_s: f64,
    pub gyros: Vec<Sensor>,
    pub accelerometers: Vec<Sensor>,
    pub turn_rate_dps: f64,
    pub stand_s: f64,
    pub positions: Vec<Position>,
    pub axis_acceleration_dps2: f64,
    pub axis_rise_s: f64,
    pub follow_tolerance_deg: f64,
    pub axis_silence_s: f64,
}

/// The words of a file by their keys; a key may have several lines.
struct Lines<'a>(HashMap<&'a str, Vec<Vec<&'a str>>>);

impl<'a> Lines<'a> {
    fn of(text: &'a str) -> Result<Self, String> {
        let mut lines = text.lines();
        if lines.next().map(str::trim) != Some("rrins-setup 1") {
            return Err("not a set-up of version 1".into());
        }
        let mut found: HashMap<_, Vec<_>> = HashMap::new();
        for line in lines {
            let mut words = line.split_whitespace();
            if let Some(key) = words.next() {
                found.entry(key).or_default().push(words.collect());
            }
        }
        Ok(Self(found))
    }

    fn all(&self, key: &str) -> &[Vec<&'a str>] {
        self.0.get(key).map_or(&[], Vec::as_slice)
    }

    fn word(&self, key: &str) -> Result<&'a str, String> {
        let value = self.all(key).last().and_then(|words| words.first());
        value.copied().ok_or_else(|| format!("{key} is missing"))
    }

    fn number(&self, key: &str) -> Result<f64, String> {
        number(key, self.word(key)?)
    }

    fn sensors(&self, key: &str) -> Result<Vec<Sensor>, String> {
        let sensors: Result<Vec<_>, _> =
            self.all(key).iter().map(|words| sensor(key, words)).collect();
        sensors.and_then(|found| match found.len() {
            3..=GROUPS => Ok(found),
            count => Err(format!("{key}: {count} of them")),
        })
    }

    fn positions(&self) -> Result<Vec<Position>, String> {
        let turns = self.all("turn");
        if turns.is_empty() {
            return Err("turn is missing".into());
        }
        turns.iter().map(|words| position(words)).collect()
    }
}

fn number(key: &str, word: &str) -> Result<f64, String> {
    let value: Option<f64> = word.parse().ok();
    value.filter(|x| x.is_finite()).ok_or_else(|| format!("{key}: {word} is not a number"))
}

fn sensor(key: &str, words: &[&str]) -> Result<Sensor, String> {
    let [polar, azimuth, weight] = words else {
        return Err(format!("{key}: not two angles and a weight"));
    };
    let (polar, azimuth) = (number(key, polar)?.to_radians(), number(key, azimuth)?.to_radians());
    let axis = [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()];
    Ok(Sensor { axis, weight: number(key, weight)? })
}

fn position(words: &[&str]) -> Result<Position, String> {
    match words {
        ["inner", angle] => Ok(Position { axis: 0, turn_deg: number("turn", angle)? }),
        ["outer", angle] => Ok(Position { axis: 1, turn_deg: number("turn", angle)? }),
        _ => Err("turn: not an axis and an angle".into()),
    }
}

impl Setup {
    /// Read the text of a file; keys that this computer does not know are for others.
    pub fn parse(text: &str) -> Result<Self, String> {
        let lines = Lines::of(text)?;
        let angle = |key| lines.number(key).map(f64::to_radians);
        let positive = |key| match lines.number(key)? {
            value if value > 0.0 => Ok(value),
            value => Err(format!("{key}: {value} is not above 0")),
        };
        let attitude =
            body_attitude(angle("roll_deg")?, angle("pitch_deg")?, angle("heading_deg")?);
        Ok(Self {
            rate_hz: positive("rate_hz")? as i64,
            latitude: angle("latitude_deg")?,
            longitude: angle("longitude_deg")?,
            height: lines.number("height_m")?,
            body_attitude: match lines.word("initial_attitude")? {
                "given" => Some(attitude),
                "self-aligned" => None,
                other => return Err(format!("initial_attitude: {other} is unknown")),
            },
            alignment_s: lines.number("alignment_s")?,
            height_channel: match lines.word("height_channel")? {
                "held" => HeightChannel::Held,
                "damped" => HeightChannel::Damped,
                "free" => HeightChannel::Free,
                other => return Err(format!("height_channel: {other} is unknown")),
            },
            has_altimeter: lines.number("altimeter")? != 0.0,
            bridge_s: lines.number("bridge_s")?,
            gyros: lines.sensors("gyro")?,
            accelerometers: lines.sensors("accelerometer")?,
            turn_rate_dps: positive("turn_rate_dps")?,
            stand_s: lines.number("stand_s")?,
            positions: lines.positions()?,
            axis_acceleration_dps2: positive("axis_acceleration_dps2")?,
            axis_rise_s: lines.number("axis_rise_s")?,
            follow_tolerance_deg: lines.number("follow_tolerance_deg")?,
            axis_silence_s: lines.number("axis_silence_s")?,
        })
    }

    pub const fn period_ns(&self) -> i64 {
        1_000_000_000 / self.rate_hz
    }

    /// The period in seconds.
    pub fn dt(&self) -> f64 {
        self.period_ns() as f64 * 1e-9
    }

    /// Seconds in epochs, rounded.
    pub fn epochs(&self, seconds: f64) -> i64 {
        (seconds * self.rate_hz as f64).round_ties_even() as i64
    }
}
