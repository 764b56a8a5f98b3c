// SPDX-License-Identifier: GPL-3.0-or-later
//! Accounts for every line of telemetry.
//!
//! The board numbers its lines and sends one per period, so received lines and gaps in
//! their numbers are all that it sent. A gap is allowed after noise, an unplugged cable, or
//! a reset since the last line. The board's clock has to agree with the simulated one, so
//! that a board that sends too few lines, but numbers them without gaps, is found too.

use wire::telemetry::{PERIOD_MS, Telemetry};

use super::summary::Summary;

/// How far the board's clock and ours may part between reset and reset (s): a line
/// waits for replies before it.
const CLOCK_S: f64 = 0.030;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ledger {
    last: Option<Telemetry>,
    /// Our time less the board's, at the first line after a reset (s).
    offset_s: Option<f64>,
    /// Resets until the last line.
    resets: u64,
    /// Conditions of the cable at any time since the last line.
    noisy: bool,
    unplugged: bool,
    torn: bool,
    /// Its conditions now: noisy, unplugged.
    present: (bool, bool),
}

impl Ledger {
    /// Takes note of what the line is like before a slice of time is run.
    pub(super) fn line_is(&mut self, noisy: bool, unplugged: bool) {
        self.present = (noisy, unplugged);
        self.noisy |= noisy;
        self.unplugged |= unplugged;
    }

    /// Whether bytes may be missing or wrong.
    fn is_excused(&self) -> bool {
        self.noisy || self.unplugged || self.torn
    }

    /// A line that makes no sense.
    pub(super) fn garbage(&mut self, resets: u64, summary: &mut Summary) -> Result<(), String> {
        if resets != self.resets {
            self.torn = true;
        }
        if !self.is_excused() {
            return Err("a line makes no sense on a quiet cable".into());
        }
        if self.torn && !self.noisy && !self.unplugged {
            summary.lost_to_resets += 1;
        }
        Ok(())
    }

