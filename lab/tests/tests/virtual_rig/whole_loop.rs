//! The loop on the virtual rig, against the truth: upload, record, diagnose.
//!
//! The tests look at one recording, of the actuator that `cargo xtask demo` draws.

use std::{fs, sync::OnceLock};

use super::served::{PORT, VirtualRig, programs};
use model_core::{
    actuator::ParameterId,
    catalogue::{Effect, Kind},
};
use softrig::diagnose::decide::verdict::{Answer, Verdict};
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig_formats::model_file::{ModelFile, to_file_units};
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};
use tempfile::TempDir;

/// The demo's seed.
const SEED: &str = "1";

/// How near zeros of the sensors are found: beside noise there is a converter
/// whose counts are 0.67 kPa and 0.26°.
const NEAR_KPA: f64 = 0.15;
const NEAR_DEG: f64 = 0.5;

/// One pass through the loop.
struct Pass {
    truth: ModelFile,
    /// The zeros that the bench was drawn with.
    pressure_zero_kpa: f64,
    angle_zero_deg: f64,
    /// Files that the recording left.
    files: Vec<String>,
    recording: Recording,
    diagnosis: Diagnosis,
    verdict: Verdict,
}

/// The pass that all tests look at; none when there is no simulator.
fn pass() -> Option<&'static Pass> {
    static PASS: OnceLock<Option<Pass>> = OnceLock::new();
    PASS.get_or_init(|| {
        let drawn = [
            "--hide",
            SEED,
            "--seed",
            SEED,
            "--speed",
            "max",
            "--model-out",
            "model.toml",
            "--truth-out",
            "truth.toml",
        ];
        VirtualRig::start(&drawn).map(go)
    })
    .as_ref()
}

