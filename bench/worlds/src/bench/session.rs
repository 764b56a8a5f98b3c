//! What is played on a rig: sections in a drawn order, each following the one
//! before without a rest, and the pressure that a pump makes of them.

use std::f64::consts::TAU;

use rand::RngExt;
use rand::seq::{IndexedRandom, SliceRandom};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::super::experiments::Pump;
use super::super::world::{Base, Line, RATE_HZ};

/// Rest (s) before the first section.
const REST_S: f64 = 1.0;
/// A segment begins so long (s) before what is asked for changes.
const LEAD_S: f64 = 0.5;

/// Which rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rig {
    /// A bending actuator on a pump.
    Actuator,
    /// A near-integrator: hardly any stiffness, pressure to both sides.
    Integrator,
    /// Free swings, released from several angles: hardly damped, no pressure.
    Swing,
    /// A linear oscillator under a random multisine.
    BroadBand,
}

impl Rig {
    /// Every rig.
    pub const ALL: [Self; 4] = [
        Self::Actuator,
        Self::Integrator,
        Self::Swing,
        Self::BroadBand,
    ];

    /// Name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Actuator => "actuator",
            Self::Integrator => "near-integrator",
            Self::Swing => "free swing",
            Self::BroadBand => "broad-band",
        }
    }
}

/// What is asked for over some seconds. Levels are angles (rad) where the angle
/// is commanded, else shares of the largest pressure.
#[derive(Clone, Debug, PartialEq)]
enum Shape {
    Hold(f64),
    Ramp(f64, f64),
    /// A triangular wave of so much to both sides.
    Reversals {
        middle: f64,
        swing: f64,
        period: f64,
    },
    /// Sines of equal size, frequency (Hz) and phase (rad), within limits.
    Multisine {
        centre: f64,
        size: f64,
        limits: [f64; 2],
        sines: Vec<(f64, f64)>,
    },
}

impl Shape {
    /// The level at a time since the shape began, of `seconds`.
    fn at(&self, time: f64, seconds: f64) -> f64 {
        match self {
            Self::Hold(level) => *level,
            Self::Ramp(from, to) => from + (to - from) * (time / seconds).clamp(0.0, 1.0),
            Self::Reversals {
                middle,
                swing,
                period,
            } => {
                let turns = (time / period + 0.25).rem_euclid(1.0);
                middle + swing * (4.0 * turns.min(1.0 - turns) - 1.0)
            }
            Self::Multisine {
                centre,
                size,
                limits: [least, most],
                sines,
            } => {
                let sum: f64 = sines
                    .iter()
                    .map(|(frequency, phase)| (TAU * frequency * time + phase).sin())
                    .sum();
                (centre + size * sum).clamp(*least, *most)
            }
        }
    }
}

/// Shapes that belong together: what a recorder writes as a segment.
#[derive(Clone, Debug, PartialEq)]
struct Section {
    /// As it would be sent to a board.
    sent: String,
    /// Set-point of a step (°).
    setpoint_deg: Option<f64>,
    shapes: Vec<(Shape, f64)>,
}

impl Section {
    fn of(sent: String, shapes: Vec<(Shape, f64)>) -> Self {
        Self {
            sent,
            setpoint_deg: None,
            shapes,
        }
    }

    fn seconds(&self) -> f64 {
        self.shapes.iter().map(|(_, seconds)| seconds).sum()
    }
}

/// Where a section lies in a session.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Its first time (s).
    pub from: f64,
    /// The first time of the next (s).
    pub to: f64,
    /// Set-point of a step (°).
    pub setpoint_deg: Option<f64>,
    /// Which step to this set-point it is, from 1.
    pub repeat: Option<u32>,
    /// As it was sent to the board.
    pub sent: String,
}

/// What drives one simulation from its beginning to its end.
#[derive(Clone, Debug)]
pub struct Drive {
    /// Pressure in the line.
    pub line: Line,
    /// Angle (rad) and rate (rad/s) at time 0.
    pub start: [f64; 2],
    /// The sections.
    pub marks: Vec<Mark>,
}

/// What a rig is driven with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Supply {
    /// The pump.
    pub pump: Pump,
    /// Largest pressure (Pa), where the pressure is commanded.
    pub pressure: f64,
}

/// Draws what is played and plays it. Only free swings are several drives.
pub fn play(rig: Rig, supply: &Supply, believed: &Base, random: &mut Pcg64Mcg) -> Vec<Drive> {
    match rig {
        Rig::Actuator => {
            let list = actuator(random);
            vec![driven(&list, &supply.pump, |angle| {
                believed.holding_pressure(angle)
            })]
        }
        Rig::Integrator => {
            let list = integrator(random);
            vec![driven(&list, &supply.pump, |share| share * supply.pressure)]
        }
        Rig::BroadBand => {
            let list = broad_band(random);
            vec![driven(&list, &supply.pump, |share| share * supply.pressure)]
        }
        Rig::Swing => swings(random),
    }
}

