//! Effects by formulas of a user's own, through the whole loop: recorded, not explained
//! without the formula, named with it; and a formula that does what the catalogue does.

use std::path::Path;

use serde_json::Value;
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::{Example, Hidden, make, of_actuator};
use softrig_formats::model_file::ModelFile;
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::Recording;

/// A rig whose hose is taut at some angles and slack at others.
const TRUTH: &str = r#"schema = 1
name = "rig with a taut hose"

[dynamics]
inertia_kg_m = 0.3
damping_n_s_per_rad = 1.5
stiffness_n_per_rad_n = 5.0
exponent = 1.727
input_gain_n_per_kpa = 0.12

[[effect]]
kind = "custom"
name = "taut_hose"
force = "a*sin(4*th)"

[effect.parameters]
a = { value = 0.9, min = 0.0, max = 5.0, unit = "N" }
"#;

/// What its owner thinks of.
const EFFECTS: &str = r#"schema = 1

[[effect]]
kind = "custom"
name = "taut_hose"
force = "a*sin(k*th)"

[effect.parameters]
a = { value = 0.5, min = 0.0, max = 5.0, unit = "N" }
k = { value = 3.0, min = 2.0, max = 6.0, unit = "1/rad" }
"#;

/// Coulomb friction, written down once more.
const FRICTION: &str = r#"schema = 1

[[effect]]
kind = "custom"
name = "my_friction"
force = "T*tanh(w/0.02)"

[effect.parameters]
T = { value = 0.1, min = 0.0, unit = "N" }
"#;

/// A diagnosis with its verdict as JSON.
fn diagnosed(example: &Example, own: Option<&OwnEffects>) -> (Diagnosis, Value, ModelFile) {
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    // Two runs of each step are enough here.
    let recordings: Vec<Recording> = example
        .recordings
        .iter()
        .filter(|(name, ..)| !name.contains("_3"))
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let request = Request {
        own,
        formulas: false,
        ..Request::of(&file, &recordings)
    };
    let diagnosis = diagnose(&request, &Job::default()).unwrap();
    let verdict = serde_json::to_value(diagnosis.verdict(&request, 0.0)).unwrap();
    (diagnosis, verdict, file)
}

fn own(text: &str) -> OwnEffects {
    OwnEffects::parse(text, Path::new("effects.toml")).unwrap()
}

#[test]
fn an_effect_that_is_in_no_catalogue_is_named_by_its_formula() {
    let truth = ModelFile::parse(TRUTH, Path::new("truth.toml")).unwrap();
    let example = of_actuator(&truth, 0.2, 3).unwrap();

    let (without, verdict, _) = diagnosed(&example, None);
    let closed = |verdict: &Value| verdict["adequacy"]["holdout_gap_closed"].as_f64().unwrap();
    let closed_without = closed(&verdict);
    // No formula of the catalogue; that it is a static curve may be said.
    assert!(without.finding.named().is_empty(), "{verdict:#}");
    let family = verdict["family"].as_str();
    assert!(
        matches!(family, None | Some("stiffness shape")),
        "{verdict:#}"
    );

    // A board runs what repairs it.
    assert_eq!(verdict["upload"], true, "{verdict:#}");

    let (with, verdict, file) = diagnosed(&example, Some(&own(EFFECTS)));
    assert_eq!(with.finding.answer(), Answer::EffectFound, "{verdict:#}");
    assert_eq!(verdict["effects"][0]["kind"], "taut_hose");
    // Better, but no board runs a formula.
    assert!(with.is_better());
    assert_eq!(verdict["upload"], false, "{verdict:#}");
    assert_eq!(verdict["effects"].as_array().unwrap().len(), 1);
    let parameter = |key: &str| verdict["effects"][0]["parameters"][key].as_f64().unwrap();
    assert!((parameter("a") - 0.9).abs() < 0.1, "{verdict:#}");
    assert!((parameter("k") - 4.0).abs() < 0.1, "{verdict:#}");
    assert!(closed(&verdict) > 0.9 && closed(&verdict) > closed_without);

    // What -o writes is a model that can be simulated, and diagnosed again.
    let repaired = with.model_text(&file);
    let repaired = ModelFile::parse(&repaired, Path::new("repaired.toml")).unwrap();
    let effect = repaired.model.effects().next().unwrap();
    assert_eq!(effect.kind().name(), "taut_hose");
    assert!((effect.value(1).unwrap() - parameter("k")).abs() < 1e-6);
}

/// Neither is more right than the other, and nobody may be told so.
#[test]
fn a_formula_that_does_what_the_catalogue_does_is_not_told_from_it() {
    let example = make(
        Hidden::Effect(model_core::catalogue::Kind::CoulombFriction),
        0.2,
        4,
    )
    .unwrap();
    let (with, verdict, _) = diagnosed(&example, Some(&own(FRICTION)));
    assert_eq!(with.finding.answer(), Answer::CannotTell, "{verdict:#}");
    let rivals: Vec<&str> = verdict["alternatives"]
        .as_array()
        .unwrap()
        .iter()
        .map(|rival| rival["kinds"][0].as_str().unwrap())
        .collect();
    assert!(
        rivals.contains(&"my_friction") && rivals.contains(&"coulomb_friction"),
        "{rivals:?}"
    );
}
