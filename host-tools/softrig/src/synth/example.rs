//! Simulated recordings with an effect hidden in them.
//!
//! A user without a rig needs something to diagnose, and the demo needs data with a known
//! answer. An example is a nominal model, with parameter errors as large as those of data
//! sheets, and recordings of a "truth" with one further effect, through noisy sensors and a
//! ten-bit converter. Every file says that it is simulated; the answer is in `truth.toml`.

use std::path::Path;

use model_core::actuator::{InvalidModel, Model, State};
use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use model_core::input::Held;
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

use crate::sim::protocol::Protocol;
use crate::sim::simulate::{InitialState, Signal, run, substeps};
use softrig_formats::error::{InputError, write_atomically, write_with_meta};
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::tidy;
use softrig_formats::recording::{Meta, PASCAL_PER_KPA, Recording, to_csv};

/// White noise of the angle in examples where nothing else is said (° RMS).
pub const NOISE_DEG: f64 = 0.4;
/// Angle of one count of a ten-bit converter behind a flex sensor (°).
const ANGLE_COUNT_DEG: f64 = 90.0 / 341.0;
/// Pressure of one count behind a 0–80 psi sensor, averaged four times (kPa).
const PRESSURE_COUNT_KPA: f64 = 0.674 / 4.0;
/// White noise of the pressure (kPa).
const PRESSURE_NOISE_KPA: f64 = 0.25;
/// Repeats of each step.
const REPEATS: u32 = 3;
/// Time (s) over which a slow effect of a virtual rig's actuator does what was
/// drawn for it: the protocol `steps` of the board lasts 85 s, and a rig stands
/// idle and homes before it.
const RIG_SESSION_S: f64 = 100.0;

/// The hidden effect of an example.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hidden {
    /// One effect, drawn from the seed.
    Drawn,
    /// This effect.
    Effect(Kind),
    /// No hidden effect, only wrong parameters.
    Nothing,
}

impl Hidden {
    /// Reads a name: an effect, `none`, or one drawn if there is no name.
    ///
    /// # Errors
    ///
    /// Lists the effects that there are.
    pub fn named(name: Option<&str>) -> Result<Self, InputError> {
        match name {
            None => Ok(Self::Drawn),
            Some("none") => Ok(Self::Nothing),
            Some(name) => Kind::from_name(name)
                .filter(|kind| kind.is_name())
                .map(Self::Effect)
                .ok_or_else(|| {
                    let known: Vec<&str> = Kind::NAMES.iter().map(|kind| kind.name()).collect();
                    InputError::new(
                        format!("{name} is not a known kind of effect"),
                        format!("use \"none\" or one of: {}", known.join(", ")),
                    )
                }),
        }
    }
}

/// An example in memory.
#[derive(Clone, Debug)]
pub struct Example {
    /// Text of the nominal model file.
    pub model: String,
    /// Text of the answer.
    pub truth: String,
    /// Recordings with the name of their file and their metadata.
    pub recordings: Vec<(String, Recording, String)>,
}

/// Makes an example. The same seed gives the same bytes.
///
/// `noise_deg` is the RMS noise of the angle (°).
///
/// # Errors
///
/// Refuses noise that is negative or not a number, and a seed of whose actuator no draw of the effect
/// leaves one.
pub fn make(hidden: Hidden, noise_deg: f64, seed: u64) -> Result<Example, InputError> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let dynamics = Dynamics {
        inertia: random.random_range(0.15..0.4),
        damping: random.random_range(0.8..3.0),
        stiffness: random.random_range(3.0..9.0),
        exponent: [1.5, 1.727, 2.0, 2.365][random.random_range(0..4)],
        input_gain: random.random_range(0.08..0.2) / PASCAL_PER_KPA,
    };
    let kind = match hidden {
        Hidden::Drawn => Some(Kind::NAMES[random.random_range(0..Kind::NAMES.len())]),
        Hidden::Effect(kind) => Some(kind),
        Hidden::Nothing => None,
    };
    // A slow effect does what was drawn for it within the longest of the runs.
    let session_s = protocols()
        .iter()
        .map(|(.., protocol)| protocol.duration())
        .fold(0.0, f64::max);
    for _ in 0..MOST_DRAWS {
        let effect = kind.map(|kind| draw_effect(kind, &dynamics, session_s, &mut random));
        let effects: Vec<_> = effect.into_iter().collect();
        let truth: Model<f64> = Model::new(dynamics, &effects).map_err(invalid)?;
        if rests(&truth) {
            let text = model_text(&dynamics, &effects, "simulated example, as it is");
            return of_truth(&truth, text, noise_deg, &mut random);
        }
    }
    Err(InputError::new(
        "no actuator of this seed comes to rest with such an effect",
        "choose another seed",
    ))
}

