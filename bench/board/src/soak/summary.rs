// SPDX-License-Identifier: GPL-3.0-or-later
//! The summary of a soak test.

use std::{collections::BTreeMap, fmt, time::Instant};

use super::draw::Misfortune;

/// Counts of one kind of event.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Tally {
    /// How often it was drawn.
    pub drawn: u64,
    /// After how many a fault was latched.
    pub latched: u64,
    /// In how many the pump was moving when it struck.
    pub moving: u64,
    /// The latest step after it (s), where there is a deadline.
    pub latest_stop_s: f64,
    /// The deadline (s).
    pub deadline_s: f64,
}

/// Figures of a soak.
#[derive(Clone, Debug)]
pub struct Summary {
    began: Instant,
    pub(super) before_s: f64,
    pub(super) session_s: f64,
    pub(super) sessions: u64,
    pub(super) rounds: u64,
    pub(super) arms: u64,
    pub(super) runs: u64,
    pub(super) ended: u64,
    pub(super) clears: u64,
    pub(super) kinds: BTreeMap<Misfortune, Tally>,
    pub(super) rows: u64,
    pub(super) lost_to_noise: u64,
    pub(super) lost_unplugged: u64,
    pub(super) lost_to_resets: u64,
    pub(super) largest_kpa: f64,
    pub(super) largest_stuck_kpa: f64,
    pub(super) largest_deg: f64,
    pub(super) stuck_travel_ul: f64,
}

impl Summary {
    pub(super) fn new() -> Self {
        Self {
            began: Instant::now(),
            before_s: 0.0,
            session_s: 0.0,
            sessions: 0,
            rounds: 0,
            arms: 0,
            runs: 0,
            ended: 0,
            clears: 0,
            kinds: BTreeMap::new(),
            rows: 0,
            lost_to_noise: 0,
            lost_unplugged: 0,
            lost_to_resets: 0,
            largest_kpa: 0.0,
            largest_stuck_kpa: 0.0,
            largest_deg: 0.0,
            stuck_travel_ul: 0.0,
        }
    }

    /// Simulated time (s), all sessions together.
    pub fn simulated_s(&self) -> f64 {
        self.before_s + self.session_s
    }

    /// Misfortunes that happened.
    pub fn misfortunes(&self) -> u64 {
        self.kinds.values().map(|tally| tally.drawn).sum()
    }

    /// How often the rig was armed, from idle to ready.
    pub fn arms(&self) -> u64 {
        self.arms
    }

    /// Lines of telemetry that came.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// A line that says how far it is.
    pub fn progress(&self) -> String {
        let wall = self.began.elapsed().as_secs_f64();
        format!(
            "{:.0} s simulated in {wall:.0} s ({:.1} times as fast as life): {} rounds, {} arms, {} misfortunes, {} lines",
            self.simulated_s(),
            self.simulated_s() / wall.max(1e-9),
            self.rounds,
            self.arms,
            self.misfortunes(),
            self.rows,
        )
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.progress())?;
        writeln!(
            f,
            "{} sessions, {} runs ({} to their end), {} faults cleared",
            self.sessions, self.runs, self.ended, self.clears
        )?;
        writeln!(
            f,
            "largest pressure {:.1} kPa ({:.1} kPa with a stuck sensor, after {:.0} ul at most), largest angle {:.1} deg",
            self.largest_kpa, self.largest_stuck_kpa, self.stuck_travel_ul, self.largest_deg
        )?;
        writeln!(
            f,
            "{} lines of telemetry; lost: {} to noise, {} unplugged, {} to resets, 0 without a reason",
            self.rows, self.lost_to_noise, self.lost_unplugged, self.lost_to_resets
        )?;
        writeln!(f)?;
        writeln!(
            f,
            "{:<16}{:>8}{:>9}{:>9}{:>16}{:>10}",
            "misfortune", "times", "moving", "latched", "latest step ms", "limit ms"
        )?;
        for (kind, tally) in &self.kinds {
            write!(
                f,
                "{:<16}{:>8}{:>9}{:>9}",
                kind.name(),
                tally.drawn,
                tally.moving,
                tally.latched
            )?;
            if tally.deadline_s > 0.0 {
                writeln!(
                    f,
                    "{:>16.2}{:>10.0}",
                    1e3 * tally.latest_stop_s,
                    1e3 * tally.deadline_s
                )?;
            } else {
                writeln!(f, "{:>16}{:>10}", "-", "-")?;
            }
        }
        Ok(())
    }
}
