//! Forces that no catalogue has: does a diagnosis say which?
//!
//! A generator draws a law, in structure and size, hides it in an actuator of `softrig example`, and the diagnosis is
//! asked. It knows nothing of the grammar that the diagnosis searches: its laws are texts, made of factors that a
//! mechanical engineer would write down, and a third of them cannot be written in that grammar. In two of five actuators
//! nothing is hidden.
//!
//! Two laws are one where their forces go together along the recorded motion ([`ALIKE`]): recordings that do not tell θ²
//! from 1 − cos θ do not need to.

use std::fs;
use std::path::Path;

use model_core::actuator::Model;
use model_core::catalogue::Effect;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::{Deserialize, Serialize};
use softrig::diagnose::evidence::alike::{ALIKE, force_correlation};
use softrig::estimate::Dataset;
use softrig::estimate::fit::Effort;
use softrig::estimate::fitter::Fitter;
use softrig::synth::example::{self, Example, make, of_actuator};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;

use super::grade::Grade;
use super::hidden::{Hidden, Secret};
use super::said::Said;
use super::verdicts::Outcome;
use super::world::{Base, World};

/// RMS noise of the angle sensor, in degrees.
const NOISE_DEG: f64 = 0.2;

/// Where a law comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// It can be written as one term of the grammar.
    Within,
    /// It cannot.
    Beyond,
    /// There is none.
    Nothing,
}

/// A law: its class, and its force (N) but for a size of one.
struct Law {
    class: Class,
    force: String,
    /// What its hidden state z follows, and how fast (s).
    memory: Option<(&'static str, f64)>,
}

/// Laws with a memory that the grammar has, and what it follows.
const REMEMBERING: [(&str, &str); 6] = [
    ("th^3 - z", "th^3"),
    ("th^2 - z", "th^2"),
    ("p - z", "p"),
    ("z*tanh(w/0.05)", "max(p, 0)"),
    ("z*w", "abs(w)"),
    ("z*th", "abs(w)"),
];
/// The same that it does not have.
const REMEMBERING_OTHERWISE: [(&str, &str); 4] = [
    ("tanh(3*th) - z", "tanh(3*th)"),
    ("z*w", "p*abs(th)"),
    ("z^2*tanh(w/0.05)", "abs(th)"),
    ("sqrt(max(p, 0)) - z", "sqrt(max(p, 0))"),
];

/// One of several.
fn any<T: Copy>(random: &mut Pcg32, of: &[T]) -> T {
    of[random.random_range(0..of.len())]
}

impl Law {
    /// As a reader sees it.
    fn shown(&self) -> String {
        let memory = self
            .memory
            .map(|(what, time_constant)| format!(", z follows {what} within {time_constant:.1} s"));
        self.force.clone() + &memory.unwrap_or_default()
    }

    /// The keys of its section.
    fn section(&self, size: f64) -> String {
        let (memory, time) = match &self.memory {
            Some((what, time_constant)) => (
                format!("memory = {{ z = {{ follows = \"{what}\", time_constant = \"tau\" }} }}\n"),
                format!(", tau = {{ value = {time_constant:.3}, min = 0.01 }}"),
            ),
            None => Default::default(),
        };
        format!(
            "\n[[effect]]\nkind = \"custom\"\nname = \"law\"\nforce = \"s*({})\"\n{memory}\
             parameters = {{ s = {size:e}{time} }}\n",
            self.force
        )
    }

    /// Draws one for an actuator of this pressure scale (kPa).
    fn draw(random: &mut Pcg32, kpa: f64) -> Self {
        let class = match random.random_range(0..5) {
            0 | 1 => Class::Nothing,
            2 => Class::Beyond,
            _ => Class::Within,
        };
        // One law in five remembers.
        let remembers = random.random_range(0..5) == 0;
        let past = match class {
            Class::Within if remembers => Some(any(random, &REMEMBERING)),
            Class::Beyond if remembers => Some(any(random, &REMEMBERING_OTHERWISE)),
            _ => None,
        };
        let force = match (class, past) {
            (_, Some((force, _))) => force.to_owned(),
            (Class::Nothing, _) => "0*th".to_owned(),
            (Class::Within, _) => Self::within(random, kpa),
            (Class::Beyond, _) => Self::beyond(random, kpa),
        };
        let time_constant = random.random_range(0.7_f64.ln()..6.0_f64.ln()).exp();
        Self {
            class,
            force,
            memory: past.map(|(_, what)| (what, time_constant)),
        }
    }