fn go(mut served: VirtualRig) -> Pass {
    rig(
        &served.folder,
        &["upload", "--port", PORT, "--model", "model.toml"],
    );
    fs::create_dir(served.folder.path().join("session")).unwrap();
    let output = "session/run.csv";
    let record = [
        "record",
        "--port",
        PORT,
        "--protocol",
        "steps",
        "-o",
        output,
    ];
    rig(&served.folder, &record);
    // As fast as it goes, it would take time from the diagnosis.
    served.switch_off();
    let folder = &served.folder;

    let (recording, warnings) = Recording::read(&folder.path().join(output)).unwrap();
    assert_eq!(warnings, [""; 0]);
    let mut files: Vec<String> = fs::read_dir(folder.path().join("session"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    let path = folder.path().join("truth.toml");
    let (truth, answer) = (ModelFile::read(&path), fs::read_to_string(path).unwrap());
    let file = ModelFile::read(&folder.path().join("model.toml")).unwrap();
    let request = Request::of(&file, std::slice::from_ref(&recording));
    let diagnosis = diagnose(&request, &Job::default()).unwrap();
    let verdict = diagnosis.verdict(&request, 0.0);
    println!("{}", serde_json::to_string(&verdict).unwrap());
    Pass {
        truth: truth.unwrap(),
        pressure_zero_kpa: told(&answer, "# pressure zero: "),
        angle_zero_deg: told(&answer, "# angle zero: "),
        files,
        recording,
        diagnosis,
        verdict,
    }
}

/// What `softrig` prints.
fn rig(folder: &TempDir, arguments: &[&str]) -> String {
    let output = super::served::rig(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// A number that a comment of the answer tells.
fn told(answer: &str, name: &str) -> f64 {
    let line = answer.lines().find_map(|line| line.strip_prefix(name));
    let word = line.and_then(|line| line.split_whitespace().next());
    let number = word.and_then(|word| word.parse().ok());
    number.unwrap_or_else(|| panic!("no {name:?} in {answer}"))
}

fn kinds(effects: impl Iterator<Item = Effect<f64>>) -> Vec<Kind> {
    effects.map(|effect| effect.kind()).collect()
}

#[test]
fn a_session_is_one_file_that_says_where_its_runs_are() {
    let Some(pass) = pass() else { return };
    assert_eq!(pass.files, ["run.csv", "run.meta.toml"]);
    let meta = &pass.recording.meta;
    let setpoints: Vec<Option<f64>> = meta.segment.iter().map(|run| run.setpoint_deg).collect();
    let levels = [10.0, 30.0, 60.0, 90.0].map(Some);
    assert_eq!(setpoints, [levels, levels].concat());
    for pair in meta.segment.windows(2) {
        assert!(pair[0].from_s < pair[0].to_s && pair[0].to_s <= pair[1].from_s);
    }
    assert_eq!(pass.diagnosis.data.sessions().len(), 1);
    assert_eq!(pass.diagnosis.data.segments().len(), 8);
}

#[test]
fn an_idle_rig_shows_the_zero_of_its_pressure() {
    let Some(pass) = pass() else { return };
    let recording = &pass.recording;
    let column = recording.extra.iter().find(|column| column.name == "state");
    let idle: Vec<f64> = column
        .expect("a state")
        .fields
        .iter()
        .zip(&recording.pressure)
        .take_while(|(state, _)| *state == "idle")
        .map(|(_, pressure)| pressure / PASCAL_PER_KPA)
        .collect();
    assert!(idle.len() > 20, "{} idle samples", idle.len());
    let mean = idle.iter().sum::<f64>() / idle.len() as f64;
    let zero = pass.pressure_zero_kpa;
    println!("idle pressure {mean:.3} kPa, zero {zero} kPa");
    assert!((mean - zero).abs() < NEAR_KPA, "{mean}, not {zero} kPa");
}

#[test]
fn the_zeros_of_the_bench_are_found() {
    let Some(pass) = pass() else { return };
    let zeros = &pass.verdict.nuisance;
    for (found, truth, near) in [
        (&zeros.pressure_zero_kpa, pass.pressure_zero_kpa, NEAR_KPA),
        (&zeros.angle_zero_deg, pass.angle_zero_deg, NEAR_DEG),
    ] {
        assert_eq!(found.len(), 1, "{zeros:?}");
        println!("zero {:.3}, true {truth}", found[0]);
        assert!((found[0] - truth).abs() < near, "{zeros:?}, not {truth}");
    }
}

#[test]
fn what_is_named_is_what_was_hidden() {
    let Some(pass) = pass() else { return };
    let hidden = kinds(pass.truth.model.effects());
    if pass.verdict.verdict == Answer::EffectFound {
        assert_eq!(kinds(pass.diagnosis.repaired.fit.model.effects()), hidden);
        assert!(pass.verdict.upload);
        let (error, noise) = (
            &pass.verdict.holdout_rmse_deg,
            pass.verdict.rmse_deg.noise_floor,
        );
        println!("held out: {error:?}, noise {noise}");
        assert!(error.repaired < 1.5 * noise, "{error:?}, noise {noise}");
    } else {
        assert_eq!(pass.verdict.verdict, Answer::CannotTell);
        let names: Vec<&str> = hidden.iter().map(|kind| kind.name()).collect();
        let alternatives = &pass.verdict.alternatives;
        assert!(
            alternatives.iter().any(|rival| rival.kinds == names),
            "{alternatives:?} lack {names:?}"
        );
    }
}

/// Each interval holds the truth in 19 of 20 recordings, so those of eight
/// parameters all do in two of three only. And intervals know the noise alone: in
/// every recording of this actuator so far damping and input gain came out 1.7 to
/// 3 half-widths too large, which is 0.5 to 0.9 %. So an interval is widened, and
/// an error that nobody would notice on a rig is none.
#[test]
fn fitted_parameters_are_those_of_the_truth() {
    /// Share of its half-width by which an interval is widened.
    const WIDER: f64 = 0.2;
    /// Relative error that does not matter.
    const SMALL: f64 = 0.03;
    let Some(pass) = pass() else { return };
    if pass.verdict.verdict != Answer::EffectFound {
        return;
    }
    let fit = &pass.diagnosis.repaired.fit;
    let is_base = |id: &&ParameterId| !matches!(id, ParameterId::Effect { .. });
    let base = fit.free.iter().filter(is_base).count();
    assert!(base >= 3 && fit.free.len() > base, "{:?}", fit.free);
    let mut missed = Vec::new();
    for (index, &id) in fit.free.iter().enumerate() {
        let name = pass.truth.parameter_name(id);
        let truth = pass.truth.model.value(id).expect("the truth has it");
        let found = fit.model.value(id).expect("it was fitted");
        let (low, high) = fit.interval95(index).expect("it was fitted");
        let shown = |value: f64| to_file_units(&fit.model, id, value);
        let half = 0.5 * (high - low);
        let is_inside = (low - WIDER * half..=high + WIDER * half).contains(&truth);
        let error = (found / truth - 1.0).abs();
        println!(
            "{name}: {:.5} ± {:.5}, true {:.5}, off by {:.2} half-widths, {:.2} %",
            shown(found),
            shown(half),
            shown(truth),
            (found - truth).abs() / half,
            100.0 * error
        );
        if !is_inside && error > SMALL {
            missed.push(name);
        }
    }
    assert_eq!(missed, [""; 0]);
}

/// A weight that no pressure tells from a spring: the rig is turned, and the answer is clear.
#[test]
fn the_next_experiment_decides() {
    if programs().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let example = ["--hide", "6", "--effect", "gravity", "-o", "drawn"];
    rig(&folder, &[&["example"][..], &example].concat());
    // Heavier, so that it matters; at 2.5 N the bend of its sine begins to tell it from a spring.
    let drawn = fs::read_to_string(folder.path().join("drawn/truth.toml")).unwrap();
    let heavy: Vec<&str> = drawn
        .lines()
        .map(|line| {
            let is_weight = line.starts_with("force_n = ");
            if is_weight { "force_n = 2.0" } else { line }
        })
        .collect();
    fs::write(folder.path().join("heavy.toml"), heavy.join("\n")).unwrap();
    let upright = ["--hide", "6", "--actuator", "heavy.toml", "-o", "upright"];
    rig(&folder, &[&["example"][..], &upright].concat());
    let mut runs: Vec<String> = fs::read_dir(folder.path().join("upright/recordings"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with("step") && !name.contains(".meta."))
        .map(|name| format!("upright/recordings/{name}"))
        .collect();
    runs.sort();
    let runs: Vec<&str> = runs.iter().map(String::as_str).collect();
    let command = ["next", "--virtual", "heavy.toml", "--model"];
    let limits = [
        "upright/model.toml",
        "-o",
        "decide",
        "--limits",
        "deg=70,s=60",
    ];
    let next = [&command[..], &limits, &runs].concat();
    let said = rig(&folder, &next);
    assert!(said.contains("cannot tell apart"), "{said}");
    // Which way does not matter: these recordings do not say what their sensor shows, and a
    // run that leaves it is followed by one the other way.
    assert!(said.contains("turn the base by 90°"), "{said}");
    assert!(said.contains("The model lacks gravity."), "{said}");
    let plans: Vec<ProtocolFile> = (1..=2)
        .map(|number| folder.path().join(format!("decide/next{number}.toml")))
        .filter(|path| path.exists())
        .map(|path| ProtocolFile::read(&path).unwrap())
        .collect();
    for plan in &plans {
        assert!(plan.total_ms() <= 60_000, "{plan:?}");
    }
    // Somebody turned it the other way, or wrote the wrong sign.
    let turned = folder
        .path()
        .join(format!("decide/next{}.meta.toml", plans.len()));
    let was = fs::read_to_string(&turned).unwrap();
    let now = if was.contains("tilt_deg = -90.0") {
        was.replace("tilt_deg = -90.0", "tilt_deg = 90.0")
    } else {
        was.replace("tilt_deg = 90.0", "tilt_deg = -90.0")
    };
    assert_ne!(was, now);
    fs::write(&turned, now).unwrap();
    let said = rig(&folder, &next);
    assert!(said.contains("Stopped: "), "{said}");
    assert!(said.contains("as if it was turned by"), "{said}");
}
