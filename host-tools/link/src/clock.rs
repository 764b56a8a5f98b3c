//! One time axis for a recording across resets of the board.
//!
//! The board counts milliseconds since its reset, and opening a port resets it. After a
//! restart its time is shifted so that it continues the recording, by the time that
//! passed on the computer's clock.

use std::time::Duration;

use softrig_formats::instant::Instant;
use wire::telemetry::{PERIOD_MS, Telemetry};

use super::client::Received;

/// Places samples on the time axis of a recording.
#[derive(Clone, Debug)]
pub struct Clock {
    /// Seconds in one of the board's.
    factor: f64,
    offset_ms: i64,
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    device_ms: u32,
    time_ms: i64,
    arrived: Instant,
}

impl Default for Clock {
    fn default() -> Self {
        Self::of_rate(1.0)
    }
}

/// Where a sample is on the time axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Time since the first sample (ms); always more than that of the sample
    /// before.
    pub time_ms: i64,
    /// The break in front of the sample, if there is one.
    pub gap: Option<Break>,
}

/// A place where samples are missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Break {
    /// Time of the sample before (ms).
    pub from_ms: i64,
    /// Time of the sample after (ms).
    pub to_ms: i64,
    /// Whether the board restarted in between, so that the length is by the
    /// computer's clock.
    pub restarted: bool,
    /// The offset that has been added to the board's time since (ms).
    pub offset_ms: i64,
}

impl Clock {
    /// A time axis by the board's clock, of which one second takes `factor` seconds of the
    /// computer's. The axis itself stays in the board's time; only the length of a restart,
    /// which the computer measures, is converted.
    pub fn of_rate(factor: f64) -> Self {
        Self {
            factor,
            offset_ms: 0,
            last: None,
        }
    }

    /// Places a sample; none for one that is not later than the one before.
    pub fn place(&mut self, received: &Received) -> Option<Placed> {
        let Telemetry { time_ms, .. } = received.sample;
        let Some(last) = self.last else {
            self.offset_ms = -i64::from(time_ms);
            return Some(self.note(received, 0, None));
        };
        if received.restarted {
            let passed = received.arrived.saturating_duration_since(last.arrived);
            let passed = passed.div_f64(self.factor);
            let passed = passed.max(Duration::from_millis(u64::from(PERIOD_MS)));
            let passed = i64::try_from(passed.as_millis()).unwrap_or(i64::MAX / 2);
            self.offset_ms = last.time_ms + passed - i64::from(time_ms);
        } else if time_ms < last.device_ms {
            // 49 days.
            self.offset_ms += 1 << 32;
        }
        let placed = i64::from(time_ms) + self.offset_ms;
        if placed <= last.time_ms {
            return None;
        }
        let is_gap = received.restarted || placed - last.time_ms > 3 * i64::from(PERIOD_MS);
        let gap = is_gap.then_some(Break {
            from_ms: last.time_ms,
            to_ms: placed,
            restarted: received.restarted,
            offset_ms: self.offset_ms,
        });
        Some(self.note(received, placed, gap))
    }

    fn note(&mut self, received: &Received, time_ms: i64, gap: Option<Break>) -> Placed {
        self.last = Some(Last {
            device_ms: received.sample.time_ms,
            time_ms,
            arrived: received.arrived,
        });
        Placed { time_ms, gap }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::state::State;
    use wire::telemetry::Setpoint;

    fn received(time_ms: u32, arrived: Instant, restarted: bool) -> Received {
        Received {
            sample: Telemetry {
                sequence: 0,
                time_ms,
                pressure_kpa: None,
                angle_deg: None,
                predicted_deg: None,
                setpoint: Setpoint::None,
                volume_ul: 0,
                state: State::Idle,
                fault: 0,
                mismatch: false,
            },
            arrived,
            restarted,
            dropped: 0,
        }
    }

    #[test]
    fn time_starts_at_zero_and_goes_on_after_a_restart() {
        let mut clock = Clock::default();
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut place =
            |device, wall, restarted| clock.place(&received(device, at(wall), restarted)).unwrap();
        assert_eq!(place(5_000, 0, false).time_ms, 0);
        assert_eq!(place(5_010, 11, false).time_ms, 10);
        let after = place(300, 4_011, true);
        assert_eq!(after.time_ms, 4_010);
        let gap = after.gap.unwrap();
        assert!(gap.restarted && gap.from_ms == 10 && gap.offset_ms == 3_710);
        assert_eq!(
            place(310, 4_022, false),
            Placed {
                time_ms: 4_020,
                gap: None
            }
        );
        // Lost lines are a gap by the board's clock, whenever they arrive.
        assert_eq!(place(400, 4_023, false).gap.unwrap().to_ms, 4_110);
    }

    #[test]
    fn time_increases_even_when_everything_comes_at_once() {
        let mut clock = Clock::default();
        let now = Instant::now();
        let mut last = -1;
        for (device, restarted) in [(900, false), (0, true), (10, false), (0, true)] {
            let placed = clock.place(&received(device, now, restarted)).unwrap();
            assert!(placed.time_ms > last);
            last = placed.time_ms;
        }
        assert_eq!(clock.place(&received(0, now, false)), None);
    }
}
