//! The cases of the set `bench`: what they hide, and what a lab would hand over.
//!
//! What a case is depends on the seed of the set and on its number alone, not on
//! how many cases there are: twelve in a row hold seven single effects, a pair,
//! a case without anything, one with parameters only, and two causes outside
//! the catalogue. How large an effect is drawn is as in the other sets
//! ([`sizes`](super::super::sizes)); what is there without it is the sensor's noise
//! and what a refit leaves of the coloured force ([`sizing`](super::sizing)).

use std::path::Path;

use rand::seq::{IndexedRandom, SliceRandom};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use softrig_formats::error::InputError;
use softrig_formats::recording::Recording;

use super::super::cases::stable_hash;
use super::super::experiments::Pump;
use super::super::folder::{File, write};
use super::super::hidden::{Hidden, Secret, kinds_of, names_of};
use super::super::kinds::group;
use super::super::law::{Effect, Law, kinds};
use super::super::sizes::{
    CORRELATION, REACH, Scale, Shows, best_of, largest, logarithmic, off, over_floor, sized,
    typical, wanted,
};
use super::super::world::{Base, Grid, Line, Outside, RATE_HZ, World, coloured};
use super::instruments::{Instruments, Shown};
use super::session::{Drive, Mark, Rig, Supply, play};
use super::sizing::Seen;

