//! `softrig init` as someone without a model meets it.
//!
//! What it writes has to be a model that the other commands take, that follows the recording
//! it came from, and that says of each number where it is from; and it has to leave alone
//! what is there.

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use predicates::prelude::*;
use predicates::str::contains;
use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;

use super::common::{Bench, HEADER};
use super::simulate::printed_error;

/// A folder with the recordings of an example, and the model that it is of.
fn with_example(hidden: Hidden, seed: u64) -> (Bench, Model<f64>) {
    let bench = Bench::empty();
    let example = make(hidden, 0.4, seed).unwrap();
    example.write(bench.folder()).unwrap();
    let truth = ModelFile::read(&bench.path("truth.toml")).unwrap().model;
    // What `softrig init` would find in its place.
    std::fs::remove_file(bench.path("model.toml")).unwrap();
    (bench, truth)
}

fn model(bench: &Bench) -> ModelFile {
    ModelFile::read(&bench.path("model.toml")).unwrap()
}

/// What `softrig simulate` says of the model's RMS error over a recording (°).
fn error_deg(bench: &Bench, recording: &str) -> f64 {
    let line = format!("simulate --model model.toml --recording {recording}");
    printed_error(&bench.line(&line).assert().success())
}

/// A recording of a model of unit inertia under steps to several levels, in the file's units.
fn steps(dynamics: Dynamics<f64>, levels: &[f64]) -> String {
    const INTERVAL: f64 = 0.01;
    const FINE: u32 = 20;
    /// Samples of a level.
    const SAMPLES: usize = 200;
    let mut text = HEADER.to_owned();
    let (mut angle, mut rate) = (0.0_f64, 0.0_f64);
    for (k, level) in levels.iter().enumerate() {
        for sample in 0..SAMPLES {
            let time = (k * SAMPLES + sample) as f64 * INTERVAL;
            text += &format!("{time:.3},{level},{:.4}\n", angle.to_degrees());
            for _ in 0..FINE {
                let force = dynamics.input_gain * level * 1e3
                    - dynamics.stiffness * angle.abs().powf(dynamics.exponent).copysign(angle)
                    - dynamics.damping * rate;
                rate += INTERVAL / f64::from(FINE) * force / dynamics.inertia;
                angle += INTERVAL / f64::from(FINE) * rate;
            }
        }
    }
    text
}

#[test]
fn without_a_terminal_it_says_what_to_give() {
    let bench = Bench::empty();
    bench.fails(
        "init",
        &[
            "no terminal to ask on",
            "softrig init --recording step.csv",
            "--length-mm 94",
        ],
    );
}

#[test]
fn a_beam_gives_stiffness_and_exponent_and_the_rest_is_a_guess() {
    let bench = Bench::empty();
    let beam = "init --material ecoflex-0030 --length-mm 94 --width-mm 30 --height-mm 24";
    bench.line(beam).assert().success().stdout(
        contains("written: model.toml")
            .and(contains("softrig upload --port PORT --model model.toml")),
    );
    let file = model(&bench);
    let actuator = file.actuator.as_ref().unwrap();
    assert_eq!(actuator.material, "Ecoflex 00-30");
    // Without stiffness and exponent the reader would take the same from the material.
    let text = bench.text("model.toml");
    let derived: String = text
        .lines()
        .filter(|line| !line.starts_with("stiffness_n") && !line.starts_with("exponent"))
        .map(|line| line.to_owned() + "\n")
        .collect();
    let derived = ModelFile::parse(&derived, &bench.path("model.toml")).unwrap();
    for id in [ParameterId::Stiffness, ParameterId::Exponent] {
        let (written, derived) = (file.model.value(id), derived.model.value(id));
        assert!((written.unwrap() / derived.unwrap() - 1.0).abs() < 1e-5);
    }
    // 90° at 150 kPa, as the file says of its guess.
    let at_90 = file.model.holding_pressure(std::f64::consts::FRAC_PI_2);
    assert!((at_90 / 150e3 - 1.0).abs() < 1e-4, "{at_90} Pa");
    assert_eq!(text.matches("GUESS").count(), 3, "{text}");

    // It is there now, and stays as it is.
    let mut edited = text.clone();
    edited.push_str("# mine\n");
    bench.put("model.toml", &edited);
    bench.fails(beam, &["model.toml", "already exists", "--dry-run"]);
    let dry = bench.line(beam).arg("--dry-run").assert().success();
    assert_eq!(String::from_utf8_lossy(&dry.get_output().stdout), text);
    assert_eq!(bench.text("model.toml"), edited);
}