/// The pressure that a pump makes of sections.
fn driven(list: &[Section], pump: &Pump, wanted: impl Fn(f64) -> f64) -> Drive {
    // Twice the integration rate: RK4 looks at the middle of its steps.
    let interval = 0.5 / f64::from(RATE_HZ);
    let (mut pressure, mut values) = (0.0, Vec::new());
    let mut follow = |shape: &Shape, seconds: f64| {
        // A section is some hundred thousand points.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let points = (seconds / interval).round() as usize;
        for k in 0..points {
            values.push(pressure);
            let target = wanted(shape.at(k as f64 * interval, seconds));
            let rate = ((target - pressure) / pump.lag).clamp(-pump.fastest, pump.fastest);
            pressure += rate * interval;
        }
    };
    follow(&Shape::Hold(0.0), REST_S);
    for (shape, seconds) in list.iter().flat_map(|section| &section.shapes) {
        follow(shape, *seconds);
    }
    values.push(pressure);
    Drive {
        line: Line::new(interval, values),
        start: [0.0; 2],
        marks: marks(list),
    }
}

fn marks(list: &[Section]) -> Vec<Mark> {
    let mut begin = REST_S;
    let mut marks: Vec<Mark> = Vec::new();
    for section in list {
        let same = |mark: &&Mark| mark.setpoint_deg == section.setpoint_deg;
        let before = marks.iter().filter(same).count();
        let end = begin + section.seconds();
        marks.push(Mark {
            from: begin - LEAD_S,
            to: end - LEAD_S,
            setpoint_deg: section.setpoint_deg,
            // A session has a dozen sections.
            repeat: section
                .setpoint_deg
                .and_then(|_| u32::try_from(before + 1).ok()),
            sent: section.sent.clone(),
        });
        begin = end;
    }
    if let Some(last) = marks.last_mut() {
        last.to += LEAD_S;
    }
    marks
}

fn sines(random: &mut Pcg64Mcg, count: u32, low: f64, high: f64) -> Vec<(f64, f64)> {
    (0..count)
        .map(|k| {
            let share = (f64::from(k) + random.random_range(0.2..0.8)) / f64::from(count);
            let frequency = low * (high / low).powf(share);
            (frequency, random.random_range(0.0..TAU))
        })
        .collect()
}

fn milliseconds(seconds: f64) -> String {
    format!("{:.0}", 1000.0 * seconds)
}

/// The protocols of a session with an actuator.
#[derive(Clone, Copy)]
enum Protocol {
    Steps,
    Staircase,
    SlowTriangle,
    FastTriangle,
    Reversals,
    Multisine,
    Hold,
}

fn actuator(random: &mut Pcg64Mcg) -> Vec<Section> {
    let mut order = [
        Protocol::Steps,
        Protocol::Steps,
        Protocol::Staircase,
        Protocol::SlowTriangle,
        Protocol::FastTriangle,
        Protocol::Reversals,
        Protocol::Multisine,
        Protocol::Hold,
    ];
    order.shuffle(random);
    // Half of the sessions never come back to zero before their end.
    let lowest = if random.random_bool(0.5) {
        0.0
    } else {
        random.random_range(10f64..20.0).round()
    };
    let levels = step_levels(random);
    let mut list: Vec<Section> = order
        .into_iter()
        .flat_map(|protocol| sections(protocol, lowest, &levels, random))
        .collect();
    if let Some(last) = list.last_mut() {
        last.shapes.push((Shape::Hold(0.0), 2.5));
    }
    list
}

/// Levels of steps (°), each at least 15° from the one before.
fn step_levels(random: &mut Pcg64Mcg) -> Vec<f64> {
    let mut levels: Vec<f64> = Vec::new();
    let count = random.random_range(3..=4);
    while levels.len() < count {
        let level = 5.0 * random.random_range(3f64..18.4).round();
        if levels.last().is_none_or(|last| (last - level).abs() > 14.0) {
            levels.push(level);
        }
    }
    levels
}

