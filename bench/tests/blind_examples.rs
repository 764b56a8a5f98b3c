//! Effects hidden in simulated recordings: how often are they found, and how
//! often is one found that is not there?
//!
//! The recordings are made by the same formulas that are looked for, so this
//! is the least that a diagnosis has to do. What it is worth on recordings of
//! others is in `real_recordings.rs`. The default tests diagnose a few examples
//! on fixed seeds; the survey diagnoses many.

use std::path::Path;

use model_core::catalogue::Kind;
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::decide::verdict::Answer;
use softrig::synth::example::{Hidden, make};
use softrig_formats::family::names;
use softrig_tests::{Case, all_tests, named};

/// RMS noise of the angle (°), as of a flex sensor on a good day.
const NOISE_DEG: f64 = 0.4;

/// Makes an example and diagnoses it, by the recordings whose names start so.
fn diagnose(hidden: Hidden, noise_deg: f64, seed: u64, only: &[&str]) -> Diagnosis {
    let example = make(hidden, noise_deg, seed).unwrap();
    let folder = format!("blind_{hidden:?}_{noise_deg}_{seed}_{}", only.concat());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(folder);
    let mut case = Case::of_example(&example, &folder);
    std::fs::remove_dir_all(&folder).unwrap();
    case.recordings
        .retain(|recording| only.iter().any(|start| recording.name.starts_with(start)));
    case.diagnose()
}

/// What diagnoses came to, counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Tally {
    /// The named set is the truth.
    exact: usize,
    /// A name that is not the truth, alone or with it.
    wrong: usize,
    /// No name, but the truth is among the rivals that the answer leaves.
    open: usize,
    /// No name where there is an effect, and no hint of it.
    silent: usize,
    /// No name where the effect moves the angle by less than what matters, and the answer
    /// says how much remains.
    small: usize,
}

impl Tally {
    fn count(&mut self, truth: &str, diagnosis: &Diagnosis) {
        match named(diagnosis).as_slice() {
            [] => {
                let finding = &diagnosis.finding;
                let among_rivals = finding
                    .explanations()
                    .iter()
                    .any(|rival| names(&rival.kinds) == [truth]);
                if let Finding::Quiet {
                    immaterial: true, ..
                } = finding
                {
                    assert!(diagnosis.beyond_noise() < diagnosis.tolerance);
                    self.small += 1;
                } else if finding.answer() == Answer::CannotTell && among_rivals {
                    self.open += 1;
                } else {
                    self.silent += 1;
                }
            }
            [name] if *name == truth => self.exact += 1,
            _ => self.wrong += 1,
        }
    }
}

#[test]
fn hidden_effects_are_named() {
    let mut tally = Tally::default();
    // The blind gate, which simulates by another integrator, asks for each effect each time.
    let kinds: Vec<Kind> = Kind::NAMES
        .iter()
        .step_by(if all_tests() { 1 } else { 9 })
        .copied()
        .collect();
    for &kind in &kinds {
        let diagnosis = diagnose(Hidden::Effect(kind), NOISE_DEG, 301, &["step", "triangle"]);
        tally.count(kind.name(), &diagnosis);
        eprintln!(
            "{}: {:?} {:?}",
            kind.name(),
            diagnosis.finding.answer(),
            named(&diagnosis)
        );
        // A name comes with a repair that holds on runs that were not
        // fitted, as the board predicts as well.
        if let Finding::Named { effects, .. } = &diagnosis.finding {
            let added = &diagnosis.repaired.added;
            assert!(effects.iter().all(|it| added.contains(&it.kind)));
            assert!(!effects.is_empty());
            assert!(diagnosis.adequacy.holdout_gap_closed > 0.8);
            let held_out = &diagnosis.held_out;
            assert!(held_out.repaired_on_board < 1.02 * held_out.repaired);
        }
    }
    // A false name is worse than none.
    assert_eq!(tally.wrong, 0, "{tally:?}");
    // Steps and a triangle do not tell every look-alike apart: friction from
    // hysteresis, a drift of the stiffness from one of the sensor. Then the
    // truth has to be in the answer set.
    let all = kinds.len();
    assert!(tally.silent <= 1 && tally.small <= 1, "{tally:?} of {all}");
    assert!(5 * tally.exact >= 4 * all, "{tally:?} of {all}");
}

#[test]
fn nothing_hidden_gets_no_name() {
    let mut parameters_only = 0;
    let seeds = if all_tests() { 400..410 } else { 400..403 };
    let count = seeds.clone().count();
    for seed in seeds {
        let diagnosis = diagnose(Hidden::Nothing, NOISE_DEG, seed, &["step", "triangle"]);
        let none: [&str; 0] = [];
        assert_eq!(named(&diagnosis), none, "seed {seed}");
        eprintln!("nothing {seed}: {:?}", diagnosis.finding.answer());
        parameters_only += usize::from(diagnosis.finding.answer() == Answer::ParametersOnly);
    }
    // The parameters of an example are always off; that something else is
    // missing as well may be suspected now and then.
    assert!(
        10 * parameters_only >= 9 * count,
        "{parameters_only} of {count}"
    );
}

/// A number from the environment.
fn setting<T: std::str::FromStr<Err: std::fmt::Debug>>(name: &str, default: T) -> T {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// Prints a row for each example. It runs only if it is asked for by name:
///
/// ```text
/// SOFTRIG_SURVEY_SEEDS=5 cargo test --release -p softrig-bench --test bench blind_examples -- --ignored --nocapture
/// ```
#[test]
#[ignore = "a survey over many seeds takes minutes; see the head of this file"]
fn survey() {
    let noise_deg = setting("SOFTRIG_SURVEY_NOISE_DEG", NOISE_DEG);
    let only = std::env::var("SOFTRIG_SURVEY_ONLY").unwrap_or_default();
    let only: Vec<&str> = only.split(',').collect();
    println!(
        "hidden\tseed\tanswer\tnamed\trefit\trepaired\tfloor\theld_out_refit\theld_out_repaired\trivals"
    );
    let mut seed = setting("SOFTRIG_SURVEY_FROM", 100);
    for _ in 0..setting("SOFTRIG_SURVEY_SEEDS", 5) {
        let effects = Kind::NAMES.iter().map(|&kind| Hidden::Effect(kind));
        for hidden in effects.chain([Hidden::Nothing; 4]) {
            seed += 1;
            let found = diagnose(hidden, noise_deg, seed, &only);
            let truth = match hidden {
                Hidden::Effect(kind) => kind.name(),
                _ => "nothing",
            };
            let rivals: Vec<String> = found
                .finding
                .explanations()
                .iter()
                .map(|rival| format!("{} ({:.0})", names(&rival.kinds).join("+"), rival.delta_bic))
                .collect();
            let degrees = [
                found.refit.rmse(),
                found.repaired.fit.rmse(),
                found.floor.rms,
                found.held_out.refit,
                found.held_out.repaired,
            ]
            .map(|radians| format!("{:.3}", radians.to_degrees()));
            println!(
                "{truth}\t{seed}\t{:?}\t{}\t{}\t{}",
                found.finding.answer(),
                named(&found).join("+"),
                degrees.join("\t"),
                rivals.join(", ")
            );
        }
    }
}