#[test]
fn without_anything_it_is_the_authors_actuator() {
    let bench = Bench::empty();
    bench
        .line("init --material none")
        .assert()
        .success()
        .stdout(contains("None of this was measured on your rig"));
    let file = model(&bench);
    assert_eq!(file.actuator.unwrap().material, "Dragon Skin 20");
    assert!((file.model.dynamics().stiffness - 0.094).abs() < 5e-4);
    assert!(
        bench
            .text("model.toml")
            .contains("value of the authors' actuator")
    );
}

#[test]
fn slips_of_the_command_line_are_refused_with_a_remedy() {
    let bench = Bench::empty();
    bench.put(
        "step.csv",
        "time_s,pressure_kpa,angle_deg\n0,1,2\n0.1,1,nan\n",
    );
    bench.put("notes.toml", "a = 1\n");
    for (line, parts) in [
        (
            "--material Dragonskin-2O",
            &["not in the table", "did you mean \"Dragon Skin 20\""][..],
        ),
        (
            "--material PLA",
            &["\"Ecoflex 00-10\"", "materials predict"],
        ),
        (
            "--material Ecoflex-00-30 --length-mm 94 --height-mm 24",
            &["--width-mm is missing", "all three"],
        ),
        (
            "--length-mm 94 --width-mm 30 --height-mm 24",
            &["dimensions need a material", "--material"],
        ),
        ("--length-mm 94 --length-m 0.094", &["cannot be used with"]),
        ("--length-mm 0", &["from 0.01 to 1000000 mm"]),
        (
            "--recording step.csv",
            &["step.csv, line 3, column angle_deg"],
        ),
        ("--recording gone.csv", &["gone.csv", "check the path"]),
        ("--recording step.csv step.csv", &["is given twice"]),
        (
            "--recording step.csv -o step.csv",
            &["step.csv", "already exists"],
        ),
        (
            "--material none -o notes.toml",
            &["notes.toml", "already exists"],
        ),
        ("--material none -o no/such/m.toml", &["there is no folder"]),
    ] {
        bench.fails(&format!("init {line}"), parts);
    }
}

/// All recordings of an example that hides nothing: the parameters are the true ones, up to
/// the scale that nothing determines.
#[test]
fn what_hides_nothing_is_identified() {
    let (bench, truth) = with_example(Hidden::Nothing, 5);
    let files = ["step30_1", "step60_1", "step90_1", "staircase"]
        .map(|name| format!("recordings/{name}.csv"));
    let line = format!("init --recording {}", files.join(" "));
    bench.line(&line).assert().success();
    let file = model(&bench);
    let (found, truth) = (file.model.dynamics(), truth.dynamics());
    assert!(
        (found.exponent / truth.exponent - 1.0).abs() < 0.05,
        "{found:?} {truth:?}"
    );
    for (found, truth) in [
        (found.damping / found.inertia, truth.damping / truth.inertia),
        (
            found.stiffness / found.inertia,
            truth.stiffness / truth.inertia,
        ),
        (
            found.input_gain / found.inertia,
            truth.input_gain / truth.inertia,
        ),
    ] {
        assert!((found / truth - 1.0).abs() < 0.1, "{found} {truth}");
    }
    // Nothing is left but noise of 0.4°, also where it was not fitted.
    assert!(error_deg(&bench, "recordings/triangle.csv") < 0.6);
    let text = bench.text("model.toml");
    for part in [
        "# stiffness K; fitted; 95 % interval",
        "# effective inertia M; by convention",
        "softrig diagnose --model model.toml recordings/step30_1.csv",
        "free = [\"damping\", \"stiffness\", \"exponent\", \"input_gain\"]",
    ] {
        assert!(text.contains(part), "{part:?} not in\n{text}");
    }
}