/// Draws of an effect until it leaves an actuator; hardly any takes more than a few.
const MOST_DRAWS: usize = 100;

/// Whether an actuator comes to rest under the pressure that bends it by 90° without its effects: a
/// spring that gives way with the cube of the angle may tip over.
fn rests(truth: &Model<f64>) -> bool {
    let Ok(plain) = Model::<f64>::new(*truth.dynamics(), &[]) else {
        return false;
    };
    let pressure = plain.holding_pressure(RIGHT_ANGLE);
    let holds = |angle: f64| {
        let at_rest = truth.at_rest(angle, pressure);
        truth
            .derivative(&at_rest, &Held(pressure), 0.0)
            .acceleration
            < 0.0
    };
    (10..=17).any(|tenths| holds(RIGHT_ANGLE * f64::from(tenths) / 10.0 + 1e-3))
}

/// Makes an example of an actuator that a model file describes, with effects of any kind.
/// The same seed gives the same bytes.
///
/// # Errors
///
/// Like [`make`].
pub fn of_actuator(truth: &ModelFile, noise_deg: f64, seed: u64) -> Result<Example, InputError> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let text = truth.text_with(&truth.model, "");
    of_truth(&truth.model, text, noise_deg, &mut random)
}

fn invalid(error: InvalidModel) -> InputError {
    InputError::new(format!("the drawn model {error}"), "choose another seed")
}

/// Recordings of an actuator, and its nominal model.
fn of_truth(
    truth: &Model<f64>,
    text: String,
    noise_deg: f64,
    random: &mut Pcg64Mcg,
) -> Result<Example, InputError> {
    if !(0.0..=20.0).contains(&noise_deg) {
        return Err(InputError::new(
            format!("the noise is {noise_deg}°"),
            "give an RMS between 0 and 20 degrees",
        ));
    }
    let dynamics = *truth.dynamics();
    let off = |value: f64, random: &mut Pcg64Mcg| value * random.random_range(0.85..1.15);
    let nominal = Dynamics {
        damping: off(dynamics.damping, random),
        stiffness: off(dynamics.stiffness, random),
        input_gain: off(dynamics.input_gain, random),
        ..dynamics
    };
    // The rig is driven as its owner would: by the plain model's inverse.
    let inverse: Model<f64> = Model::new(dynamics, &[]).map_err(invalid)?;
    let recordings = protocols()
        .into_iter()
        .map(|(name, setpoint_deg, repeat, protocol)| {
            let recording = record(truth, &inverse, &protocol, noise_deg, random);
            let file = match repeat {
                Some(repeat) => format!("{name}_{repeat}.csv"),
                None => format!("{name}.csv"),
            };
            (file, recording, meta_text(name, setpoint_deg, repeat))
        })
        .collect();
    Ok(Example {
        model: model_text(&nominal, &[], "simulated example"),
        truth: text,
        recordings,
    })
}

/// The models of an actuator for the virtual rig.
#[derive(Clone, Debug, PartialEq)]
pub struct RigModels {
    /// Text of the nominal model file.
    pub model: String,
    /// Text of the answer: the actuator with its hidden effect.
    pub truth: String,
}