    /// A line of telemetry, heard at `now_s`.
    pub(super) fn sample(
        &mut self,
        sample: &Telemetry,
        now_s: f64,
        resets: u64,
        summary: &mut Summary,
    ) -> Result<(), String> {
        summary.rows += 1;
        let board_s = f64::from(sample.time_ms) / 1e3;
        let is_on_time = |offset_s: f64| (now_s - board_s - offset_s).abs() <= CLOCK_S;
        // What was on its way when the board was reset still follows. A board that was reset long ago
        // on an unplugged cable may have counted beyond the last line, but not at that line's pace.
        let follows = |last: &Telemetry| {
            sample.time_ms > last.time_ms
                && (resets == self.resets || self.offset_s.is_none_or(is_on_time))
        };
        let lost = if let Some(last) = self.last.filter(follows) {
            let numbers = sample.sequence.wrapping_sub(last.sequence);
            let periods = (sample.time_ms - last.time_ms) / u32::from(PERIOD_MS);
            if u32::from(numbers) != periods & 0xffff {
                return Err(format!(
                    "{numbers} lines were numbered in {periods} periods"
                ));
            }
            periods - 1
        } else {
            if self.last.is_some() && resets == self.resets {
                return Err("the board's clock went back without a reset".into());
            }
            self.resets = resets;
            self.offset_s = None;
            u32::from(sample.sequence).saturating_sub(1)
        };
        if lost > 0 {
            let lost = u64::from(lost);
            if self.unplugged {
                summary.lost_unplugged += lost;
            } else if self.noisy {
                summary.lost_to_noise += lost;
            } else {
                return Err(format!("{lost} lines were lost on a quiet cable"));
            }
        }
        let offset_s = *self.offset_s.get_or_insert(now_s - board_s);
        let drift_s = now_s - board_s - offset_s;
        if drift_s.abs() > CLOCK_S {
            return Err(format!(
                "the line came {:.1} ms from where its time says",
                1e3 * drift_s
            ));
        }
        self.last = Some(*sample);
        (self.noisy, self.unplugged) = self.present;
        self.torn = false;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use wire::{state::State, telemetry::Setpoint};

    use super::*;

    fn line(sequence: u16, time_ms: u32) -> Telemetry {
        Telemetry {
            sequence,
            time_ms,
            pressure_kpa: None,
            angle_deg: None,
            predicted_deg: None,
            setpoint: Setpoint::None,
            volume_ul: 0,
            state: State::Idle,
            fault: 0,
            mismatch: false,
        }
    }

    /// A ledger that has seen two lines, half a second after the board started.
    fn two_lines(summary: &mut Summary) -> Ledger {
        let mut ledger = Ledger::default();
        for (sequence, time_ms, now_s) in [(1, 10, 0.510), (2, 20, 0.520)] {
            let sample = line(sequence, time_ms);
            assert_eq!(ledger.sample(&sample, now_s, 0, summary), Ok(()));
        }
        ledger
    }

    #[test]
    fn a_line_that_is_lost_needs_a_reason_and_is_counted() {
        let mut summary = Summary::new();
        let ledger = two_lines(&mut summary);
        let later = line(5, 50);
        assert!({ ledger }.sample(&later, 0.550, 0, &mut summary).is_err());
        for (noisy, unplugged) in [(true, false), (false, true)] {
            let mut ledger = ledger;
            ledger.line_is(noisy, unplugged);
            ledger.line_is(false, false);
            assert_eq!(ledger.sample(&later, 0.550, 0, &mut summary), Ok(()));
            // The next one has no excuse any more.
            let much_later = line(7, 70);
            assert!(ledger.sample(&much_later, 0.570, 0, &mut summary).is_err());
        }
        assert_eq!((summary.lost_to_noise, summary.lost_unplugged), (2, 2));
    }

    #[test]
    fn numbers_clock_and_lines_have_to_agree() {
        let mut summary = Summary::new();
        let ledger = two_lines(&mut summary);
        for (sequence, time_ms, now_s) in [
            // Two numbers in a period, one in two.
            (4, 30, 0.530),
            (3, 40, 0.540),
            // A line that comes a period late, and more and more so.
            (3, 30, 0.570),
            // A clock that goes back although nothing was reset.
            (1, 10, 0.530),
        ] {
            let mut ledger = ledger;
            let sample = line(sequence, time_ms);
            let entry = ledger.sample(&sample, now_s, 0, &mut summary);
            assert!(entry.is_err(), "{sequence} {time_ms} {now_s}");
        }
        let mut after_reset = ledger;
        let first = line(1, 10);
        assert_eq!(after_reset.sample(&first, 2.0, 1, &mut summary), Ok(()));
    }

    #[test]
    fn a_board_that_was_reset_unplugged_may_count_beyond_its_last_line() {
        let mut summary = Summary::new();
        let mut ledger = two_lines(&mut summary);
        ledger.line_is(false, true);
        ledger.line_is(false, false);
        // Reset a second later, it has counted to 5 when it is heard again.
        let later = line(5, 50);
        let mut refused = Summary::new();
        assert!({ ledger }.sample(&later, 1.570, 0, &mut refused).is_err());
        assert_eq!(ledger.sample(&later, 1.570, 1, &mut summary), Ok(()));
        assert_eq!(summary.lost_unplugged, 4);
        // From then on its clock is held against ours.
        assert!(
            { ledger }
                .sample(&line(6, 60), 1.620, 1, &mut refused)
                .is_err()
        );
        assert_eq!(ledger.sample(&line(6, 60), 1.580, 1, &mut summary), Ok(()));
    }

    #[test]
    fn garbage_needs_noise_or_a_reset() {
        let mut summary = Summary::new();
        let ledger = two_lines(&mut summary);
        assert!({ ledger }.garbage(0, &mut summary).is_err());
        assert_eq!({ ledger }.garbage(1, &mut summary), Ok(()));
        let mut noisy = ledger;
        noisy.line_is(true, false);
        assert_eq!(noisy.garbage(0, &mut summary), Ok(()));
        assert_eq!(summary.lost_to_resets, 1);
    }
}
