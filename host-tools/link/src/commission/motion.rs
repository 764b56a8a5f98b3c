//! What is measured while the plunger moves.

use wire::state::State;

use super::{Curve, Limit, Measurement};
use crate::Received;

/// Pressure (kPa) beyond which a rig with an open vent is not vented.
const VENTED_KPA: f64 = 5.0;

/// Longest time (s) in which the vent takes the pressure away; the board calls 3.5 s blocked.
const LONGEST_VENT_S: f64 = 2.0;

fn pressure(received: &Received) -> Option<f64> {
    received
        .sample
        .pressure_kpa
        .map(|it| f64::from(it.to_f32()))
}

fn angle(received: &Received) -> Option<f64> {
    received.sample.angle_deg.map(|it| f64::from(it.to_f32()))
}

/// Time (s) since the first.
fn time(first: &Received, received: &Received) -> f64 {
    f64::from(received.sample.time_ms.wrapping_sub(first.sample.time_ms)) / 1000.0
}

/// A pressure that was reached, held with the pump off, and let out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hold {
    /// What was asked for (kPa).
    pub asked_kpa: f64,
    /// Time at which it was reached within a tenth (s from the start).
    pub reached_s: Option<f64>,
    /// Largest pressure (kPa).
    pub highest_kpa: f64,
    /// Share of the pressure that was gone after ten seconds with the pump off.
    pub lost_share: Option<f64>,
    /// Time from the opening of the vent to 5 kPa (s).
    pub vented_s: Option<f64>,
    /// Pressure at the end against that at the start (kPa).
    pub zero_shift_kpa: Option<f64>,
    /// How far it bent (°).
    pub bent_deg: Option<f64>,
}

/// Seconds of the hold over which the leak is judged, the first ones left out: air that was
/// compressed quickly cools, and silicone creeps.
const LEAK_S: (f64, f64) = (2.0, 10.0);

impl Hold {
    /// Reads it off a run that held `asked_kpa` up to `pump_off_s`, then with the pump off up to
    /// `release_s` (s after the run began).
    pub fn of(samples: &[Received], asked_kpa: f64, pump_off_s: f64, release_s: f64) -> Self {
        let Some(start) = samples
            .iter()
            .position(|it| it.sample.state == State::Running)
        else {
            return Self {
                asked_kpa,
                ..Self::default()
            };
        };
        let (before, run) = samples.split_at(start);
        let Some(first) = run.first() else {
            return Self::default();
        };
        let mean = |from: f64, to: f64, pick: fn(&Received) -> Option<f64>| {
            let within = run
                .iter()
                .filter(|it| (from..to).contains(&time(first, it)));
            mean_of(within.filter_map(pick))
        };
        let rest_kpa = mean_of(before.iter().rev().take(50).filter_map(pressure)).unwrap_or(0.0);
        let rest_deg = mean_of(before.iter().rev().take(50).filter_map(angle));
        let reached = run.iter().find(|it| {
            it.sample.state == State::Running && pressure(it).is_some_and(|it| it > 0.9 * asked_kpa)
        });
        let early = mean(pump_off_s + LEAK_S.0, pump_off_s + LEAK_S.0 + 0.5, pressure);
        let late = mean(pump_off_s + LEAK_S.1 - 0.5, pump_off_s + LEAK_S.1, pressure);
        let last_s = run.last().map_or(0.0, |it| time(first, it));
        let is_released = last_s > release_s;
        let vented = run.iter().find(|it| {
            time(first, it) >= release_s
                && pressure(it).is_some_and(|it| (it - rest_kpa).abs() < VENTED_KPA)
        });
        let end = mean_of(run.iter().rev().take(50).filter_map(pressure)).filter(|_| is_released);
        let bent = mean(release_s - 1.0, release_s, angle);
        Self {
            asked_kpa,
            reached_s: reached.map(|it| time(first, it)),
            highest_kpa: run.iter().filter_map(pressure).fold(f64::NAN, f64::max),
            lost_share: early
                .zip(late)
                .map(|(early, late)| (early - late) / (early - rest_kpa)),
            vented_s: vented.map(|it| time(first, it) - release_s),
            zero_shift_kpa: end.map(|end| end - rest_kpa),
            bent_deg: bent.zip(rest_deg).map(|(bent, rest)| bent - rest),
        }
    }

