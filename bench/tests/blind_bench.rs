//! The set `bench` of the blind benchmark: its physics against closed forms, its
//! cases as a stranger reads them, its tables.

use std::path::{Path, PathBuf};

use serde_json::json;
use softrig::diagnose::{Job, Request, diagnose};
use softrig_bench::blind::answer::{Answer, Collection};
use softrig_bench::blind::bench::cases::{Made, Plan, make, plan};
use softrig_bench::blind::bench::session::Rig;
use softrig_bench::blind::cases::stable_hash;
use softrig_bench::blind::counts::{Group, Rate};
use softrig_bench::blind::experiments::{Experiment, Pump};
use softrig_bench::blind::grade::{Grade, Strength};
use softrig_bench::blind::hidden::{Hidden, kinds_of, names_of};
use softrig_bench::blind::law::{Effect, Law, break_away};
use softrig_bench::blind::score::Scored;
use softrig_bench::blind::sizes::typical_effect;
use softrig_bench::blind::tables;
use softrig_bench::blind::verdicts::Outcome;
use softrig_bench::blind::world::{
    Base, Grid, Line, Outside, RATE_HZ, SAMPLES_HZ, World, coloured,
};
use softrig_bench::pages;
use softrig_formats::columns::Layout;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, read_all};

const LINEAR: Base = Base {
    inertia: 0.05,
    damping: 0.6,
    stiffness: 6.0,
    exponent: 1.0,
    input_gain: 1e-4,
};

const SOFT: Base = Base {
    inertia: 0.25,
    damping: 1.5,
    stiffness: 5.0,
    exponent: 2.0,
    input_gain: 1.2e-4,
};

fn world(base: Base, law: Law, values: [f64; 4]) -> World {
    World {
        base,
        effects: vec![Effect { law, values }],
    }
}

/// From rest, a thousand readings a second.
fn shown(world: &World, line: &Line) -> Vec<f64> {
    world.show(
        &Outside::at_rest(line),
        Grid::of_steps(RATE_HZ, RATE_HZ / 1000),
    )
}

fn at(readings: &[f64], seconds: f64) -> f64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let index = (seconds * 1000.0).round() as usize;
    readings[index]
}

/// Runs are looked at by samples with steps between them, sessions by steps.
#[test]
fn what_is_shown_does_not_depend_on_the_grid() {
    let pump = Pump {
        lag: 0.08,
        fastest: 300e3,
    };
    let line = pump.drive(&Experiment::Triangle(1.0), &SOFT);
    for &law in Law::ALL {
        let truth = World {
            base: SOFT,
            effects: vec![typical_effect(law, &SOFT, 4)],
        };
        let by_steps = shown(&truth, &line);
        let by_samples = truth.simulate(&line, 0, RATE_HZ / SAMPLES_HZ);
        for (k, reading) in by_samples.iter().enumerate() {
            let off = (at(&by_steps, k as f64 * 0.01) - reading).abs();
            assert!(off < 1e-9, "{law:?}: {off} rad");
        }
    }
}

/// Friction alone: what is pushed is hardly held by anything else.
const SLIDING: f64 = 1.0;
const EXTRA: f64 = 0.8;
const DWELL: f64 = 1.5;
const PRESLIDING: f64 = 0.004;
const FREE: Base = Base {
    stiffness: 0.01,
    damping: 0.2,
    ..LINEAR
};

/// The force (N) at which the angle leaves what a bristle gives, pushed by a ramp
/// of 0.4 N/s that begins after so many seconds; and when.
fn break_away_found(after: f64, extra: f64) -> (f64, f64) {
    let interval = 0.01;
    let force = |time: f64| 0.4 * (time - after).max(0.0);
    let values = (0..2000)
        .map(|k| force(f64::from(k) * interval) / FREE.input_gain)
        .collect();
    let line = Line::new(interval, values);
    let stiction = world(
        FREE,
        Law::DwellStiction,
        [SLIDING, extra, DWELL, PRESLIDING],
    );
    let readings = shown(&stiction, &line);
    let moved = readings.iter().position(|angle| *angle > 2.0 * PRESLIDING);
    let time = moved.unwrap() as f64 * 1e-3;
    (force(time), time)
}