/// Pressures (Pa) that hold the drawn actuator of a virtual rig at 90°: what a
/// syringe pump reaches quickly and its pressure sensor resolves well.
const RIG_PRESSURE_PA: std::ops::RangeInclusive<f64> = 60e3..=150e3;

/// Draws an actuator for the virtual rig: a nominal model whose parameters are
/// off by as much as data sheets are, and the truth with one effect more. The
/// same seed gives the same bytes.
///
/// Unlike the recordings of [`make`], which may be of any actuator, this one
/// must do as it is told: 90° is held at 60 to 150 kPa, and after five seconds
/// at that pressure it moves by less than 2° a second. What drifts stays in
/// reach of the rig for a session of 100 s.
///
/// With a `kind`, that effect is hidden instead of one drawn from the seed.
///
/// # Errors
///
/// Asks for another seed if none of many draws is such an actuator.
pub fn rig_models(seed: u64, kind: Option<Kind>) -> Result<RigModels, InputError> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    for _ in 0..1000 {
        let exponent = [1.5, 1.727, 2.0, 2.365][random.random_range(0..4)];
        let stiffness = random.random_range(3.0..9.0);
        let pressure: f64 = random.random_range(70e3..120e3);
        let dynamics = Dynamics {
            inertia: random.random_range(0.15..0.4),
            damping: random.random_range(0.8..3.0),
            stiffness,
            exponent,
            input_gain: stiffness * libm::pow(RIGHT_ANGLE, exponent) / pressure,
        };
        // Drawn also when it is given: the actuator around it is the same then.
        let drawn = Kind::NAMES[random.random_range(0..Kind::NAMES.len())];
        let kind = kind.unwrap_or(drawn);
        let effect = draw_effect(kind, &dynamics, RIG_SESSION_S, &mut random);
        let mut off = |value: f64| value * random.random_range(0.85..1.15);
        let nominal = Dynamics {
            damping: off(dynamics.damping),
            stiffness: off(dynamics.stiffness),
            input_gain: off(dynamics.input_gain),
            ..dynamics
        };
        if Model::new(dynamics, &[effect]).is_ok_and(|truth| obeys(&truth)) {
            return Ok(RigModels {
                model: model_text(&nominal, &[], "virtual rig"),
                truth: model_text(&dynamics, &[effect], "virtual rig, as it is"),
            });
        }
    }
    Err(InputError::new(
        "no actuator of this seed bends by 90° at 60 to 150 kPa",
        "choose another seed",
    ))
}

const RIGHT_ANGLE: f64 = std::f64::consts::FRAC_PI_2;

/// Whether an actuator reaches 90° at a reachable pressure and comes to rest, and
/// still reaches it at the end of a session if its stiffness drifts.
fn obeys(truth: &Model<f64>) -> bool {
    let pressure = truth.holding_pressure(RIGHT_ANGLE);
    if !RIG_PRESSURE_PA.contains(&pressure) {
        return false;
    }
    let drifts = truth
        .effects()
        .any(|effect| effect.kind() == Kind::StiffnessDrift);
    if drifts && !is_held_late(truth) {
        return false;
    }
    let time: Vec<f64> = (0..=600).map(|k| f64::from(k) * 0.01).collect();
    // From rest without pressure, up within a second.
    let ramp = time.iter().map(|t| pressure * t.min(1.0)).collect();
    let start = InitialState {
        angle: truth.reading(&truth.at_rest(0.0, 0.0)),
        rate: 0.0,
    };
    let end = run(
        truth,
        &Signal::new(time, ramp),
        start,
        substeps(truth, 0.01, 2.0),
    );
    let (then, now) = (end.reading[500], end.reading[600]);
    !end.diverged && now > 0.8 && now < 2.4 && (now - then).abs() < 2f64.to_radians()
}

