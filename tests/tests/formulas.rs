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
    let truth = format!(
        "schema = 1\nname = \"rig\"\n\n[dynamics]\ninertia_kg_m = 0.3\n\
         damping_n_s_per_rad = 1.5\nstiffness_n_per_rad_n = 5.0\nexponent = 1.727\n\
         input_gain_n_per_kpa = 0.12\n\n[[effect]]\nkind = \"custom\"\nname = \"hidden\"\n\
         force = \"s*{force}\"\n\n[effect.parameters]\ns = 1.0\n"
    );
    let truth = ModelFile::parse(&truth, Path::new("truth.toml")).unwrap();
    let example = of_actuator(&truth, 0.2, 3).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let recordings: Vec<Recording> = example
        .recordings
        .iter()
        .filter(|(name, ..)| !name.contains("_3"))
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let request = Request {
        formulas,
        without,
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