#[test]
fn stiction_grows_with_the_time_at_rest() {
    for after in [0.0, 0.5, 2.0, 12.0] {
        let (force, time) = break_away_found(after, EXTRA);
        let expected = SLIDING + EXTRA * (1.0 - (-time / DWELL).exp());
        assert!(
            (force / expected - 1.0).abs() < 0.04,
            "after {after} s: {force} N, {expected} N"
        );
    }
    // After a long rest it is all of it, and none without the extra.
    assert!((break_away(SLIDING, EXTRA, DWELL, 1e3) - SLIDING - EXTRA).abs() < 1e-12);
    let (force, _) = break_away_found(3.0, 0.0);
    assert!((force / SLIDING - 1.0).abs() < 0.08, "{force} N");
}

#[test]
fn a_slip_begins_the_rest_anew() {
    // Pushed over the edge, let go for a while, pushed again.
    let found = |rest: f64| {
        let (slip, ramp) = (4.0, 4.8 + rest);
        let force = |time: f64| {
            if time < slip {
                0.0
            } else if time < slip + 0.5 {
                1.9
            } else {
                0.4 * (time - ramp).max(0.0)
            }
        };
        let values = (0..3000)
            .map(|k| force(f64::from(k) * 0.01) / FREE.input_gain)
            .collect();
        let stiction = world(
            FREE,
            Law::DwellStiction,
            [SLIDING, EXTRA, DWELL, PRESLIDING],
        );
        let readings = shown(&stiction, &Line::new(0.01, values));
        let before = at(&readings, ramp);
        assert!(before > 10.0 * PRESLIDING, "it did not slip: {before}");
        let mut time = ramp;
        while at(&readings, time) < before + 2.5 * PRESLIDING {
            time += 1e-3;
        }
        // It came to rest where it had got to before the ramp.
        let mut stopped = slip;
        while at(&readings, stopped) < before - 1e-3 {
            stopped += 1e-3;
        }
        (force(time), time - stopped)
    };
    for rest in [0.1, 1.0, 6.0] {
        let (force, rested) = found(rest);
        let expected = break_away(SLIDING, EXTRA, DWELL, rested);
        assert!(
            (force / expected - 1.0).abs() < 0.05,
            "{rest} s: {force} N, {expected} N"
        );
    }
}

#[test]
fn a_pulsating_stiffness_moves_the_rest_angle() {
    let (ratio, frequency) = (0.3, 0.05);
    let pulsating = world(
        LINEAR,
        Law::PulsatingStiffness,
        [ratio, frequency, 0.0, 0.0],
    );
    let readings = shown(&pulsating, &Line::new(40.0, vec![30e3; 2]));
    // Slow against the actuator: at its quarters the angle is F/K.
    for (time, factor) in [(20.0, 1.0), (25.0, 1.0 + ratio), (35.0, 1.0 - ratio)] {
        let expected = 3.0 / (6.0 * factor);
        let found = at(&readings, time);
        assert!((found / expected - 1.0).abs() < 0.02, "{time} s: {found}");
    }
}

#[test]
fn the_shape_of_a_loop_is_what_its_coefficient_says() {
    let line = Line::new(5.0, (0..9).map(|k| 50e3 * f64::from(k % 3)).collect());
    // With B = ½ it is the law that the other sets have.
    let plain = world(LINEAR, Law::BoucWen, [1.5, 0.2, 0.0, 0.0]);
    let half = world(LINEAR, Law::BoucWenShape, [1.5, 0.2, 0.5, 0.0]);
    for (a, b) in shown(&plain, &line).iter().zip(shown(&half, &line)) {
        assert!((a - b).abs() < 1e-12);
    }
    // Pushed far, w ends at 1/(½ + B): all of the force is against the push.
    for shape in [-0.2, 0.0, 0.5] {
        let loose = Base {
            stiffness: 1.0,
            ..LINEAR
        };
        let bent = world(loose, Law::BoucWenShape, [1.0, 0.1, shape, 0.0]);
        let readings = shown(&bent, &Line::new(30.0, vec![60e3; 2]));
        let expected = 6.0 - 1.0 / (0.5 + shape);
        let found = at(&readings, 29.0);
        assert!(
            (found / expected - 1.0).abs() < 0.01,
            "B = {shape}: {found}"
        );
    }
}