    fn curve(random: &mut Pcg32) -> String {
        let (k, from) = (random.random_range(2.0..6.0), random.random_range(0.2..0.6));
        match random.random_range(0..8) {
            7 => format!("(exp({k:.2}*th) - 1)"),
            0 => "th^5".to_owned(),
            1 => format!("sin({k:.2}*th)"),
            2 => format!("sign(th)*log(1 + {k:.2}*abs(th))"),
            3 => "sign(th)*sqrt(abs(th))".to_owned(),
            4 => format!("(1 - cos({k:.2}*th))"),
            5 => format!("max(th - {from:.2}, 0)^1.5"),
            _ => "th^2".to_owned(),
        }
    }

    fn within(random: &mut Pcg32, kpa: f64) -> String {
        let pressure = any(random, &["p", "p^2", "sqrt(max(p, 0))"]);
        let beyond = format!("max(p - {:.2}, 0)", 0.5 * kpa);
        let growths = ["abs(th)", "th^2", "max(p, 0)", "p^2", "sqrt(max(p, 0))"];
        let more = ["abs(th)*max(p, 0)", &beyond];
        let growth = any(random, &[growths.as_slice(), &more].concat());
        let width = random.random_range(0.02..0.08);
        let sign = format!("tanh(w/{width:.3})");
        let resistance = match random.random_range(0..5) {
            4 => "w^3",
            0 => "w",
            1 => "w*abs(w)",
            2 => "w/sqrt(sqrt(w^2 + 1e-4))",
            _ => &sign,
        };
        match random.random_range(0..8) {
            0 | 1 => Self::curve(random),
            2 | 3 => {
                let curve = Self::curve(random);
                format!("{curve}*{pressure}")
            }
            4 => "p^2".to_owned(),
            5 => {
                let tau = random.random_range(2.0..10.0);
                format!("exp(-t/{tau:.1})")
            }
            6 => format!("{growth}*{resistance}"),
            _ => {
                // A part that is always there, beside one that grows to about as much.
                let scale = if growth.contains('p') {
                    format!("{growth}/{:.4}", Self::at(growth, kpa))
                } else {
                    growth.to_owned()
                };
                let part = random.random_range(0.3..1.0);
                if resistance == "w" {
                    format!("{growth}*w")
                } else {
                    format!("({part:.2} + {scale})*{resistance}")
                }
            }
        }
    }

    /// A growth with the pressure at this pressure.
    fn at(growth: &str, kpa: f64) -> f64 {
        match growth {
            "p^2" => kpa * kpa,
            "sqrt(max(p, 0))" => kpa.sqrt(),
            _ => kpa,
        }
    }

