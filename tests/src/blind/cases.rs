//! Drawing what is hidden, so that it matters, and writing what a lab would
//! hand over.
//!
//! An effect that cannot be seen cannot be named, so its size is set by what it
//! does: the base model is refitted to noise-free readings, and the size is
//! moved until the misfit that is left, together with the noise, is a drawn
//! multiple of the noise between 1.5 and 8. Where an effect cannot reach that
//! within the largest size that is taken for real, the actuator is drawn again.
//! Of a pair each partner has to matter beside the other: without it, the rest
//! refitted, the misfit has to be 1.3 times the noise or more.

use std::path::Path;

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use softrig_formats::error::InputError;
use softrig_formats::recording::{Recording, to_csv};

use super::experiments::{Planned, Pump, Set};
use super::kinds::group;
use super::refit::{BASE, Fitted, everything, misfit, refit};
use super::sensors::Sensors;
use super::truth::{Base, Effect, Formula, Line, RATE_HZ, SAMPLES_HZ, Truth, VALUES, kinds};

/// Integration steps of a sample, for the recordings.
const STEPS: u32 = RATE_HZ / SAMPLES_HZ;
/// Integration steps of a sample, while a size is searched.
const STEPS_SEARCH: u32 = 8;
/// Integration steps of a sample of the base model, which has nothing fast.
const STEPS_BASE: u32 = 2;

/// The misfit of the refitted base model with noise, over the noise.
const VISIBLE: std::ops::RangeInclusive<f64> = 1.5..=8.0;
/// … for two effects together.
const VISIBLE_PAIR: std::ops::RangeInclusive<f64> = 1.5..=12.0;
/// What leaving out one of a pair has to leave, over the noise.
const PARTNER: f64 = 1.3;
/// Actuators that are drawn for an effect before it is taken as it is.
const ATTEMPTS: u32 = 24;

/// What is hidden in a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// Nothing: the nominal model is the truth.
    Nothing,
    /// The parameters are off.
    Parameters,
    /// One effect of the catalogue.
    One,
    /// Two effects of the catalogue.
    Two,
    /// An effect outside the catalogue.
    Outside,
}

/// What a case hides, before anything is drawn.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Plan {
    /// Which experiments.
    pub set: Set,
    /// What is hidden.
    pub hidden: Hidden,
    /// The formulas.
    pub formulas: Vec<Formula>,
    /// Tells cases with the same formulas apart.
    pub replicate: u32,
}

/// The answer to a case: all that is needed to make it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Name of the case's folder.
    pub case: String,
    /// Which experiments.
    pub set: Set,
    /// What is hidden.
    pub hidden: Hidden,
    /// Kinds of the catalogue, in alphabetical order.
    pub kinds: Vec<String>,
    /// Names of the formulas, in the order of the truth's effects.
    pub formulas: Vec<String>,
    /// Whether the catalogue's own formulas were used throughout.
    pub same_formulas: bool,
    /// The truth, in SI units.
    pub truth: Truth,
    /// The nominal parameters.
    pub nominal: Base,
    /// The pump.
    pub pump: Pump,
    /// The sensors.
    pub sensors: Sensors,
    /// RMS of the refitted base model with noise over the noise.
    pub misfit_over_noise: f64,
    /// Of a pair: the least that leaving out one of the two, the rest
    /// refitted, leaves over the noise.
    pub partner_over_noise: Option<f64>,
    /// Whether both are in the range that is asked for.
    pub visible: bool,
    /// Seed of phases and noise.
    pub seed: u64,
}

/// A case in memory.
#[derive(Clone, Debug)]
pub struct Made {
    /// The answer.
    pub answer: Answer,
    /// The runs, as recorded.
    pub runs: Vec<(Planned, Recording)>,
}

/// A hash that is the same on every machine (FNV-1a).
pub fn stable_hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// How many cases hide what, in a set of `count`.
fn shares(set: Set, count: u32) -> [(Hidden, u32); 5] {
    let share = |percent: u32| (count * percent + 50) / 100;
    // The figures ask for pairs on the rich set only.
    let two = if set == Set::Rich { share(14) } else { 0 };
    let (nothing, parameters, outside) = (share(7), share(10), share(14));
    let rest = count.saturating_sub(two + nothing + parameters + outside);
    [
        (Hidden::One, rest),
        (Hidden::Two, two),
        (Hidden::Nothing, nothing),
        (Hidden::Parameters, parameters),
        (Hidden::Outside, outside),
    ]
}