#[test]
fn the_coloured_force_has_its_size_and_its_memory() {
    for (deviation, time) in [(0.2, 0.3), (1.5, 2.0)] {
        let seconds = 4000.0 * time;
        let line = coloured(deviation, time, seconds, 9);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let count = (seconds / 0.05) as u32;
        let values: Vec<f64> = (0..count).map(|k| line.at(f64::from(k) * 0.05)).collect();
        let mean_of = |lag: usize| {
            let pairs = values.iter().zip(&values[lag..]);
            pairs.map(|(a, b)| a * b).sum::<f64>() / (values.len() - lag) as f64
        };
        let variance = mean_of(0);
        assert!((variance.sqrt() / deviation - 1.0).abs() < 0.05);
        // After the correlation time 1/e is left, after two of them its square.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let lag = (time / 0.05).round() as usize;
        for times in [1, 2] {
            let left = mean_of(times * lag) / variance;
            let expected = (-(times as f64)).exp();
            assert!((left - expected).abs() < 0.06, "{left}, {expected}");
        }
    }
    let (same, other) = (coloured(1.0, 1.0, 9.0, 3), coloured(1.0, 1.0, 9.0, 4));
    assert!((same.at(5.0) - coloured(1.0, 1.0, 9.0, 3).at(5.0)).abs() < 1e-15);
    assert!((same.at(5.0) - other.at(5.0)).abs() > 1e-6);
}

#[test]
fn a_start_in_motion_swings_as_the_textbook_says() {
    let base = Base {
        damping: 0.02,
        ..LINEAR
    };
    let swing = World::of(base);
    let line = Line::new(5.0, vec![0.0; 2]);
    let outside = Outside {
        start: [0.9, -0.2],
        ..Outside::at_rest(&line)
    };
    let readings = swing.show(&outside, Grid::of_steps(RATE_HZ, RATE_HZ / 1000));
    let decay = base.damping / (2.0 * base.inertia);
    let ringing = (base.stiffness / base.inertia - decay * decay).sqrt();
    for k in 0..50 {
        let t = f64::from(k) * 0.1;
        let sine = (-0.2 + decay * 0.9) / ringing;
        let exact = (-decay * t).exp() * (0.9 * (ringing * t).cos() + sine * (ringing * t).sin());
        assert!((at(&readings, t) - exact).abs() < 1e-6, "{t} s");
    }
}

fn quiet(rig: Rig) -> Plan {
    Plan {
        rig,
        hidden: Hidden::Parameters,
        laws: Vec::new(),
    }
}

fn hash(made: &Made) -> u64 {
    let mut text = serde_json::to_string(&made.answer).unwrap();
    for file in &made.files {
        text += &format!("{} {:?} {:?}", file.name, file.meta, file.recording);
    }
    stable_hash(text.as_bytes())
}

#[test]
fn a_case_depends_on_its_seed_and_its_number_alone() {
    assert_eq!(plan(5, &[], 3), plan(40, &[], 3)[..5]);
    assert_ne!(plan(12, &[], 3), plan(12, &[], 4));
    let plan = quiet(Rig::Integrator);
    let first = hash(&make(&plan, 3, 7));
    assert_eq!(first, hash(&make(&plan, 3, 7)));
    assert_ne!(first, hash(&make(&plan, 3, 8)));
    assert_ne!(first, hash(&make(&plan, 4, 7)));
}

#[test]
fn twelve_cases_hold_every_class_and_all_of_them_every_kind() {
    let list = plan(12 * 12, &[], 1);
    for deck in list.chunks(12) {
        let of = |hidden| deck.iter().filter(|plan| plan.hidden == hidden).count();
        assert_eq!(of(Hidden::One), 7);
        assert_eq!(of(Hidden::Outside), 2);
        assert_eq!(of(Hidden::Nothing) + of(Hidden::Parameters), 2);
        let elsewhere = deck
            .iter()
            .filter(|plan| plan.hidden == Hidden::One && plan.rig != Rig::Actuator);
        assert_eq!(elsewhere.count(), 2);
    }
    for kind in softrig_bench::blind::law::kinds() {
        let hides = |plan: &&Plan| {
            plan.hidden == Hidden::One
                && plan.rig == Rig::Actuator
                && plan.laws[0].row().kind == Some(kind)
        };
        assert!(list.iter().filter(hides).count() >= 2, "{kind}");
    }
    for law in [
        Law::DwellStiction,
        Law::PulsatingStiffness,
        Law::ColouredForce,
    ] {
        let count = list.iter().filter(|plan| plan.laws == [law]).count();
        assert_eq!(count, 8);
    }
    for rig in Rig::ALL {
        let is_quiet = |plan: &&Plan| plan.laws.is_empty() && plan.rig == rig;
        assert!(list.iter().any(|plan| is_quiet(&plan)), "{rig:?}");
    }
    let only = plan(5, &["leak".to_owned()], 1);
    assert!(
        only.iter()
            .all(|plan| plan.laws[0].row().kind == Some("leak"))
    );
}