fn sections(
    protocol: Protocol,
    lowest: f64,
    levels: &[f64],
    random: &mut Pcg64Mcg,
) -> Vec<Section> {
    let low = lowest.to_radians();
    let top_deg = random.random_range(75f64..90.0).round();
    let top = top_deg.to_radians();
    let triangle = |ramp: f64| {
        let mut shapes = vec![(Shape::Hold(low), 1.0)];
        for _ in 0..2 {
            shapes.push((Shape::Ramp(low, top), ramp));
            shapes.push((Shape::Ramp(top, low), ramp));
        }
        Section::of(
            format!("ramp open {top_deg:.2} {}", milliseconds(ramp)),
            shapes,
        )
    };
    match protocol {
        Protocol::Steps => {
            let hold = random.random_range(2.5..4.5);
            let between = lowest == 0.0 && random.random_bool(0.5);
            levels
                .iter()
                .map(|level| {
                    let mut shapes = vec![(Shape::Hold(level.to_radians()), hold)];
                    if between {
                        shapes.push((Shape::Hold(0.0), 1.8));
                    }
                    Section {
                        sent: format!("step open {level:.2} {}", milliseconds(hold)),
                        setpoint_deg: Some(*level),
                        shapes,
                    }
                })
                .collect()
        }
        Protocol::Staircase => {
            let hold = random.random_range(1.4..2.4);
            let shapes = [0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25, 0.0]
                .map(|share| (Shape::Hold(low + share * (top - low)), hold));
            vec![Section::of(
                format!("staircase open {top_deg:.2} {}", milliseconds(hold)),
                shapes.to_vec(),
            )]
        }
        Protocol::SlowTriangle => vec![triangle(random.random_range(3.5..6.0))],
        Protocol::FastTriangle => vec![triangle(random.random_range(0.9..1.8))],
        Protocol::Reversals => {
            let period = random.random_range(1.2..2.2);
            let middle_deg: f64 = random.random_range(28.0..62.0);
            let middle = middle_deg.to_radians();
            let swing = random.random_range(2f64..4.0).to_radians();
            vec![Section::of(
                format!("reversals open {middle_deg:.2} {}", milliseconds(period)),
                vec![
                    (Shape::Hold(middle), 2.0),
                    (
                        Shape::Reversals {
                            middle,
                            swing,
                            period,
                        },
                        5.0 * period,
                    ),
                ],
            )]
        }
        Protocol::Multisine => {
            let sines = sines(random, 8, 0.06, 3.0);
            let shape = Shape::Multisine {
                centre: 48f64.to_radians(),
                size: 11f64.to_radians(),
                limits: [lowest.max(4.0).to_radians(), 92f64.to_radians()],
                sines,
            };
            vec![Section::of(
                "multisine open 48.00 11.00 16000".to_owned(),
                vec![(shape, 16.0)],
            )]
        }
        Protocol::Hold => {
            let level: f64 = random.random_range(30.0..85.0);
            let seconds = random.random_range(6.0..14.0);
            vec![Section::of(
                format!("hold open {level:.2} {}", milliseconds(seconds)),
                vec![(Shape::Hold(level.to_radians()), seconds)],
            )]
        }
    }
}

fn integrator(random: &mut Pcg64Mcg) -> Vec<Section> {
    // To both sides for the same time, so that the angle comes back.
    let switching = |random: &mut Pcg64Mcg| {
        let mut shapes = Vec::new();
        for _ in 0..random.random_range(5..8) {
            let share = random.random_range(0.5..1.0);
            let seconds = random.random_range(0.5..1.4);
            let sign = *[1.0, -1.0].choose(random).unwrap_or(&1.0);
            shapes.push((Shape::Hold(sign * share), seconds));
            shapes.push((Shape::Hold(-sign * share), seconds));
        }
        Section::of("steps pressure".to_owned(), shapes)
    };
    let triangles = |random: &mut Pcg64Mcg| {
        let period = random.random_range(2.0..5.0);
        let shape = Shape::Reversals {
            middle: 0.0,
            swing: random.random_range(0.7..1.0),
            period,
        };
        Section::of(
            format!("triangles pressure {}", milliseconds(period)),
            vec![(shape, 4.0 * period)],
        )
    };
    let small = |random: &mut Pcg64Mcg| {
        let shapes = (0..6)
            .map(|k| {
                let share: f64 = random.random_range(0.1..0.45);
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                (Shape::Hold(sign * share), random.random_range(1.0..2.5))
            })
            .collect();
        Section::of("small steps pressure".to_owned(), shapes)
    };
    let multisine = |random: &mut Pcg64Mcg| {
        let shape = Shape::Multisine {
            centre: 0.0,
            size: 0.28,
            limits: [-1.0, 1.0],
            sines: sines(random, 10, 0.15, 3.0),
        };
        Section::of("multisine pressure".to_owned(), vec![(shape, 16.0)])
    };
    let mut list = vec![
        switching(random),
        switching(random),
        triangles(random),
        triangles(random),
        small(random),
        multisine(random),
        Section::of(
            "hold pressure 0.00".to_owned(),
            vec![(Shape::Hold(0.0), 4.0)],
        ),
    ];
    list.shuffle(random);
    list
}