/// What `count` cases hide. With `only`, each hides one of these kinds.
///
/// Kinds take turns. Every second case of a kind has another formula than the
/// catalogue's, where there is one.
pub fn plan(set: Set, count: u32, only: &[String], seed: u64) -> Vec<Plan> {
    let mut random = Pcg64Mcg::seed_from_u64(stable_hash(
        format!("plan {seed} {}", set.name()).as_bytes(),
    ));
    let mut names = kinds();
    names.shuffle(&mut random);
    let mut outside = Formula::outside();
    outside.shuffle(&mut random);
    let shares = if only.is_empty() {
        shares(set, count)
    } else {
        names.retain(|name| only.iter().any(|only| only == name));
        [(Hidden::One, count); 5].map({
            let mut first = true;
            move |(hidden, count)| (hidden, if std::mem::take(&mut first) { count } else { 0 })
        })
    };
    let of_kind = |kind: &str, turn: usize| {
        let formulas = Formula::of_kind(kind);
        if turn.is_multiple_of(2) || formulas.len() == 1 {
            formulas[0]
        } else {
            formulas[1 + turn / 2 % (formulas.len() - 1)]
        }
    };
    let mut list = Vec::new();
    for (hidden, count) in shares {
        for replicate in 0..count {
            let turn = replicate as usize;
            let formulas = match hidden {
                Hidden::Nothing | Hidden::Parameters => Vec::new(),
                Hidden::Outside => vec![outside[turn % outside.len()]],
                Hidden::One => {
                    // Half of the kinds start with another formula.
                    let index = turn % names.len();
                    vec![of_kind(names[index], turn / names.len() + index % 2)]
                }
                Hidden::Two => loop {
                    let pair: Vec<&str> = names.sample(&mut random, 2).copied().collect();
                    if group(pair[0]) != group(pair[1]) {
                        let mut pair = [pair[0], pair[1]].map(|kind| of_kind(kind, turn % 2));
                        // A dead time looks at the line itself, so it is first.
                        pair.sort_by_key(|formula| {
                            (*formula != Formula::DeadTime, formula.row().name)
                        });
                        break pair.to_vec();
                    }
                },
            };
            list.push(Plan {
                set,
                hidden,
                formulas,
                replicate,
            });
        }
    }
    // The number of a case says nothing about it.
    list.shuffle(&mut random);
    list
}

/// Draws a case.
pub fn make(plan: &Plan, case: &str, seed: u64) -> Made {
    let label = format!(
        "{seed} {} {:?} {:?} {}",
        plan.set.name(),
        plan.hidden,
        plan.formulas,
        plan.replicate
    );
    let mut random = Pcg64Mcg::seed_from_u64(stable_hash(label.as_bytes()));
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
    let mut kinds: Vec<String> = plan
        .formulas
        .iter()
        .filter_map(|formula| formula.row().kind.map(str::to_owned))
        .collect();
    kinds.sort_unstable();
    let answer = Answer {
        case: case.to_owned(),
        set: plan.set,
        hidden: plan.hidden,
        kinds,
        formulas: plan
            .formulas
            .iter()
            .map(|formula| formula.row().name.to_owned())
            .collect(),
        same_formulas: plan.formulas.iter().all(|formula| formula.row().same),
        misfit_over_noise: drawn.ratio,
        partner_over_noise: drawn.partner.is_finite().then_some(drawn.partner),
        visible: miss <= 0.0,
        truth: drawn.truth,
        nominal: drawn.nominal,
        pump: drawn.pump,
        sensors: drawn.sensors,
        seed: stable_hash(format!("noise {label}").as_bytes()),
    };
    let runs = answer.runs();
    Made { answer, runs }
}

impl Answer {
    /// The runs to diagnose by, as recorded.
    pub fn runs(&self) -> Vec<(Planned, Recording)> {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let list = self.set.experiments(&mut random);
        self.record(list, 0, &mut random)
            .into_iter()
            .map(|(planned, recording, _)| (planned, recording))
            .collect()
    }