    /// What it is held to.
    pub fn measure(&self) -> Vec<Measurement> {
        let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
        vec![
            Measurement::new(
                format!("time to {:.0} kPa", self.asked_kpa),
                or_nan(self.reached_s),
                "s",
                Limit::AtMost(8.0),
            ),
            Measurement::new(
                "highest pressure",
                self.highest_kpa,
                "kPa",
                Limit::AtMost(1.15 * self.asked_kpa),
            ),
            Measurement::new(
                "pressure lost in 8 s with the pump off",
                100.0 * or_nan(self.lost_share),
                "%",
                Limit::Within(-5.0, 10.0),
            ),
            Measurement::new(
                "time to vent",
                or_nan(self.vented_s),
                "s",
                Limit::AtMost(LONGEST_VENT_S),
            ),
            Measurement::new(
                "shift of the pressure's zero",
                or_nan(self.zero_shift_kpa),
                "kPa",
                Limit::Within(-1.0, 1.0),
            ),
            Measurement::new(
                "bend of the actuator",
                or_nan(self.bent_deg),
                "°",
                Limit::AtLeast(5.0),
            ),
        ]
    }
}

fn mean_of(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), it| (sum + it, count + 1.0));
    (count > 0.0).then_some(sum / count)
}

/// What happened when a moving pump was stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stop {
    /// Flow just before (µl/s).
    pub flow_ul_s: f64,
    /// Volume that was pumped after the board had latched the fault (µl).
    pub after_ul: f64,
    /// Time from there to a vented actuator (s).
    pub vented_s: Option<f64>,
}

impl Stop {
    /// Reads it off the samples around the first latched fault; nothing where there is none.
    pub fn of(samples: &[Received]) -> Option<Self> {
        let at = samples
            .iter()
            .position(|it| it.sample.state == State::Fault)?;
        let (before, after) = samples.split_at(at);
        let first = after.first()?;
        let volume = |it: &Received| f64::from(it.sample.volume_ul);
        let earlier = before.len().checked_sub(50).and_then(|at| before.get(at));
        let flow = match (earlier.or(before.first()), before.last()) {
            (Some(earlier), Some(last)) => {
                (volume(last) - volume(earlier)) / time(earlier, last).max(0.01)
            }
            _ => 0.0,
        };
        let vented = after
            .iter()
            .find(|it| pressure(it).is_some_and(|it| it.abs() < VENTED_KPA));
        Some(Self {
            flow_ul_s: flow,
            after_ul: after
                .last()
                .map_or(0.0, |last| (volume(last) - volume(first)).abs()),
            vented_s: vented.map(|it| time(first, it)),
        })
    }

    /// What it is held to; the volume of a microstep is `step_ul` (µl).
    pub fn measure(&self, step_ul: f64) -> Vec<Measurement> {
        vec![
            Measurement::new("flow before", self.flow_ul_s, "µl/s", Limit::AtLeast(1.0)),
            Measurement::new(
                "steps after the stop",
                self.after_ul / step_ul,
                "",
                Limit::AtMost(10.0),
            ),
            Measurement::new(
                "time to vent",
                self.vented_s.unwrap_or(f64::NAN),
                "s",
                Limit::AtMost(LONGEST_VENT_S),
            ),
        ]
    }
}