fn broad_band(random: &mut Pcg64Mcg) -> Vec<Section> {
    (0..3)
        .map(|_| {
            let shape = Shape::Multisine {
                centre: 0.0,
                size: 1.0 / (2.5 * 18f64.sqrt()),
                limits: [-1.2, 1.2],
                sines: sines(random, 36, 0.05, 3.0),
            };
            Section::of(
                "multisine pressure 0.00 36 25000".to_owned(),
                vec![(shape, 25.0)],
            )
        })
        .collect()
}

fn swings(random: &mut Pcg64Mcg) -> Vec<Drive> {
    let mut angles = [25.0, 40.0, 60.0, 80.0, 100.0];
    angles.shuffle(random);
    angles
        .iter()
        .map(|angle: &f64| {
            let off: f64 = random.random_range(-5.0..5.0);
            // No hand lets go quite at rest.
            let rate = random.random_range(-0.3..0.3);
            let seconds = random.random_range(9.0..15.0);
            Drive {
                line: Line::new(seconds, vec![0.0; 2]),
                start: [(angle + off).to_radians(), rate],
                marks: Vec::new(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const BELIEVED: Base = Base {
        inertia: 0.3,
        damping: 1.0,
        stiffness: 4.0,
        exponent: 2.0,
        input_gain: 1e-4,
    };
    const SUPPLY: Supply = Supply {
        pump: Pump {
            lag: 0.05,
            fastest: 400e3,
        },
        pressure: 60e3,
    };

    fn played(rig: Rig, seed: u64) -> Vec<Drive> {
        play(rig, &SUPPLY, &BELIEVED, &mut Pcg64Mcg::seed_from_u64(seed))
    }

    #[test]
    fn sections_follow_each_other_through_the_whole_session() {
        for rig in [Rig::Actuator, Rig::Integrator, Rig::BroadBand] {
            for seed in 0..20 {
                let drives = played(rig, seed);
                let [drive] = drives.as_slice() else {
                    panic!("{} drives", drives.len())
                };
                assert!(drive.marks.len() >= 3);
                for pair in drive.marks.windows(2) {
                    assert!((pair[0].to - pair[1].from).abs() < 1e-9);
                    assert!(pair[0].to - pair[0].from > 1.0);
                }
                let end = drive.marks.last().unwrap().to;
                assert!((end - drive.line.duration()).abs() < 0.01, "{rig:?} {seed}");
                assert!((60.0..200.0).contains(&end), "{rig:?} {seed}: {end} s");
            }
        }
    }

    #[test]
    fn half_of_the_sessions_do_not_return_to_zero() {
        let without = (0..60)
            .filter(|&seed| {
                let drive = played(Rig::Actuator, seed).remove(0);
                // From the first section's end to what is played before the last vent.
                let until = drive.line.duration() - 4.0;
                let mut time = drive.marks[0].to + 1.0;
                let mut least = f64::INFINITY;
                while time < until {
                    least = least.min(drive.line.at(time));
                    time += 0.1;
                }
                least > 500.0
            })
            .count();
        assert!((18..=42).contains(&without), "{without} of 60");
    }

    #[test]
    fn steps_are_numbered_by_their_set_point() {
        for seed in 0..20 {
            let drive = played(Rig::Actuator, seed).remove(0);
            let mut seen = std::collections::BTreeMap::new();
            for mark in &drive.marks {
                let Some(level) = mark.setpoint_deg else {
                    assert_eq!(mark.repeat, None);
                    continue;
                };
                let count = seen.entry(level.to_bits()).or_insert(0);
                *count += 1;
                assert_eq!(mark.repeat, Some(*count));
            }
            assert!(seen.values().all(|count| *count >= 2), "{seen:?}");
        }
    }

    #[test]
    fn shapes_are_what_their_names_say() {
        let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let ramp = Shape::Ramp(1.0, 3.0);
        assert!(close(ramp.at(0.0, 4.0), 1.0) && close(ramp.at(3.0, 4.0), 2.5));
        let wave = Shape::Reversals {
            middle: 1.0,
            swing: 0.2,
            period: 2.0,
        };
        // From the middle up, down through it, and back.
        for (time, level) in [(0.0, 1.0), (0.5, 1.2), (1.0, 1.0), (1.5, 0.8), (2.0, 1.0)] {
            assert!(close(wave.at(time, 8.0), level), "{time}");
        }
    }

    #[test]
    fn swings_begin_in_motion_and_without_pressure() {
        let drives = played(Rig::Swing, 3);
        assert_eq!(drives.len(), 5);
        for drive in drives {
            assert!(drive.start[0] > 0.3 && drive.start[1] != 0.0);
            assert!(drive.line.at(3.0).abs() < 1e-12);
        }
    }
}
