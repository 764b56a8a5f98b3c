//! `softrig example`, `softrig simulate`, `softrig fit` and `softrig compare`.

use assert_cmd::assert::Assert;
use predicates::prelude::*;
use predicates::str::{contains, is_empty};
use softrig_formats::model_file::ModelFile;

use super::common::{Bench, stdout};

#[test]
fn an_example_is_the_same_for_the_same_seed() {
    let bench = Bench::empty();
    for (folder, seed) in [("a", 7), ("b", 7), ("c", 8)] {
        bench
            .line(&format!("example -o {folder} --hide {seed}"))
            .assert()
            .success()
            .stderr(is_empty())
            .stdout(contains("simulated").and(contains(format!("{folder}/truth.toml"))));
    }
    let contents = bench.contents();
    let files = |folder: &str| -> Vec<_> {
        let root = bench.path(folder);
        contents
            .iter()
            .filter_map(|(path, bytes)| Some((path.strip_prefix(&root).ok()?, bytes.as_ref()?)))
            .collect()
    };
    // Two models, eleven recordings and the metadata of each.
    assert_eq!(files("a").len(), 2 + 2 * 11);
    assert!(files("a") == files("b"));
    assert!(files("a") != files("c"));
    assert_eq!(
        bench.text("a/recordings/step60_2.meta.toml"),
        "simulated = true\nprotocol = \"step60\"\nsetpoint_deg = 60.0\nrepeat = 2\n"
    );
}

/// A plan that separates nothing says what would, and writes nothing without being told to.
#[test]
fn a_plan_that_decides_nothing_is_written_only_by_force() {
    let bench = Bench::with_example("none", "0.2");
    let line = "plan --model demo/model.toml --between sensor_offset,linear_stiffness --limits kpa=10,deg=20 -o next.toml";
    bench
        .line(line)
        .assert()
        .code(2)
        .stdout(
            contains("no pressure and no known change").and(contains("Better calibrated zeros")),
        )
        .stderr(contains("--force"));
    assert!(!bench.path("next.toml").exists());
    bench.prints(&format!("{line} --force"));
    assert!(bench.path("next.toml").exists());
}

/// Sensors that are off take up a part of the angle: a fit says so, and its intervals are wider.
#[test]
fn a_fit_says_that_the_zeros_of_the_sensors_are_far() {
    let bench = Bench::with_example("none", "0.2");
    let right = bench.text("demo/recordings/step60_1.csv");
    let numbers = |line: &str| -> Vec<f64> {
        let fields = line.split(',').map(|it| it.parse().unwrap());
        fields.collect()
    };
    let rows = || right.lines().skip(1).map(numbers);
    let range = rows().map(|row| row[1]).fold(0.0, f64::max);
    let rows = rows().map(|mut fields| {
        // A sensor is sold with one to two percent.
        fields[1] -= 0.04 * range;
        fields[2] += 7.7;
        format!("{},{},{}\n", fields[0], fields[1], fields[2])
    });
    bench.put(
        "off.csv",
        "time_s,pressure_kpa,angle_deg\n".to_owned() + &rows.collect::<String>(),
    );
    let fit = |file: &str| {
        bench
            .line(&format!("fit --model demo/model.toml {file}"))
            .assert()
            .success()
    };
    // The ends of the 95 % interval of the gain, apart.
    let width = |said: &str| -> f64 {
        let line = said.lines().find(|it| it.starts_with("input_gain"));
        let interval = line.unwrap().split(" … ");
        let ends: Vec<f64> = interval
            .filter_map(|part| part.split_whitespace().next_back())
            .map(|it| it.parse().unwrap())
            .collect();
        ends[1] - ends[0]
    };
    let off = fit("off.csv").stderr(
        contains("the zero of the pressure ends up to").and(contains("the zero of the angle")),
    );
    let right = fit("demo/recordings/step60_1.csv").stderr(contains("the zero").not());
    assert!(width(&stdout(&off)) > 3.0 * width(&stdout(&right)));
}

/// The RMS error (°) that `softrig simulate` prints.
pub fn printed_error(assert: &Assert) -> f64 {
    let text = stdout(assert);
    let (_, number) = text.split_once("against the recording: ").unwrap();
    number.split('°').next().unwrap().parse().unwrap()
}

#[test]
fn simulate_follows_a_recording_in_every_arithmetic() {
    let bench = Bench::with_example("gravity", "0");
    let run = |model: &str, more: &str| {
        let line = format!(
            "simulate --model demo/{model}.toml --recording demo/recordings/step60_1.csv -o out.csv {more}"
        );
        let assert = bench.line(&line).assert().success().stderr(is_empty());
        let out = bench.recording("out.csv");
        let predicted = out.column("predicted_deg").unwrap();
        let squares: f64 = predicted
            .iter()
            .zip(&out.angle)
            .map(|(a, b)| (a - b.to_degrees()).powi(2))
            .sum();
        let rms = (squares / out.len() as f64).sqrt();
        assert!((printed_error(&assert) - rms).abs() < 1e-3);
        (rms, predicted)
    };
    let (truth, exact) = run("truth", "");
    // The converter's steps and the noise of the pressure are left.
    assert!(truth < 0.25, "{truth}");
    let (nominal, _) = run("model", "");
    assert!(nominal > 4.0 * truth, "{nominal} {truth}");
    for arithmetic in ["board", "minimax", "micromath", "board-micromath"] {
        let (_, board) = run("truth", &format!("--arithmetic {arithmetic}"));
        let apart = exact
            .iter()
            .zip(&board)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(apart > 0.0 && apart < 0.05, "{arithmetic}: {apart}°");
    }
    let (linear, _) = run("truth", "--linear --plot out.svg");
    assert!(linear > 4.0 * truth, "{linear}");
    assert!(bench.text("out.svg").contains("<svg"));
}