    /// Fresh runs: as recorded, and what a perfect sensor would have shown.
    pub fn fresh(&self) -> Vec<(Planned, Recording, Vec<f64>)> {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed ^ 0x5eed);
        let list = self.set.fresh(&mut random);
        self.record(list, 100, &mut random)
    }

    fn record(
        &self,
        list: Vec<Planned>,
        first: u32,
        random: &mut Pcg64Mcg,
    ) -> Vec<(Planned, Recording, Vec<f64>)> {
        (first..)
            .zip(list)
            .map(|(run, planned)| {
                let line = self.pump.drive(&planned.experiment, &self.nominal);
                let reading = self.truth.simulate(&line, run, STEPS);
                let mut recording = self.sensors.record(&line, &reading, random);
                recording.name = planned.name();
                (planned, recording, reading)
            })
            .collect()
    }

    /// The right structure, its numbers refitted to what was recorded, from the
    /// measured pressure: as well as anyone could do.
    pub fn oracle(&self) -> Truth {
        let runs: Vec<Fitted> = (0..)
            .zip(self.runs())
            .map(|(run, (_, recording))| measured(run, &recording))
            .collect();
        refit(&self.truth, &everything(&self.truth), &runs, STEPS_ORACLE)
    }

    /// RMS (rad) of a truth-like model on the fresh runs: against what was
    /// recorded, and against what a perfect sensor would have shown.
    pub fn on_fresh(&self, model: &Truth) -> (f64, f64) {
        let fresh = self.fresh();
        let runs: Vec<Fitted> = (100..)
            .zip(&fresh)
            .map(|(run, (_, recording, _))| measured(run, recording))
            .collect();
        let clean: Vec<Fitted> = runs
            .iter()
            .zip(fresh)
            .map(|(run, (_, _, reading))| Fitted {
                angle: reading,
                ..run.clone()
            })
            .collect();
        (
            misfit(model, &runs, STEPS_ORACLE),
            misfit(model, &clean, STEPS_ORACLE),
        )
    }
}

/// Integration steps of a sample when the right structure is refitted.
const STEPS_ORACLE: u32 = 10;

fn measured(run: u32, recording: &Recording) -> Fitted {
    Fitted {
        line: Line::new(1.0 / f64::from(SAMPLES_HZ), recording.pressure.clone()),
        run,
        angle: recording.angle.clone(),
    }
}

/// An actuator with its rig.
#[derive(Clone, Debug)]
struct Drawn {
    truth: Truth,
    nominal: Base,
    pump: Pump,
    sensors: Sensors,
    /// RMS of the refitted base model with noise over the noise.
    ratio: f64,
    /// Largest angle (rad).
    reach: f64,
    /// Least that leaving out an effect leaves, over the noise.
    partner: f64,
}

/// Pressure at 90° in proportion to which sizes are drawn, and the like.
pub(super) struct Scale {
    /// Elastic force at 90° (N).
    pub(super) force: f64,
    /// Pressure at 90° (Pa).
    pub(super) pressure: f64,
    pub(super) damping: f64,
}

