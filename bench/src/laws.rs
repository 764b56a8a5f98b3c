//! Forces that no catalogue has: does a diagnosis say which?
//!
//! A generator draws a law, in structure and size, hides it in an actuator, and asks. It knows nothing of the grammar that
//! the diagnosis searches: its laws are texts, made of factors that a mechanical engineer would write down, and a third
//! of them cannot be written in that grammar. In two of five actuators nothing is hidden.
//!
//! Two laws are one where their forces go together along the recorded motion ([`ALIKE`]): recordings that do not tell θ²
//! from 1 − cos θ do not need to.

use std::path::Path;

use clap::Args;
use model_core::actuator::Model;
use model_core::catalogue::Effect;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg32;
use serde::Serialize;
use serde_json::{Value, json};
use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::decide::verdict::Strength;
use softrig::diagnose::evidence::alike::{ALIKE, force_correlation};
use softrig::diagnose::score::grammar::is_term;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::estimate::fit::Effort;
use softrig::estimate::fitter::Fitter;
use softrig::statistics::median;
use softrig::synth::example::{Hidden, make, of_actuator};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

use crate::blind::counts::Rate;
use crate::processor::{Of, seconds};
use crate::rig_loop::bench::Seeds;

/// A law is found as it is if the model leaves at most this multiple of what the law itself leaves.
const AS_GOOD: f64 = 1.2;

/// Does a diagnosis say which force no catalogue has?
///
/// For each seed a law is drawn and hidden in an actuator, and its recordings are diagnosed.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench laws --seeds 1..150 --docs
  cargo xtask bench laws --seeds 7 --noise-deg 0.5")]
pub struct Options {
    /// Seeds: a range with both ends, 1..4, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse, default_value = "1..150")]
    seeds: Seeds,
    /// RMS noise of the angle sensor, in degrees
    #[arg(long, default_value_t = 0.2)]
    noise_deg: f64,
}

/// Where a law comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Class {
    /// It can be written as one term of the grammar.
    Within,
    /// It cannot.
    Beyond,
    /// There is none.
    Nothing,
}

impl Class {
    const ALL: [Self; 3] = [Self::Within, Self::Beyond, Self::Nothing];

    const fn title(self) -> &'static str {
        match self {
            Self::Within => "laws that the grammar has",
            Self::Beyond => "laws that it does not have",
            Self::Nothing => "nothing hidden",
        }
    }
}

/// A law: its class, and its force (N) but for a size of one.
struct Law {
    class: Class,
    force: String,
    memory: Option<Memory>,
}

/// A hidden state z of a law.
struct Memory {
    /// What it follows.
    follows: &'static str,
    /// How fast (s).
    time_constant: f64,
}

impl Law {
    /// As a reader sees it.
    fn shown(&self) -> String {
        match &self.memory {
            Some(memory) => format!(
                "{}, z follows {} within {:.1} s",
                self.force, memory.follows, memory.time_constant
            ),
            None => self.force.clone(),
        }
    }

    /// The keys of its section.
    fn section(&self, size: f64) -> String {
        let (memory, time) = match &self.memory {
            Some(it) => (
                format!(
                    "memory = {{ z = {{ follows = \"{}\", time_constant = \"tau\" }} }}\n",
                    it.follows
                ),
                format!(", tau = {{ value = {:.3}, min = 0.01 }}", it.time_constant),
            ),
            None => Default::default(),
        };
        format!(
            "\n[[effect]]\nkind = \"custom\"\nname = \"law\"\nforce = \"s*({})\"\n{memory}\
             parameters = {{ s = {size:e}{time} }}\n",
            self.force
        )
    }
}

/// One of several.
fn any<'a, R: Rng>(random: &mut R, of: &[&'a str]) -> &'a str {
    of[random.random_range(0..of.len())]
}

