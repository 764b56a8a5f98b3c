//! What a lab runs: set-points over time, and the pressure that a syringe pump
//! makes of them.
//!
//! The pump is commanded by the inverse of the *nominal* model, as its owner
//! believes in it, builds pressure up with a lag and no faster than its flow
//! allows, and knows nothing of what the actuator does.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::world::{Base, Line, RATE_HZ};

/// Rest (s) before the first command.
const REST_S: f64 = 0.6;

/// A run.
#[derive(Clone, Debug, PartialEq)]
pub enum Experiment {
    /// A step to an angle (rad), held for 4.4 s, and back.
    Step(f64),
    /// Four steps up to an angle (rad) and down again.
    Staircase(f64),
    /// Two ramps up to 85° and down, each of so many seconds.
    Triangle(f64),
    /// Ramps of ±2° about 30° and about 60°.
    SmallReversals,
    /// Eight sines about 45°, with these phases (rad).
    Multisine([f64; 8]),
}

/// Frequencies of the multisine (Hz): no one is a multiple of another.
const FREQUENCIES: [f64; 8] = [0.07, 0.13, 0.23, 0.41, 0.71, 1.13, 1.87, 2.9];

impl Experiment {
    /// Duration (s).
    pub fn duration(&self) -> f64 {
        REST_S
            + match *self {
                Self::Step(_) => 7.4,
                Self::Staircase(_) => 23.4,
                Self::Triangle(ramp) => 4.0 * ramp + 1.9,
                Self::SmallReversals => 16.4,
                Self::Multisine(_) => 16.9,
            }
    }

    /// Set-point (rad) at a time (s).
    pub fn setpoint(&self, time: f64) -> f64 {
        let time = time - REST_S;
        if time < 0.0 {
            return 0.0;
        }
        match self {
            Self::Step(angle) if time < 4.4 => *angle,
            Self::Step(_) => 0.0,
            Self::Staircase(angle) => {
                let level = (time / 2.9).floor() + 1.0;
                let level = if level <= 4.0 { level } else { 8.0 - level };
                angle * level.max(0.0) / 4.0
            }
            Self::Triangle(ramp) => {
                if time >= 4.0 * ramp {
                    return 0.0;
                }
                85f64.to_radians() * triangle(time / (2.0 * ramp))
            }
            Self::SmallReversals => {
                let (middle, since) = if time < 8.2 {
                    (30f64, time)
                } else {
                    (60f64, time - 8.2)
                };
                // Time to get there, then four periods of 1.5 s.
                let swing = if since < 2.2 {
                    0.0
                } else {
                    2.0 * triangle((since - 2.2) / 1.5 + 0.25) - 1.0
                };
                (middle + 2.0 * swing).to_radians()
            }
            Self::Multisine(phases) => {
                let sum: f64 = FREQUENCIES
                    .iter()
                    .zip(phases)
                    .map(|(frequency, phase)| {
                        (std::f64::consts::TAU * frequency * time + phase).sin()
                    })
                    .sum();
                (45.0 + 13.0 * sum).clamp(3.0, 92.0).to_radians()
            }
        }
    }
}

/// Rises from 0 to 1 in half a turn and falls back in the other.
fn triangle(turns: f64) -> f64 {
    let within = turns.rem_euclid(1.0);
    2.0 * within.min(1.0 - within)
}

/// A run with its name, set-point (°) and repeat for the metadata.
#[derive(Clone, Debug, PartialEq)]
pub struct Planned {
    /// Name of the protocol.
    pub protocol: &'static str,
    /// Set-point of a step (°).
    pub setpoint_deg: Option<f64>,
    /// Number of the repeat, from 1.
    pub repeat: Option<u32>,
    /// The run.
    pub experiment: Experiment,
}

impl Planned {
    /// Name of the file without extension.
    pub fn name(&self) -> String {
        match self.repeat {
            Some(repeat) => format!("{}_{repeat}", self.protocol),
            None => self.protocol.to_owned(),
        }
    }
}

/// Which experiments a case has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Set {
    /// Steps, a staircase, triangles at three speeds, small reversals, a
    /// multisine: 12 runs, 15 000 samples.
    Rich,
    /// The paper's: steps to 60° and 90°, seven repeats each: 14 runs, 11 200
    /// samples.
    Paper,
}

impl Set {
    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rich => "rich",
            Self::Paper => "paper",
        }
    }

    /// The runs to diagnose by.
    pub fn experiments(self, random: &mut Pcg64Mcg) -> Vec<Planned> {
        match self {
            Self::Paper => steps(&[(60, 7), (90, 7)]),
            Self::Rich => {
                let mut list = steps(&[(10, 1), (30, 1), (60, 2), (90, 2)]);
                list.extend([
                    plain("staircase", Experiment::Staircase(88f64.to_radians())),
                    plain("triangle_slow", Experiment::Triangle(5.6)),
                    plain("triangle_mid", Experiment::Triangle(2.4)),
                    plain("triangle_fast", Experiment::Triangle(1.0)),
                    plain("small_reversals", Experiment::SmallReversals),
                    plain("multisine", Experiment::Multisine(phases(random))),
                ]);
                list
            }
        }
    }

    /// Fresh runs of the same actuator, to judge a repaired model by. None of
    /// them repeats a run of [`Set::experiments`].
    pub fn fresh(self, random: &mut Pcg64Mcg) -> Vec<Planned> {
        match self {
            Self::Paper => steps(&[(50, 1), (75, 1), (85, 1)]),
            Self::Rich => {
                let mut list = steps(&[(45, 1), (75, 1)]);
                list.extend([
                    plain("triangle", Experiment::Triangle(1.6)),
                    plain("multisine", Experiment::Multisine(phases(random))),
                ]);
                list
            }
        }
    }
}