impl Drawn {
    fn draw(plan: &Plan, random: &mut Pcg64Mcg) -> Self {
        let exponent = *[1.538, 1.727, 2.0, 2.174, 2.365]
            .choose(random)
            .unwrap_or(&2.0);
        let right = std::f64::consts::FRAC_PI_2;
        let stiffness = logarithmic(random, 1.5, 15.0);
        let force = stiffness * right.powf(exponent);
        let pressure = random.random_range(60e3..150e3);
        let base = Base {
            inertia: random.random_range(0.15..0.4),
            damping: logarithmic(random, 0.8, 4.5),
            stiffness,
            exponent,
            input_gain: force / pressure,
        };
        let mut off = |value: f64| {
            let by: f64 = random.random_range(0.1..0.3);
            value
                * if random.random_bool(0.5) {
                    1.0 + by
                } else {
                    1.0 - by
                }
        };
        let nominal = if plan.hidden == Hidden::Nothing {
            base
        } else {
            Base {
                damping: off(base.damping),
                stiffness: off(base.stiffness),
                input_gain: off(base.input_gain),
                ..base
            }
        };
        let pump = Pump {
            lag: random.random_range(0.04..0.15),
            fastest: pressure / random.random_range(0.15..0.5),
        };
        let sensors = Sensors {
            angle_noise: random.random_range(0.2f64..0.6).to_radians(),
            pressure_noise: random.random_range(300.0..900.0),
            averaged: *[4, 8, 16].choose(random).unwrap_or(&8),
        };
        let scale = Scale {
            force,
            pressure,
            damping: base.damping,
        };
        let mut drawn = Self {
            truth: Truth {
                base,
                effects: Vec::new(),
            },
            nominal,
            pump,
            sensors,
            ratio: 1.0,
            reach: 1.5,
            partner: f64::INFINITY,
        };
        let lines = drawn.lines(plan, random);
        let mut effects = Vec::new();
        for &formula in &plan.formulas {
            let typical = Effect {
                formula,
                values: typical(formula, &scale, random),
            };
            let wanted = if plan.formulas.len() == 1 {
                logarithmic(random, 1.7, 6.5)
            } else {
                logarithmic(random, 2.0, 5.0)
            };
            effects.push(drawn.sized(typical, wanted, &lines));
        }
        drawn.truth.effects = effects;
        drawn.measure(&lines);
        drawn
    }

    fn lines(&self, plan: &Plan, random: &mut Pcg64Mcg) -> Vec<Line> {
        plan.set
            .experiments(random)
            .iter()
            .map(|planned| self.pump.drive(&planned.experiment, &self.nominal))
            .collect()
    }

    /// Noise-free runs of a truth.
    fn shown(truth: &Truth, lines: &[Line]) -> Vec<Fitted> {
        (0..)
            .zip(lines)
            .map(|(run, line)| Fitted {
                line: line.clone(),
                run,
                angle: truth.simulate(line, run, STEPS_SEARCH),
            })
            .collect()
    }

    /// Misfit with noise over noise; infinite where the refit failed, so that
    /// the actuator is drawn again.
    fn over_noise(&self, misfit: f64) -> f64 {
        let floor = self.sensors.angle_floor();
        if misfit.is_finite() {
            misfit.hypot(floor) / floor
        } else {
            f64::INFINITY
        }
    }

    /// Misfit of the base model, refitted to the runs (rad).
    fn base_misfit(&self, runs: &[Fitted]) -> f64 {
        if runs
            .iter()
            .any(|run| run.angle.iter().any(|a| !a.is_finite()))
        {
            return f64::INFINITY;
        }
        let base = Truth {
            base: self.truth.base,
            effects: Vec::new(),
        };
        misfit(&refit(&base, &BASE, runs, STEPS_BASE), runs, STEPS_BASE)
    }

    /// The effect in the size whose misfit with noise is `wanted` times the
    /// noise, as nearly as its limits allow.
    fn sized(&self, effect: Effect, wanted: f64, lines: &[Line]) -> Effect {
        let aim = self.sensors.angle_floor() * (wanted * wanted - 1.0).sqrt();
        let largest = largest(&effect);
        let mut factor = 1.0;
        for _ in 0..6 {
            let truth = Truth {
                base: self.truth.base,
                effects: vec![effect.scaled(factor)],
            };
            let misfit = self.base_misfit(&Self::shown(&truth, lines));
            if (0.8..1.25).contains(&(misfit / aim)) {
                break;
            }
            let by = if misfit.is_finite() {
                aim / misfit
            } else {
                0.3
            };
            let next = (factor * by.clamp(0.2, 4.0)).min(largest);
            if (next / factor - 1.0).abs() < 0.02 {
                break;
            }
            factor = next;
        }
        effect.scaled(factor)
    }

