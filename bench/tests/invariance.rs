//! The same question, asked otherwise, gets the same answer: a small part of
//! `cargo xtask bench invariance`, on cases that are drawn here.
//!
//! What is asserted is what nobody would accept otherwise: neither the random seed, nor the
//! order of the files, nor their units change an answer. What a wrong first model changes is
//! printed, and must not be a contradiction.

use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use softrig::diagnose::{Job, Request, diagnose};
use softrig::synth::example::{self, Hidden};
use softrig_bench::blind::bench::cases::{self as bench, Plan};
use softrig_bench::blind::bench::session::Rig;
use softrig_bench::blind::cases::{make, plan};
use softrig_bench::blind::experiments::Set;
use softrig_bench::blind::hidden::Hidden as Hides;
use softrig_bench::blind::law::Law;
use softrig_bench::invariance::answer::{Answer, Likeness};
use softrig_bench::invariance::ask::{Asked, CaseReplies, Reply};
use softrig_bench::invariance::cases::{Case, CaseSet};
use softrig_bench::invariance::counts::Figures;
use softrig_bench::invariance::known::Labels;
use softrig_bench::invariance::pose::{Posed, Question, pose};
use softrig_bench::invariance::ways::Way;
use softrig_bench::pages::{for_terminal, render};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::read_all;
use softrig_tests::all_tests;

/// Ways that must not change any answer. With the order, the seed changes as well: whatever
/// depends on either of them shows.
const EXACT: [Way; 2] = [Way::Order, Way::Units];
/// A way that may, and must not contradict it. `softrig init` has no place here: it frees the
/// exponent of every actuator, which the models of these cases fix.
const REPORTED: [Way; 1] = [Way::Times3];

/// Seeds of the examples, which hide a drawn effect, with the noise of their angle (° RMS).
const EXAMPLES: [(u64, f64); 6] = [
    (2, 0.4),
    (24, 0.4),
    (30, 0.4),
    (7, 1.5),
    (14, 1.5),
    (16, 1.5),
];
/// The runs of an example that are diagnosed: each once, which leaves the most open.
const RUNS: [&str; 4] = ["step30_1", "step60_1", "step90_1", "triangle"];
/// Cases of the blind benchmark, of the set `paper`.
const PAPER: u32 = 3;
/// Their runs of each set-point that are kept.
const REPEATS: u32 = 2;
/// The number of a bench with free swings, and how many of them are kept.
const SWING: usize = 8;
const SWINGS: usize = 3;
/// Answers that still change: of two structures whose errors on held-out segments are nearly
/// the same, the last digit of a converted pressure decides which is named.
const OPEN: [(Way, &str); 1] = [(Way::Units, "swing")];
/// Seed of what is drawn here.
const SEED: u64 = 1;

/// Ten cases, or four of them, written as a lab would hand them over: the same files on every machine.
fn cases(folder: &Path) -> Vec<Case> {
    let mut names = Vec::new();
    for (seed, noise_deg) in EXAMPLES {
        let mut example = example::make(Hidden::Drawn, noise_deg, seed).unwrap();
        example
            .recordings
            .retain(|(file, ..)| RUNS.contains(&file.trim_end_matches(".csv")));
        names.push(format!("example_{seed}"));
        example
            .write(&folder.join(&names[names.len() - 1]))
            .unwrap();
    }
    for (number, plan) in plan(Set::Paper, PAPER, &[], SEED).iter().enumerate() {
        names.push(format!("paper_{number}"));
        let mut made = make(plan, &names[names.len() - 1], SEED);
        made.runs.retain(|(run, _)| run.repeat <= Some(REPEATS));
        made.write(&folder.join(&names[names.len() - 1])).unwrap();
    }
    let plan = Plan {
        rig: Rig::Swing,
        hidden: Hides::One,
        laws: vec![Law::CoulombLugre],
    };
    let mut made = bench::make(&plan, SEED, SWING);
    made.files.truncate(SWINGS);
    names.push("swing".into());
    made.write(&folder.join("swing")).unwrap();
    if !all_tests() {
        // One of each kind: an example, a noisy one, one of another simulator, a swinging one.
        names
            .retain(|name| ["example_2", "example_7", "paper_0", "swing"].contains(&name.as_str()));
    }
    let read = |name: &String| Case::read(&folder.join(name), None).unwrap();
    names.iter().map(read).collect()
}

/// Diagnoses as `softrig diagnose` does.
fn ask(question: &Question) -> Result<Answer, InputError> {
    let file = ModelFile::read(&question.model)?;
    let layout = Layout::from(question.units.unwrap_or_default()).or(&file.recording);
    let recordings = read_all(&question.recordings, &layout, |_| {})?;
    let holdout = read_all(&question.holdout, &layout, |_| {})?;
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &holdout,
        start_from: &[],
        own: None,
        formulas: true,
        without: &[],
        seed: question.seed,
    };
    let diagnosis = diagnose(&request, &Job::default())?;
    let verdict = serde_json::to_value(diagnosis.verdict(&request, 0.0)).unwrap();
    Ok(Answer::of(&verdict).unwrap())
}

fn asked(case: &Case, way: Way, folder: &Path) -> Asked {
    let folder = folder.join("asked").join(&case.name).join(way.name());
    let clock = Instant::now();
    let init = |_: &[_], _: &Path| unreachable!("`init` is none of the ways");
    let reply = match pose(case, way, &folder, &init).unwrap() {
        Posed::LeftOut(why) => Reply::LeftOut(why),
        Posed::Question(mut question) => {
            if way == Way::Order {
                question.seed = Way::Seed.seed();
            }
            match ask(&question) {
                Ok(answer) => Reply::Answered(answer),
                Err(error) => Reply::Silent(error.to_string()),
            }
        }
    };
    Asked::of(reply, clock.elapsed().as_secs_f64())
}

#[test]
fn the_same_question_asked_otherwise_gets_the_same_answer() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("invariance");
    let _ = std::fs::remove_dir_all(&folder);
    let set = CaseSet {
        name: "drawn".into(),
        cases: cases(&folder),
        labels: Labels::new(),
    };
    assert_eq!(set.cases.len(), if all_tests() { 10 } else { 4 });
    let ways: Vec<Way> = EXACT.into_iter().chain(REPORTED).collect();
    let replies: Vec<CaseReplies> = set
        .cases
        .par_iter()
        .map(|case| CaseReplies {
            name: case.name.clone(),
            plain: asked(case, Way::Plain, &folder),
            ways: ways
                .par_iter()
                .map(|&way| (way, asked(case, way, &folder)))
                .collect(),
        })
        .collect();
    let figures = Figures::of(&set, &replies, &ways);
    let shown = serde_json::json!({ "benchmark": "invariance", "sets": [&figures] });
    eprintln!("{}", for_terminal(&render(&shown).unwrap()));
    for (way, counts) in &figures.ways {
        let open = OPEN
            .iter()
            .filter(|(known, _)| known.name() == *way)
            .count();
        assert!(counts.count(Likeness::Contradicting) <= open, "{way}");
        if EXACT.iter().any(|exact| exact.name() == *way) {
            assert!(counts.count(Likeness::Same) + open >= counts.of, "{way}");
            assert_eq!(counts.of, set.cases.len(), "{way}");
        }
    }
}