/// One step of an actuator that hides something: the model follows it far better than its
/// mean does.
#[test]
fn one_step_is_enough_to_follow_it() {
    for (kind, seed) in [
        (Kind::MaxwellBranch, 2),
        (Kind::CoulombFriction, 3),
        (Kind::Gravity, 4),
    ] {
        let (bench, _) = with_example(Hidden::Effect(kind), seed);
        let step = "recordings/step60_1.csv";
        bench
            .line(&format!("init --recording {step}"))
            .assert()
            .success();
        let error = error_deg(&bench, step);
        // A step to 60° scatters by 20° to 30° about its mean.
        assert!(error < 4.0, "{kind:?}: {error}°");
    }
}

/// Volts to revolutions: far from an actuator in every unit, and of the other sign.
#[test]
fn a_motor_in_other_units_is_identified() {
    let bench = Bench::empty();
    let motor = Dynamics {
        inertia: 1.0,
        damping: 18.0,
        stiffness: 100.0,
        exponent: 1.0,
        input_gain: -0.02,
    };
    let volts = [0.0, 3.0, 6.0, -4.0, 0.0];
    bench.put("motor.csv", steps(motor, &volts));
    bench
        .line("init --recording motor.csv --name")
        .arg("motor \"A\"")
        .assert()
        .success();
    let file = model(&bench);
    assert_eq!(file.name, "motor \"A\"");
    let found = file.model.dynamics();
    assert!((found.exponent - 1.0).abs() < 1e-12, "{found:?}");
    for (found, truth) in [
        (found.damping, motor.damping),
        (found.stiffness, motor.stiffness),
        (found.input_gain, motor.input_gain),
    ] {
        assert!((found / truth - 1.0).abs() < 0.1, "{found} {truth}");
    }
    // The same numbers in millivolts and milliseconds.
    let text = bench.text("motor.csv");
    let rows = text.lines().skip(1).map(|row| {
        let (time, rest) = row.split_once(',').unwrap();
        format!("{:.0},{rest}\n", time.parse::<f64>().unwrap() * 1e3)
    });
    let rows: String = rows.collect();
    bench.put("ms.csv", HEADER.to_owned() + &rows);
    let line = "init --recording ms.csv --time-in ms -o ms.toml";
    bench.line(line).assert().success();
    let again = ModelFile::read(&bench.path("ms.toml")).unwrap();
    let ratio = again.model.dynamics().stiffness / found.stiffness;
    assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
}

/// A free swing has no input whose gain could be known.
#[test]
fn a_free_swing_has_no_input_gain() {
    let bench = Bench::empty();
    let rows = (0..1_000).map(|k| {
        let time = f64::from(k) * 0.01;
        let angle = 12.0 * (-0.1 * time).exp() * (5.0 * time).cos();
        format!("{time:.2},0,{angle:.4}\n")
    });
    bench.put("swing.csv", HEADER.to_owned() + &rows.collect::<String>());
    bench
        .line("init --recording swing.csv")
        .assert()
        .success()
        .stderr(contains("the input is zero all the time"));
    let file = model(&bench);
    assert!(!file.free.contains(&ParameterId::InputGain));
    let stiffness = file.model.dynamics().stiffness;
    assert!((stiffness / 25.0 - 1.0).abs() < 0.02, "{stiffness}");
    assert!(error_deg(&bench, "swing.csv") < 0.3);
}

/// What is no rig of second order is said to be none.
#[test]
fn noise_is_not_explained() {
    let bench = Bench::empty();
    let mut state = 1_u32;
    let rows = (0..600).map(|k| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        format!("{:.2},{},{}\n", f64::from(k) * 0.01, k / 100, state >> 26)
    });
    bench.put("noise.csv", HEADER.to_owned() + &rows.collect::<String>());
    bench
        .line("init --recording noise.csv")
        .assert()
        .success()
        .stderr(contains("explains little of the motion").and(contains("panicked").not()));
    assert!(bench.text("model.toml").contains("It explains little"));
}