    fn beyond(random: &mut Pcg32, kpa: f64) -> String {
        let k = random.random_range(2.0..5.0);
        let half = 0.5 * kpa;
        match random.random_range(0..9) {
            0 => format!("tanh({k:.2}*th)*abs(w)"),
            1 => format!("tanh((p - {half:.2})/{:.2})", 0.2 * half),
            2 => format!("exp(-abs(p)/{half:.2})*th"),
            3 => "max(w, 0)*p".to_owned(),
            4 => format!("th/(1 + ({k:.2}*w)^2)"),
            5 => "tanh((th - 0.4)/0.05)".to_owned(),
            6 => format!("sin({k:.2}*th)*exp(-t/5)"),
            7 => format!("cos({k:.2}*t)*th"),
            _ => format!("(1 + sin({:.2}*th))*tanh(w/0.05)", 2.0 * k),
        }
    }
}

/// An actuator with a law, its size such that the law is a share of the spring.
fn actuator(seed: u64) -> Result<(Law, ModelFile), InputError> {
    /// An angle (rad) and a rate (rad/s) that actuators reach.
    const ANGLE: f64 = 0.8;
    const RATE: f64 = 1.0;
    let plain = make(example::Hidden::Nothing, NOISE_DEG, seed)?;
    let base = ModelFile::parse(&plain.truth, Path::new("truth.toml"))?;
    let d = *base.model.dynamics();
    let spring = d.stiffness * ANGLE.powf(d.exponent);
    let kpa = 1e-3 * spring / d.input_gain;
    let mut random = Pcg32::seed_from_u64(seed ^ 0x006c_6177);
    let law = Law::draw(&mut random, kpa);
    let share = random.random_range(0.08_f64.ln()..0.4_f64.ln()).exp();
    let text = plain.truth.split("[fit]").next().unwrap_or_default();
    let with = |size: f64| {
        let all = format!("{text}{}", law.section(size));
        ModelFile::parse(&all, Path::new("truth.toml"))
    };
    let alone = with(1.0)?;
    let effect = alone.model.effects().last();
    let largest = effect.map_or(0.0, |effect| largest(&effect, ANGLE, RATE, kpa));
    let size = if largest > 0.0 {
        share * spring / largest
    } else {
        0.0
    };
    let file = with(size)?;
    Ok((law, file))
}

/// The largest force within the states that an actuator passes.
fn largest(effect: &Effect<f64>, angle: f64, rate: f64, kpa: f64) -> f64 {
    use model_core::effects::{Instant, Mechanism, Rest};
    let mut most = 0.0_f64;
    for share in [0.25, 0.5, 0.75, 1.0] {
        for rate in [-rate, 0.0, rate] {
            let at = Instant {
                time: 0.0,
                angle: share * angle,
                rate,
                pressure: 1e3 * share * kpa,
            };
            // With nothing to remember, and with all there is.
            let settled = effect.at_rest(&Rest {
                angle: at.angle,
                start: at.angle,
                rate,
                pressure: at.pressure,
                reading: at.angle,
            });
            // What follows the speed is nothing after a rest.
            let moved = settled.map(|past| if past == 0.0 { rate.abs() } else { past });
            for past in [[0.0; 2], moved] {
                let force: f64 = effect.force(&at, &past, &mut [0.0; 2]);
                most = most.max(force.abs());
            }
        }
    }
    most
}

/// The answer to a case: all that is needed to make it again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// What is hidden; its truth is the actuator without the law.
    pub secret: Secret,
    /// Where the law comes from.
    pub class: Class,
    /// What drew law, actuator and noise.
    pub seed: u64,
    /// Text of the actuator with its law.
    pub truth: String,
    /// RMS error (°) that a fit of the law itself leaves, from the truth.
    pub law_rmse_deg: f64,
}

/// The name of a case's folder.
pub fn name(seed: u64) -> String {
    format!("laws_{seed:03}")
}

/// Draws a case and writes it into a folder.
///
/// # Errors
///
/// If the law cannot be simulated, or the case cannot be written.
pub fn write(seed: u64, folder: &Path) -> Result<Answer, InputError> {
    let (law, truth) = actuator(seed)?;
    let example = of_actuator(&truth, NOISE_DEG, seed)?;
    // Half a case, of a draw that was interrupted.
    let _ = fs::remove_dir_all(folder);
    example.write(folder)?;
    let told = folder.join("truth.toml");
    fs::remove_file(&told).map_err(|error| InputError::from_io(&told, &error))?;
    Answer::new(seed, &law, &truth, &example)
}

impl Answer {
    fn new(seed: u64, law: &Law, truth: &ModelFile, example: &Example) -> Result<Self, InputError> {
        let file = ModelFile::parse(&example.model, Path::new("model.toml"))?;
        let data = Dataset::of(&example.as_read()?);
        let fitter = Fitter::new(&file.model, &data);
        let left = |model: &Model<f64>| fitter.fit(model, &file.free, Effort::Full).rmse();
        let law_leaves = left(&truth.model);
        let is_quiet = law.class == Class::Nothing;
        let secret = Secret {
            case: name(seed),
            hidden: if is_quiet {
                Hidden::Parameters
            } else {
                Hidden::Outside
            },
            kinds: Vec::new(),
            laws: (!is_quiet).then(|| law.shown()).into_iter().collect(),
            same_laws: false,
            truth: World::of(base(&truth.model)),
            nominal: base(&file.model),
            misfit_over_noise: left(&file.model) / law_leaves,
            partner_over_noise: None,
            visible: true,
        };
        Ok(Self {
            secret,
            class: law.class,
            seed,
            truth: example.truth.clone(),
            law_rmse_deg: law_leaves.to_degrees(),
        })
    }

