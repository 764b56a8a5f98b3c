//! Forces that no catalogue has are named by a formula, and nothing else is.

use std::path::Path;

use model_core::catalogue::Kind;
use serde_json::Value;
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::of_actuator;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;
use softrig_report::content::Content;

struct Found {
    diagnosis: Diagnosis,
    verdict: Value,
    sentence: String,
    file: ModelFile,
}

/// An actuator with this force, in N, beside spring and damper; half the recordings of an example.
fn diagnosed(force: &str, formulas: bool, without: &[Kind]) -> Found {
    diagnosed_with(force, "", formulas, without)
}

/// With more in its section, and other effects.
fn diagnosed_with(force: &str, more: &str, formulas: bool, without: &[Kind]) -> Found {
    let truth = format!(
        "schema = 1\nname = \"rig\"\n\n[dynamics]\ninertia_kg_m = 0.3\n\
         damping_n_s_per_rad = 1.5\nstiffness_n_per_rad_n = 5.0\nexponent = 1.727\n\
         input_gain_n_per_kpa = 0.12\n\n[[effect]]\nkind = \"custom\"\nname = \"hidden\"\n\
         force = \"s*{force}\"\n{more}"
    );
    let truth = if more.contains("s = 1.0") {
        truth
    } else {
        truth + "\n[effect.parameters]\ns = 1.0\n"
    };
    let truth = ModelFile::parse(&truth, Path::new("truth.toml")).unwrap();
    let example = of_actuator(&truth, 0.2, 3).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let recordings: Vec<Recording> = example
        .recordings
        .iter()
        .filter(|(name, ..)| !name.contains("_3"))
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let without: Vec<String> = without.iter().map(|kind| kind.name().to_owned()).collect();
    let request = Request {
        formulas,
        without: &without,
        ..Request::of(&file, &recordings)
    };
    let diagnosis = diagnose(&request, &Job::default()).unwrap();
    let verdict = serde_json::to_value(diagnosis.verdict(&request, 0.0)).unwrap();
    let sentence = Content::of(&request, &diagnosis).sentence;
    Found {
        diagnosis,
        verdict,
        sentence,
        file,
    }
}

impl Found {
    fn named(&self) -> Vec<&'static str> {
        let named = self.diagnosis.finding.named();
        named.iter().map(|kind| kind.name()).collect()
    }
}

/// A friction that grows with the pressure: the form, the sizes, the sentence, and a model that is
/// read again.
#[test]
fn friction_that_grows_with_the_pressure_is_named_by_its_formula() {
    let found = diagnosed("(0.2 + 0.012*p)*tanh(w/0.05)", true, &[]);
    let (diagnosis, verdict) = (&found.diagnosis, &found.verdict);
    assert_eq!(
        diagnosis.finding.answer(),
        Answer::EffectFound,
        "{verdict:#}"
    );
    let effect = &verdict["effects"][0];
    assert_eq!(
        effect["kind"], "term_friction_with_pressure_and_constant",
        "{verdict:#}"
    );
    let parameter = |key: &str| effect["parameters"][key].as_f64().unwrap();
    assert!((parameter("a") - 0.2).abs() < 0.03, "{effect:#}");
    assert!((parameter("b") - 0.012).abs() < 0.001, "{effect:#}");
    assert!((parameter("s") - 0.05).abs() < 0.03, "{effect:#}");
    let sentence = &found.sentence;
    assert!(
        sentence.starts_with("What is missing is not in the catalogue. Dry friction that grows")
            && sentence.contains("*max(p, 0))*tanh(w/"),
        "{sentence}"
    );
    // At the noise, on runs that it was not fitted to.
    assert!(diagnosis.held_out.repaired < 1.15 * diagnosis.held_out.floor);
    let written = diagnosis.model_text(&found.file);
    let again = ModelFile::parse(&written, Path::new("repaired.toml")).unwrap();
    let effect = again.model.effects().next().unwrap();
    assert_eq!(
        effect.kind().info().title,
        "dry friction that grows with the pressure, beside a constant part"
    );
}