    fn measure(&mut self, lines: &[Line]) {
        if self.truth.effects.is_empty() {
            return;
        }
        let runs = Self::shown(&self.truth, lines);
        self.reach = runs
            .iter()
            .flat_map(|run| &run.angle)
            .fold(0.0, |reach: f64, angle| {
                if angle.is_finite() {
                    reach.max(angle.abs())
                } else {
                    f64::INFINITY
                }
            });
        self.ratio = self.over_noise(self.base_misfit(&runs));
        if self.truth.effects.len() < 2 || !self.reach.is_finite() {
            return;
        }
        self.partner = (0..self.truth.effects.len())
            .map(|slot| {
                let mut less = self.truth.clone();
                less.effects.remove(slot);
                let fitted = refit(&less, &everything(&less), &runs, STEPS_SEARCH);
                self.over_noise(misfit(&fitted, &runs, STEPS_SEARCH))
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
        let reach = outside(self.reach, &(0.8..=2.7));
        match plan.formulas.len() {
            0 => 0.0,
            1 => outside(self.ratio, &VISIBLE) + 10.0 * reach,
            _ => {
                outside(self.ratio, &VISIBLE_PAIR)
                    + outside(self.partner, &(PARTNER..=f64::INFINITY))
                    + 10.0 * reach
            }
        }
    }
}

/// An effect of a typical size for an actuator.
pub fn typical_effect(formula: Formula, base: &Base, seed: u64) -> Effect {
    let force = base.stiffness * std::f64::consts::FRAC_PI_2.powf(base.exponent);
    let scale = Scale {
        force,
        pressure: force / base.input_gain,
        damping: base.damping,
    };
    Effect {
        formula,
        values: typical(formula, &scale, &mut Pcg64Mcg::seed_from_u64(seed)),
    }
}

pub(super) fn logarithmic(random: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    random.random_range(low.ln()..high.ln()).exp()
}

/// Numbers of a formula in a size that is seen in real actuators, before the
/// size is moved to where it matters.
// One arm for each formula or for those that differ in their equation only.
#[allow(clippy::too_many_lines, clippy::match_same_arms)]
pub(super) fn typical(formula: Formula, scale: &Scale, random: &mut Pcg64Mcg) -> [f64; VALUES] {
    let Scale {
        force,
        pressure,
        damping,
    } = *scale;
    let per_rad = force / 1.57;
    let mut either = |value: f64| {
        if random.random_bool(0.5) {
            value
        } else {
            -value
        }
    };
    let sign = either(1.0);
    let mut within = |low: f64, high: f64| random.random_range(low..high);
    match formula {
        Formula::CoulombTanh | Formula::CoulombRoot => [0.06 * force, within(0.01, 0.03), 0.0, 0.0],
        Formula::CoulombLugre => [0.06 * force, within(0.005, 0.012), 0.0, 0.0],
        Formula::StribeckGauss | Formula::StribeckExponential => [
            0.04 * force,
            0.04 * force * within(0.7, 1.8),
            within(0.1, 0.35),
            within(0.01, 0.03),
        ],
        Formula::StribeckLugre => [
            0.04 * force,
            0.04 * force * within(0.7, 1.8),
            within(0.1, 0.35),
            within(0.006, 0.012),
        ],
        Formula::QuadraticDrag | Formula::QuadraticBlasius => [0.3 * damping, 0.0, 0.0, 0.0],
        Formula::AngleDamping | Formula::AngleDampingSquare => {
            [if sign > 0.0 { 1.0 } else { -0.3 }, 0.0, 0.0, 0.0]
        }
        Formula::AsymmetricDamping => [if sign > 0.0 { 1.0 } else { -0.4 }, 0.0, 0.0, 0.0],
        Formula::AsymmetricSmooth => [
            if sign > 0.0 { 1.0 } else { -0.4 },
            within(0.05, 0.2),
            0.0,
            0.0,
        ],
        Formula::MaxwellOne => [0.15 * per_rad, within(0.8, 6.0), 0.0, 0.0],
        Formula::MaxwellTwo => [
            0.1 * per_rad,
            within(0.5, 1.5),
            0.1 * per_rad,
            within(4.0, 9.0),
        ],
        Formula::MaxwellPower => [0.06 * per_rad, within(1.0, 3.0), 0.0, 0.0],
        Formula::BoucWen | Formula::HysteresisDahl | Formula::HysteresisStops => {
            [0.1 * force, within(0.1, 0.4), 0.0, 0.0]
        }
        Formula::Gravity | Formula::GravityArc => [sign * 0.2 * force, within(-0.6, 0.6), 0.0, 0.0],
        Formula::ExponentShift => [sign * 0.2, 0.0, 0.0, 0.0],
        Formula::Cubic => [sign * 0.1 * force / 3.9, 0.0, 0.0, 0.0],
        Formula::CubicSinh => [0.3 * per_rad, within(1.2, 2.0), 0.0, 0.0],
        Formula::LinearStiffness => [0.15 * per_rad, 0.0, 0.0, 0.0],
        Formula::LinearSoftening => [0.15 * per_rad, within(1.2, 3.0), 0.0, 0.0],
        Formula::EndStop | Formula::EndStopProgressive => {
            [3.0 * per_rad, within(1.05, 1.4), 0.0, 0.0]
        }
        Formula::StiffnessDrift => [sign * 0.015, 0.0, 0.0, 0.0],
        Formula::StiffnessDriftLog => [sign * 0.03, within(2.0, 8.0), 0.0, 0.0],
        Formula::Mullins | Formula::MullinsSquare => [0.2, within(0.3, 1.0), 0.0, 0.0],
        Formula::SecondMode | Formula::SecondModePair => {
            [within(2.5, 9.0), within(0.02, 0.08), 0.1, 0.0]
        }
        Formula::Lag | Formula::LagDistributed => [0.15, 0.0, 0.0, 0.0],
        Formula::LagSecondOrder => [0.15, within(0.6, 1.2), 0.0, 0.0],
        Formula::DeadTime | Formula::DeadTimeDispersed => [0.1, 0.0, 0.0, 0.0],
        Formula::VentAsymmetry | Formula::VentOrifice => [within(0.03, 0.1), 0.3, 0.0, 0.0],
        Formula::Threshold => [0.08 * pressure, 0.0, 0.0, 0.0],
        Formula::ThresholdSmooth => [0.08 * pressure, 0.02 * pressure, 0.0, 0.0],
        Formula::PressureStiffening => [0.3 / pressure, 0.0, 0.0, 0.0],
        Formula::PressureStiffeningSaturating => {
            [0.4 / pressure, pressure * within(0.8, 2.0), 0.0, 0.0]
        }
        Formula::Backlash | Formula::BacklashPlays => [0.04 * pressure, 0.0, 0.0, 0.0],
        Formula::Leak | Formula::LeakOrifice => [20.0, 0.0, 0.0, 0.0],
        Formula::SensorLag => [0.1, 0.0, 0.0, 0.0],
        Formula::SensorLagSecondOrder => [0.1, within(0.6, 1.2), 0.0, 0.0],
        Formula::SensorOffset => [sign * 0.03, 0.0, 0.0, 0.0],
        Formula::SensorNonlinearity => [sign * 0.06, 0.0, 0.0, 0.0],
        Formula::SensorNonlinearitySaturating => [sign * 0.08, within(0.2, 0.6), 0.0, 0.0],
        Formula::SensorDrift => [sign * 0.005, 0.0, 0.0, 0.0],
        Formula::SensorDriftSettling => [sign * 0.01, within(4.0, 12.0), 0.0, 0.0],
        Formula::Periodic | Formula::PeriodicTriangle | Formula::PeriodicUnsynchronised => {
            [0.05 * force, within(0.7, 4.0), within(-3.0, 3.0), 0.0]
        }
        Formula::TwoStepStiffness => [0.2, within(0.8, 1.1), within(0.3, 0.6), 0.0],
        Formula::ReliefValve => [0.9 * pressure, 0.0, 0.0, 0.0],
        Formula::PressureDependentDelay => [0.2, pressure * within(0.2, 0.5), 0.0, 0.0],
        Formula::Torsion => [sign * 0.05 * per_rad, within(5.0, 9.0), 0.0, 0.0],
        Formula::PeriodicStiffness => [sign * 0.03 * force, within(0.3, 0.6), 0.0, 0.0],
        Formula::StictionAgeing => [0.05 * force, within(1.5, 4.0), within(0.5, 2.0), 0.0],
        Formula::WarmingDamping => [0.5, within(2.0, 8.0), 0.0, 0.0],
        Formula::SnapThrough => [0.15 * force, within(0.6, 1.0), within(0.1, 0.25), 0.0],
        Formula::AmplitudeLag => [0.15, 0.0, 0.0, 0.0],
        Formula::SensorDeadZone => [0.03, within(0.5, 1.1), 0.0, 0.0],
        Formula::RandomForce => [0.05 * force, within(0.0, 9.0), 0.0, 0.0],
    }
}

/// The largest factor by which an effect may be enlarged and still be of a
/// real actuator, and not change its nature (a damping that turns negative).
// Limits that happen to be equal have different reasons.
#[allow(clippy::match_same_arms)]
pub(super) fn largest(effect: &Effect) -> f64 {
    let [first, second, ..] = effect.values;
    let most = match effect.formula {
        Formula::AngleDamping | Formula::AngleDampingSquare if first < 0.0 => 0.35,
        Formula::AsymmetricDamping | Formula::AsymmetricSmooth if first < 0.0 => 0.85,
        Formula::AngleDamping
        | Formula::AngleDampingSquare
        | Formula::AsymmetricDamping
        | Formula::AsymmetricSmooth => 6.0,
        Formula::StiffnessDrift if first < 0.0 => 0.028,
        Formula::StiffnessDriftLog if first < 0.0 => 0.6 / (second * (24.0 / second).ln_1p()),
        Formula::Cubic if first < 0.0 => return 2.0,
        Formula::ExponentShift | Formula::Mullins | Formula::MullinsSquare => 0.6,
        Formula::WarmingDamping => 0.9,
        Formula::Lag | Formula::LagSecondOrder | Formula::LagDistributed => 0.6,
        Formula::AmplitudeLag | Formula::VentAsymmetry | Formula::VentOrifice => {
            return if effect.formula == Formula::AmplitudeLag {
                5.0
            } else {
                4.0
            };
        }
        Formula::DeadTime | Formula::DeadTimeDispersed | Formula::PressureDependentDelay => 0.5,
        Formula::SensorLag | Formula::SensorLagSecondOrder => 0.4,
        Formula::PressureStiffening | Formula::PressureStiffeningSaturating => return 6.0,
        Formula::TwoStepStiffness => 2.0,
        _ => return 8.0,
    };
    most / first.abs()
}

impl Made {
    /// Writes `model.toml` and the recordings with their metadata into a
    /// folder. Nothing in it tells what is hidden.
    ///
    /// # Errors
    ///
    /// Says what cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        use softrig_formats::error::write_atomically;
        let recordings = folder.join("recordings");
        std::fs::create_dir_all(&recordings)
            .map_err(|error| InputError::from_io(&recordings, &error))?;
        let nominal = &self.answer.nominal;
        let model = format!(
            "schema = 1\nname = \"{}\"\n\n[dynamics]\ninertia_kg_m = {:.6}\ndamping_n_s_per_rad = {:.6}\nstiffness_n_per_rad_n = {:.6}\nexponent = {}\ninput_gain_n_per_kpa = {:.6}\n\n[fit]\nfree = [\"damping\", \"stiffness\", \"input_gain\"]\n",
            self.answer.case,
            nominal.inertia,
            nominal.damping,
            nominal.stiffness,
            nominal.exponent,
            nominal.input_gain * 1e3,
        );
        for (planned, recording) in &self.runs {
            let mut meta = format!("simulated = true\nprotocol = \"{}\"\n", planned.protocol);
            if let Some(setpoint) = planned.setpoint_deg {
                meta += &format!("setpoint_deg = {setpoint:.1}\n");
            }
            if let Some(repeat) = planned.repeat {
                meta += &format!("repeat = {repeat}\n");
            }
            let path = recordings.join(format!("{}.csv", planned.name()));
            write_atomically(&path.with_extension("meta.toml"), meta.as_bytes())?;
            write_atomically(&path, to_csv(recording, &[]).as_bytes())?;
        }
        // Last, so that a folder with a model is complete.
        write_atomically(&folder.join("model.toml"), model.as_bytes())
    }
}

/// Draws cases in parallel and hands each to `done` as soon as it is made.
///
/// # Errors
///
/// The first error of `done`.
pub fn make_all<E: Send>(
    plans: &[Plan],
    seed: u64,
    done: impl Fn(Made) -> Result<Answer, E> + Sync,
) -> Result<Vec<Answer>, E> {
    plans
        .par_iter()
        .enumerate()
        .map(|(index, plan)| {
            let case = format!("{}_{index:03}", plan.set.name());
            done(make(plan, &case, seed))
        })
        .collect()
}
