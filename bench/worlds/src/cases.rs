//! The cases of the sets `rich` and `paper`: what they hide, drawn so that it
//! matters ([`sizes`](super::sizes)), and the runs that a lab would hand over.
//!
//! What is there without an effect is the sensor's noise: the misfit of a refit is
//! that to noise-free readings.

use std::path::Path;

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use softrig_formats::error::InputError;
use softrig_formats::recording::Recording;

use super::experiments::{Planned, Pump, Set};
use super::folder::{File, write};
use super::hidden::{Hidden, Secret, kinds_of, names_of};
use super::kinds::group;
use super::law::{Effect, Law, kinds};
use super::refit::{BASE, Fitted, everything, misfit, refit};
use super::sensors::Sensors;
use super::sizes::{
    REACH, Scale, Shows, best_of, largest, logarithmic, off, over_floor, reach, sized, typical,
    wanted,
};
use super::world::{Base, Line, RATE_HZ, SAMPLES_HZ, World};

/// Integration steps of a sample, for the recordings.
const STEPS: u32 = RATE_HZ / SAMPLES_HZ;
/// Integration steps of a sample, while a size is searched.
const STEPS_SEARCH: u32 = 8;
/// Integration steps of a sample of the base model, which has nothing fast.
const STEPS_BASE: u32 = 2;

/// Actuators that are drawn for an effect before it is taken as it is.
const ATTEMPTS: u32 = 24;

/// What a case hides, before anything is drawn.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Plan {
    /// Which experiments.
    pub set: Set,
    /// What is hidden.
    pub hidden: Hidden,
    /// The laws.
    pub laws: Vec<Law>,
    /// Tells cases with the same laws apart.
    pub replicate: u32,
}

