//! Drawing the cases of the set, and writing them as a lab would hand them over.
//!
//! What a case is depends on the seed of the set and on its number alone, not on
//! how many cases there are: twelve in a row hold seven single effects, a pair,
//! a case without anything, one with parameters only, and two causes outside
//! the catalogue. The size of an effect is drawn as in the other sets, between
//! 1.5 and 8 times what is there without it ([`sizing`](super::sizing)).

use std::path::Path;

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::recording::{Recording, to_csv};

use super::super::cases::{Hidden, Scale, largest, logarithmic, stable_hash, typical};
use super::super::experiments::Pump;
use super::super::kinds::group;
use super::super::truth::{Base, Effect, Formula, Line, RATE_HZ, kinds};
use super::instruments::{Instruments, Samples, Shown};
use super::session::{Drive, Mark, Rig, Supply, play};
use super::sizing::Seen;
use super::world::{Law, Outside, Part, World, coloured};

/// What the refitted base leaves with what is there without the effect, over
/// that.
const VISIBLE: std::ops::RangeInclusive<f64> = 1.5..=8.0;
/// … for two effects together.
const VISIBLE_PAIR: std::ops::RangeInclusive<f64> = 1.5..=12.0;
/// What leaving out one of a pair has to leave, likewise.
const PARTNER: f64 = 1.3;
/// Actuators that are drawn before one is taken as it is.
const ATTEMPTS: u32 = 12;
/// The coloured force of every bench, over the force of reference.
const COLOURED: std::ops::Range<f64> = 0.01..0.02;
/// The same, where it is what is hidden.
const RANDOM_FORCE: std::ops::Range<f64> = 0.1..0.2;
/// Correlation time of both (s).
const CORRELATION: std::ops::Range<f64> = 0.3..5.0;
/// Share of the sessions that are cut into files.
const CUT: f64 = 1.0 / 3.0;
/// Seconds of the runs for which the other sets draw what grows with time.
const SHORT_RUN_S: f64 = 24.0;

/// What a case hides, before anything is drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// On which rig.
    pub rig: Rig,
    /// What is hidden.
    pub hidden: Hidden,
    /// The laws.
    pub laws: Vec<Law>,
}

/// The answer to a case.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Name of the case's folder.
    pub case: String,
    /// Which rig.
    pub rig: Rig,
    /// Whether the session was cut into files without metadata.
    pub cut: bool,
    /// What is hidden.
    pub hidden: Hidden,
    /// Kinds of the catalogue, in alphabetical order.
    pub kinds: Vec<String>,
    /// Names of the laws.
    pub laws: Vec<String>,
    /// The truth, in SI units.
    pub truth: World,
    /// The nominal parameters.
    pub nominal: Base,
    /// What drives the rig.
    pub supply: Supply,
    /// The instruments.
    pub instruments: Instruments,
    /// Standard deviation (N) and correlation time (s) of the coloured force.
    pub coloured: [f64; 2],
    /// What the refitted base leaves of the coloured force (rad).
    pub coloured_misfit: f64,
    /// What the refitted base leaves of everything, over what it leaves without
    /// the effect.
    pub misfit_over_noise: f64,
    /// Of a pair: the least that leaving out one of the two leaves, likewise.
    pub partner_over_noise: Option<f64>,
    /// Whether both are in the range that is asked for.
    pub visible: bool,
    /// Samples of all files.
    pub samples: usize,
    /// Duration of all files (s).
    pub seconds: f64,
}

/// A file of a case.
#[derive(Clone, Debug)]
pub struct File {
    /// Its name without extension.
    pub name: String,
    /// What was recorded.
    pub samples: Samples,
    /// The text of its metadata, if there is any.
    pub meta: Option<String>,
}

/// A case in memory.
#[derive(Clone, Debug)]
pub struct Made {
    /// The answer.
    pub answer: Answer,
    /// The files, in the order of time.
    pub files: Vec<File>,
}