/// A seal that remembers the pressure: a hidden state with its time constant, which is written and
/// read again.
#[test]
fn a_friction_that_remembers_the_pressure_is_named_with_its_time() {
    let more = "memory = { z = { follows = \"max(p, 0)\", time_constant = \"tau\" } }\n\
                parameters = { s = 1.0, tau = { value = 3.0, min = 0.01 } }\n";
    let found = diagnosed_with("0.02*z*tanh(w/0.05)", more, true, &[]);
    let named = found.named();
    assert_eq!(
        named,
        ["term_friction_with_past_pressure"],
        "{:#}",
        found.verdict
    );
    let effect = &found.verdict["effects"][0];
    let parameter = |key: &str| effect["parameters"][key].as_f64().unwrap();
    assert!((parameter("c") - 0.02).abs() < 0.002, "{effect:#}");
    assert!((parameter("tau") - 3.0).abs() < 0.3, "{effect:#}");
    assert!(
        found.sentence.contains("dz/dt = (max(p, 0) - z)/"),
        "{}",
        found.sentence
    );
    let written = found.diagnosis.model_text(&found.file);
    let again = ModelFile::parse(&written, Path::new("repaired.toml")).unwrap();
    assert_eq!(
        again
            .model
            .effects()
            .next()
            .unwrap()
            .kind()
            .info()
            .states
            .len(),
        1
    );
}

/// A law that no catalogue has, and an effect of the catalogue beside it: both are said.
#[test]
fn a_formula_beside_an_effect_is_found_with_it() {
    let more = "parameters = { s = 1.0 }\n\n\
                [[effect]]\nkind = \"maxwell_branch\"\nstiffness_n_per_rad = 0.8\n\
                time_constant_s = 2.0\n";
    let found = diagnosed_with("1.5*p^2/1000", more, true, &[]);
    let mut named = found.named();
    named.sort_unstable();
    assert_eq!(
        named,
        ["maxwell_branch", "term_pressure_squared"],
        "{:#}",
        found.verdict
    );
    assert!(
        found
            .sentence
            .starts_with("What is missing is not in the catalogue alone."),
        "{}",
        found.sentence
    );
}

/// θ⁵ is a formula; without formulas it is whatever bends most alike, and no name for it.
#[test]
fn a_steep_spring_is_a_formula_and_without_formulas_none() {
    let found = diagnosed("2*th^5", true, &[]);
    assert_eq!(found.named(), ["term_angle_5"], "{:#}", found.verdict);
    let without = diagnosed("2*th^5", false, &[]);
    let text = without.verdict.to_string();
    assert!(!text.contains("term_"), "{text}");
}

/// A cubic spring whose name and whose imitations are not tried is found as a formula.
#[test]
fn without_its_name_a_cubic_spring_is_a_formula() {
    let without = [
        Kind::CubicStiffness,
        Kind::LinearStiffness,
        Kind::ExponentShift,
        Kind::EndStop,
        Kind::Gravity,
        Kind::PressureStiffening,
        Kind::SensorNonlinearity,
    ];
    let found = diagnosed("2*th^3", true, &without);
    assert_eq!(found.named(), ["term_angle_cubed"], "{:#}", found.verdict);
    let untried = found.diagnosis.untried.iter().map(|it| it.kind);
    assert!(
        without
            .iter()
            .all(|kind| untried.clone().any(|it| it == *kind))
    );
}

/// What the catalogue has is named by its name, and never tried as a formula.
#[test]
fn an_effect_of_the_catalogue_keeps_its_name() {
    let found = diagnosed("0.5*tanh(w/0.02)", true, &[]);
    assert_eq!(found.named(), ["coulomb_friction"], "{:#}", found.verdict);
}