/// The answer to a case: all that is needed to make it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// What is hidden.
    pub secret: Secret,
    /// Which experiments.
    pub set: Set,
    /// The pump.
    pub pump: Pump,
    /// The sensors.
    pub sensors: Sensors,
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
/// Kinds take turns.
pub fn plan(set: Set, count: u32, only: &[String], seed: u64) -> Vec<Plan> {
    let mut random = Pcg64Mcg::seed_from_u64(stable_hash(
        format!("plan {seed} {}", set.name()).as_bytes(),
    ));
    let mut names = kinds();
    names.shuffle(&mut random);
    let mut outside = Law::outside();
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
    let mut list = Vec::new();
    for (hidden, count) in shares {
        for replicate in 0..count {
            let turn = replicate as usize;
            let laws = match hidden {
                Hidden::Nothing | Hidden::Parameters => Vec::new(),
                Hidden::Outside => vec![outside[turn % outside.len()]],
                Hidden::One => {
                    // Half of the kinds start with another law.
                    let index = turn % names.len();
                    vec![Law::in_turn(names[index], turn / names.len() + index % 2)]
                }
                Hidden::Two => loop {
                    let pair: Vec<&str> = names.sample(&mut random, 2).copied().collect();
                    if group(pair[0]) != group(pair[1]) {
                        let mut pair = [pair[0], pair[1]].map(|kind| Law::in_turn(kind, turn % 2));
                        // A dead time looks at the line itself, so it is first.
                        pair.sort_by_key(|law| (*law != Law::DeadTime, law.row().name));
                        break pair.to_vec();
                    }
                },
            };
            list.push(Plan {
                set,
                hidden,
                laws,
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
        plan.laws,
        plan.replicate
    );
    let mut random = Pcg64Mcg::seed_from_u64(stable_hash(label.as_bytes()));
    let (miss, drawn) = best_of(ATTEMPTS, || {
        let drawn = Drawn::draw(plan, &mut random);
        (drawn.shows.miss(plan.laws.len(), REACH), drawn)
    });
    let secret = Secret {
        case: case.to_owned(),
        hidden: plan.hidden,
        kinds: kinds_of(&plan.laws),
        laws: names_of(&plan.laws),
        same_laws: plan.laws.iter().all(|law| law.row().same),
        truth: drawn.truth,
        nominal: drawn.nominal,
        misfit_over_noise: drawn.shows.ratio,
        partner_over_noise: drawn.shows.known_partner(),
        visible: miss <= 0.0,
    };
    let answer = Answer {
        secret,
        set: plan.set,
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
                let line = self.pump.drive(&planned.experiment, &self.secret.nominal);
                let reading = self.secret.truth.simulate(&line, run, STEPS);
                let mut recording = self.sensors.record(&line, &reading, random);
                recording.name = planned.name();
                (planned, recording, reading)
            })
            .collect()
    }

    /// The right structure, its numbers refitted to what was recorded, from the
    /// measured pressure: as well as anyone could do.
    pub fn oracle(&self) -> World {
        let runs: Vec<Fitted> = (0..)
            .zip(self.runs())
            .map(|(run, (_, recording))| measured(run, &recording))
            .collect();
        let truth = &self.secret.truth;
        refit(truth, &everything(truth), &runs, STEPS_ORACLE)
    }

    /// RMS (rad) of a world on the fresh runs: against what was
    /// recorded, and against what a perfect sensor would have shown.
    pub fn on_fresh(&self, model: &World) -> (f64, f64) {
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
    truth: World,
    nominal: Base,
    pump: Pump,
    sensors: Sensors,
    shows: Shows,
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
        let nominal = if plan.hidden == Hidden::Nothing {
            base
        } else {
            off(&base, random)
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
        let scale = Scale::of(&base, pressure);
        let mut drawn = Self {
            truth: World::of(base),
            nominal,
            pump,
            sensors,
            shows: Shows::NOTHING,
        };
        let lines = drawn.lines(plan, random);
        let mut effects = Vec::new();
        for &law in &plan.laws {
            let typical = typical(law, &scale, random);
            let wanted = wanted(plan.laws.len(), random);
            let floor = drawn.sensors.angle_floor();
            let misfit = |effect: Effect| {
                let truth = World {
                    base,
                    effects: vec![effect],
                };
                drawn.base_misfit(&Self::shown(&truth, &lines))
            };
            effects.push(sized(typical, largest(&typical), wanted, floor, misfit));
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
    fn shown(truth: &World, lines: &[Line]) -> Vec<Fitted> {
        (0..)
            .zip(lines)
            .map(|(run, line)| Fitted {
                line: line.clone(),
                run,
                angle: truth.simulate(line, run, STEPS_SEARCH),
            })
            .collect()
    }

    /// Misfit of the base model, refitted to the runs (rad).
    fn base_misfit(&self, runs: &[Fitted]) -> f64 {
        if runs
            .iter()
            .any(|run| run.angle.iter().any(|a| !a.is_finite()))
        {
            return f64::INFINITY;
        }
        let base = World::of(self.truth.base);
        misfit(&refit(&base, &BASE, runs, STEPS_BASE), runs, STEPS_BASE)
    }

    fn measure(&mut self, lines: &[Line]) {
        if self.truth.effects.is_empty() {
            return;
        }
        let runs = Self::shown(&self.truth, lines);
        self.shows.reach = reach(runs.iter().map(|run| &run.angle));
        let over_noise = |misfit: f64| over_floor(misfit, self.sensors.angle_floor());
        self.shows.ratio = over_noise(self.base_misfit(&runs));
        if self.truth.effects.len() < 2 || !self.shows.reach.is_finite() {
            return;
        }
        self.shows.partner = (0..self.truth.effects.len())
            .map(|slot| {
                let mut less = self.truth.clone();
                less.effects.remove(slot);
                let fitted = refit(&less, &everything(&less), &runs, STEPS_SEARCH);
                over_noise(misfit(&fitted, &runs, STEPS_SEARCH))
            })
            .fold(f64::INFINITY, f64::min);
    }
}

impl Made {
    /// Writes the case into a folder.
    ///
    /// # Errors
    ///
    /// Says what cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let file = |(planned, recording): &(Planned, Recording)| {
            let mut meta = format!("simulated = true\nprotocol = \"{}\"\n", planned.protocol);
            if let Some(setpoint) = planned.setpoint_deg {
                meta += &format!("setpoint_deg = {setpoint:.1}\n");
            }
            if let Some(repeat) = planned.repeat {
                meta += &format!("repeat = {repeat}\n");
            }
            File {
                name: planned.name(),
                recording: recording.clone(),
                meta: Some(meta),
            }
        };
        let files: Vec<File> = self.runs.iter().map(file).collect();
        let Secret { case, nominal, .. } = &self.answer.secret;
        let free = ["damping", "stiffness", "input_gain"];
        write(folder, case, nominal, &free, &files)
    }
}