impl Law {
    /// Draws one for an actuator of this pressure scale (kPa).
    fn draw(random: &mut Pcg32, kpa: f64) -> Self {
        let class = match random.random_range(0..5) {
            0 | 1 => Class::Nothing,
            2 => Class::Beyond,
            _ => Class::Within,
        };
        // One law in five remembers.
        let remembers = random.random_range(0..5) == 0;
        let (force, follows) = match class {
            Class::Nothing => ("0*th".to_owned(), None),
            Class::Within if remembers => Self::remembering(random),
            Class::Within => (Self::within(random, kpa), None),
            Class::Beyond if remembers => Self::remembering_otherwise(random),
            Class::Beyond => (Self::beyond(random, kpa), None),
        };
        let time_constant = random.random_range(0.7_f64.ln()..6.0_f64.ln()).exp();
        let memory = follows.map(|follows| Memory {
            follows,
            time_constant,
        });
        Self {
            class,
            force,
            memory,
        }
    }

    fn remembering(random: &mut Pcg32) -> (String, Option<&'static str>) {
        let (force, follows) = match random.random_range(0..6) {
            0 => ("th^3 - z", "th^3"),
            1 => ("th^2 - z", "th^2"),
            2 => ("p - z", "p"),
            3 => ("z*tanh(w/0.05)", "max(p, 0)"),
            4 => ("z*w", "abs(w)"),
            _ => ("z*th", "abs(w)"),
        };
        (force.to_owned(), Some(follows))
    }