/// Actuators that are drawn before one is taken as it is.
const ATTEMPTS: u32 = 12;
/// The coloured force of every bench, over the force of reference.
const COLOURED: std::ops::Range<f64> = 0.01..0.02;
/// Share of the sessions that are cut into files.
const CUT: f64 = 1.0 / 3.0;
/// Least angle (rad) that rigs other than an actuator have to reach.
const REACH_ELSEWHERE: f64 = 0.35;
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
    /// What is hidden.
    pub secret: Secret,
    /// Which rig.
    pub rig: Rig,
    /// Whether the session was cut into files without metadata.
    pub cut: bool,
    /// What drives the rig.
    pub supply: Supply,
    /// The instruments.
    pub instruments: Instruments,
    /// Standard deviation (N) and correlation time (s) of the coloured force.
    pub coloured: [f64; 2],
    /// What the refitted base leaves of the coloured force (rad).
    pub coloured_misfit: f64,
    /// Recording of all files.
    pub samples: usize,
    /// Duration of all files (s).
    pub seconds: f64,
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
const fn special(rig: Rig) -> &'static [Law] {
    match rig {
        Rig::Actuator => &[],
        Rig::Integrator => &[
            Law::CoulombTanh,
            Law::StribeckGauss,
            Law::CoulombLugre,
            Law::StribeckLugre,
            Law::StribeckExponential,
        ],
        Rig::Swing => &[
            Law::CoulombLugre,
            Law::Gravity,
            Law::QuadraticDrag,
            Law::CoulombTanh,
            Law::AngleDamping,
            Law::Cubic,
            Law::QuadraticBlasius,
            Law::ExponentShift,
            Law::SensorNonlinearity,
        ],
        Rig::BroadBand => &[Law::BoucWenShape],
    }
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
        Law::ColouredForce,
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
                        // Half of the kinds begin with another law.
                        let index = turn % names.len();
                        let law = Law::in_turn(names[index], turn / names.len() + index % 2);
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
    match turn % 4 {
        // Friction that is not the same to both sides.
        2 => (
            Rig::Integrator,
            vec![Law::CoulombTanh, Law::AsymmetricDamping],
        ),
        // A pendulum with a dry bearing.
        3 => (Rig::Swing, vec![Law::CoulombTanh, Law::Gravity]),
        _ => loop {
            let drawn: Vec<&str> = names.sample(random, 2).copied().collect();
            if group(drawn[0]) != group(drawn[1]) {
                let in_turn = drawn.iter().map(|kind| Law::in_turn(kind, turn));
                let mut laws: Vec<Law> = in_turn.collect();
                // A dead time looks at the line itself, so it is first.
                laws.sort_by_key(|law| (*law != Law::DeadTime, law.row().name));
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
    shows: Shows,
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
    let scale = Scale::of(&base, pressure);
    // What drives a rig without elastic force.
    let driving = base.input_gain * pressure;
    let scale = match rig {
        Rig::Integrator => Scale {
            force: driving,
            reference: driving,
            ..scale
        },
        _ => scale,
    };
    (base, supply, scale)
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
        let mut drawn = Self {
            truth: World::of(base),
            nominal,
            supply,
            instruments: Instruments::draw(random),
            drives,
            coloured: [
                scale.reference * random.random_range(COLOURED),
                random.random_range(CORRELATION),
            ],
            noise_seed: random.random(),
            coloured_misfit: 0.0,
            shows: Shows::NOTHING,
        };
        let alone = Seen::of(plan.rig, &drawn.truth, &drawn.drives, &drawn.forces());
        drawn.coloured_misfit = alone.base_misfit(&base);
        for &law in &plan.laws {
            let (typical, most) = drawn.typical(law, &scale, random);
            let wanted = wanted(plan.laws.len(), random);
            // A random force has the size that is asked for.
            let effect = if law == Law::ColouredForce {
                typical
            } else {
                sized(typical, most, wanted, drawn.floor(), |effect| {
                    let world = World {
                        base,
                        effects: vec![effect],
                    };
                    let seen = Seen::of(plan.rig, &world.resolved(), &drawn.drives, &[]);
                    seen.base_misfit(&base)
                })
            };
            drawn.truth.effects.push(effect);
        }
        drawn.truth = drawn.truth.resolved();
        drawn.measure(plan.rig);
        drawn
    }

    /// The paths of the coloured force, one for each drive, and of a random force
    /// if that is hidden.
    fn forces(&self) -> Vec<Line> {
        let [deviation, time] = match self.coloured_force() {
            Some(effect) => [effect.values[0], effect.values[1]],
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

    /// The large coloured force, if that is hidden.
    fn coloured_force(&self) -> Option<&Effect> {
        let mut effects = self.truth.effects.iter();
        effects.find(|effect| effect.law == Law::ColouredForce)
    }

    /// An effect in a size that is seen in real rigs, and the most by which it may
    /// be enlarged. What the other sets draw as well and goes with time is stretched
    /// to the length of the session.
    fn typical(&self, law: Law, scale: &Scale, random: &mut Pcg64Mcg) -> (Effect, f64) {
        let mut effect = typical(law, scale, random);
        let most = largest(&effect);
        if Law::OF_BENCHES.contains(&law) {
            return (effect, most);
        }
        let session: f64 = self.drives.iter().map(|drive| drive.line.duration()).sum();
        let stretch = session / SHORT_RUN_S;
        let longer = logarithmic(random, 1.0, 4.0);
        let values = &mut effect.values;
        match law {
            Law::StiffnessDrift | Law::SensorDrift => values[0] /= stretch,
            Law::StiffnessDriftLog | Law::SensorDriftSettling => {
                values[0] /= stretch;
                values[1] *= stretch;
            }
            Law::MaxwellOne => values[1] *= longer,
            Law::MaxwellTwo => values[3] *= longer,
            // An offset within what a calibration leaves is none.
            Law::SensorOffset => values[0] *= 5.0,
            _ => {}
        }
        (effect, most)
    }

    /// RMS of everything that is there without an effect (rad).
    fn floor(&self) -> f64 {
        self.instruments.angle_floor().hypot(self.coloured_misfit)
    }

    fn measure(&mut self, rig: Rig) {
        let base = self.truth.base;
        // With the coloured force only to see how far everything reaches.
        self.shows.reach = Seen::of(rig, &self.truth, &self.drives, &self.forces()).reach();
        if self.truth.effects.is_empty() || !self.shows.reach.is_finite() {
            return;
        }
        let forces = match self.coloured_force() {
            Some(_) => self.forces(),
            None => Vec::new(),
        };
        let seen = Seen::of(rig, &self.truth, &self.drives, &forces);
        let floor = self.floor();
        let over_noise = |misfit: f64| over_floor(misfit, floor);
        self.shows.ratio = over_noise(seen.base_misfit(&base));
        if self.truth.effects.len() < 2 {
            return;
        }
        self.shows.partner = (0..self.truth.effects.len())
            .map(|slot| {
                let mut left = self.truth.effects.clone();
                left.remove(slot);
                over_noise(seen.misfit(&base, &left))
            })
            .fold(f64::INFINITY, f64::min);
    }

    /// How far the draw is from what is asked for; zero if it is that.
    fn miss(&self, plan: &Plan) -> f64 {
        let least = match plan.rig {
            Rig::Actuator => REACH,
            _ => REACH_ELSEWHERE,
        };
        let searched = plan.laws.iter().filter(|law| **law != Law::ColouredForce);
        self.shows.miss(searched.count(), least)
    }
}

/// Draws the case with this number.
pub fn make(plan: &Plan, seed: u64, number: usize) -> Made {
    let mut random = random_for(seed, &format!("case {number}"));
    let (miss, drawn) = best_of(ATTEMPTS, || {
        let drawn = Drawn::draw(plan, &mut random);
        (drawn.miss(plan), drawn)
    });
    let mut random = random_for(seed, &format!("recording {number}"));
    let cut = plan.rig == Rig::Swing || random.random_bool(CUT);
    let files = drawn.record(plan.rig, cut, number, &mut random);
    let secret = Secret {
        case: case_name(number),
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
        rig: plan.rig,
        cut,
        supply: drawn.supply,
        instruments: drawn.instruments,
        coloured: drawn.coloured,
        coloured_misfit: drawn.coloured_misfit,
        samples: files.iter().map(|file| file.recording.time.len()).sum(),
        seconds: files
            .iter()
            .filter_map(|file| file.recording.time.last())
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
                self.truth.show(&outside, Grid::of_steps(RATE_HZ, 1))
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
        let mut recorded: Vec<Recording> = recorded.collect();
        if rig == Rig::Swing {
            return numbered("release", recorded);
        }
        // One drive for every other rig.
        let recording = recorded.remove(0);
        let marks = &self.drives[0].marks;
        if cut {
            return numbered("part", pieces(&recording, marks));
        }
        // A table of an actuator's sensor begins a little below zero.
        let least = if rig == Rig::Actuator { -30.0 } else { -180.0 };
        let range = [least, limit.map_or(180.0, f64::to_degrees)];
        let meta = metadata(&recording, marks, range, number, random);
        vec![File {
            name: "session".to_owned(),
            recording,
            meta: Some(meta),
        }]
    }
}

/// Files without metadata.
fn numbered(name: &str, list: Vec<Recording>) -> Vec<File> {
    (1..)
        .zip(list)
        .map(|(number, recording)| File {
            name: format!("{name}_{number:02}"),
            recording,
            meta: None,
        })
        .collect()
}

/// A session cut where its sections begin, each piece with its time from zero.
fn pieces(session: &Recording, marks: &[Mark]) -> Vec<Recording> {
    let at = |time: f64| session.time.partition_point(|t| *t < time);
    let mut bounds: Vec<usize> = marks.iter().map(|mark| at(mark.from)).collect();
    bounds.push(session.time.len());
    bounds
        .windows(2)
        .map(|bounds| {
            let range = bounds[0]..bounds[1];
            let begin = session.time[range.start];
            Recording {
                time: session.time[range.clone()]
                    .iter()
                    .map(|time| time - begin)
                    .collect(),
                pressure: session.pressure[range.clone()].to_vec(),
                angle: session.angle[range].to_vec(),
                ..Recording::default()
            }
        })
        .collect()
}

/// The metadata of a session, as a recorder writes it.
fn metadata(
    session: &Recording,
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
        session.time.len(),
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
    /// Writes the case into a folder.
    ///
    /// # Errors
    ///
    /// Says what cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let Secret { case, nominal, .. } = &self.answer.secret;
        // Without pressure nothing says what a pressure does.
        let free: &[&str] = match self.answer.rig {
            Rig::Swing => &["damping", "stiffness"],
            _ => &["damping", "stiffness", "input_gain"],
        };
        write(folder, case, nominal, free, &self.files)
    }
}