/// Whether the largest of the rig's pressures still bends the actuator beyond
/// 90° at the end of a session. One that has become softer needs less, which is
/// always there.
fn is_held_late(truth: &Model<f64>) -> bool {
    let pressure = *RIG_PRESSURE_PA.end();
    let late = State {
        time: RIG_SESSION_S,
        ..truth.at_rest(RIGHT_ANGLE, pressure)
    };
    truth.derivative(&late, &Held(pressure), 0.0).acceleration > 0.0
}

impl Example {
    /// The recordings as they are read from the files that [`Example::write`] writes.
    ///
    /// # Errors
    ///
    /// No example is known to cause one.
    pub fn as_read(&self) -> Result<Vec<Recording>, InputError> {
        let read = |(file, recording, meta): &(String, Recording, String)| {
            let path = Path::new(file);
            let (mut recording, _) = Recording::parse(&to_csv(recording, &[]), path)?;
            recording.meta = Meta::parse(meta, &path.with_extension("meta.toml"))?;
            Ok(recording)
        };
        self.recordings.iter().map(read).collect()
    }

    /// Writes `model.toml`, `truth.toml` and the recordings into a folder.
    ///
    /// # Errors
    ///
    /// Says what cannot be written. A folder with a model and no hidden truth is somebody's
    /// work, and left alone.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let recordings = folder.join("recordings");
        let truth = folder.join("truth.toml");
        let model = folder.join("model.toml");
        if let Some(found) = [&model, &recordings].into_iter().find(|path| path.exists())
            && !truth.exists()
        {
            return Err(InputError::new(
                "is there, and is no earlier example: there is no truth.toml beside it",
                "give -o a folder of its own, such as -o demo",
            )
            .in_file(found));
        }
        std::fs::create_dir_all(&recordings).map_err(|error| {
            InputError::new(
                format!("cannot be created: {error}"),
                "choose a folder that can be written",
            )
            .in_file(&recordings)
        })?;
        write_atomically(&model, self.model.as_bytes())?;
        write_atomically(&truth, self.truth.as_bytes())?;
        for (file, recording, meta) in &self.recordings {
            let path = recordings.join(file);
            write_with_meta(
                (&path, to_csv(recording, &[]).as_bytes()),
                (&path.with_extension("meta.toml"), meta.as_bytes()),
            )?;
        }
        Ok(())
    }
}

/// Name, set-point (°), repeat and protocol of each run: the paper's steps, a
/// small one that separates static rivals, a staircase and a triangle.
fn protocols() -> Vec<(&'static str, Option<f64>, Option<u32>, Protocol)> {
    let mut list = Vec::new();
    for (name, angle_deg) in [("step30", 30.0), ("step60", 60.0), ("step90", 90.0)] {
        for repeat in 1..=REPEATS {
            let step = Protocol::Step {
                angle: f64::to_radians(angle_deg),
                hold: 5.0,
                release: 3.0,
            };
            list.push((name, Some(angle_deg), Some(repeat), step));
        }
    }
    let angle = 90f64.to_radians();
    list.push((
        "staircase",
        None,
        None,
        Protocol::Staircase {
            angle,
            steps: 4,
            hold: 2.5,
        },
    ));
    list.push((
        "triangle",
        None,
        None,
        Protocol::Triangle {
            angle,
            ramp: 3.0,
            cycles: 2,
        },
    ));
    list
}