    /// What a verdict is worth: exact is the law or one that pushes alike, a set is one that has such a law.
    pub fn grade(&self, outcome: &Outcome, said: &Said) -> Grade {
        let is_law = |text: &String| self.is_law(text).is_ok_and(|it| it);
        if said.names() && is_law(&outcome.repaired) {
            Grade::Exact
        } else if outcome.rivals.iter().any(is_law) {
            Grade::Set
        } else {
            Grade::of(&[], said)
        }
    }

    /// Whether a model has one effect, and that is the law or pushes alike.
    fn is_law(&self, model: &str) -> Result<bool, InputError> {
        let [truth, model] = [self.truth.as_str(), model]
            .map(|text| ModelFile::parse(text, Path::new("model.toml")));
        let (truth, model) = (truth?, model?);
        let data = Dataset::of(&of_actuator(&truth, NOISE_DEG, self.seed)?.as_read()?);
        let forces = [&model, &truth].map(|file| {
            let mut effects = file.model.effects();
            let only = effects.next().filter(|_| effects.next().is_none());
            only.map(|effect| (*file.model.dynamics(), effect))
        });
        let [Some((a, one)), Some((b, other))] = forces else {
            return Ok(false);
        };
        Ok(force_correlation((&a, &one), (&b, &other), &data) >= ALIKE)
    }
}

fn base(model: &Model<f64>) -> Base {
    let it = model.dynamics();
    Base {
        inertia: it.inertia,
        damping: it.damping,
        stiffness: it.stiffness,
        exponent: it.exponent,
        input_gain: it.input_gain,
    }
}

#[cfg(test)]
mod tests {
    use super::super::grade::Strength;
    use super::*;

    /// Every law can be read and simulated, and all classes are drawn.
    #[test]
    fn laws_are_forces_of_their_size() {
        let mut classes = Vec::new();
        for seed in 1..=40 {
            let (law, truth) = actuator(seed).unwrap();
            let d = truth.model.dynamics();
            let spring = d.stiffness * 0.8_f64.powf(d.exponent);
            let effect = truth.model.effects().last().unwrap();
            let kpa = 1e-3 * spring / d.input_gain;
            let share = largest(&effect, 0.8, 1.0, kpa) / spring;
            match law.class {
                Class::Nothing => assert!(share.abs() < 1e-12),
                _ => assert!((0.079..0.401).contains(&share), "{}: {share}", law.force),
            }
            if !classes.contains(&law.class) {
                classes.push(law.class);
            }
        }
        assert_eq!(classes.len(), 3);
    }
    /// Whoever gets a case does not get what it hides, and the answer knows its law by any name.
    #[test]
    fn a_law_is_known_by_what_it_does() {
        let folder = tempfile::tempdir().unwrap();
        let answer = write(8, folder.path()).unwrap();
        assert_eq!(answer.secret.laws, ["p^2"]);
        let written = fs::read_to_string(folder.path().join("model.toml")).unwrap();
        assert!(!written.contains("p^2") && !folder.path().join("truth.toml").exists());
        assert!(answer.law_rmse_deg < 1.2 * NOISE_DEG && answer.secret.misfit_over_noise > 5.0);

        let grade = |verdict: &str, law: &str, rivals: &[&str]| {
            let model = |law: &str| answer.truth.replace("p^2", law);
            let outcome = Outcome {
                verdict: Some(serde_json::json!({
                    "verdict": verdict, "effects": [{ "kind": "term", "formula": law }],
                })),
                repaired: model(law),
                rivals: rivals.iter().map(|law| model(law)).collect(),
                ..Outcome::default()
            };
            answer.grade(&outcome, &Said::of(&outcome))
        };
        let another = Grade::Wrong(Strength::Full);
        assert_eq!(grade("effect_found", "abs(p)^2.02", &[]), Grade::Exact);
        assert_eq!(grade("effect_found", "th^2*w", &[]), another);
        assert_eq!(grade("cannot_tell", "th", &["th^2*w", "p^2"]), Grade::Set);
        assert_eq!(grade("cannot_tell", "th", &["th^2*w"]), Grade::Open);
        assert_eq!(grade("unexplained", "p^2", &[]), Grade::Silent);
    }
}
