//! Each finding in the sentence that heads its report.

use model_core::catalogue::Kind::{self, CoulombFriction, Gravity, Leak, MaxwellBranch};
use model_core::effects::table::Variable;
use softrig::diagnose::decide::finding::{Explanation, Finding, NamedKind};
use softrig::diagnose::decide::verdict::Strength::{self, Explains, Part};
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::Hidden;
use softrig_formats::family::Family;
use softrig_formats::measurand::Measurand;
use softrig_report::content::sentence;

use super::steps;

fn explanation(kinds: &[Kind]) -> Explanation {
    Explanation {
        kinds: kinds.to_vec(),
        probability: 0.5,
        delta_bic: 1.0,
    }
}

fn named(kind: Kind, strength: Strength) -> Finding {
    Finding::Named {
        effects: vec![NamedKind {
            kind,
            probability: 0.97,
        }],
        strength,
        rivals: Vec::new(),
    }
}

fn rivals(families: &[Family], strength: Strength) -> Finding {
    let rivals = [[Leak, Gravity].as_slice(), &[MaxwellBranch]];
    Finding::Rivals {
        rivals: rivals.map(explanation).to_vec(),
        families: families.to_vec(),
        strength,
    }
}

/// Two explanations that have an effect in common.
fn related(second: &[Kind]) -> Finding {
    Finding::Rivals {
        rivals: [&[CoulombFriction, Gravity], second]
            .map(explanation)
            .to_vec(),
        families: Vec::new(),
        strength: Explains,
    }
}

fn trace(strength: Strength) -> Finding {
    Finding::Trace {
        explanation: explanation(&[CoulombFriction]),
        families: Vec::new(),
        strength,
    }
}

#[test]
#[allow(clippy::too_many_lines)] // A row for each finding.
fn every_finding_is_a_sentence_that_a_person_would_say() {
    let (file, recordings) = steps(Hidden::Nothing, 0.3, 4);
    let request = Request::of(&file, &recordings);
    let plain = diagnose(&request, &Job::default()).unwrap();
    let said = |finding: Finding| {
        sentence(&Diagnosis {
            finding,
            ..plain.clone()
        })
    };
    let creep = Kind::MaxwellBranch.info().title;
    let (leak, gravity) = (Kind::Leak.info().title, Kind::Gravity.info().title);
    let friction = Kind::CoulombFriction.info().title;
    let quiet = |refitted| Finding::Quiet {
        refitted,
        immaterial: false,
    };
    let shape = Finding::Shape {
        of: Variable::Angle,
        formula: explanation(&[Gravity]),
        families: vec![Family::StiffnessShape],
        strength: Explains,
    };
    let closest = |kind: Option<Kind>| Finding::OutOfTime {
        closest: kind.map(|kind| explanation(&[kind])),
    };
    let unexplained = Finding::Unexplained {
        closest: vec![explanation(&[Leak])],
    };
    let floor = &plain.floor;
    let noise = format!(
        "{} ({})",
        Measurand::default().value(floor.rms),
        floor.source()
    );
    for (finding, expected) in [
        (
            quiet(false),
            format!(
                "Nothing is missing: the model agrees with the recordings within their noise, {noise}."
            ),
        ),
        (
            Finding::Noisy,
            format!(
                "These recordings cannot tell whether something is missing: only noise is left, {noise}, and it hides smaller effects."
            ),
        ),
        (
            quiet(true),
            "No effect is missing: the structure is right, only the parameters were off.".into(),
        ),
        (
            named(Gravity, Explains),
            format!("The model lacks {gravity}."),
        ),
        (
            named(Gravity, Part),
            format!("The model lacks {gravity}, which explains part of the error."),
        ),
        (
            rivals(&[], Explains),
            format!(
                "Something is missing, but these recordings cannot tell apart {leak} with {gravity} and {creep}."
            ),
        ),
        (
            related(&[CoulombFriction, MaxwellBranch]),
            format!(
                "The model lacks {friction}, and {gravity} or {creep}; these recordings cannot tell which."
            ),
        ),
        (
            related(&[CoulombFriction]),
            format!(
                "The model lacks {friction}, and perhaps {gravity}; these recordings cannot tell which."
            ),
        ),
        (
            rivals(&[Family::Creep], Part),
            format!(
                "The model lacks a kind of creep, which explains part of the error; these recordings cannot tell apart {leak} with {gravity} and {creep}."
            ),
        ),
        (
            shape,
            "The model lacks a kind of stiffness shape: a force of the angle described by a table, but no formula."
                .into(),
        ),
        (
            trace(Explains),
            format!(
                "What is missing looks like {friction}, but these recordings do not determine it."
            ),
        ),
        (
            trace(Part),
            format!(
                "Part of what is missing looks like {friction}, but these recordings do not determine it."
            ),
        ),
        (
            closest(None),
            "Something is missing, but time ran out before it was found.".into(),
        ),
        (
            unexplained,
            "Something is missing, but no known effect explains it.".into(),
        ),
    ] {
        assert_eq!(said(finding), expected);
    }
    let late = said(closest(Some(CoulombFriction)));
    assert!(
        late.ends_with("came closest before time ran out."),
        "{late}"
    );
}