/// Laws that a rig other than the actuator can hide, one at a time.
fn special(rig: Rig) -> Vec<Law> {
    let known = |formulas: &[Formula]| formulas.iter().copied().map(Law::Known).collect();
    match rig {
        Rig::Actuator => Vec::new(),
        Rig::Integrator => known(&[
            Formula::CoulombTanh,
            Formula::StribeckGauss,
            Formula::CoulombLugre,
            Formula::StribeckLugre,
            Formula::StribeckExponential,
        ]),
        Rig::Swing => known(&[
            Formula::CoulombLugre,
            Formula::Gravity,
            Formula::QuadraticDrag,
            Formula::CoulombTanh,
            Formula::AngleDamping,
            Formula::Cubic,
            Formula::QuadraticBlasius,
            Formula::ExponentShift,
            Formula::SensorNonlinearity,
        ]),
        Rig::BroadBand => vec![Law::BoucWenShape],
    }
}

/// The formula that a kind has in its n-th turn: every second time another one
/// than the catalogue's, where there is one.
fn of_kind(kind: &str, turn: usize) -> Law {
    let formulas = Formula::of_kind(kind);
    Law::Known(if turn.is_multiple_of(2) || formulas.len() == 1 {
        formulas[0]
    } else {
        formulas[1 + turn / 2 % (formulas.len() - 1)]
    })
}

fn random_for(seed: u64, what: &str) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(stable_hash(format!("bench {seed} {what}").as_bytes()))
}

/// What twelve cases hide.
const DECK: [Hidden; 12] = {
    use Hidden::{Nothing, One, Outside, Parameters, Two};
    [
        One, One, One, One, One, One, One, Two, Nothing, Parameters, Outside, Outside,
    ]
};

/// What `count` cases hide. With `only`, each hides one of these kinds, on an
/// actuator.
pub fn plan(count: u32, only: &[String], seed: u64) -> Vec<Plan> {
    let mut names = kinds();
    names.shuffle(&mut random_for(seed, "kinds"));
    names.retain(|name| only.is_empty() || only.iter().any(|only| only == name));
    let outside = [
        Law::DwellStiction,
        Law::PulsatingStiffness,
        Law::RandomForce,
    ];
    // Turns of single effects on actuators, on other rigs, and of the rest.
    let (mut on_actuator, mut elsewhere, mut two, mut quiet, mut beyond) = (0, 0, 0, 0, 0);
    let take = |turn: &mut usize| std::mem::replace(turn, *turn + 1);
    let mut list = Vec::new();
    for deck in 0..count.div_ceil(12) {
        let mut random = random_for(seed, &format!("deck {deck}"));
        let mut cards = DECK;
        cards.shuffle(&mut random);
        let mut singles = 0;
        for hidden in cards {
            let hidden = if only.is_empty() { hidden } else { Hidden::One };
            let (rig, laws) = match hidden {
                Hidden::One => {
                    let single = take(&mut singles);
                    // Two of seven are of other rigs.
                    if only.is_empty() && (single == 2 || single == 5) {
                        let turn = take(&mut elsewhere);
                        let rig = [Rig::Integrator, Rig::Swing, Rig::BroadBand][turn % 3];
                        let laws = special(rig);
                        (rig, vec![laws[turn / 3 % laws.len()]])
                    } else {
                        let turn = take(&mut on_actuator);
                        // Half of the kinds begin with another formula.
                        let index = turn % names.len();
                        let law = of_kind(names[index], turn / names.len() + index % 2);
                        (Rig::Actuator, vec![law])
                    }
                }
                Hidden::Two => pair(take(&mut two), &names, &mut random),
                Hidden::Nothing | Hidden::Parameters => {
                    let rig = match take(&mut quiet) % 6 {
                        1 => Rig::Integrator,
                        3 => Rig::Swing,
                        5 => Rig::BroadBand,
                        _ => Rig::Actuator,
                    };
                    (rig, Vec::new())
                }
                Hidden::Outside => {
                    let turn = take(&mut beyond);
                    let law = outside[turn % 3];
                    let rig = match (turn / 3 % 3, law) {
                        (2, Law::DwellStiction) => Rig::Integrator,
                        (2, Law::PulsatingStiffness) => Rig::Swing,
                        (2, _) => Rig::BroadBand,
                        _ => Rig::Actuator,
                    };
                    (rig, vec![law])
                }
            };
            list.push(Plan { rig, hidden, laws });
        }
    }
    list.truncate(count as usize);
    list
}