    fn remembering_otherwise(random: &mut Pcg32) -> (String, Option<&'static str>) {
        let (force, follows) = match random.random_range(0..4) {
            0 => ("tanh(3*th) - z", "tanh(3*th)"),
            1 => ("z*w", "p*abs(th)"),
            2 => ("z^2*tanh(w/0.05)", "abs(th)"),
            _ => ("sqrt(max(p, 0)) - z", "sqrt(max(p, 0))"),
        };
        (force.to_owned(), Some(follows))
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

/// What a diagnosis said of a law.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Said {
    /// It, or one that pushes alike.
    Law,
    /// A set that has it.
    InSet,
    /// Another formula, by name and at full strength.
    OtherFormula,
    /// An effect of the catalogue, by name and at full strength.
    OtherEffect,
    /// A name for a part, a set without it, or that it is none of the known.
    Open,
    /// That nothing is missing.
    Nothing,
}

/// A case.
#[derive(Clone, Debug, Serialize)]
struct Asked {
    seed: u64,
    class: Class,
    law: String,
    said: Said,
    /// The answer, as the verdict has it.
    answer: String,
    refit_rmse_deg: f64,
    repaired_rmse_deg: f64,
    /// What a fit of the law itself leaves, from the truth.
    law_rmse_deg: f64,
    cpu_seconds: Option<f64>,
}

impl Options {
    /// Asks for every seed.
    ///
    /// # Errors
    ///
    /// If a law cannot be simulated.
    pub fn measure(&self, _folder: &Path) -> Result<Value, String> {
        let mut cases = Vec::new();
        for &seed in &self.seeds.each {
            let case =
                Asked::of(seed, self.noise_deg).map_err(|error| format!("seed {seed}: {error}"))?;
            eprintln!("{}", json!(case));
            cases.push(case);
        }
        let mut figures = figures(&cases);
        figures["command"] = format!(
            "cargo xtask bench laws --seeds {} --noise-deg {}",
            self.seeds.asked, self.noise_deg
        )
        .into();
        Ok(figures)
    }
}

/// An actuator with a law, its size such that the law is a share of the spring.
fn actuator(seed: u64, noise_deg: f64) -> Result<(Law, ModelFile), InputError> {
    /// An angle (rad) and a rate (rad/s) that actuators reach.
    const ANGLE: f64 = 0.8;
    const RATE: f64 = 1.0;
    let plain = make(Hidden::Nothing, noise_deg, seed)?;
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

impl Asked {
    fn of(seed: u64, noise_deg: f64) -> Result<Self, InputError> {
        let (law, truth) = actuator(seed, noise_deg)?;
        let example = of_actuator(&truth, noise_deg, seed)?;
        let file = ModelFile::parse(&example.model, Path::new("model.toml"))?;
        let recordings: Vec<Recording> = example.recordings.into_iter().map(|it| it.1).collect();
        let request = Request::of(&file, &recordings);
        let before = seconds(Of::Itself);
        let diagnosis = diagnose(&request, &Job::default())?;
        let spent = seconds(Of::Itself).zip(before);
        let verdict = diagnosis.verdict(&request, 0.0);
        let names: Vec<&str> = verdict.effects.iter().map(|it| it.kind.as_str()).collect();
        let answer = serde_json::to_value(verdict.verdict).unwrap_or_default();
        Ok(Self {
            seed,
            class: law.class,
            law: law.shown(),
            said: said(&diagnosis, &truth.model),
            answer: [answer.as_str().unwrap_or_default(), &names.join("+")].join(" "),
            refit_rmse_deg: diagnosis.refit.rmse().to_degrees(),
            repaired_rmse_deg: diagnosis.repaired.fit.rmse().to_degrees(),
            law_rmse_deg: of_the_law(&truth, &diagnosis).to_degrees(),
            cpu_seconds: spent.map(|(after, before)| after - before),
        })
    }

    fn is_as_good(&self) -> bool {
        self.repaired_rmse_deg <= AS_GOOD * self.law_rmse_deg
    }
}

/// The RMS error of the law, fitted from the truth with the parameters of the base.
fn of_the_law(truth: &ModelFile, diagnosis: &Diagnosis) -> f64 {
    let data = diagnosis.data.guessing(&diagnosis.data.expected());
    let fitter = Fitter::new(&diagnosis.refit.model, &data);
    fitter
        .fit(&truth.model, &diagnosis.refit.free, Effort::Full)
        .rmse()
}

/// What was said, beside the true actuator.
fn said(diagnosis: &Diagnosis, truth: &Model<f64>) -> Said {
    let law = truth.effects().last();
    let is_law = |model: &Model<f64>| {
        let own = model.effects().last();
        let correlation = own.zip(law).map(|(own, law)| {
            let (a, b) = ((model.dynamics(), &own), (truth.dynamics(), &law));
            force_correlation(a, b, &diagnosis.data)
        });
        correlation.is_some_and(|correlation| correlation >= ALIKE)
    };
    match &diagnosis.finding {
        Finding::Quiet { .. } => Said::Nothing,
        Finding::Named {
            effects, strength, ..
        } => {
            let is_one = effects.len() == 1;
            if is_one && is_law(&diagnosis.repaired.fit.model) {
                Said::Law
            } else if *strength == Strength::Part {
                Said::Open
            } else if effects.iter().any(|it| is_term(it.kind)) {
                Said::OtherFormula
            } else {
                Said::OtherEffect
            }
        }
        Finding::Rivals { .. } | Finding::Trace { .. } => {
            let mut rivals = diagnosis.rivals.iter();
            if rivals.any(|rival| rival.added.len() == 1 && is_law(&rival.fit.model)) {
                Said::InSet
            } else {
                Said::Open
            }
        }
        _ => Said::Open,
    }
}

fn figures(cases: &[Asked]) -> Value {
    let groups = Class::ALL.into_iter().map(|class| {
        let these: Vec<&Asked> = cases.iter().filter(|case| case.class == class).collect();
        let rate = |is: &dyn Fn(&Asked) -> bool| Rate::count(these.iter().map(|case| is(case)));
        let mut spent: Vec<f64> = these.iter().filter_map(|case| case.cpu_seconds).collect();
        json!({
            "name": class.title(), "cases": these.len(),
            "law": rate(&|it| it.said == Said::Law).shown(),
            "in_answer": rate(&|it| matches!(it.said, Said::Law | Said::InSet)).shown(),
            "as_good": rate(&Asked::is_as_good).shown(),
            "other_formula": rate(&|it| it.said == Said::OtherFormula).shown(),
            "other_effect": rate(&|it| it.said == Said::OtherEffect).shown(),
            "open": rate(&|it| it.said == Said::Open).shown(),
            "nothing": rate(&|it| it.said == Said::Nothing).shown(),
            "median_cpu_seconds": (!spent.is_empty()).then(|| median(&mut spent)),
        })
    });
    json!({ "benchmark": "laws", "cases": cases, "groups": groups.collect::<Vec<_>>() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every law can be read and simulated, and all classes are drawn.
    #[test]
    fn laws_are_forces_of_their_size() {
        let mut classes = Vec::new();
        for seed in 1..=40 {
            let (law, truth) = actuator(seed, 0.2).unwrap();
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
        assert_eq!(classes.len(), Class::ALL.len());
    }
}
