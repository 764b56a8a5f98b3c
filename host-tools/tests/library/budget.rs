//! A search that its budget ends claims no more than what it tried, wherever that is.

use model_core::catalogue::Kind;
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::work::budget::BudgetEnd;
use softrig::diagnose::{Budget, Diagnosis, Job, Request, diagnose};
use softrig::synth::example::Hidden;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

use super::steps;

/// A model, and recordings of an actuator that hides `kind`.
fn example(kind: Kind) -> (ModelFile, Vec<Recording>) {
    steps(Hidden::Effect(kind), 0.3, 4)
}

/// The diagnosis within a budget, and the verdict without the wall time.
fn within(
    file: &ModelFile,
    recordings: &[Recording],
    budget: Option<Budget>,
) -> (Diagnosis, String) {
    let request = Request::of(file, recordings);
    let found = diagnose(&request, &Job::within(budget)).unwrap();
    let verdict = serde_json::to_string(&found.verdict(&request, 0.0)).unwrap();
    (found, verdict)
}

/// What holds of every answer, early or late, if `kind` is what is missing.
fn assert_honest(found: &Diagnosis, verdict: &str, kind: Kind) {
    assert_eq!(
        found.ended.is_some(),
        verdict.contains(r#""ended":"budget""#)
    );
    assert_eq!(found.ended.is_some(), verdict.contains(r#""not_tried":["#));
    let open = found.ended.as_ref().is_some_and(BudgetEnd::is_open);
    match found.finding.answer() {
        Answer::EffectFound => assert_eq!(found.finding.named(), [kind]),
        Answer::CannotTell => assert!(found.finding.named().is_empty()),
        Answer::Unexplained => assert!(!open, "{verdict}"),
        other => panic!("{other:?}: {verdict}"),
    }
    let held_out = &found.held_out;
    assert!(held_out.repaired <= 1.001 * held_out.refit, "{verdict}");
}

#[test]
fn an_answer_grows_with_the_budget() {
    let kind = Kind::QuadraticDamping;
    let (file, recordings) = example(kind);
    let (whole, without) = within(&file, &recordings, None);
    assert_eq!(
        (whole.finding.answer(), whole.ended.clone()),
        (Answer::EffectFound, None)
    );
    let mut tried = Vec::new();
    for fits in [0, 3, 6, 8] {
        let (found, verdict) = within(&file, &recordings, Some(Budget::Fits(fits)));
        assert_honest(&found, &verdict, kind);
        let ended = found.ended.unwrap();
        assert!(ended.is_open(), "{fits} fits: {}", ended.sentence());
        assert_eq!(found.finding.answer(), Answer::CannotTell, "{fits} fits");
        tried.push(ended.kinds().len());
        if fits == 0 {
            assert!(found.repaired.added.is_empty() && found.finding.explanations().is_empty());
        }
    }
    assert_eq!(tried[0], Kind::NAMES.len());
    assert!(tried.windows(2).all(|pair| pair[1] <= pair[0]), "{tried:?}");
    // With enough, it is the one that a search without a budget gives.
    let (_, verdict) = within(&file, &recordings, Some(Budget::Fits(1_000_000)));
    assert_eq!(verdict, without);
}

/// Where no formula is right, structures are measured at several horizons: the search is
/// ended in each of its stages.
#[test]
fn an_answer_without_an_exact_formula_is_as_honest() {
    let kind = Kind::Gravity;
    let (file, mut recordings) = example(kind);
    for recording in &mut recordings {
        for angle in &mut recording.angle {
            *angle += 0.04 * (5.0 * *angle).sin();
        }
    }
    let mut last = None;
    for fits in [20, 45, 70, 110, 160] {
        let (found, verdict) = within(&file, &recordings, Some(Budget::Fits(fits)));
        if let Some(ended) = &found.ended {
            let all = !ended.is_open();
            assert!(
                all || found.finding.answer() != Answer::Unexplained,
                "{verdict}"
            );
            let single = ended.kinds().is_empty();
            assert!(
                single || found.finding.answer() != Answer::EffectFound,
                "{verdict}"
            );
        }
        let repaired = found.held_out.repaired;
        assert!(repaired <= 1.001 * found.held_out.refit, "{verdict}");
        last = Some(found);
    }
    assert!(last.is_some_and(|found| !found.tried.is_empty()));
}
