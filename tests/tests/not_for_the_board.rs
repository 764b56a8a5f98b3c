//! A repair that the board cannot run is offered for the computer, and the reason is said.

use std::path::Path;

use host_tools::diagnose::{Progress, Request, diagnose};
use host_tools::io::model_file::ModelFile;
use host_tools::io::recording::Recording;
use host_tools::report::Outputs;
use host_tools::report::content::Content;
use host_tools::report::terminal::summary;
use host_tools::synth::example::of_actuator;
use model_core::predictor;

/// Light, overdamped, and braked by dry friction: within a step of the board the friction
/// takes more than there is.
const TRUTH: &str = r#"schema = 1
name = "light rig with dry friction"

[dynamics]
inertia_kg_m = 0.0004
damping_n_s_per_rad = 1.5
stiffness_n_per_rad_n = 5.0
exponent = 1.727
input_gain_n_per_kpa = 0.12

[[effect]]
kind = "coulomb_friction"
force_n = 0.5
smoothing_rad_per_s = 0.02
"#;

#[test]
fn a_model_that_the_board_refuses_is_not_for_upload_and_the_reason_is_said() {
    let truth = ModelFile::parse(TRUTH, Path::new("truth.toml")).unwrap();
    let example = of_actuator(&truth, 0.2, 3).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let recordings: Vec<Recording> = example
        .recordings
        .iter()
        .filter(|(name, ..)| !name.contains("_3"))
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &[],
        own: None,
        seed: 1,
    };
    let diagnosis = diagnose(&request, &Progress::default()).unwrap();
    let verdict = diagnosis.verdict(&request, 0.0);
    // It is better, and written.
    assert!(diagnosis.is_better(), "{:?}", diagnosis.held_out);
    #[allow(clippy::cast_possible_truncation)]
    let kept = diagnosis.model_to_keep(&file).map(|value| value as f32);
    assert!(predictor::check(&kept, 2.27).is_err());
    assert!(!verdict.upload);
    // The error is that of the computer: the board has none.
    let held_out = &diagnosis.held_out;
    assert!((held_out.repaired_on_board / held_out.repaired - 1.0).abs() < 0.02);

    let content = Content::of(&request, &diagnosis);
    assert_eq!(content.upload, verdict.upload);
    assert!(!content.is_unchanged());
    let said = content.refused.clone().unwrap();
    assert!(said.contains("moves too fast for the steps"), "{said}");
    let summary = summary(&content, &Outputs::default(), 1, 0.0);
    assert!(summary.contains(&said), "{summary}");
    assert!(summary.lines().count() <= 25, "{summary}");
}
