//! A navigation computer on the rehearsal's bus, in Rust without crates.
//!
//! `own_firmware_rust --setup FILE --interface rrins --channel PATH --speed max|1`
//!
//! The shells own time and the bus, and run the step: in lockstep the hardware opens an epoch and
//! this closes it; in real time (speed 1) it keeps deadlines by its own clock.

mod bus;
mod clock;
mod contract;
mod firmware;
mod intake;
mod maths;
mod navigation;
mod scheme;
mod setup;
mod sys;
mod transmit;

use std::collections::HashMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use bus::Bus;
use contract::Frame;
use firmware::{Firmware, Mode};
use setup::Setup;

const SLICES: u32 = 4; // of the wait for a late epoch
const LARGEST_WAIT: u32 = 16; // slices

fn run_lockstep(firmware: &mut Firmware, bus: &Bus) -> Result<(), String> {
    let (mut inbox, mut outbox) = (Vec::new(), Vec::new());
    firmware.intake.is_whole = true;
    while firmware.mode != Mode::Shutdown {
        let mut batch = bus.receive()?;
        // The hardware's clock is this computer's: every SYNC comes when it is expected.
        let at_ns = batch.epoch as i64 * firmware.setup.period_ns();
        batch.frames.iter_mut().for_each(|frame| frame.at_ns = at_ns);
        inbox.append(&mut batch.frames);
        if batch.closes_epoch {
            outbox.clear();
            firmware.step(&inbox, &mut outbox);
            inbox.clear();
            bus.send(&outbox, batch.epoch, batch.time_ns)?;
        }
    }
    Ok(())
}

/// The shell of real time: what has come, and when.
struct Realtime<'a> {
    bus: &'a Bus,
    origin: Instant,
    period_ns: i64,
    inbox: Vec<Frame>,
}

impl Realtime<'_> {
    fn now_ns(&self) -> i64 {
        self.origin.elapsed().as_nanos() as i64
    }

    fn is_whole(&self) -> bool {
        self.inbox.iter().any(|frame| frame.id == contract::AXIS_STATUS + 1)
    }

    /// Receive until a deadline, or until the epoch is whole.
    fn gather(&mut self, deadline_ns: i64, until_whole: bool) -> Result<(), String> {
        while !(until_whole && self.is_whole()) {
            let left = Duration::from_nanos((deadline_ns - self.now_ns()).max(0) as u64);
            match self.bus.receive_within(left)? {
                Some(batch) => self.inbox.extend(batch.frames),
                None if self.now_ns() >= deadline_ns => break,
                None => {}
            }
        }
        Ok(())
    }

    /// Wait a period for an epoch that is late; anew after a stall, which the other side had, too.
    fn wait_for_late_frames(&mut self) -> Result<(), String> {
        let slice_ns = self.period_ns / i64::from(SLICES);
        let mut on_time = 0;
        for _ in 0..LARGEST_WAIT {
            if self.is_whole() || on_time == SLICES {
                break;
            }
            let end_ns = self.now_ns() + slice_ns;
            self.gather(end_ns, true)?;
            on_time = if self.now_ns() - end_ns > slice_ns / 2 { 0 } else { on_time + 1 };
        }
        Ok(())
    }

    fn run(&mut self, firmware: &mut Firmware) -> Result<(), String> {
        let period_ns = self.period_ns;
        let mut deadline_ns = self.now_ns() + period_ns;
        let mut outbox = Vec::new();
        while firmware.mode != Mode::Shutdown {
            self.gather(deadline_ns, false)?;
            let clock = &firmware.intake.clock;
            let is_overrun = clock.is_synchronised && self.now_ns() - deadline_ns > period_ns;
            if clock.is_synchronised && !clock.is_lost {
                self.wait_for_late_frames()?;
            }
            firmware.overruns += i64::from(is_overrun);
            let begin_ns = self.now_ns();
            outbox.clear();
            let used = firmware.step(&self.inbox, &mut outbox);
            self.inbox.drain(..used);
            let epoch = firmware.intake.epoch;
            self.bus.send(&outbox, epoch as u64, epoch * period_ns)?;
            let load = 100.0 * (self.now_ns() - begin_ns) as f64 / period_ns as f64;
            firmware.load_percent += (load - firmware.load_percent) / 16.0;
            let clock = &firmware.intake.clock;
            let is_timed = clock.is_synchronised;
            deadline_ns =
                if is_timed { clock.next_ns + period_ns / 2 } else { deadline_ns + period_ns };
        }
        Ok(())
    }
}

fn run() -> Result<(), String> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let options: HashMap<&str, &str> =
        words.chunks_exact(2).map(|pair| (pair[0].as_str(), pair[1].as_str())).collect();
    let option =
        |name: &str| options.get(name).copied().ok_or_else(|| format!("{name} is missing"));
    let wait = option("--attach-wait").unwrap_or("10").parse().unwrap_or(10.0);
    if options.get("--interface").is_some_and(|name| *name != "rrins") {
        return Err("--interface: rrins alone".into());
    }
    let (file, channel) = (option("--setup")?, option("--channel")?);
    let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
    let setup = Setup::parse(&text).map_err(|error| format!("{file}: {error}"))?;
    let (origin, period_ns) = (Instant::now(), setup.period_ns());
    let mut firmware = Firmware::new(setup);
    let is_realtime = options.get("--speed") == Some(&"1");
    if is_realtime {
        sys::enter_realtime();
    }
    let bus = Bus::attach(channel, Duration::from_secs_f64(wait), origin)
        .map_err(|error| format!("{channel}: {error}"))?;
    if is_realtime {
        Realtime { bus: &bus, origin, period_ns, inbox: Vec::new() }.run(&mut firmware)?;
    } else {
        run_lockstep(&mut firmware, &bus)?;
    }
    bus.leave();
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("own_firmware_rust: {error}");
            ExitCode::FAILURE
        }
    }
}