fn phases(random: &mut Pcg64Mcg) -> [f64; 8] {
    std::array::from_fn(|_| random.random_range(0.0..std::f64::consts::TAU))
}

fn plain(protocol: &'static str, experiment: Experiment) -> Planned {
    Planned {
        protocol,
        setpoint_deg: None,
        repeat: None,
        experiment,
    }
}

fn steps(angles_and_repeats: &[(u32, u32)]) -> Vec<Planned> {
    angles_and_repeats
        .iter()
        .flat_map(|&(angle, repeats)| {
            (1..=repeats).map(move |repeat| Planned {
                protocol: match angle {
                    10 => "step10",
                    30 => "step30",
                    60 => "step60",
                    90 => "step90",
                    _ => "step",
                },
                setpoint_deg: Some(f64::from(angle)),
                repeat: Some(repeat),
                experiment: Experiment::Step(f64::from(angle).to_radians()),
            })
        })
        .collect()
}

/// A syringe pump.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pump {
    /// Time constant with which it follows a command (s).
    pub lag: f64,
    /// Fastest change of pressure that its flow allows (Pa/s).
    pub fastest: f64,
}

impl Pump {
    /// The pressure in the line over a run that `believed`, the model of the
    /// owner, commands.
    pub fn drive(&self, experiment: &Experiment, believed: &Base) -> Line {
        // Twice the integration rate: RK4 looks at the middle of its steps.
        let interval = 0.5 / f64::from(RATE_HZ);
        // A run is some ten thousand points.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let points = (experiment.duration() / interval).round() as usize + 1;
        let mut pressure = 0.0;
        let values = (0..points)
            .map(|k| {
                let now = pressure;
                let wanted = believed.holding_pressure(experiment.setpoint(k as f64 * interval));
                let rate = ((wanted - pressure) / self.lag).clamp(-self.fastest, self.fastest);
                pressure += rate * interval;
                now
            })
            .collect();
        Line::new(interval, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn the_rich_set_has_fifteen_thousand_samples() {
        let list = Set::Rich.experiments(&mut Pcg64Mcg::seed_from_u64(1));
        let seconds: f64 = list.iter().map(|run| run.experiment.duration()).sum();
        assert_eq!(list.len(), 12);
        assert!((seconds - 150.0).abs() < 2.0, "{seconds} s");
        let names: std::collections::BTreeSet<_> = list.iter().map(Planned::name).collect();
        assert_eq!(names.len(), list.len(), "two files would have one name");
    }

    #[test]
    fn setpoints_are_what_their_names_say() {
        let deg = |experiment: &Experiment, time: f64| experiment.setpoint(time).to_degrees();
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let step = Experiment::Step(1.0);
        assert!(close(step.setpoint(0.5), 0.0) && close(step.setpoint(4.9), 1.0));
        assert!(close(step.setpoint(5.1), 0.0));
        let stairs = Experiment::Staircase(80f64.to_radians());
        for (level, time) in [20.0, 40.0, 60.0, 80.0, 60.0, 40.0, 20.0, 0.0]
            .into_iter()
            .zip([1.0, 4.0, 7.0, 10.0, 13.0, 16.0, 19.0, 22.0])
        {
            assert!(close(deg(&stairs, time), level), "{time}");
        }
        let triangle = Experiment::Triangle(2.0);
        assert!(close(deg(&triangle, REST_S + 2.0), 85.0));
        assert!(close(deg(&triangle, REST_S + 1.0), 42.5));
        assert!(close(deg(&triangle, REST_S + 8.0), 0.0));
        for k in 0..1640 {
            let angle = deg(&Experiment::SmallReversals, REST_S + f64::from(k) * 0.01);
            let off = (angle - 30.0).abs().min((angle - 60.0).abs());
            assert!(off <= 2.0 + 1e-9, "{angle}");
        }
    }

    #[test]
    fn the_pump_is_late_and_limited() {
        let base = Base {
            inertia: 0.3,
            damping: 1.0,
            stiffness: 4.0,
            exponent: 2.0,
            input_gain: 1e-4,
        };
        let pump = Pump {
            lag: 0.1,
            fastest: 50e3,
        };
        let line = pump.drive(&Experiment::Step(1.0), &base);
        // 40 kPa are wanted: 35 in 0.7 s at full flow, the rest with the lag.
        assert!((line.at(REST_S + 0.5) - 25e3).abs() < 50.0);
        assert!((line.at(REST_S + 0.8) - (40e3 - 5e3 * (-1f64).exp())).abs() < 50.0);
        assert!(line.at(REST_S).abs() < 1.0);
    }
}