/// Two effects of different families, or a pair that another rig is known for.
fn pair(turn: usize, names: &[&str], random: &mut Pcg64Mcg) -> (Rig, Vec<Law>) {
    let known = |formulas: [Formula; 2]| formulas.map(Law::Known).to_vec();
    match turn % 4 {
        // Friction that is not the same to both sides.
        2 => (
            Rig::Integrator,
            known([Formula::CoulombTanh, Formula::AsymmetricDamping]),
        ),
        // A pendulum with a dry bearing.
        3 => (Rig::Swing, known([Formula::CoulombTanh, Formula::Gravity])),
        _ => loop {
            let drawn: Vec<&str> = names.sample(random, 2).copied().collect();
            if group(drawn[0]) != group(drawn[1]) {
                let mut laws: Vec<Law> = drawn.iter().map(|kind| of_kind(kind, turn)).collect();
                // A dead time looks at the line itself, so it is first.
                laws.sort_by_key(|law| (*law != Law::Known(Formula::DeadTime), law.name()));
                break (Rig::Actuator, laws);
            }
        },
    }
}

/// A rig with everything that is drawn for it.
#[derive(Clone, Debug)]
struct Drawn {
    truth: World,
    nominal: Base,
    supply: Supply,
    instruments: Instruments,
    drives: Vec<Drive>,
    /// Standard deviation (N) and correlation time (s).
    coloured: [f64; 2],
    noise_seed: u64,
    coloured_misfit: f64,
    ratio: f64,
    partner: f64,
    reach: f64,
}

/// The base model of a rig, what drives it, and a force (N), pressure (Pa) and
/// damping to draw effects by.
fn rig(rig: Rig, random: &mut Pcg64Mcg) -> (Base, Supply, Scale) {
    let right = std::f64::consts::FRAC_PI_2;
    let quick = |random: &mut Pcg64Mcg, pressure: f64| Supply {
        pump: Pump {
            lag: random.random_range(0.02..0.06),
            fastest: pressure / random.random_range(0.05..0.15),
        },
        pressure,
    };
    let inertia = random.random_range(0.15..0.4);
    let pressure = random.random_range(60e3..150e3);
    let (base, supply) = match rig {
        Rig::Actuator => {
            let exponent = *[1.538, 1.727, 2.0, 2.174, 2.365]
                .choose(random)
                .unwrap_or(&2.0);
            let stiffness = logarithmic(random, 1.5, 15.0);
            let base = Base {
                inertia,
                damping: logarithmic(random, 0.8, 4.5),
                stiffness,
                exponent,
                input_gain: stiffness * right.powf(exponent) / pressure,
            };
            let pump = Pump {
                lag: random.random_range(0.04..0.15),
                fastest: pressure / random.random_range(0.15..0.5),
            };
            (base, Supply { pump, pressure })
        }
        Rig::Integrator => {
            // So fast (rad/s) at the largest pressure.
            let rate = random.random_range(0.6..1.1);
            let damping = logarithmic(random, 0.8, 4.5);
            let force = damping * rate;
            let base = Base {
                inertia,
                damping,
                stiffness: force * random.random_range(0.03..0.08),
                exponent: 1.0,
                input_gain: force / pressure,
            };
            (base, quick(random, pressure))
        }
        Rig::BroadBand | Rig::Swing => {
            let stiffness = logarithmic(random, 3.0, 12.0);
            let ratio = if rig == Rig::Swing {
                logarithmic(random, 0.01, 0.04)
            } else {
                logarithmic(random, 0.1, 0.4)
            };
            let base = Base {
                inertia,
                damping: 2.0 * ratio * (stiffness * inertia).sqrt(),
                stiffness,
                exponent: *[1.0, 1.0, 1.2].choose(random).unwrap_or(&1.0),
                // The largest pressure holds about 80°.
                input_gain: stiffness * random.random_range(1.2..1.6) / pressure,
            };
            (base, quick(random, pressure))
        }
    };
    let force = match rig {
        Rig::Integrator => base.input_gain * pressure,
        _ => base.stiffness * right.powf(base.exponent),
    };
    let damping = base.damping;
    let scale = Scale {
        force,
        pressure,
        damping,
    };
    (base, supply, scale)
}