/// An effect of a size that matters but does not dominate.
///
/// A drift goes on for as long as a session lasts, so what is drawn is how far
/// it has come after `session_s` seconds: 15 to 45 % of the stiffness, 2 to 6° of
/// the sensor's zero. At a rate that is drawn for itself, a long session would
/// end without any stiffness, and in a short one nothing would be seen.
fn draw_effect(
    kind: Kind,
    dynamics: &Dynamics<f64>,
    session_s: f64,
    random: &mut Pcg64Mcg,
) -> model_core::catalogue::Effect<f64> {
    use model_core::effects::Unit;
    let values: Vec<f64> = kind
        .parameters()
        .iter()
        .map(|row| {
            if let Some(value) = row.left_out() {
                return f64::from(value);
            }
            let share: f64 = random.random_range(0.1..0.3);
            let sign = if row.lower < 0.0 && random.random_bool(0.5) {
                -1.0
            } else {
                1.0
            };
            // Somewhere between two values.
            let between = |low: f64, high: f64| low + (high - low) * (share - 0.1) / 0.2;
            let pressure = dynamics.stiffness / dynamics.input_gain;
            match (kind, row.unit) {
                (Kind::MaxwellBranch, Unit::Second) => random.random_range(2.0..8.0),
                (Kind::Leak, Unit::Second) => between(10.0, 40.0),
                (Kind::VentAsymmetry, Unit::Second) if row.key == "fill_s" => between(0.05, 0.15),
                (Kind::VentAsymmetry, Unit::Second) => between(0.3, 0.6),
                (_, Unit::Second) => random.random_range(0.1..0.3),
                (Kind::AngleDependentDamping | Kind::AsymmetricDamping, _) if sign > 0.0 => {
                    5.0 * share
                }
                (Kind::EndStop, Unit::NewtonPerRad) => 10.0 * share * dynamics.stiffness,
                (Kind::EndStop, Unit::Radian) => between(0.8, 1.2),
                (Kind::MullinsSoftening, Unit::Radian) => between(0.4, 1.0),
                (Kind::SecondMode, Unit::Hertz) => between(2.0, 5.0),
                (Kind::SecondMode, _) if row.key == "coupling" => 2.0 * sign * share,
                (Kind::SecondMode, _) => between(0.03, 0.1),
                (Kind::PeriodicDisturbance, Unit::Hertz) => between(0.5, 3.0),
                (Kind::PeriodicDisturbance, Unit::Radian) => between(-3.0, 3.0),
                (Kind::PeriodicDisturbance | Kind::StribeckFriction, Unit::Newton) => {
                    0.5 * share * dynamics.stiffness
                }
                (Kind::SensorDrift, _) => sign * between(2.0, 6.0).to_radians() / session_s,
                (Kind::SensorNonlinearity, _) => 0.5 * sign * share,
                (_, Unit::NewtonSecond2PerRad2) => share * 3.0 * dynamics.damping,
                (_, Unit::Newton | Unit::NewtonPerRad | Unit::NewtonPerRad3) => {
                    sign * share * dynamics.stiffness
                }
                (_, Unit::Radian) => sign * 0.4 * share,
                (Kind::StiffnessDrift, _) => sign * between(0.15, 0.45) / session_s,
                (_, Unit::KiloPascal) => 0.5 * share * pressure,
                (_, Unit::PerKiloPascal) => sign * share / pressure,
                _ => sign * share,
            }
        })
        .collect();
    kind.build(&values)
        .expect("one value was drawn for each row of the table")
}

/// Simulates a run and its sensors.
fn record(
    truth: &Model<f64>,
    inverse: &Model<f64>,
    protocol: &Protocol,
    noise_deg: f64,
    random: &mut Pcg64Mcg,
) -> Recording {
    let (time, _, pressure) = protocol.pressure(inverse);
    let signal = Signal::new(time.clone(), pressure.clone());
    let start = InitialState {
        angle: truth.reading(&truth.at_rest(0.0, 0.0)),
        rate: 0.0,
    };
    let steps = 2 * substeps(truth, 0.01, 2.0);
    let reading = run(truth, &signal, start, steps).reading;
    let angle = reading
        .iter()
        .map(|angle| {
            let noisy = angle.to_degrees() + noise_deg * normal(random);
            quantised(noisy, ANGLE_COUNT_DEG).to_radians()
        })
        .collect();
    let pressure = pressure
        .iter()
        .map(|pressure| {
            let noisy = pressure / PASCAL_PER_KPA + PRESSURE_NOISE_KPA * normal(random);
            quantised(noisy, PRESSURE_COUNT_KPA) * PASCAL_PER_KPA
        })
        .collect();
    Recording {
        time,
        pressure,
        angle,
        ..Recording::default()
    }
}

