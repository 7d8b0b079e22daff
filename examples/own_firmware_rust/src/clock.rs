//! When SYNC comes, by this computer's clock: a loop of second order (`docs/firmware.md`, "Clock").

const JUMP_AFTER: u32 = 8;
const LOST_AFTER: u32 = 10;

pub struct Clock {
    pub is_synchronised: bool,
    pub is_lost: bool,
    /// Whether this epoch has had its SYNC.
    pub is_seen: bool,
    pub next_ns: i64,
    pub nominal_ns: i64,
    period_q16: i64, // ns * 2^16
    fraction_q16: i64,
    outliers: u32,
    missed: u32,
}

impl Clock {
    pub const fn new(period_ns: i64) -> Self {
        Self {
            is_synchronised: false,
            is_lost: false,
            is_seen: false,
            next_ns: 0,
            nominal_ns: period_ns,
            period_q16: period_ns << 16,
            fraction_q16: 0,
            outliers: 0,
            missed: 0,
        }
    }

    /// Take a SYNC that came `late` epochs behind the count.
    pub fn synchronise(&mut self, at_ns: i64, late: i64) {
        let period_ns = self.period_q16 >> 16;
        let error_ns = at_ns - (self.next_ns - late * period_ns);
        self.missed = 0;
        self.is_lost = false;
        if !self.is_synchronised {
            self.is_synchronised = true;
            self.next_ns = at_ns;
            self.fraction_q16 = 0;
            self.outliers = 0;
        } else if error_ns.abs() > period_ns / 2 {
            self.outliers += 1;
            if self.outliers == JUMP_AFTER {
                self.next_ns += error_ns;
                self.outliers = 0;
            }
        } else {
            let error_ns = error_ns.clamp(-period_ns / 16, period_ns / 16);
            self.next_ns += error_ns >> 4;
            self.period_q16 += (error_ns << 16) >> 10;
            self.outliers = 0;
        }
    }

    /// End an epoch.
    pub fn advance(&mut self) {
        self.fraction_q16 += self.period_q16;
        self.next_ns += self.fraction_q16 >> 16;
        self.fraction_q16 &= 0xFFFF;
        if !self.is_seen {
            self.missed += 1;
            self.is_lost = self.missed >= LOST_AFTER;
        }
    }

    pub fn error_ppm(&self) -> f64 {
        (self.period_q16 as f64 / (self.nominal_ns << 16) as f64 - 1.0) * 1e6
    }
}