/// Nominal parameters, each off by 10 to 30 %.
fn off(base: &Base, random: &mut Pcg64Mcg) -> Base {
    let mut off = |value: f64| {
        let by: f64 = random.random_range(0.1..0.3);
        value
            * if random.random_bool(0.5) {
                1.0 + by
            } else {
                1.0 - by
            }
    };
    Base {
        damping: off(base.damping),
        stiffness: off(base.stiffness),
        input_gain: off(base.input_gain),
        ..*base
    }
}

impl Drawn {
    fn draw(plan: &Plan, random: &mut Pcg64Mcg) -> Self {
        let (base, supply, scale) = rig(plan.rig, random);
        let nominal = if plan.hidden == Hidden::Nothing {
            base
        } else {
            off(&base, random)
        };
        let drives = play(plan.rig, &supply, &nominal, random);
        // The elastic force at 60°, or what drives a rig without any.
        let reference = match plan.rig {
            Rig::Integrator => scale.force,
            _ => base.stiffness * 60f64.to_radians().powf(base.exponent),
        };
        let mut drawn = Self {
            truth: World {
                base,
                parts: Vec::new(),
            },
            nominal,
            supply,
            instruments: Instruments::draw(random),
            drives,
            coloured: [
                reference * random.random_range(COLOURED),
                random.random_range(CORRELATION),
            ],
            noise_seed: random.random(),
            coloured_misfit: 0.0,
            ratio: 1.0,
            partner: f64::INFINITY,
            reach: 0.0,
        };
        let alone = Seen::of(plan.rig, &drawn.truth, &drawn.drives, &drawn.forces());
        drawn.coloured_misfit = alone.base_misfit(&base);
        drawn.reach = alone.reach();
        for &law in &plan.laws {
            let (part, most) = drawn.typical(law, &scale, reference, random);
            let wanted = if plan.laws.len() == 1 {
                logarithmic(random, 1.7, 6.5)
            } else {
                logarithmic(random, 2.0, 5.0)
            };
            // A random force has the size that is asked for.
            let part = if law == Law::RandomForce {
                part
            } else {
                drawn.sized(plan.rig, part, wanted, most)
            };
            drawn.truth.parts.push(part);
        }
        drawn.truth = drawn.truth.resolved();
        drawn.measure(plan.rig);
        drawn
    }

    /// The paths of the coloured force, one for each drive, and of a random force
    /// if that is hidden.
    fn forces(&self) -> Vec<Line> {
        let random_force = self
            .truth
            .parts
            .iter()
            .find(|part| part.law == Law::RandomForce);
        let [deviation, time] = match random_force {
            Some(part) => [part.values[0], part.values[1]],
            None => self.coloured,
        };
        (0..)
            .zip(&self.drives)
            .map(|(number, drive)| {
                let seed = self.noise_seed.wrapping_add(number);
                coloured(deviation, time, drive.line.duration(), seed)
            })
            .collect()
    }

    /// A part in a size that is seen in real rigs, and the most by which it may
    /// be enlarged.
    fn typical(
        &self,
        law: Law,
        scale: &Scale,
        reference: f64,
        random: &mut Pcg64Mcg,
    ) -> (Part, f64) {
        let mut within = |low: f64, high: f64| random.random_range(low..high);
        let values = match law {
            Law::BoucWenShape => [0.1 * scale.force, within(0.1, 0.4), within(-0.4, 0.5), 0.0],
            Law::DwellStiction => [
                0.05 * scale.force,
                0.05 * scale.force * within(1.5, 4.0),
                within(0.3, 3.0),
                within(0.004, 0.012),
            ],
            Law::PulsatingStiffness => [0.2, within(0.2, 2.5), within(-3.0, 3.0), 0.0],
            Law::RandomForce => [
                reference * random.random_range(RANDOM_FORCE),
                random.random_range(CORRELATION),
                0.0,
                0.0,
            ],
            Law::Known(formula) => return self.known(formula, scale, random),
        };
        let most = match law {
            Law::PulsatingStiffness => 0.9 / values[0],
            _ => 8.0,
        };
        (Part { law, values }, most)
    }