fn normal(random: &mut impl Rng) -> f64 {
    StandardNormal.sample(random)
}

fn quantised(value: f64, count: f64) -> f64 {
    (value / count).round() * count
}

fn meta_text(protocol: &str, setpoint_deg: Option<f64>, repeat: Option<u32>) -> String {
    let mut text = format!("simulated = true\nprotocol = \"{protocol}\"\n");
    if let Some(setpoint) = setpoint_deg {
        text += &format!("setpoint_deg = {setpoint:.1}\n");
    }
    if let Some(repeat) = repeat {
        text += &format!("repeat = {repeat}\n");
    }
    text
}

fn model_text(
    dynamics: &Dynamics<f64>,
    effects: &[model_core::catalogue::Effect<f64>],
    name: &str,
) -> String {
    let mut text = format!(
        "schema = 1\nname = \"{name}\"\n\n[dynamics]\ninertia_kg_m = {}\ndamping_n_s_per_rad = {}\nstiffness_n_per_rad_n = {}\nexponent = {}\ninput_gain_n_per_kpa = {}\n\n[fit]\nfree = [\"damping\", \"stiffness\", \"input_gain\"]\n",
        tidy(dynamics.inertia),
        tidy(dynamics.damping),
        tidy(dynamics.stiffness),
        tidy(dynamics.exponent),
        tidy(dynamics.input_gain * PASCAL_PER_KPA)
    );
    for effect in effects {
        text += &format!("\n[[effect]]\nkind = \"{}\"\n", effect.kind().name());
        for (row, value) in effect.parameters().iter().zip(effect.values()) {
            text += &format!("{} = {}\n", row.key, tidy(row.unit.from_si(value)));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::model_file::ModelFile;

    #[test]
    fn same_seed_same_bytes_and_other_seeds_differ() {
        let bytes = |seed| {
            let example = make(Hidden::Drawn, 0.4, seed).unwrap();
            example.truth.clone() + &to_csv(&example.recordings[0].1, &[])
        };
        assert_eq!(bytes(7), bytes(7));
        assert_ne!(bytes(7), bytes(8));
    }

    #[test]
    fn recordings_in_memory_are_those_of_the_files() {
        let example = make(Hidden::Drawn, 0.4, 7).unwrap();
        let folder = tempfile::tempdir().unwrap();
        example.write(folder.path()).unwrap();
        for recording in example.as_read().unwrap() {
            let path = folder.path().join("recordings").join(&recording.path);
            let (read, warnings) = Recording::read(&path).unwrap();
            assert_eq!(warnings, [""; 0]);
            assert_eq!(
                (read.time, read.pressure, read.angle, read.meta, read.name),
                (
                    recording.time,
                    recording.pressure,
                    recording.angle,
                    recording.meta,
                    recording.name
                )
            );
        }
    }

    #[test]
    fn every_effect_can_be_hidden_and_read_back() {
        for &kind in Kind::NAMES {
            let example = make(Hidden::Effect(kind), 0.0, 3).unwrap();
            let truth = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
            assert_eq!(truth.model.effects().next().unwrap().kind(), kind);
            ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
            let (_, last, _) = example.recordings.last().unwrap();
            let reach = last.angle.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            assert!(reach > 0.3 && reach < 3.0, "{kind:?} reaches {reach} rad");
        }
    }

    #[test]
    fn actuators_for_the_rig_are_reachable_and_hide_one_effect() {
        let mut kinds = std::collections::HashSet::new();
        for seed in 0..300 {
            let models = rig_models(seed, None).unwrap();
            assert_eq!(models, rig_models(seed, None).unwrap());
            let truth = ModelFile::parse(&models.truth, Path::new("truth.toml")).unwrap();
            let pressure = truth.model.holding_pressure(RIGHT_ANGLE);
            assert!(RIG_PRESSURE_PA.contains(&pressure), "{seed}: {pressure} Pa");
            let nominal = ModelFile::parse(&models.model, Path::new("model.toml")).unwrap();
            assert_eq!(nominal.model.effects().count(), 0);
            assert_ne!(nominal.model.dynamics(), truth.model.dynamics());
            let mut effects = truth.model.effects();
            kinds.insert(effects.next().unwrap().kind().name());
            assert!(effects.next().is_none());
        }
        // Drawing again must not sort out any kind of effect.
        assert_eq!(kinds.len(), Kind::NAMES.len(), "{kinds:?}");
    }

    /// The model and hidden effect of a seed, for a kind.
    fn hidden(seed: u64, kind: Kind) -> (Model<f64>, model_core::catalogue::Effect<f64>) {
        let models = rig_models(seed, Some(kind)).unwrap();
        let truth = ModelFile::parse(&models.truth, Path::new("truth.toml")).unwrap();
        let effect = truth.model.effects().next().unwrap();
        (truth.model, effect)
    }

    #[test]
    fn no_example_bends_further_than_an_actuator_can() {
        for kind in [Kind::CubicStiffness, Kind::ExponentShift, Kind::Gravity] {
            for seed in 0..12 {
                let example = make(Hidden::Effect(kind), 0.0, seed).unwrap();
                let all = example.recordings.iter().flat_map(|(_, it, _)| &it.angle);
                let farthest = all.fold(0.0, |most: f64, angle| most.max(angle.abs()));
                assert!(farthest < 4.0, "{kind:?} {seed}: {farthest} rad");
            }
        }
    }

    #[test]
    fn an_effect_that_is_asked_for_is_hidden_in_the_seeds_actuator() {
        for seed in 0..5 {
            for &kind in Kind::NAMES {
                assert_eq!(hidden(seed, kind).1.kind(), kind);
            }
        }
        // What is drawn is what is drawn when it is asked for, unless an
        // actuator before it was sorted out.
        let same = (0..20)
            .filter(|&seed| {
                let drawn = rig_models(seed, None).unwrap();
                let truth = ModelFile::parse(&drawn.truth, Path::new("truth.toml")).unwrap();
                let kind = truth.model.effects().next().unwrap().kind();
                rig_models(seed, Some(kind)).unwrap() == drawn
            })
            .count();
        assert!(same > 10, "{same} of 20");
    }

    /// The change by a drift in its session is noticeable and
    /// leaves an actuator: seed 201 once lost all of its stiffness half-way.
    #[test]
    fn drifts_come_as_far_as_stated_and_stay_in_reach() {
        for seed in 190..230 {
            let (model, drift) = hidden(seed, Kind::StiffnessDrift);
            let share = (drift.value(0).unwrap() * RIG_SESSION_S).abs();
            assert!((0.149..0.451).contains(&share), "{seed}: {share}");
            assert!(is_held_late(&model), "{seed}: out of reach");
            let (_, drift) = hidden(seed, Kind::SensorDrift);
            let degrees = (drift.value(0).unwrap() * RIG_SESSION_S).to_degrees().abs();
            assert!((1.99..6.01).contains(&degrees), "{seed}: {degrees} degrees");
        }
        for (kind, low, high) in [
            (Kind::StiffnessDrift, 0.149, 0.451),
            (
                Kind::SensorDrift,
                1.99f64.to_radians(),
                6.01f64.to_radians(),
            ),
        ] {
            let example = make(Hidden::Effect(kind), 0.0, 5).unwrap();
            let truth = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
            let rate = truth.model.effects().next().unwrap().value(0).unwrap();
            let longest = example
                .recordings
                .iter()
                .map(|(_, recording, _)| recording.time.last().unwrap() - recording.time[0])
                .fold(0.0, f64::max);
            let total = (rate * longest).abs();
            assert!((low..high).contains(&total), "{kind:?}: {total}");
        }
    }

    #[test]
    fn impossible_noise_is_refused() {
        assert!(make(Hidden::Nothing, f64::NAN, 1).is_err());
        assert!(make(Hidden::Nothing, -1.0, 1).is_err());
    }
}
