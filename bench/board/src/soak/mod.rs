// SPDX-License-Identifier: GPL-3.0-or-later
//! The soak test: simulated hours of random protocols, broken wires, pulled cables and
//! resets, while invariants are checked against the simulated truth ([`run`]).
//!
//! A round arms the rig, runs a protocol, injects a fault at a random instant of a random
//! phase, removes it and clears.
//!
//! Each session has a rig of its own: noise, sensor zeros and plunger position are drawn
//! from its seed. Session *n* of seed *s* is session 0 of seed *s + n*, so that a violation
//! can be reproduced without the sessions before it.

mod draw;
mod ledger;
mod round;
mod session;
mod summary;

use std::time::{Duration, Instant};

use virtual_rig::image::Image;

pub use draw::{Deadline, Misfortune};
pub use session::STUCK_TRAVEL;
pub use summary::Summary;

/// Simulated length of a session (s), to the end of the round that it falls into.
pub const SESSION_S: f64 = 600.0;

/// Options of a soak test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Seed of the first session.
    pub seed: u64,
    /// Simulated time in all (s).
    pub seconds: f64,
    /// How often [`run`] tells how far it is.
    pub every: Duration,
}

/// A promise that was broken.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Seed of the session: alone it leads back here.
    pub seed: u64,
    /// Simulated time in that session (s).
    pub time_s: f64,
    /// The violation.
    pub what: String,
    /// The random draw of the round.
    pub round: String,
    /// How things really were.
    pub truth: String,
    /// The last lines in both directions, oldest first.
    pub lines: Vec<String>,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.what)?;
        writeln!(f, "  seed {}, at {:.4} s", self.seed, self.time_s)?;
        writeln!(f, "  round: {}", self.round)?;
        writeln!(f, "  truth: {}", self.truth)?;
        writeln!(f, "  the last lines:")?;
        for line in &self.lines {
            writeln!(f, "    {line}")?;
        }
        write!(
            f,
            "  again: cargo xtask soak --seed {} --hours {:.3}",
            self.seed,
            (self.time_s + 1.0) / 3600.0
        )
    }
}

impl std::error::Error for Violation {}

/// Runs sessions until the time is over; `tell` hears how far it is.
///
/// | invariant | checked |
/// |---|---|
/// | the true pressure stays below `max.kpa` + 10 % | every 2.5 ms |
/// | no step later than [`Deadline`] allows after something broke | every step, to the cycle |
/// | in idle and in a fault the pump is off and the valve open | every 2.5 ms |
/// | a line of telemetry for every period, except the lines that a noisy or unplugged cable or a reset took, which are counted | every line |
/// | a fault names something that was broken | every fault |
/// | what is broken is not armed | every line |
/// | `clear` works once the cause is gone, and the rig can be armed again | every round |
///
/// The first invariant has one exception: a stuck pressure sensor shows the firmware a wrong
/// pressure. The firmware detects it as a stall, after at most two windows of the stall watch. So
/// with that fault the plunger may move by [`STUCK_TRAVEL`] of `max.ul`, and the pressure may rise
/// by the gas law for that volume. A broken or shorted pressure sensor is also wrong for 50 ms,
/// but has no exception: the last good reading is held, and a pump at full flow compresses 0.25 ml
/// in that time.
///
/// # Errors
///
/// The first promise that was broken, and what had been until then.
pub fn run(
    image: &Image,
    options: &Options,
    mut tell: impl FnMut(&Summary),
) -> Result<Summary, Box<(Violation, Summary)>> {
    let mut summary = Summary::new();
    let mut told = Instant::now();
    let mut seed = options.seed;
    while summary.simulated_s() < options.seconds {
        let rest = (options.seconds - summary.simulated_s()).min(SESSION_S);
        let mut tell_now_and_then = |summary: &Summary| {
            if told.elapsed() >= options.every {
                told = Instant::now();
                tell(summary);
            }
        };
        let outcome = session::run(image, seed, rest, &mut summary, &mut tell_now_and_then);
        if let Err(violation) = outcome {
            return Err(Box::new((*violation, summary)));
        }
        seed = seed.wrapping_add(1);
    }
    Ok(summary)
}