    /// As the other sets draw a formula; what goes with time is stretched to the
    /// length of the session.
    fn known(&self, formula: Formula, scale: &Scale, random: &mut Pcg64Mcg) -> (Part, f64) {
        let mut effect = Effect {
            formula,
            values: typical(formula, scale, random),
        };
        let most = largest(&effect);
        let session: f64 = self.drives.iter().map(|drive| drive.line.duration()).sum();
        let stretch = session / SHORT_RUN_S;
        let longer = logarithmic(random, 1.0, 4.0);
        let values = &mut effect.values;
        match formula {
            Formula::StiffnessDrift | Formula::SensorDrift => values[0] /= stretch,
            Formula::StiffnessDriftLog | Formula::SensorDriftSettling => {
                values[0] /= stretch;
                values[1] *= stretch;
            }
            Formula::MaxwellOne => values[1] *= longer,
            Formula::MaxwellTwo => values[3] *= longer,
            // An offset within what a calibration leaves is none.
            Formula::SensorOffset => values[0] *= 5.0,
            _ => {}
        }
        let part = Part {
            law: Law::Known(formula),
            values: effect.values,
        };
        (part, most)
    }

    /// RMS of everything that is there without an effect (rad).
    fn floor(&self) -> f64 {
        self.instruments.angle_floor().hypot(self.coloured_misfit)
    }

    /// A misfit with the floor, over the floor.
    fn over_noise(&self, misfit: f64) -> f64 {
        let floor = self.floor();
        if misfit.is_finite() && floor.is_finite() {
            misfit.hypot(floor) / floor
        } else {
            f64::INFINITY
        }
    }

    /// The part in the size whose misfit with the floor is `wanted` times the
    /// floor, as nearly as its limits allow.
    fn sized(&self, rig: Rig, part: Part, wanted: f64, most: f64) -> Part {
        let aim = self.floor() * (wanted * wanted - 1.0).sqrt();
        let mut factor = 1.0;
        for _ in 0..6 {
            let world = World {
                base: self.truth.base,
                parts: vec![part.scaled(factor)],
            }
            .resolved();
            let seen = Seen::of(rig, &world, &self.drives, &[]);
            let misfit = seen.base_misfit(&self.truth.base);
            if (0.8..1.25).contains(&(misfit / aim)) {
                break;
            }
            let by = if misfit.is_finite() {
                aim / misfit
            } else {
                0.3
            };
            let next = (factor * by.clamp(0.2, 4.0)).min(most);
            if (next / factor - 1.0).abs() < 0.02 {
                break;
            }
            factor = next;
        }
        part.scaled(factor)
    }

    fn measure(&mut self, rig: Rig) {
        let base = self.truth.base;
        // With the coloured force only to see how far everything reaches.
        self.reach = Seen::of(rig, &self.truth, &self.drives, &self.forces()).reach();
        if self.truth.parts.is_empty() || !self.reach.is_finite() {
            return;
        }
        let random_force = self.truth.parts.iter().any(|p| p.law == Law::RandomForce);
        let forces = if random_force {
            self.forces()
        } else {
            Vec::new()
        };
        let seen = Seen::of(rig, &self.truth, &self.drives, &forces);
        self.ratio = self.over_noise(seen.base_misfit(&base));
        if self.truth.parts.len() < 2 {
            return;
        }
        self.partner = (0..self.truth.parts.len())
            .map(|slot| {
                let mut left = self.truth.parts.clone();
                left.remove(slot);
                self.over_noise(seen.misfit(&base, &left))
            })
            .fold(f64::INFINITY, f64::min);
    }

    /// How far the draw is from what is asked for; zero if it is that.
    fn miss(&self, plan: &Plan) -> f64 {
        let outside = |value: f64, range: &std::ops::RangeInclusive<f64>| {
            if value < *range.start() {
                (range.start() / value).ln()
            } else {
                (value / range.end()).ln().max(0.0)
            }
        };
        let least = if plan.rig == Rig::Actuator { 0.8 } else { 0.35 };
        let reach = 10.0 * outside(self.reach, &(least..=2.7));
        reach
            + match plan.laws.as_slice() {
                [] | [Law::RandomForce] => 0.0,
                [_] => outside(self.ratio, &VISIBLE),
                _ => {
                    outside(self.ratio, &VISIBLE_PAIR)
                        + outside(self.partner, &(PARTNER..=f64::INFINITY))
                }
            }
    }
}

