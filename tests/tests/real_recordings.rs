//! What a diagnosis says about recordings that others made and published.
//!
//! The simulated examples are made with the same formulas that are then looked
//! for. Here a real pendulum and a real electronic oscillator have their say,
//! whose missing effect the literature knows, and cases from another simulator
//! that hide nothing. None of them is part of the project: see
//! [`softrig_tests::shared`].

use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::verdict::{Answer, Strength};
use softrig::estimate::assemble::assemble;
use softrig::estimate::unit_errors::refuse;
use softrig_tests::{Case, named, shared};

/// The least that the right effect has to shrink the held-out error, against
/// the refitted linear model.
const SHRINKS: f64 = 5.0;

fn assert_found(diagnosis: &Diagnosis, effect: &str) {
    let names = named(diagnosis);
    assert_eq!(diagnosis.finding.answer(), Answer::EffectFound);
    assert!(names.contains(&effect), "named {names:?}");
    assert_shrinks(diagnosis);
}

fn assert_shrinks(diagnosis: &Diagnosis) {
    let held_out = &diagnosis.held_out;
    assert!(!held_out.in_turn);
    for after in [held_out.repaired, held_out.repaired_on_board] {
        assert!(SHRINKS * after < held_out.refit, "{held_out:?}");
    }
}

#[test]
fn a_pendulum_is_missing_gravity() {
    let Some(folder) = shared("data/real/pendulum") else {
        return;
    };
    let case = Case::read(&folder, &["id_"], &["vad_"]);
    assert_eq!((case.recordings.len(), case.holdout.len()), (4, 2));
    assert_found(&case.diagnose(), "gravity");
}

#[test]
fn the_silverbox_is_missing_a_cubic_spring() {
    let Some(folder) = shared("data/real/silverbox") else {
        return;
    };
    let case = Case::read(&folder, &["multisine_1", "multisine_2"], &["multisine_3"]);
    assert_eq!((case.recordings.len(), case.holdout.len()), (2, 1));
    let diagnosis = case.diagnose();
    // A sine of eight times the spring's force, and a spring that takes it back, are as near.
    assert_eq!(named(&diagnosis), ["cubic_stiffness"]);
    assert_eq!(diagnosis.finding.strength(), Some(Strength::Explains));
    assert_shrinks(&diagnosis);
}

/// Whatever their authors recorded is looked at: no set is refused for its units or
/// columns, and none has only samples that cannot be used.
#[test]
fn no_recording_of_others_is_refused() {
    for rig in [
        "falling_bowling_ball",
        "hanging_load",
        "hydraulic_cylinder",
        "hydraulic_motor",
        "pendulum",
        "silverbox",
        "soft_chamber_pump",
        "torque_pendulum",
    ] {
        let Some(folder) = shared(&format!("data/real/{rig}")) else {
            return;
        };
        let case = Case::read(&folder, &[""], &[]);
        let assembled = assemble(&case.recordings, &[]).unwrap();
        assert!(
            assembled.data.indices(true).len() >= case.recordings.len(),
            "{rig}"
        );
        refuse(&case.file, &case.recordings).unwrap();
    }
}

#[test]
fn cases_without_a_missing_effect_get_no_name() {
    let Some(folder) = shared("cases") else {
        return;
    };
    for (case, answers) in [
        (
            "case_009",
            [Answer::NoDiscrepancy, Answer::ParametersOnly].as_slice(),
        ),
        ("case_010", &[Answer::ParametersOnly]),
    ] {
        let diagnosis = Case::read(&folder.join(case), &[""], &[]).diagnose();
        let none: [&str; 0] = [];
        assert_eq!(named(&diagnosis), none, "{case}");
        assert!(
            answers.contains(&diagnosis.finding.answer()),
            "{case}: {:?}",
            diagnosis.finding.answer()
        );
    }
}
