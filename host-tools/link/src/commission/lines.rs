//! Lines of telemetry: whether all come, and when.

use wire::telemetry::PERIOD_MS;

use super::{Limit, Measurement};
use crate::{Counters, Received};

/// Longest period of the board's own clock (ms) that is no gap: a late one is made up for by the
/// next.
const LONGEST_PERIOD_MS: f64 = 12.0;

/// Latest arrival (ms) behind the soonest ones that harms nothing: the board waits two seconds
/// for a sign of life.
const LATEST_MS: f64 = 250.0;

/// Least RAM (bytes) that was never used: the deepest interrupt on the deepest call needs less.
const LEAST_FREE: f64 = 128.0;

/// What came while nobody did anything.
#[derive(Clone, Debug, Default)]
pub struct Watched {
    /// The samples.
    pub samples: Vec<Received>,
    /// Lines counted meanwhile.
    pub counters: Counters,
    /// RAM that was never used (bytes), if the board said so.
    pub free_bytes: Option<u32>,
}

impl Watched {
    /// What the telemetry of this watch is held to. Arrivals are judged only where the board's
    /// time passes as ours does: `in_real_time`.
    pub fn measure(&self, in_real_time: bool) -> Vec<Measurement> {
        let whole =
            |name: &str, value: u64| Measurement::new(name, value as f64, "", Limit::AtMost(0.0));
        let arrivals = Arrivals::of(&self.samples);
        let period = f64::from(PERIOD_MS);
        let expected = arrivals.seconds * 1000.0 / period + 1.0;
        let mut measured = vec![
            Measurement::new(
                "lines received",
                self.samples.len() as f64,
                "",
                Limit::AtLeast((0.999 * expected).floor().max(2.0)),
            ),
            whole("lines lost on the way", self.counters.dropped),
            whole("lines damaged on the way", self.counters.damaged),
            whole("restarts of the board", self.counters.restarts),
            Measurement::new(
                "longest control period",
                arrivals.longest_period_ms,
                "ms",
                Limit::AtMost(LONGEST_PERIOD_MS),
            ),
            Measurement::new(
                "jitter of the control period, rms",
                arrivals.jitter_ms,
                "ms",
                Limit::AtMost(0.5),
            ),
        ];
        if in_real_time {
            measured.push(Measurement::new(
                "latest arrival",
                arrivals.latest_ms,
                "ms",
                Limit::AtMost(LATEST_MS),
            ));
        }
        if let Some(free) = self.free_bytes {
            let limit = Limit::AtLeast(LEAST_FREE);
            measured.push(Measurement::new(
                "RAM never used",
                f64::from(free),
                "bytes",
                limit,
            ));
        }
        measured
    }
}

/// When lines came.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Arrivals {
    /// From the first to the last, by the board's clock (s), restarts left out.
    pub seconds: f64,
    /// Longest time between two neighbouring lines, by the board's clock (ms).
    pub longest_period_ms: f64,
    /// Standard deviation of that time about 10 ms (ms).
    pub jitter_ms: f64,
    /// The latest arrival, against the soonest (ms).
    pub latest_ms: f64,
}

impl Arrivals {
    /// Looks at neighbours; those with a lost line or a restart between them are none.
    pub fn of(samples: &[Received]) -> Self {
        let mut seconds = 0.0;
        let (mut longest, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
        let mut delays: Vec<f64> = Vec::with_capacity(samples.len());
        let mut board_ms = 0.0;
        for (index, received) in samples.iter().enumerate() {
            if let Some(before) = index.checked_sub(1).and_then(|index| samples.get(index)) {
                if received.restarted {
                    continue;
                }
                let passed = received.sample.time_ms.wrapping_sub(before.sample.time_ms);
                let passed = f64::from(passed);
                board_ms += passed;
                seconds += passed / 1000.0;
                if received.dropped == 0 {
                    longest = longest.max(passed);
                    squares += (passed - f64::from(PERIOD_MS)).powi(2);
                    count += 1.0;
                }
            }
            let first = samples.first().map_or(received.arrived, |it| it.arrived);
            let ours = received.arrived.saturating_duration_since(first);
            delays.push(ours.as_secs_f64() * 1000.0 - board_ms);
        }
        // A clock that is off by a percent is judged elsewhere.
        let slope = match (delays.first(), delays.last()) {
            (Some(first), Some(last)) if board_ms > 0.0 => (last - first) / delays.len() as f64,
            _ => 0.0,
        };
        let level: Vec<f64> = (0..)
            .zip(&delays)
            .map(|(index, delay)| delay - slope * f64::from(index))
            .collect();
        let least = level.iter().copied().fold(f64::INFINITY, f64::min);
        let most = level.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        Self {
            seconds,
            longest_period_ms: longest,
            jitter_ms: if count > 0.0 {
                f64::sqrt(squares / count)
            } else {
                f64::NAN
            },
            latest_ms: most - least,
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::time::{Duration, Instant};
    use wire::state::State;
    use wire::telemetry::{Setpoint, Telemetry};

    /// The sample of this number of an idle board.
    pub fn sample(index: u32) -> Received {
        Received {
            sample: Telemetry {
                sequence: u16::try_from(index % 65_536).unwrap(),
                time_ms: index * 10,
                pressure_kpa: None,
                angle_deg: None,
                predicted_deg: None,
                setpoint: Setpoint::None,
                volume_ul: 0,
                state: State::Idle,
                fault: 0,
                mismatch: false,
            },
            arrived: Instant::now(),
            restarted: false,
            dropped: 0,
        }
    }

    fn failures(watched: &Watched) -> Vec<String> {
        let measured = watched.measure(true);
        let failed = measured.into_iter().filter(|it| !it.passed);
        failed.map(|it| it.name).collect()
    }

    #[test]
    fn a_minute_without_a_gap_passes_and_each_trouble_is_named() {
        let start = Instant::now();
        let line = |index: u32| Received {
            arrived: start + Duration::from_millis(u64::from(index) * 10 + u64::from(index % 3)),
            ..sample(index)
        };
        let well = Watched {
            samples: (0..6_000).map(line).collect(),
            free_bytes: Some(2_000),
            ..Watched::default()
        };
        assert_eq!(failures(&well), [""; 0]);

        let mut lost = well.clone();
        lost.samples.drain(100..110);
        lost.samples[100].dropped = 10;
        lost.counters.dropped = 10;
        assert_eq!(failures(&lost), ["lines received", "lines lost on the way"]);

        let mut late = well.clone();
        late.samples[3_000].sample.time_ms += 5;
        assert_eq!(failures(&late), ["longest control period"]);

        let mut slow = well.clone();
        slow.samples[3_000].arrived += Duration::from_millis(400);
        assert_eq!(failures(&slow), ["latest arrival"]);

        let mut full = well;
        full.free_bytes = Some(10);
        assert_eq!(failures(&full), ["RAM never used"]);
    }
}