/// Draws the case with this number.
pub fn make(plan: &Plan, seed: u64, number: usize) -> Made {
    let mut random = random_for(seed, &format!("case {number}"));
    let mut best: Option<(f64, Drawn)> = None;
    for _ in 0..ATTEMPTS {
        let drawn = Drawn::draw(plan, &mut random);
        let miss = drawn.miss(plan);
        if best.as_ref().is_none_or(|(least, _)| miss < *least) {
            best = Some((miss, drawn));
        }
        if miss <= 0.0 {
            break;
        }
    }
    // There is at least one attempt.
    let Some((miss, drawn)) = best else {
        unreachable!("no attempt was made")
    };
    let mut random = random_for(seed, &format!("recording {number}"));
    let cut = plan.rig == Rig::Swing || random.random_bool(CUT);
    let files = drawn.record(plan.rig, cut, number, &mut random);
    let mut kinds: Vec<String> = plan
        .laws
        .iter()
        .filter_map(|law| law.kind().map(str::to_owned))
        .collect();
    kinds.sort_unstable();
    let answer = Answer {
        case: case_name(number),
        rig: plan.rig,
        cut,
        hidden: plan.hidden,
        kinds,
        laws: plan.laws.iter().map(|law| law.name().to_owned()).collect(),
        misfit_over_noise: drawn.ratio,
        partner_over_noise: drawn.partner.is_finite().then_some(drawn.partner),
        visible: miss <= 0.0,
        truth: drawn.truth,
        nominal: drawn.nominal,
        supply: drawn.supply,
        instruments: drawn.instruments,
        coloured: drawn.coloured,
        coloured_misfit: drawn.coloured_misfit,
        samples: files.iter().map(|file| file.samples.time.len()).sum(),
        seconds: files
            .iter()
            .filter_map(|file| file.samples.time.last())
            .sum(),
    };
    Made { answer, files }
}

/// Name of the folder of a case.
pub fn case_name(number: usize) -> String {
    format!("bench_{number:03}")
}

impl Drawn {
    /// Records the whole session, or each release.
    fn record(&self, rig: Rig, cut: bool, number: usize, random: &mut Pcg64Mcg) -> Vec<File> {
        let forces = self.forces();
        let readings: Vec<Vec<f64>> = self
            .drives
            .iter()
            .zip(&forces)
            .map(|(drive, force)| {
                let outside = Outside {
                    force: Some(force),
                    start: drive.start,
                    ..Outside::at_rest(&drive.line)
                };
                self.truth.simulate(&outside, RATE_HZ, 1)
            })
            .collect();
        let limit = self.instruments.limit(&readings);
        let recorded = self.drives.iter().zip(&readings).map(|(drive, reading)| {
            let shown = Shown {
                line: &drive.line,
                reading,
                rate_hz: f64::from(RATE_HZ),
            };
            self.instruments.record(&shown, limit, random)
        });
        let mut recorded: Vec<Samples> = recorded.collect();
        if rig == Rig::Swing {
            return numbered("release", recorded);
        }
        // One drive for every other rig.
        let samples = recorded.remove(0);
        let marks = &self.drives[0].marks;
        if cut {
            return numbered("part", pieces(&samples, marks));
        }
        // A table of an actuator's sensor begins a little below zero.
        let least = if rig == Rig::Actuator { -30.0 } else { -180.0 };
        let range = [least, limit.map_or(180.0, f64::to_degrees)];
        let meta = metadata(&samples, marks, range, number, random);
        vec![File {
            name: "session".to_owned(),
            samples,
            meta: Some(meta),
        }]
    }
}

/// Files without metadata.
fn numbered(name: &str, list: Vec<Samples>) -> Vec<File> {
    (1..)
        .zip(list)
        .map(|(number, samples)| File {
            name: format!("{name}_{number:02}"),
            samples,
            meta: None,
        })
        .collect()
}

/// A session cut where its sections begin, each piece with its time from zero.
fn pieces(samples: &Samples, marks: &[Mark]) -> Vec<Samples> {
    let at = |time: f64| samples.time.partition_point(|t| *t < time);
    let mut bounds: Vec<usize> = marks.iter().map(|mark| at(mark.from)).collect();
    bounds.push(samples.time.len());
    bounds
        .windows(2)
        .map(|bounds| {
            let range = bounds[0]..bounds[1];
            let begin = samples.time[range.start];
            Samples {
                time: samples.time[range.clone()]
                    .iter()
                    .map(|time| time - begin)
                    .collect(),
                pressure: samples.pressure[range.clone()].to_vec(),
                angle: samples.angle[range].to_vec(),
            }
        })
        .collect()
}

