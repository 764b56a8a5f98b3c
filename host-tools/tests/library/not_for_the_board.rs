//! A repair that the board cannot run is offered for the computer, and the reason is said.

use model_core::actuator::Model;
use model_core::catalogue::Kind;
use model_core::predictor;
use softrig::diagnose::{Job, Request, Upload, diagnose};
use softrig::synth::example::Hidden;
use softrig_report::Outputs;
use softrig_report::content::Content;
use softrig_report::terminal::summary;

use super::steps;

#[test]
fn a_model_that_the_board_refuses_is_not_for_upload_and_the_reason_is_said() {
    let (file, recordings) = steps(Hidden::Effect(Kind::QuadraticDamping), 0.3, 4);
    let request = Request::of(&file, &recordings);
    let mut diagnosis = diagnose(&request, &Job::default()).unwrap();
    assert!(diagnosis.is_better(), "{:?}", diagnosis.held_out);
    assert_eq!(diagnosis.upload(&file), Upload::Worth);
    assert!(diagnosis.verdict(&request, 0.0).upload);

    // As good a fit, by an effect that needs more memory of pressures than the board has.
    let late = Kind::DeadTime.build(&[0.7]).unwrap();
    let fitted = &mut diagnosis.repaired.fit.model;
    *fitted = Model::new(*fitted.dynamics(), &[late]).unwrap();
    #[allow(clippy::cast_possible_truncation)]
    let narrow = fitted.map(|value| value as f32);
    assert!(predictor::check(&narrow, 2.27).is_err());
    assert!(!diagnosis.verdict(&request, 0.0).upload);
    let content = Content::of(&request, &diagnosis);
    assert!(!content.upload);
    assert!(!content.is_unchanged());
    let refused = content.refused.clone().unwrap();
    assert!(refused.contains("dead time"), "{refused}");
    let text = summary(&content, &Outputs::default(), 1, 1.0);
    assert!(text.contains(&refused), "{text}");
}