#[test]
fn an_effect_is_as_large_as_is_asked_for() {
    let plan = Plan {
        rig: Rig::Actuator,
        hidden: Hidden::One,
        laws: vec![Law::Backlash],
    };
    let answer = make(&plan, 2, 0).answer;
    let secret = &answer.secret;
    assert!(secret.visible);
    assert!((1.5..=8.0).contains(&secret.misfit_over_noise));
    assert!(answer.coloured_misfit > 0.0);
    let nominal = secret.nominal.stiffness / secret.truth.base.stiffness - 1.0;
    assert!((0.1..0.3).contains(&nominal.abs()), "{nominal}");
}

/// A folder for one test, with a case in it.
fn written(name: &str, made: &Made) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    made.write(&folder).unwrap();
    folder
}

fn read(folder: &Path) -> Vec<Recording> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder.join("recordings"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "csv"))
        .collect();
    paths.sort();
    read_all(&paths, &Layout::default(), |warning| {
        eprintln!("{warning}");
    })
    .unwrap()
}

/// The first case of a plan that is one session, or that was cut.
fn first(plan: &Plan, cut: bool) -> Made {
    (0..30)
        .map(|number| make(plan, 1, number))
        .find(|made| made.answer.cut == cut)
        .unwrap()
}

#[test]
fn a_whole_session_is_one_file_with_its_segments() {
    let made = first(&quiet(Rig::Actuator), false);
    let folder = written("blind_bench_whole", &made);
    let recordings = read(&folder);
    let [session] = recordings.as_slice() else {
        panic!("{} files", recordings.len())
    };
    let meta = &session.meta;
    assert!(meta.segment.len() >= 10, "{}", meta.segment.len());
    assert!(meta.started_unix_s().is_some() && meta.uptime_s.is_some());
    assert!(meta.angle_range_deg.is_some());
    let steps = meta.segment.iter().filter(|it| it.repeat == Some(2));
    assert!(steps.count() >= 3, "steps are repeated");
    for pair in meta.segment.windows(2) {
        assert!((pair[0].to_s - pair[1].from_s).abs() < 2e-3);
    }
    assert_eq!(session.len(), made.answer.samples);
    let model = std::fs::read_to_string(folder.join("model.toml")).unwrap();
    ModelFile::parse(&model, &folder).unwrap();
    assert!(!model.contains("effect"));
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn pieces_are_the_session_with_nothing_known_of_it() {
    let made = first(&quiet(Rig::Actuator), true);
    let folder = written("blind_bench_pieces", &made);
    let recordings = read(&folder);
    assert!(recordings.len() >= 10);
    for recording in &recordings {
        assert!(recording.time[0].abs() < 1e-12);
        assert_eq!(recording.meta, softrig_formats::recording::Meta::default());
    }
    let moving = recordings
        .windows(2)
        .filter(|pair| (pair[0].angle.last().unwrap() - pair[1].angle[0]).abs() < 0.1);
    assert_eq!(
        moving.count(),
        recordings.len() - 1,
        "they follow each other"
    );
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_session_is_diagnosed_and_not_refused() {
    let made = make(&quiet(Rig::Swing), 1, 0);
    let folder = written("blind_bench_diagnosed", &made);
    let file = ModelFile::read(&folder.join("model.toml")).unwrap();
    let recordings = read(&folder);
    let request = Request::of(&file, &recordings);
    let diagnosis = diagnose(&request, &Job::default()).unwrap();
    assert!(diagnosis.refit.rmse().is_finite());
    std::fs::remove_dir_all(&folder).unwrap();
}

fn scored(plan: &Plan, verdict: serde_json::Value) -> Scored {
    let mut answer = make(&quiet(Rig::Swing), 1, 0).answer;
    answer.secret.hidden = plan.hidden;
    answer.secret.laws = names_of(&plan.laws);
    answer.secret.kinds = kinds_of(&plan.laws);
    let outcome = Outcome {
        verdict: Some(verdict),
        seconds: 2.0,
        cpu_seconds: Some(3.0),
        ..Outcome::default()
    };
    Scored::of(&Answer::Session(answer), &outcome)
}

#[test]
fn tables_count_what_was_said() {
    let one = Plan {
        rig: Rig::Swing,
        hidden: Hidden::One,
        laws: vec![Law::Gravity],
    };
    let outside = Plan {
        hidden: Hidden::Outside,
        laws: vec![Law::DwellStiction],
        ..one.clone()
    };
    let named = |kind: &str, strength: &str| {
        json!({ "verdict": "effect_found", "effects": [{ "kind": kind }], "strength": strength,
                "holdout_rmse_deg": { "refit": 2.0, "repaired": 1.0 } })
    };
    let cases = vec![
        scored(&one, named("gravity", "explains")),
        scored(&one, named("cubic_stiffness", "part")),
        scored(&one, named("leak", "part")),
        scored(&one, json!({ "verdict": "cannot_tell", "family": "creep" })),
        scored(&outside, named("stribeck_friction", "part")),
        scored(&quiet(Rig::Swing), json!({ "verdict": "parameters_only" })),
    ];
    let all = Group::of(Collection::Bench, &cases);
    let pair = |rate: Rate| (rate.hits, rate.of);
    let graded = |cases: &Group, grade| pair(cases.rate(|case| case.grade == grade));
    let single = all.hiding(&[Hidden::One]);
    assert_eq!(pair(single.rate(|case| case.grade.is_right())), (2, 4));
    assert_eq!(graded(&single, Grade::Exact), (1, 4));
    assert_eq!(graded(&single, Grade::Wrong(Strength::Full)), (0, 4));
    assert_eq!(graded(&single, Grade::Wrong(Strength::Part)), (1, 4));
    assert_eq!(graded(&single, Grade::Open), (1, 4));
    let beyond = all.hiding(&[Hidden::Outside]);
    assert_eq!(graded(&beyond, Grade::Wrong(Strength::Part)), (1, 1));
    let free = all.quiet();
    assert_eq!(graded(&free, Grade::Denied), (1, 1));
    let mut figures = tables::figures(&cases);
    let rows = figures["sets"][0]["rows"].as_array().unwrap().clone();
    let figure = |label: &str| {
        let row = rows.iter().find(|row| row["label"] == label);
        &row.unwrap()["figure"]
    };
    let counts = |label: &str| (figure(label)["hits"].as_u64(), figure(label)["of"].as_u64());
    assert_eq!(counts("one effect: right"), (Some(2), Some(4)));
    assert_eq!(counts("one effect, free swing: right"), (Some(2), Some(4)));
    assert_eq!(counts("outside: a name for a part"), (Some(1), Some(1)));
    assert_eq!(
        counts("quiet: nothing or parameters only"),
        (Some(1), Some(1))
    );
    let median = figure("held-out RMSE, repaired over refit, median");
    assert_eq!(median["value"], 0.5);
    assert_eq!(figure("processor time a case, worst (s)")["value"], 3.0);

    figures["command"] = "cargo xtask bench blind --set bench".into();
    figures["tool"] = "0000".into();
    let text = pages::render(&figures).unwrap();
    assert!(text.contains("stribeck_friction (part) 1"), "{text}");
    assert!(text.contains("(cannot_tell: creep) 1"), "{text}");
    let rows = figures["cases"].as_array().unwrap();
    assert_eq!(rows.len(), cases.len());
    let columns = |row: &serde_json::Value| row.as_object().unwrap().len();
    assert!(rows.iter().all(|row| columns(row) == columns(&rows[0])));

    // The sections of runs stay when those of sessions are written.
    assert!(
        text.starts_with("<!-- bench -->\n") && !text.contains("<!-- runs -->"),
        "{text}"
    );
}

/// The truth must not come from the code that is tested with it.
#[test]
fn the_bench_shares_no_code_with_the_tool() {
    for text in [
        include_str!("../worlds/src/hidden.rs"),
        include_str!("../worlds/src/folder.rs"),
        include_str!("../worlds/src/bench/session.rs"),
        include_str!("../worlds/src/bench/sizing.rs"),
        include_str!("../worlds/src/bench/instruments.rs"),
        include_str!("../worlds/src/bench/cases.rs"),
    ] {
        for crate_name in ["model_core", "softrig_cli", "firmware::", "wire::"] {
            assert!(!text.contains(crate_name), "{crate_name}");
        }
        for line in text.lines().filter(|line| line.contains("softrig")) {
            assert!(
                line.contains("softrig_formats::error")
                    || line.contains("softrig_formats::recording"),
                "{line}"
            );
        }
    }
}