/// The metadata of a session, as a recorder writes it.
fn metadata(
    samples: &Samples,
    marks: &[Mark],
    [least, most]: [f64; 2],
    number: usize,
    random: &mut Pcg64Mcg,
) -> String {
    let sent: Vec<String> = marks
        .iter()
        .map(|mark| format!("\"{}\"", mark.sent))
        .collect();
    let mut text = format!(
        "simulated = true\nprotocol = \"session\"\nstarted = \"2026-03-{:02}T{:02}:{:02}:07Z\"\nuptime_s = {:.2}\nport = \"/dev/ttyACM0\"\nfirmware = \"0.1.0\"\nwire = 1\nsettings = \"7f3a\"\nangle_range_deg = [{least:.1}, {most:.4}]\nrig = \"0.1.0\"\ncomplete = true\nsamples = {}\ndropped_lines = 0\ndamaged_lines = 0\nrows_without_reading = 0\nconnection_lost = 0\nsegments = [{}]\n",
        1 + number % 28,
        random.random_range(8..19),
        random.random_range(0..60),
        random.random_range(3.0..900.0),
        samples.time.len(),
        sent.join(", "),
    );
    for mark in marks {
        text += &format!(
            "\n[[segment]]\nfrom_s = {:.3}\nto_s = {:.3}\n",
            mark.from, mark.to
        );
        if let Some(setpoint) = mark.setpoint_deg {
            text += &format!("setpoint_deg = {setpoint:.1}\n");
        }
        if let Some(repeat) = mark.repeat {
            text += &format!("repeat = {repeat}\n");
        }
    }
    text
}

impl Made {
    /// Writes `model.toml` and the recordings into a folder. Nothing in it tells
    /// what is hidden.
    ///
    /// # Errors
    ///
    /// Says what cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let recordings = folder.join("recordings");
        std::fs::create_dir_all(&recordings)
            .map_err(|error| InputError::from_io(&recordings, &error))?;
        for file in &self.files {
            let path = recordings.join(format!("{}.csv", file.name));
            if let Some(meta) = &file.meta {
                write_atomically(&path.with_extension("meta.toml"), meta.as_bytes())?;
            }
            let recording = Recording {
                time: file.samples.time.clone(),
                pressure: file.samples.pressure.clone(),
                angle: file.samples.angle.clone(),
                ..Recording::default()
            };
            write_atomically(&path, to_csv(&recording, &[]).as_bytes())?;
        }
        // Last, so that a folder with a model is complete.
        write_atomically(&folder.join("model.toml"), self.model().as_bytes())
    }

    fn model(&self) -> String {
        let nominal = &self.answer.nominal;
        // Without pressure nothing says what a pressure does.
        let free = if self.answer.rig == Rig::Swing {
            "\"damping\", \"stiffness\""
        } else {
            "\"damping\", \"stiffness\", \"input_gain\""
        };
        format!(
            "schema = 1\nname = \"{}\"\n\n[dynamics]\ninertia_kg_m = {:.6}\ndamping_n_s_per_rad = {:.6}\nstiffness_n_per_rad_n = {:.6}\nexponent = {}\ninput_gain_n_per_kpa = {:.6}\n\n[fit]\nfree = [{free}]\n",
            self.answer.case,
            nominal.inertia,
            nominal.damping,
            nominal.stiffness,
            nominal.exponent,
            nominal.input_gain * 1e3,
        )
    }
}

/// Draws the cases with these numbers in parallel and hands each to `done` as
/// soon as it is made.
///
/// # Errors
///
/// The first error of `done`.
pub fn make_all<E: Send>(
    plans: &[Plan],
    numbers: &[usize],
    seed: u64,
    done: impl Fn(Made) -> Result<(), E> + Sync,
) -> Result<(), E> {
    numbers
        .par_iter()
        .try_for_each(|&number| done(make(&plans[number], seed, number)))
}