/// `softrig init` on a terminal of its own: answers each question as it is asked, and returns
/// the exit code.
#[cfg(unix)]
fn converse(bench: &Bench, dialogue: &[(&str, &str)]) -> Option<i32> {
    use std::fs::File;
    use std::io::{Read, Write};
    use std::process::Stdio;

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let open = || {
        let mut options = File::options();
        options.read(true).write(true);
        options.open(name.to_str().unwrap()).unwrap()
    };
    // Keys reach the program as they are also while it is not reading yet.
    let keyboard = open();
    let mut modes = tcgetattr(&keyboard).unwrap();
    modes.make_raw();
    tcsetattr(&keyboard, OptionalActions::Now, &modes).unwrap();
    let slave = || Stdio::from(open());
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"))
        .current_dir(bench.folder())
        .arg("init")
        .env("TERM", "xterm")
        .stdin(slave())
        .stdout(slave())
        .stderr(slave())
        .spawn()
        .unwrap();
    // Reading ends when the program has.
    drop(keyboard);
    let mut terminal = File::from(master);
    let mut said = String::new();
    for (question, answer) in dialogue {
        let mut bytes = [0; 4096];
        while !said.contains(question) {
            let count = terminal.read(&mut bytes).unwrap_or(0);
            assert!(count > 0, "{question:?} was not asked: {said}");
            said += &String::from_utf8_lossy(&bytes[..count]);
        }
        terminal.write_all(answer.as_bytes()).unwrap();
    }
    child.wait().unwrap().code()
}

#[cfg(unix)]
#[test]
fn on_a_terminal_it_asks() {
    let (bench, _) = with_example(Hidden::Nothing, 5);
    let code = converse(
        &bench,
        &[
            // The last choice is none.
            ("> another material, or none", "\r"),
            ("Recordings of steps", "nothing.csv\r"),
            ("there is no file nothing.csv", "recordings/staircase.csv\r"),
            ("Write the model to", "\r"),
            ("written: model.toml", ""),
        ],
    );
    assert_eq!(code, Some(0));
    assert!(error_deg(&bench, "recordings/staircase.csv") < 0.6);
}

/// Columns that are not known are asked for, with what the header looks like; several files are
/// read at once, and the model file says their columns for the commands that follow.
#[cfg(unix)]
#[test]
fn on_a_terminal_it_asks_for_columns_and_units() {
    let (bench, _) = with_example(Hidden::Nothing, 5);
    for (name, into) in [("staircase", "a.csv"), ("step60_1", "b.csv")] {
        let text = bench.text(&format!("recordings/{name}.csv"));
        let rows = text.lines().skip(1).map(|line| {
            let mut fields: Vec<f64> = line.split(',').map(|it| it.parse().unwrap()).collect();
            fields[1] /= 6.894_757;
            format!("{},{},{}\n", fields[0], fields[1], fields[2])
        });
        bench.put(
            into,
            "t,p_psi,theta\n".to_owned() + &rows.collect::<String>(),
        );
    }
    let code = converse(
        &bench,
        &[
            ("> another material, or none", "\r"),
            ("Recordings of steps", "a.csv; b.csv\r"),
            ("time=t,pressure=p_psi,angle=theta", "\r"),
            ("pressure=psi", "\r"),
            ("Write the model to", "\r"),
            ("written: model.toml", ""),
        ],
    );
    assert_eq!(code, Some(0));
    assert!(error_deg(&bench, "a.csv") < 0.6);
    assert!(
        bench
            .text("model.toml")
            .contains("units = { pressure = \"psi\" }")
    );
}

/// A material of which nothing could be used is neither in the numbers nor forgotten.
#[test]
fn a_material_that_is_not_used_is_said_to_be_on_screen_and_in_the_file() {
    let (bench, _) = with_example(Hidden::Nothing, 5);
    let steps = "recordings/step30_1.csv recordings/step60_1.csv recordings/step90_1.csv recordings/staircase.csv";
    bench
        .line(&format!("init --recording {steps}"))
        .args(["--material", "Ecoflex 00-30"])
        .assert()
        .success()
        .stdout(contains("The material Ecoflex 00-30 is not used"));
    assert!(
        bench
            .text("model.toml")
            .contains("# The material Ecoflex 00-30 is not used")
    );
}

#[cfg(unix)]
#[test]
fn who_gives_up_leaves_no_trace() {
    let bench = Bench::empty();
    for (keys, code) in [("\u{1b}", 0), ("\u{3}", 130)] {
        let dialogue = [
            ("> another material, or none", keys),
            ("nothing was written", ""),
        ];
        assert_eq!(converse(&bench, &dialogue), Some(code), "{keys:?}");
        assert!(bench.contents().is_empty());
    }
}