/// The pressure and the angle over time, to be drawn.
pub fn curves(samples: &[Received]) -> Vec<Curve> {
    let Some(first) = samples.first() else {
        return Vec::new();
    };
    let of = |y_label, pick: fn(&Received) -> Option<f64>| Curve {
        x_label: "time (s)",
        y_label,
        points: samples
            .iter()
            .filter_map(|it| Some((time(first, it), pick(it)?)))
            .collect(),
    };
    vec![of("pressure (kPa)", pressure), of("angle (°)", angle)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commission::lines::tests::sample;
    use wire::decimal::Hundredths;

    fn at(index: u32, state: State, kpa: f64, volume_ul: i32) -> Received {
        let mut received = sample(index);
        received.sample.state = state;
        #[allow(clippy::cast_possible_truncation)]
        let hundredths = (kpa * 100.0).round() as i32;
        received.sample.pressure_kpa = Some(Hundredths(hundredths));
        received.sample.angle_deg = Some(Hundredths(hundredths));
        received.sample.volume_ul = volume_ul;
        received
    }

    /// Up to 40 kPa in a second, held 4 s, then a leak of this time constant for 10 s, then out.
    fn run(leak_s: f64, vent_s: f64) -> Vec<Received> {
        (0..1_900)
            .map(|index| {
                let time = f64::from(index) * 0.01 - 1.0;
                let kpa = match time {
                    t if t < 0.0 => 0.1,
                    t if t < 1.0 => 40.0 * t,
                    t if t < 5.0 => 40.0,
                    t if t < 15.0 => 40.0 * ((5.0 - t) / leak_s).exp(),
                    t => 40.0 * (-10.0 / leak_s - (t - 15.0) / vent_s).exp(),
                };
                let state = if time < 0.0 {
                    State::Ready
                } else {
                    State::Running
                };
                at(index, state, kpa, 0)
            })
            .collect()
    }

    fn failures(hold: &Hold) -> String {
        let failed = hold.measure().into_iter().filter(|it| !it.passed);
        let names: Vec<String> = failed.map(|it| it.name).collect();
        names.join("; ")
    }

    #[test]
    fn a_tight_rig_passes_and_a_leak_or_a_blocked_vent_does_not() {
        let hold = Hold::of(&run(2_500.0, 0.08), 40.0, 5.0, 15.0);
        assert_eq!(failures(&hold), "", "{hold:?}");
        assert!((hold.lost_share.unwrap() - 0.003).abs() < 1e-3, "{hold:?}");
        assert!((hold.reached_s.unwrap() - 0.9).abs() < 0.02, "{hold:?}");
        assert!((hold.vented_s.unwrap() - 0.08 * 8.0_f64.ln()).abs() < 0.02);
        assert!(failures(&Hold::of(&run(50.0, 0.08), 40.0, 5.0, 15.0)).contains("lost"));
        let blocked = failures(&Hold::of(&run(2_500.0, 100.0), 40.0, 5.0, 15.0));
        assert!(
            blocked.contains("vent") && blocked.contains("zero"),
            "{blocked}"
        );
        // A run that never began.
        assert!(failures(&Hold::of(&[], 40.0, 5.0, 15.0)).contains("time to 40 kPa"));
    }

    #[test]
    fn a_pump_that_goes_on_after_the_stop_is_found() {
        let stopped = |after: i32, kpa: f64| {
            let mut samples: Vec<Received> = (0..200_u32)
                .map(|index| {
                    at(
                        index,
                        State::Running,
                        20.0,
                        500 + i32::try_from(index).unwrap(),
                    )
                })
                .collect();
            samples.extend((200..400).map(|index| at(index, State::Fault, kpa, 700 + after)));
            samples[200].sample.volume_ul = 700;
            Stop::of(&samples).unwrap()
        };
        let passes = |stop: Stop| stop.measure(0.35).iter().all(|it| it.passed);
        let well = stopped(0, 0.0);
        assert!(
            passes(well) && (well.flow_ul_s - 100.0).abs() < 5.0,
            "{well:?}"
        );
        assert!(!passes(stopped(50, 0.0)));
        assert!(!passes(stopped(0, 20.0)));
        assert_eq!(Stop::of(&[at(0, State::Idle, 0.0, 0)]), None);
    }
}