#[test]
fn simulate_generates_protocols() {
    let bench = Bench::new();
    for (protocol, seconds) in [("step", 6.9), ("staircase", 32.5), ("triangle", 17.5)] {
        let out = format!("{protocol}.csv");
        bench
            .line(&format!(
                "simulate --model m.toml --protocol {protocol} --angle-deg 45 --hold-s 4 -o {out}"
            ))
            .assert()
            .success()
            .stderr(is_empty())
            .stdout(contains(format!("over {seconds:.2} s")).and(contains(&out)));
        let run = bench.recording(&out);
        assert!((run.duration() - seconds).abs() < 1e-9);
        let setpoint = run.column("setpoint_deg").unwrap();
        let highest = setpoint.iter().copied().fold(0.0, f64::max);
        assert!((highest - 45.0).abs() < 0.5, "{protocol}: {highest}°");
        let reach = run.angle.iter().copied().fold(0.0, f64::max).to_degrees();
        assert!(reach > 40.0 && reach < 80.0, "{protocol} reaches {reach}°");
    }
}

#[test]
fn fit_finds_the_parameters_and_writes_a_model() {
    let bench = Bench::with_example("none", "0.2");
    let runs = ["step60_1", "step90_1", "triangle"].map(|run| format!("demo/recordings/{run}.csv"));
    // RMS error over all runs (°), before and after.
    let fit = |model: &str, to: &str| {
        let assert = bench
            .line(&format!("fit --model {model} {} -o {to}", runs.join(" ")))
            .assert()
            .success()
            .stdout(contains("95 % interval").and(contains(format!("written: {to}"))));
        let text = stdout(&assert);
        let all = text.lines().find(|line| line.starts_with("all ")).unwrap();
        let errors: Vec<f64> = all
            .split_whitespace()
            .skip(1)
            .map(|number| number.parse().unwrap())
            .collect();
        (errors[0], errors[1])
    };
    let (before, after) = fit("demo/model.toml", "fitted.toml");
    // White noise of 0.2° and the converter's steps are left.
    assert!(after < 0.25 && before > 2.0 * after, "{before} {after}");
    let shown = bench
        .line(&format!("fit --model demo/model.toml {}", runs.join(" ")))
        .assert();
    let shown = stdout(&shown);
    let table = shown.lines().take_while(|line| !line.starts_with("Zeros"));
    for number in table.flat_map(|line| line.split_whitespace().skip(1)) {
        let digits: String = number.chars().filter(char::is_ascii_digit).collect();
        let significant = digits.trim_start_matches('0').len();
        let is_number = number.starts_with(|c: char| c.is_ascii_digit());
        assert!(!is_number || significant <= 3, "{number} in\n{shown}");
    }
    let read = |name: &str| ModelFile::read(&bench.path(name)).unwrap();
    let nominal = read("demo/model.toml");
    let (fitted, truth) = (read("fitted.toml"), read("demo/truth.toml"));
    assert_eq!(fitted.free, nominal.free);
    assert_eq!(fitted.name, nominal.name);
    let off = |file: &ModelFile, id| {
        (file.model.value(id).unwrap() / truth.model.value(id).unwrap() - 1.0).abs()
    };
    for &id in &fitted.free {
        let name = fitted.parameter_name(id);
        assert!(
            off(&fitted, id) < 0.02,
            "{name} is off by {}",
            off(&fitted, id)
        );
    }
    assert!(fitted.free.iter().any(|&id| off(&nominal, id) > 0.05));
    // What was written is where the fit ended.
    let (again, _) = fit("fitted.toml", "again.toml");
    assert!((again - after).abs() < 2e-3, "{again} {after}");
}

#[test]
fn compare_prints_and_writes_the_table() {
    let bench = Bench::with_example("coulomb_friction", "0.3");
    let runs: Vec<String> = ["step30", "step60", "step90"]
        .iter()
        .flat_map(|step| (1..=3).map(move |k| format!("demo/recordings/{step}_{k}.csv")))
        .collect();
    let line = format!(
        "compare --model demo/model.toml --model demo/truth.toml --linear -o table.csv {}",
        runs.join(" ")
    );
    let printed = stdout(&bench.line(&line).assert().success().stderr(is_empty()));
    for setpoint in ["30.0°", "60.0°", "90.0°"] {
        let row = printed.lines().find(|row| row.contains(setpoint)).unwrap();
        assert_eq!(row.split_whitespace().nth(2), Some("3"), "{row}");
        assert_eq!(row.matches(" %)").count(), 3, "{row}");
    }
    let mut table = csv::Reader::from_path(bench.path("table.csv")).unwrap();
    assert_eq!(
        table.headers().unwrap(),
        &[
            "run",
            "setpoint_deg",
            "repeats",
            "model",
            "rms_deg",
            "rms_percent"
        ][..]
    );
    let rows: Vec<csv::StringRecord> = table.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 3 * 3);
    let number = |text: &str| -> f64 { text.parse().unwrap() };
    for row in &rows {
        let percent = 100.0 * number(&row[4]) / number(&row[1]);
        assert!((number(&row[5]) - percent).abs() < 0.01, "{row:?}");
        assert_eq!(&row[2], "3");
    }
    for setpoint in 0..3 {
        let [nominal, truth, linear] = [0, 3, 6].map(|model| number(&rows[model + setpoint][4]));
        // The mean of three runs with noise of 0.3°.
        assert!(truth < 0.25, "{truth}");
        assert!(
            nominal > 2.0 * truth && linear > 2.0 * truth,
            "{nominal} {linear}"
        );
    }
}
