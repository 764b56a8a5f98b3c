//! The `rig` command as its users meet it: what it prints, writes and returns.
//!
//! A lab hands over damaged files, swapped columns and slips of the keyboard.
//! Each has to end in one sentence that says where and what to do, in exit
//! code 2, and in a folder that is as it was.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Stdio;
#[cfg(unix)]
use std::time::Duration;

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use host_tools::io::model_file::ModelFile;
use host_tools::io::recording::Recording;
use predicates::prelude::*;
use predicates::str::{contains, is_empty, is_match};
use serde_json::Value;
use tempfile::TempDir;

const MODEL: &str = r#"schema = 1
name = "bench actuator"

[dynamics]
inertia_kg_m = 0.36
damping_n_s_per_rad = 0.913
stiffness_n_per_rad_n = 4.2
exponent = 1.727
input_gain_n_per_kpa = 0.12

[fit]
free = ["damping", "stiffness", "input_gain"]

[[effect]]
kind = "coulomb_friction"
force_n = 0.02
"#;

const HEADER: &str = "time_s,pressure_kpa,angle_deg\n";

/// A step that rises to 50°, with neither noise nor fault.
fn clean_recording() -> String {
    let rows = (0..200).map(|k| {
        let time = f64::from(k) * 0.01;
        let angle = 50.0 * (1.0 - (-2.0 * time).exp());
        format!("{time:.2},30.0,{angle:.4}\n")
    });
    HEADER.to_owned() + &rows.collect::<String>()
}

fn compressed(text: &str) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(text.as_bytes()).unwrap();
    encoder.finish().unwrap()
}

/// A folder to run commands in.
struct Bench(TempDir);

impl Bench {
    /// A folder with `m.toml` and the recordings `good.csv` and `other.csv`.
    fn new() -> Self {
        let bench = Self::empty();
        bench.put("m.toml", MODEL);
        bench.put("good.csv", clean_recording());
        bench.put("other.csv", clean_recording());
        bench
    }

    fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with an example that hides `effect`, in `demo`.
    fn with_example(effect: &str, noise_deg: &str) -> Self {
        let bench = Self::empty();
        bench
            .line("example -o demo --hide 11")
            .args(["--effect", effect, "--noise-deg", noise_deg])
            .assert()
            .success();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn recording(&self, name: &str) -> Recording {
        Recording::read(&self.path(name)).unwrap().0
    }

    /// `rig` with a command line without quotes.
    fn line(&self, line: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rig"));
        command
            .current_dir(self.0.path())
            // A panic would print its backtrace.
            .env("RUST_BACKTRACE", "1")
            .args(line.split_whitespace());
        command
    }

    /// Every file and folder with its content.
    fn contents(&self) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
        fn collect(folder: &Path, into: &mut BTreeMap<PathBuf, Option<Vec<u8>>>) {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    into.insert(path.clone(), None);
                    collect(&path, into);
                } else {
                    let bytes = std::fs::read(&path).unwrap();
                    into.insert(path, Some(bytes));
                }
            }
        }
        let mut contents = BTreeMap::new();
        collect(self.0.path(), &mut contents);
        contents
    }

    /// Asserts that the command is refused in one sentence with these parts in
    /// this order, and that it leaves the folder as it was.
    fn refuses(&self, line: &str, parts: &[&str]) {
        let before = self.contents();
        let assert = self.line(line).assert().code(2).stdout(is_empty());
        let said = stderr(&assert);
        let sentence = said
            .strip_prefix("error: ")
            .unwrap_or_else(|| panic!("`rig {line}` does not begin with \"error: \": {said:?}"));
        assert_eq!(said.lines().count(), 1, "`rig {line}` says {said:?}");
        let mut rest = sentence;
        for part in parts {
            rest = rest
                .split_once(part)
                .unwrap_or_else(|| panic!("`rig {line}`: no {part:?} (in order) in {said:?}"))
                .1;
        }
        let advice = sentence.rsplit_once("; ").map_or("", |(_, advice)| advice);
        assert!(advice.len() > 8, "`rig {line}` gives no advice: {said:?}");
        assert!(
            before == self.contents(),
            "`rig {line}` changed the folder, and said {said:?}"
        );
    }
}

fn stdout(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stdout.clone()).unwrap()
}

fn stderr(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stderr.clone()).unwrap()
}

/// Commands that read a recording, with everything that they could write.
const READERS: [&str; 5] = [
    "simulate --model m.toml --recording {} -o out.csv --plot out.svg",
    "fit --model m.toml good.csv {} -o out.toml",
    "compare --model m.toml {} good.csv -o out.csv",
    "diagnose --model m.toml good.csv {} --json out.json --plot out.svg -o out.toml",
    "diagnose --model m.toml good.csv other.csv --holdout {} --json out.json -o out.toml",
];

#[test]
fn damaged_rows_are_refused_with_line_and_column() {
    let good = clean_recording();
    let lines: Vec<&str> = good.lines().collect();
    let bench = Bench::new();
    for (row, parts) in [
        (
            "0.29,30.0,NaN",
            ["column angle_deg", "NaN", "delete the rows"],
        ),
        (
            "0.29,inf,3",
            ["column pressure_kpa", "inf", "delete the rows"],
        ),
        (
            "0.29,30.0,3°",
            ["column angle_deg", "\"3°\" is not a number", "no unit"],
        ),
        (
            "0.29,,3",
            ["column pressure_kpa", "is empty", "delete the row"],
        ),
        (
            "0.28,30.0,3",
            [
                "column time_s",
                "0.28 s does not follow 0.28 s",
                "must increase",
            ],
        ),
        (
            "0.1,30.0,3",
            ["column time_s", "0.1 s does not follow", "clock restarts"],
        ),
        (
            "0.29,30.0,3,4",
            ["column 4", "4 of 3 fields", "as many fields"],
        ),
        ("0.29,30.0", ["column 3", "2 of 3 fields", "as many fields"]),
    ] {
        let mut lines = lines.clone();
        lines[30] = row;
        bench.put("bad.csv", lines.join("\n") + "\n");
        for command in READERS {
            let line = command.replace("{}", "bad.csv");
            bench.refuses(&line, &[&["bad.csv, line 31, "], &parts[..]].concat());
        }
    }
}

#[test]
fn damaged_files_are_refused_with_their_place() {
    let good = clean_recording();
    let packed = compressed(&good);
    let cases: [(&str, Vec<u8>, &[&str]); 8] = [
        (
            "column.csv",
            good.replace("pressure_kpa", "pressure_psi").into(),
            &[
                "column.csv, line 1, column pressure_kpa",
                "has no column pressure_kpa",
                "pressure_psi",
                "rename",
            ],
        ),
        (
            "spaces.csv",
            good.replace(',', " ").into(),
            &[
                "spaces.csv, line 1, column time_s",
                "time_s pressure_kpa",
                "separate the columns",
            ],
        ),
        (
            "cut.csv",
            good[..good.len() - 10].into(),
            &[
                "cut.csv, line 201, column 3",
                "2 of 3 fields",
                "cut off",
                "delete this line",
            ],
        ),
        (
            "cut.csv.gz",
            packed[..packed.len() / 2].into(),
            &["cut.csv.gz", "ends in the middle", "copy it again"],
        ),
        (
            "plain.csv.gz",
            good.clone().into(),
            &["plain.csv.gz", "gzip"],
        ),
        (
            "empty.csv",
            Vec::new(),
            &["empty.csv", "is empty", "record it again"],
        ),
        (
            "header.csv",
            HEADER.into(),
            &["header.csv", "0 samples", "at least two"],
        ),
        (
            "image.csv",
            vec![0xff, 0xd8, 0xff, 0xe0, 0x00],
            &["image.csv", "UTF-8", "give a CSV"],
        ),
    ];
    let bench = Bench::new();
    for (name, content, parts) in &cases {
        bench.put(name, content);
        for command in READERS {
            bench.refuses(&command.replace("{}", name), parts);
        }
    }
    for command in READERS {
        let line = command.replace("{}", "absent.csv");
        bench.refuses(&line, &["absent.csv", "No such file", "check the path"]);
    }
    bench.put("other.meta.toml", "simulated = true\nrepeat = \"two\"\n");
    for command in &READERS[..4] {
        let line = command.replace("{}", "other.csv");
        bench.refuses(&line, &["other.meta.toml, line 2, column 10", "optional"]);
    }
}

/// Commands that read a model, with everything that they could write.
const MODEL_READERS: [&str; 4] = [
    "simulate --model bad.toml --protocol step -o out.csv --plot out.svg",
    "fit --model bad.toml good.csv -o out.toml",
    "compare --model m.toml --model bad.toml good.csv -o out.csv",
    "diagnose --model bad.toml good.csv other.csv --json out.json --plot out.svg -o out.toml",
];

#[test]
fn faults_of_a_model_are_refused_with_their_place() {
    let bench = Bench::new();
    let cases: [(&str, &str, &[&str]); 12] = [
        (
            "schema = 1",
            "schema = 7",
            &["line 1, column 10", "schema is 7", "reads schema 1"],
        ),
        (
            "schema = 1\n",
            "",
            &["has no schema number", "`schema = 1`"],
        ),
        ("= 0.913", "= ", &["line 6", "correct the TOML"]),
        (
            "coulomb_friction",
            "colomb_friction",
            &[
                "line 15, column 8",
                "colomb_friction",
                "not a known kind",
                "coulomb_friction",
            ],
        ),
        (
            "= 4.2",
            "= -4.2",
            &[
                "line 7, column 25",
                "stiffness_n_per_rad_n = -4.2 must not be negative",
                "give a value from 0 to 1e12 N/radⁿ",
            ],
        ),
        (
            "= 1.727",
            "= 0",
            &[
                "line 8, column 12",
                "exponent = 0 must be above zero",
                "give a value from 0.01 to 20",
            ],
        ),
        (
            "= 1.727",
            "= -2",
            &[
                "line 8, column 12",
                "exponent = -2 must be above zero",
                "give a value from 0.01 to 20",
            ],
        ),
        (
            "= 0.36",
            "= nan",
            &["line 5, column 16", "inertia_kg_m = nan", "finite"],
        ),
        (
            "\"stiffness\"",
            "\"stifness\"",
            &[
                "line 12, column 20",
                "\"stifness\"",
                "does not have",
                "use any of: inertia, damping, stiffness",
            ],
        ),
        (
            "\"stiffness\"",
            "\"gravity.force_n\"",
            &[
                "line 12, column 20",
                "\"gravity.force_n\"",
                "coulomb_friction.force_n",
            ],
        ),
        (
            "force_n = 0.02",
            "force_n = -0.02",
            &["line 16, column 11", "outside", "give a value from"],
        ),
        (
            "[dynamics]",
            "[dynamic]",
            &["line 4", "no key dynamic", "dynamics"],
        ),
    ];
    for (from, to, parts) in cases {
        assert!(MODEL.contains(from), "{from:?} is not in the model");
        bench.put("bad.toml", MODEL.replacen(from, to, 1));
        for command in MODEL_READERS {
            bench.refuses(command, &[&["bad.toml"], parts].concat());
        }
    }
}

#[test]
fn models_that_are_not_there_are_refused() {
    let bench = Bench::new();
    bench.put("bad.toml", "");
    for command in MODEL_READERS {
        bench.refuses(command, &["bad.toml", "is empty", "rig init"]);
    }
    std::fs::remove_file(bench.path("bad.toml")).unwrap();
    for command in MODEL_READERS {
        bench.refuses(command, &["bad.toml", "No such file", "check the path"]);
    }
}

#[test]
fn slips_of_units_are_asked_about_and_not_refused() {
    let bench = Bench::new();
    let questions = |rows: &str| {
        bench.put("run.csv", format!("{HEADER}0,0,0\n{rows}"));
        bench
            .line("simulate --model m.toml --recording run.csv")
            .assert()
            .success()
    };
    // One question for each column, at the first row that raises it.
    questions("0.01,30,721\n0.02,30,900\n").stderr(
        is_match("^warning: run.csv, line 3, column angle_deg: 721 .*degrees.*\\?\n$").unwrap(),
    );
    questions("0.01,601,1\n0.02,30000,2\n").stderr(
        is_match("^warning: run.csv, line 3, column pressure_kpa: 601 .*kPa.*\\?\n$").unwrap(),
    );
    questions("0.01,600,720\n0.02,-600,-720\n").stderr(is_empty());
}

/// A recording whose numbers are changed, row by row.
fn rewritten(text: &str, change: impl Fn([f64; 3]) -> [f64; 3]) -> String {
    let rows = text.lines().skip(1).map(|line| {
        let mut fields = line.split(',').map(|field| field.parse::<f64>().unwrap());
        let row = std::array::from_fn(|_| fields.next().unwrap());
        let [time, pressure, angle] = change(row);
        format!("{time},{pressure},{angle}\n")
    });
    HEADER.to_owned() + &rows.collect::<String>()
}

/// Flags of the command line, and a file of other columns that they mend.
type Mended = (&'static str, fn([f64; 3]) -> [f64; 3]);

const MENDED: [Mended; 8] = [
    ("--units time=ms", |[t, p, a]| [t * 1e3, p, a]),
    ("--units pressure=psi", |[t, p, a]| [t, p / 6.894_757, a]),
    ("--units pressure=bar", |[t, p, a]| [t, p / 100.0, a]),
    ("--absolute-pressure", |[t, p, a]| [t, p + 101.325, a]),
    ("--absolute-pressure=95", |[t, p, a]| [t, p + 95.0, a]),
    ("--units angle=rad", |[t, p, a]| [t, p, a.to_radians()]),
    ("--flip-angle", |[t, p, a]| [t, p, -a]),
    ("--exchange-columns", |[t, p, a]| [t, a, p]),
];

#[test]
fn flags_mend_what_columns_hold() {
    let bench = Bench::with_example("none", "0.2");
    let simulate = "simulate --model demo/model.toml --recording";
    let right = bench.text("demo/recordings/step60_1.csv");
    bench.put("right.csv", &right);
    let error = |line: &str| printed_error(&bench.line(line).assert().success());
    let expected = error(&format!("{simulate} right.csv"));
    for (flags, change) in MENDED {
        bench.put("other.csv", rewritten(&right, change));
        let found = error(&format!("{simulate} other.csv {flags}"));
        assert!(
            (found - expected).abs() < 0.02,
            "{flags}: {found}° instead of {expected}°"
        );
    }
}

#[test]
fn a_fit_and_a_diagnosis_refuse_other_columns_at_once_and_name_the_flags() {
    let bench = Bench::with_example("none", "0.2");
    let right = bench.text("demo/recordings/step60_1.csv");
    for (flags, change) in MENDED {
        bench.put("a.csv", rewritten(&right, change));
        bench.put("b.csv", rewritten(&right, change));
        // 95.0 kPa is what such a recording rests at, but for its noise.
        let flags = flags.strip_suffix("95").unwrap_or(flags);
        for command in ["fit", "diagnose"] {
            let clock = std::time::Instant::now();
            bench.refuses(
                &format!("{command} --model demo/model.toml a.csv b.csv"),
                &["a.csv", "every recording", flags],
            );
            assert!(clock.elapsed().as_secs() < 20, "{command} {flags}");
        }
    }
}

#[test]
fn every_command_that_fits_takes_the_flags() {
    let bench = Bench::empty();
    for command in [
        "diagnose", "fit", "compare", "simulate", "plan", "gap", "convert",
    ] {
        let assert = bench.line(&format!("{command} --help")).assert().success();
        let help = stdout(&assert);
        let (_, flags) = help
            .split_once("If the columns mean something else:")
            .unwrap_or_else(|| panic!("{command}: {help}"));
        for flag in [
            "--columns",
            "--units",
            "--absolute-pressure",
            "--flip-angle",
            "--exchange-columns",
        ] {
            assert!(flags.contains(flag), "{command} {flag}");
        }
    }
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_the_work() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("folder")).unwrap();
    let mut places = vec![
        ("absent/out", "no folder absent", "create it"),
        ("good.csv/out", "no folder good.csv", "create it"),
        ("folder", "is a folder", "name of a file"),
    ];
    // A folder in which nobody can create a file, not even root.
    if cfg!(target_os = "linux") {
        places.push(("/proc/out", "cannot be written", "check that the folder"));
    }
    for (place, found, advice) in places {
        for command in [
            "simulate --model m.toml --protocol step -o {}",
            "simulate --model m.toml --protocol step --plot {}",
            "simulate --model m.toml --protocol step -o out.csv --plot {}",
            "fit --model m.toml good.csv -o {}",
            "compare --model m.toml good.csv -o {}",
            "diagnose --model m.toml good.csv other.csv --json {}",
            "diagnose --model m.toml good.csv other.csv --json out.json -o out.toml --plot {}",
            "diagnose --model m.toml good.csv other.csv --json out.json --plot out.svg -o {}",
            "diagnose --model m.toml good.csv other.csv -o out.toml --report {}",
        ] {
            bench.refuses(&command.replace("{}", place), &[place, found, advice]);
        }
    }
    bench.refuses(
        "diagnose --model m.toml good.csv other.csv --json out -o out",
        &["out: is named for two results", "a file of its own"],
    );
    bench.refuses(
        "diagnose --model m.toml good.csv other.csv --json out --report out",
        &["out: is named for two results", "a file of its own"],
    );
    bench.refuses(
        "example -o good.csv",
        &[
            "good.csv/recordings",
            "cannot be created",
            "choose a folder",
        ],
    );
}

/// Every flag that writes a file, `{}` in its place.
const WRITERS: [&str; 17] = [
    "diagnose --model m.toml good.csv other.csv -o {}",
    "diagnose --model m.toml good.csv other.csv --json {}",
    "diagnose --model m.toml good.csv other.csv --plot {}",
    "diagnose --model m.toml good.csv other.csv --report {}",
    "diagnose --model m.toml good.csv --holdout other.csv -o {}",
    "fit --model m.toml good.csv other.csv -o {}",
    "compare --model m.toml good.csv other.csv -o {}",
    "simulate --model m.toml --recording good.csv -o {}",
    "simulate --model m.toml --recording good.csv --plot {}",
    "simulate --model m.toml --protocol p.toml --plot {}",
    "plan --model m.toml --between gravity,leak good.csv other.csv -o {}",
    "gap good.csv other.csv --plot {}",
    "materials list --json {}",
    "materials fit-curve good.csv --json {}",
    "materials fit-curve good.csv --plot {}",
    "materials predict --modulus-mpa 0.3 --viscosity-cps 20000 --tensile-mpa 4 --json {}",
    "record --port nowhere --seconds 1 -o {}",
];

#[test]
fn what_is_worth_keeping_is_never_written_over() {
    let bench = Bench::new();
    bench.put(
        "p.toml",
        "schema = 1\nname = \"p\"\n\n[[segment]]\nkind = \"release\"\nduration_s = 1\n",
    );
    bench.put("diary.txt", "Monday: cut the tube.\n");
    bench.put("theirs.csv", "Time (ms);Pressure (psi);Bend\n0;1;2\n");
    bench.put("packed.csv.gz", compressed(&clean_recording()));
    let kept = [
        "good.csv",
        "other.csv",
        "theirs.csv",
        "packed.csv.gz",
        "m.toml",
        "diary.txt",
    ];
    for writer in WRITERS {
        for file in kept {
            // A recording's name has to end so.
            if writer.starts_with("record") && Path::new(file).extension() != Some("csv".as_ref()) {
                continue;
            }
            bench.refuses(&writer.replace("{}", file), &[file]);
        }
    }
    // By whatever name.
    for (line, parts) in [
        (
            "diagnose --model m.toml -o good.csv other.csv",
            [
                "good.csv: is a recording, and -o would write a model over it",
                "-o repaired.toml",
            ],
        ),
        (
            "diagnose --model m.toml good.csv other.csv -o ./good.csv",
            [
                "good.csv: is read by this command, and -o",
                "-o repaired.toml",
            ],
        ),
        (
            "fit --model m.toml good.csv -o m.toml",
            [
                "m.toml: is read by this command, and -o",
                "-o repaired.toml",
            ],
        ),
        (
            "diagnose --model m.toml good.csv other.csv --json diary.txt",
            [
                "diary.txt: is something else, and --json",
                "--json verdict.json",
            ],
        ),
        (
            "simulate --model m.toml --protocol p.toml --plot p.toml",
            [
                "p.toml: is read by this command, and --plot",
                "--plot picture.svg",
            ],
        ),
        (
            "simulate --model m.toml --protocol step -o other.csv",
            ["other.csv: is a recording that exists", "another name"],
        ),
        (
            "simulate --model m.toml --recording other.csv -o ./other.csv",
            ["other.csv: is read by this command, and -o", "-o new.csv"],
        ),
    ] {
        bench.refuses(line, &parts);
    }
    bench.put("model.toml", MODEL);
    bench.refuses(
        "example -o .",
        &["model.toml: is there", "give -o a folder of its own"],
    );
}

#[test]
fn a_result_replaces_an_earlier_one_of_its_kind() {
    let bench = Bench::new();
    for line in [
        "fit --model m.toml good.csv -o fitted.toml",
        "compare --model m.toml good.csv -o table.csv",
        "simulate --model m.toml --protocol step --plot run.svg",
        "simulate --model m.toml --protocol step -o run.csv",
        "simulate --model m.toml --recording good.csv -o predicted.csv",
        "materials list --json table.json",
        "example -o demo",
    ] {
        for _ in 0..2 {
            bench.line(line).assert().success();
        }
    }
}

#[test]
fn a_diagnosis_needs_runs_that_were_not_fitted() {
    let bench = Bench::new();
    let outputs = "--json out.json --plot out.svg -o out.toml";
    // The parts of a single session are left out in turn, if it has some.
    let good = bench.text("good.csv");
    let short: String = good
        .lines()
        .take(60)
        .flat_map(|line| [line, "\n"])
        .collect();
    bench.put("short.csv", &short);
    bench.refuses(
        &format!("diagnose --model m.toml short.csv {outputs}"),
        &["two runs or more, and 1 can be used", "--holdout"],
    );
    for twice in [
        "good.csv good.csv",
        "good.csv ./good.csv",
        "good.csv --holdout good.csv",
        "other.csv good.csv --holdout good.csv",
    ] {
        bench.refuses(
            &format!("diagnose --model m.toml {outputs} {twice}"),
            &["good.csv", "is given twice", "name each recording once"],
        );
    }
}

#[test]
fn faults_of_arguments_exit_with_2() {
    let bench = Bench::new();
    for (line, part) in [
        ("", "Usage: rig <COMMAND>"),
        (
            "diagnoze --model m.toml",
            "unrecognized subcommand 'diagnoze'",
        ),
        ("fit good.csv", "--model <MODEL.toml>"),
        ("simulate --model m.toml", "--recording <REC.csv>"),
        (
            "simulate --model m.toml --protocol step --recording good.csv",
            "cannot be used with",
        ),
        (
            "simulate --model m.toml --protocol step --angle-deg 3000",
            "0.1 to 360 degrees",
        ),
        (
            "simulate --model m.toml --protocol step --hold-s nan",
            "0.1 to 3600 seconds",
        ),
        (
            "simulate --model m.toml --protocol step --arithmetic f16",
            "board-micromath",
        ),
        (
            "diagnose --model m.toml good.csv other.csv --seed=-1",
            "--seed",
        ),
        (
            "fit --model m.toml good.csv --absolute-pressure=500",
            "from 0 to 110 kPa",
        ),
        ("fit --model m.toml good.csv --pressure-in atm", "kpa, psi"),
        (
            "fit --model m.toml good.csv --units pressure=atm",
            "kpa, psi",
        ),
        ("fit --model m.toml good.csv --columns p=q", "none of time"),
        (
            "fit --model m.toml good.csv --units time=s --time-in ms",
            "cannot be used with",
        ),
        ("completions tcsh", "bash"),
    ] {
        let before = bench.contents();
        bench
            .line(line)
            .assert()
            .code(2)
            .stdout(is_empty())
            .stderr(contains(part).and(contains("panicked").not()));
        assert!(before == bench.contents());
    }
    for (line, parts) in [
        (
            "example -o demo --effect frictoin",
            ["frictoin is not a known kind", "none", "coulomb_friction"],
        ),
        (
            "example -o demo --noise-deg nan",
            ["the noise is NaN°", "between 0", "20 degrees"],
        ),
        (
            "example -o demo --noise-deg=-1",
            ["the noise is -1°", "between 0", "20 degrees"],
        ),
    ] {
        bench.refuses(line, &parts);
    }
}

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

/// The RMS error (°) that `rig simulate` prints.
fn printed_error(assert: &Assert) -> f64 {
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
    for arithmetic in ["board", "board-micromath"] {
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
fn compressed_recordings_equal_plain_ones() {
    let bench = Bench::new();
    let text = clean_recording();
    bench.put("packed.csv.gz", compressed(&text));
    // As a recorder leaves it that appends to a compressed file.
    let (head, tail) = text.split_at(text.len() / 2);
    bench.put(
        "appended.csv.gz",
        [compressed(head), compressed(tail)].concat(),
    );
    let simulated = |name: &str| {
        bench
            .line(&format!(
                "simulate --model m.toml --recording {name} -o out.csv"
            ))
            .assert()
            .success()
            .stderr(is_empty());
        bench.text("out.csv")
    };
    let plain = simulated("good.csv");
    assert_eq!(plain.lines().count(), 201);
    assert_eq!(plain, simulated("packed.csv.gz"));
    assert_eq!(plain, simulated("appended.csv.gz"));
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

/// The keys of an object in the order in which they were written.
fn keys(value: &Value) -> Vec<&str> {
    value
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect()
}

fn assert_numbers(value: &Value, wanted: &[&str]) {
    assert_eq!(keys(value), wanted);
    for (key, number) in value.as_object().unwrap() {
        assert!(number.as_f64().is_some(), "{key} is {number}");
    }
}

/// Whether `value` obeys `schema`, for the part of JSON Schema that `rig schema`
/// uses; a keyword beyond it is an error and not passed over.
fn obeys(value: &Value, schema: &Value, root: &Value) -> bool {
    let Value::Object(rules) = schema else {
        return schema == true;
    };
    rules.iter().all(|(keyword, rule)| match keyword.as_str() {
        // Words about the schema; formats are notes as well by default.
        "$schema" | "$defs" | "title" | "description" | "format" | "default" => true,
        "$ref" => {
            let place = rule.as_str().unwrap().strip_prefix('#').unwrap();
            obeys(value, root.pointer(place).unwrap(), root)
        }
        "type" if rule.is_array() => {
            let kinds = rule.as_array().unwrap().iter();
            kinds
                .map(|kind| serde_json::json!({ "type": kind }))
                .any(|rule| obeys(value, &rule, root))
        }
        "type" => match rule.as_str().unwrap() {
            "object" => value.is_object(),
            "array" => value.is_array(),
            "string" => value.is_string(),
            "boolean" => value.is_boolean(),
            "number" => value.is_number(),
            "integer" => value.is_i64() || value.is_u64(),
            "null" => value.is_null(),
            other => panic!("unknown type {other}"),
        },
        "const" => value == rule,
        "minimum" => value
            .as_f64()
            .is_none_or(|number| number >= rule.as_f64().unwrap()),
        "oneOf" => {
            let list = rule.as_array().unwrap();
            list.iter().filter(|rule| obeys(value, rule, root)).count() == 1
        }
        "anyOf" => {
            let mut list = rule.as_array().unwrap().iter();
            list.any(|rule| obeys(value, rule, root))
        }
        "required" => value.as_object().is_none_or(|object| {
            let mut keys = rule.as_array().unwrap().iter();
            keys.all(|key| object.contains_key(key.as_str().unwrap()))
        }),
        "properties" => value.as_object().is_none_or(|object| {
            let mut members = object.iter();
            members.all(|(key, member)| rule.get(key).is_none_or(|rule| obeys(member, rule, root)))
        }),
        "additionalProperties" => {
            assert!(rule == true, "unknown rule {rule}");
            true
        }
        "items" => value
            .as_array()
            .is_none_or(|list| list.iter().all(|item| obeys(item, rule, root))),
        other => panic!("unknown keyword {other}"),
    })
}

/// Checks everything that a verdict promises, whatever it says.
fn assert_verdict(verdict: &Value, schema: &Value) {
    assert!(obeys(verdict, schema, schema), "{verdict:#}");
    // What is only there where it says something.
    let optional = [
        "strength",
        "family",
        "closure",
        "repair",
        "ended",
        "not_tried",
    ];
    let mut always = keys(verdict);
    always.retain(|key| !optional.contains(key));
    assert_eq!(
        always.join(" "),
        "schema verdict effects alternatives adequacy remaining where rmse_deg \
         holdout_rmse_deg nuisance upload next_experiment recordings seed tool_version seconds"
    );
    assert_eq!(
        verdict["strength"].is_string(),
        verdict["verdict"] == "effect_found"
    );
    assert_eq!(verdict["schema"], 1);
    let list = |key: &str| verdict[key].as_array().unwrap();
    let share = |value: &Value| value.as_f64().is_some_and(|p| (0.0..=1.0).contains(&p));
    for effect in list("effects") {
        assert_eq!(
            keys(effect),
            ["kind", "parameters", "interval95", "probability"]
        );
        assert!(share(&effect["probability"]), "{effect}");
        for (key, interval) in effect["interval95"].as_object().unwrap() {
            let value = effect["parameters"][key].as_f64().unwrap();
            let ends: Vec<f64> = serde_json::from_value(interval.clone()).unwrap();
            assert!(ends.len() == 2 && ends[0] < value && value < ends[1]);
        }
    }
    for rival in list("alternatives") {
        assert_eq!(keys(rival), ["kinds", "probability", "delta_bic"]);
        assert!(share(&rival["probability"]), "{rival}");
        assert!(!rival["kinds"].as_array().unwrap().is_empty());
    }
    for place in list("where") {
        assert_eq!(keys(place), ["feature", "share_of_gap", "text"]);
        assert!(share(&place["share_of_gap"]), "{place}");
        assert!(place["text"].as_str().is_some_and(|text| text.len() > 10));
    }
    for run in list("next_experiment") {
        assert_eq!(keys(run), ["protocol", "separates", "expected_delta_chi2"]);
    }
    let adequacy = &verdict["adequacy"];
    assert_eq!(
        keys(adequacy),
        ["adequate", "holdout_gap_closed", "exact_form"]
    );
    assert!(adequacy["adequate"].is_boolean() && adequacy["exact_form"].is_boolean());
    assert!(adequacy["holdout_gap_closed"].is_number());
    assert_numbers(
        &verdict["rmse_deg"],
        &["nominal", "refit", "repaired", "noise_floor"],
    );
    assert_numbers(
        &verdict["holdout_rmse_deg"],
        &["nominal", "refit", "repaired"],
    );
    assert_eq!(verdict["tool_version"], env!("CARGO_PKG_VERSION"));
    assert!(verdict["seconds"].as_f64().is_some_and(|s| s >= 0.0));
}

#[test]
fn a_diagnosis_writes_the_verdict_and_the_repaired_model() {
    let bench = Bench::with_example("quadratic_damping", "0.4");
    let printed = stdout(&bench.line("schema").assert().success().stderr(is_empty()));
    let schema: Value = serde_json::from_str(&printed).unwrap();

    let file = |name: &str| format!("demo/recordings/{name}.csv");
    let fitted = ["step30_1", "step60_1", "step90_1"].map(file);
    let held_out = ["step90_2", "triangle"].map(file);
    let diagnose = |model: &str, outputs: &str| {
        let line = format!(
            "diagnose --model {model} --seed 5 {outputs} {} --holdout {}",
            fitted.join(" "),
            held_out.join(" ")
        );
        // On a slow machine it says how far it is.
        let only_progress = is_match(r"\A(.* so far.*\n)*\z").unwrap();
        stdout(&bench.line(&line).assert().success().stderr(only_progress))
    };
    let verdict = |name: &str| -> Value { serde_json::from_str(&bench.text(name)).unwrap() };
    let said = diagnose(
        "demo/model.toml",
        "--json v.json -o repaired.toml --plot gap.svg --report report.html",
    );
    assert!(said.starts_with("The model lacks "), "{said}");
    for name in ["v.json", "repaired.toml", "gap.svg", "report.html"] {
        assert!(said.contains(name), "{name} is not in {said}");
    }
    assert!(bench.text("gap.svg").contains("<svg"));
    // The template engine escapes slashes as well.
    let page = bench.text("report.html").replace("&#x2f;", "/");
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>"));
    assert!(page.contains("rig diagnose --model demo/model.toml --seed 5 --json v.json"));

    let found = verdict("v.json");
    assert_verdict(&found, &schema);
    assert_eq!(found["verdict"], "effect_found");
    assert_eq!(found["seed"], 5);
    assert_eq!(
        found["recordings"],
        serde_json::json!([&fitted[..], &held_out[..]].concat())
    );
    assert_eq!(found["effects"].as_array().unwrap().len(), 1);
    assert_eq!(found["effects"][0]["kind"], "quadratic_damping");
    let error = |key: &str| found["holdout_rmse_deg"][key].as_f64().unwrap();
    assert!(error("repaired") < 0.5 * error("refit") && error("refit") < error("nominal"));
    // The schema refuses what is not a verdict.
    for (key, wrong) in [
        ("verdict", "perhaps".into()),
        ("effects", Value::Null),
        ("seed", (-1).into()),
    ] {
        let mut other = found.clone();
        other[key] = wrong;
        assert!(!obeys(&other, &schema, &schema), "{key}");
        other.as_object_mut().unwrap().remove(key);
        assert!(!obeys(&other, &schema, &schema), "{key}");
    }

    // The repaired model holds what the verdict says, and lacks nothing more.
    let repaired = ModelFile::read(&bench.path("repaired.toml")).unwrap();
    let effects: Vec<_> = repaired.model.effects().collect();
    assert_eq!(effects.len(), 1);
    assert_eq!(effects[0].kind().name(), "quadratic_damping");
    for (row, value) in effects[0].parameters().iter().zip(effects[0].values()) {
        let shown = found["effects"][0]["parameters"][row.key].as_f64().unwrap();
        let written = row.unit.from_si(value);
        assert!(
            (written - shown).abs() <= 1e-6 * shown.abs(),
            "{}: {written} {shown}",
            row.key
        );
    }
    let said = diagnose("repaired.toml", "--json again.json -o kept.toml");
    // Nothing is wrong with it, so it is kept: no refit, which would differ.
    assert!(said.contains("Model, unchanged: kept.toml"), "{said}");
    let kept = ModelFile::read(&bench.path("kept.toml")).unwrap();
    assert_eq!(kept.model, repaired.model);
    let again = verdict("again.json");
    assert_verdict(&again, &schema);
    assert_eq!(again["verdict"], "no_discrepancy");
    assert_eq!(again["effects"], serde_json::json!([]));

    // The same command gives the same bytes, but for the time that it took.
    diagnose("demo/model.toml", "--json same.json");
    let mut same = verdict("same.json");
    same["seconds"] = found["seconds"].clone();
    assert_eq!(same, found);
}

/// A search that its budget ends gives a whole verdict on what it tried; one that has time
/// enough gives the one that it gives without.
#[test]
fn a_budget_ends_the_search_with_a_verdict() {
    let bench = Bench::with_example("quadratic_damping", "0.4");
    let printed = stdout(&bench.line("schema").assert().success());
    let schema: Value = serde_json::from_str(&printed).unwrap();
    let recordings =
        ["step30_1", "step60_1", "step90_1"].map(|name| format!("demo/recordings/{name}.csv"));
    let diagnose = |flags: &str| -> (String, Value) {
        let line = format!(
            "diagnose --model demo/model.toml {flags} --json v.json --report r.html -o r.toml {}",
            recordings.join(" ")
        );
        let said = stdout(&bench.line(&line).assert().success());
        let verdict: Value = serde_json::from_str(&bench.text("v.json")).unwrap();
        assert_verdict(&verdict, &schema);
        (said, verdict)
    };
    let (said, at_once) = diagnose("--budget 1ms");
    assert_eq!(at_once["verdict"], "cannot_tell");
    assert_eq!(at_once["ended"], "budget");
    assert_eq!(at_once["effects"], serde_json::json!([]));
    let not_tried = at_once["not_tried"].as_array().unwrap();
    assert!(not_tried.contains(&"quadratic_damping".into()) && not_tried.len() > 20);
    assert!(
        said.starts_with("Something is missing, and the time was up"),
        "{said}"
    );
    assert!(said.contains("The time of 1 ms was up"), "{said}");
    assert!(bench.text("r.html").contains("The time of 1 ms was up"));
    ModelFile::read(&bench.path("r.toml")).unwrap();

    let (_, mut without) = diagnose("");
    let (_, with) = diagnose("--budget 3h");
    assert_eq!(without["verdict"], "effect_found");
    assert!(with.get("ended").is_none() && with.get("not_tried").is_none());
    without["seconds"] = with["seconds"].clone();
    assert_eq!(with, without);

    bench
        .line("diagnose --model demo/model.toml --budget soon demo/recordings/step30_1.csv")
        .assert()
        .code(2)
        .stderr(contains("--budget"));
}

/// The subcommands that a help text lists.
fn subcommands(help: &str) -> Vec<String> {
    help.lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        // Continued descriptions are indented further.
        .filter(|line| !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

#[test]
fn every_help_has_an_example() {
    fn visit(bench: &Bench, command: &str, seen: &mut Vec<String>) {
        let line = format!("{command} --help");
        let help = stdout(&bench.line(&line).assert().success().stderr(is_empty()));
        let (_, examples) = help
            .split_once("Examples:\n")
            .unwrap_or_else(|| panic!("`rig {command} --help` has no example"));
        let shown = format!("  rig {command}");
        assert!(
            examples.contains(shown.trim_end()),
            "no {shown:?} in {examples}"
        );
        for name in subcommands(&help) {
            visit(bench, format!("{command} {name}").trim(), seen);
        }
        seen.push(command.to_owned());
    }
    let bench = Bench::empty();
    let mut seen = Vec::new();
    visit(&bench, "", &mut seen);
    for name in ["diagnose", "materials predict", "schema", "completions"] {
        assert!(seen.contains(&name.to_owned()), "{name} is not in {seen:?}");
    }
}

#[test]
fn completions_know_every_subcommand() {
    let bench = Bench::empty();
    let help = stdout(&bench.line("--help").assert().success());
    let names = subcommands(&help);
    assert!(names.contains(&"diagnose".to_owned()));
    for (shell, mark) in [
        ("bash", "complete -F _rig"),
        ("zsh", "#compdef rig"),
        ("fish", "complete -c rig"),
    ] {
        let line = format!("completions {shell}");
        let script = stdout(&bench.line(&line).assert().success().stderr(is_empty()));
        assert!(script.contains(mark), "{shell}");
        for name in &names {
            assert!(script.contains(name), "{name} is not completed in {shell}");
        }
    }
}

#[test]
fn a_quick_diagnosis_says_nothing_on_the_way() {
    let bench = Bench::with_example("none", "0.4");
    bench
        .line("diagnose --model demo/model.toml")
        .args(["step30_1", "step60_1"].map(|name| format!("demo/recordings/{name}.csv")))
        .assert()
        .success()
        .stderr(is_empty());
}

/// Sends SIGINT to a diagnosis once it has finished a fit: what it said.
#[cfg(unix)]
fn interrupted(bench: &Bench, folder: &str) -> String {
    use rustix::process::{Pid, Signal, kill_process};

    let recordings = ["step30_1", "step60_1", "step90_1", "triangle"];
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_rig"))
        .current_dir(bench.0.path())
        .args(["diagnose", "--model", "demo/model.toml", "--resume", folder])
        .args(["--json", "v.json", "--report", "r.html"])
        .args(["--plot", "gap.svg", "-o", "repaired.toml"])
        .args(recordings.map(|name| format!("demo/recordings/{name}.csv")))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let kept = bench.path(folder).join("fits.txt");
    while std::fs::metadata(&kept).map_or(0, |file| file.len()) == 0 {
        assert_eq!(
            child.try_wait().unwrap(),
            None,
            "ended before the first fit"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
    kill_process(Pid::from_child(&child), Signal::INT).unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130));
    assert_eq!(String::from_utf8_lossy(&output.stdout), "");
    String::from_utf8(output.stderr).unwrap()
}

#[cfg(unix)]
#[test]
fn an_interrupted_diagnosis_says_what_is_known_and_writes_nothing() {
    let bench = Bench::with_example("quadratic_damping", "0.4");
    let before = bench.contents();
    let said = interrupted(&bench, "fits");
    let lines: Vec<&str> = said.lines().collect();
    let [title, stage, how_far, best, go_on] = lines.as_slice() else {
        panic!("{said}");
    };
    assert_eq!(*title, "unfinished: not a diagnosis");
    assert!(stage.starts_with("coarse fits of "), "{said}");
    assert!(how_far.contains(" fits, ") && how_far.contains(" so far"));
    assert!(best.contains(" so far"), "{said}");
    assert!(go_on.contains("repeat the command") && go_on.contains("fits"));
    let mut after = bench.contents();
    after.retain(|path, _| !path.starts_with(bench.path("fits")));
    assert!(before == after, "{:?}", after.keys());
}

#[test]
fn a_reader_that_has_seen_enough_is_no_fault() {
    let bench = Bench::with_example("none", "0.4");
    let run = "demo/recordings/step60_1.csv";
    for line in [
        "schema".to_owned(),
        "completions bash".to_owned(),
        "materials list".to_owned(),
        "example -o other".to_owned(),
        format!("simulate --model demo/model.toml --recording {run}"),
        format!("fit --model demo/model.toml {run} -o fitted.toml"),
        format!("compare --model demo/model.toml {run} -o table.csv"),
        format!("diagnose --model demo/model.toml {run} demo/recordings/step30_1.csv"),
    ] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_rig"))
            .current_dir(bench.0.path())
            .args(line.split_whitespace())
            .stdout(writer)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said, "", "`rig {line}`");
        assert!(
            output.status.success(),
            "`rig {line}` ends with {}",
            output.status
        );
    }
    // What was asked for was written all the same.
    assert!(bench.path("fitted.toml").exists() && bench.path("table.csv").exists());
}

/// Two cases in two jobs of an array, one of them at fault, and a third call that collects:
/// what is there is not diagnosed again, what failed is tried again.
#[test]
fn a_batch_is_shared_resumed_and_collected() {
    let bench = Bench::with_example("coulomb_friction", "0.1");
    let recordings: Vec<String> = std::fs::read_dir(bench.path("demo/recordings"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|it| it == "csv"))
        .map(|path| format!("recordings/{}", path.file_name().unwrap().display()))
        .collect();
    let good = recordings.join(";");
    bench.put(
        "demo/cases.csv",
        format!("case,model,recordings\nfirst,model.toml,{good}\nsecond,model.toml,lost.csv\n"),
    );
    let batch = "diagnose --batch demo/cases.csv -o out";
    bench
        .line(&format!("{batch} --share 0/2"))
        .assert()
        .success()
        .stdout(contains("1/1 first  effect_found: coulomb_friction"));
    assert!(!bench.path("out/results.parquet").exists());
    let before = bench.contents();
    bench
        .line(&format!("{batch} --share 1/2"))
        .assert()
        .failure()
        .stderr(contains("1 of 1 cases could not be diagnosed"));
    assert!(bench.text("out/second/error.txt").contains("lost.csv"));

    std::fs::copy(
        bench.path("demo").join(&recordings[0]),
        bench.path("demo/lost.csv"),
    )
    .unwrap();
    bench
        .line(batch)
        .assert()
        .success()
        .stdout(contains("first   effect_found: coulomb_friction (known)"))
        .stdout(contains("2 cases in"));
    let after = bench.contents();
    for file in ["verdict.json", "repaired.toml", "inputs.sha256"] {
        let of = |name: &str| bench.path("out").join(name).join(file);
        assert_eq!(before[&of("first")], after[&of("first")]);
        assert!(after.contains_key(&of("second")), "{file}");
    }
    assert!(!bench.path("out/second/error.txt").exists());
    assert!(bench.path("out/results.parquet").exists());

    // Another model is another case.
    bench.put("demo/model.toml", bench.text("demo/model.toml") + "\n");
    bench
        .line(&format!("{batch} --share 0/2"))
        .assert()
        .success()
        .stdout(contains("known").not());
}

/// Each case has the whole budget, and tries the user's own effects.
#[test]
fn a_batch_takes_effects_and_a_budget_for_each_case() {
    let bench = Bench::with_example("coulomb_friction", "0.1");
    let runs = "recordings/step60_1.csv;recordings/triangle.csv";
    bench.put(
        "demo/cases.csv",
        format!("case,model,recordings\nfirst,model.toml,{runs}\nsecond,model.toml,{runs}\n"),
    );
    bench.put(
        "mine.toml",
        "schema = 1\n[[effect]]\nkind = \"custom\"\nname = \"wave\"\nforce = \"a*sin(3*th)\"\n\
         parameters = { a = { value = 0.01, min = 0.0, unit = \"N\" } }\n",
    );
    let batch = "diagnose --batch demo/cases.csv -o out --effects mine.toml --budget";
    bench.line(&format!("{batch} 0s")).assert().success();
    for case in ["first", "second"] {
        let verdict: Value =
            serde_json::from_str(&bench.text(&format!("out/{case}/verdict.json"))).unwrap();
        assert_eq!(verdict["ended"], "budget", "{case}");
        let left = verdict["not_tried"].as_array().unwrap();
        assert!(left.contains(&"wave".into()), "{case}: {left:?}");
    }
    let again = |budget: &str| {
        let assert = bench.line(&format!("{batch} {budget}")).assert().success();
        stdout(&assert).matches("(known").count()
    };
    assert_eq!(again("0s"), 2);
    // Effects and budget are part of what results are of.
    bench.put("mine.toml", bench.text("mine.toml") + "\n");
    assert_eq!(again("0s"), 0);
    assert_eq!(again("1ms"), 0);
    bench.put("mine.toml", "schema = 1\n");
    bench.refuses(&format!("{batch} 0s"), &["mine.toml", "has no effect"]);
}

// ---- what others wrote ----

/// A title for the window, a cleared screen, a colour, a line that overwrites itself, and one
/// that is read from the right: what a terminal obeys.
const HOSTILE: &str = "\u{1b}]0;title\u{7}\u{1b}[2J\u{9b}31m\rgpj.\u{202e}\u{2066}\u{7f}";

/// [`HOSTILE`] in the quotes of TOML.
fn hostile_toml() -> String {
    let escaped = |c: char| format!("\\U{:08x}", u32::from(c));
    HOSTILE.chars().map(escaped).collect()
}

/// Asserts that nothing that a terminal obeys was printed, and returns all that was.
fn harmless(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let mut said = String::from_utf8(output.stdout).unwrap();
    said += &String::from_utf8(output.stderr).unwrap();
    assert!(!said.contains("panicked"), "{said}");
    let obeyed = |c: char| (c.is_control() && c != '\n') || matches!(c, '\u{202e}' | '\u{2066}');
    assert!(!said.contains(obeyed), "{command:?} said {said:?}");
    said
}

#[cfg(unix)]
#[test]
fn names_of_files_are_not_obeyed_by_the_terminal() {
    let bench = Bench::new();
    let name = |ending: &str| format!("{HOSTILE}{ending}");
    bench.put(&name(".csv"), clean_recording());
    bench.put(&name(".meta.toml"), "complete = false\n");
    bench.put(&name(".toml"), MODEL);
    bench.put("broken.csv", "");
    for (line, files) in [
        ("simulate --model m.toml --recording", vec![name(".csv")]),
        ("compare --model m.toml", vec![name(".csv")]),
        ("fit --model m.toml", vec![name(".csv")]),
        ("gap", vec![name(".csv")]),
        ("diagnose --model m.toml", vec![name(".csv")]),
        ("compare --model m.toml", vec![name("absent.csv")]),
        ("compare good.csv --model", vec![name("absent.toml")]),
        ("compare broken.csv --model", vec![name(".toml")]),
        ("compare good.csv --model", vec![name(".csv")]),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name(".csv")],
        ),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name("/out.csv")],
        ),
        (
            "simulate --protocol step --angle-deg 60 --model m.toml -o",
            vec![name("new.csv")],
        ),
        (
            "simulate --model m.toml --protocol",
            vec![name("absent.toml")],
        ),
        ("materials fit-curve", vec![name(".csv")]),
        (
            "materials predict --viscosity-cps 1 --tensile-mpa 1 --modulus-mpa",
            vec![name("")],
        ),
        ("record --dry-run --protocol", vec![name("")]),
        ("record --seconds 1 -o run.csv --port", vec![name("")]),
        ("diagnose -o out.parquet --batch", vec![name(".csv")]),
        ("example -o", vec![name(".csv")]),
        ("simulate", vec![name("")]),
        ("", vec![name("")]),
        ("compare --model m.toml --units", vec![name("")]),
        ("simulate --angle-deg", vec![name("")]),
    ] {
        let said = harmless(bench.line(line).args(files));
        assert!(
            line.starts_with("compare broken") || said.contains("\\u001b]0;title"),
            "`rig {line}` does not show the name: {said:?}"
        );
    }
}

#[test]
fn what_files_hold_is_not_obeyed_by_the_terminal() {
    let bench = Bench::new();
    let toml = hostile_toml();
    assert!(toml.starts_with("\\U0000001b\\U0000005d"), "{toml}");
    let in_model = |from: &str, to: &str| MODEL.replace(from, to);
    for (name, model) in [
        ("name.toml", in_model("bench actuator", &toml)),
        ("key.toml", in_model("exponent", &format!("\"{toml}\""))),
        ("kind.toml", in_model("coulomb_friction", &toml)),
        ("free.toml", in_model("\"stiffness\"", &format!("\"{toml}\""))),
        ("number.toml", in_model("= 4.2", &format!("= \"{toml}\""))),
        ("raw.toml", in_model("bench actuator", HOSTILE)),
        ("text.toml", HOSTILE.to_owned()),
        (
            "material.toml",
            in_model(
                "[dynamics]",
                &format!(
                    "[actuator]\nmaterial = \"{toml}\"\nlength_m = 1\nwidth_m = 1\nheight_m = 1\n[dynamics]"
                ),
            )
            .replace("exponent = 1.727\n", ""),
        ),
    ] {
        bench.put(name, model);
        for line in [
            "simulate --protocol step --angle-deg 60 --model",
            "compare good.csv --model",
            "fit good.csv --model",
        ] {
            harmless(bench.line(line).arg(name));
        }
    }
    harmless(&mut bench.line("gap good.csv"));
    harmless(&mut bench.line("diagnose good.csv other.csv --model name.toml"));

    let table = |header: &str, field: &str| {
        let text = clean_recording();
        let header = HEADER.replace("angle_deg", header);
        text.replace(HEADER, &header)
            .replacen("0.01,30.0", &format!("0.01,{field}"), 1)
    };
    bench.put("column.csv", table(HOSTILE, "30.0"));
    bench.put("more.csv", table(&format!("angle_deg,{HOSTILE}"), "30.0"));
    bench.put("field.csv", table("angle_deg", HOSTILE));
    bench.put("text.csv", HOSTILE.repeat(1_000));
    bench.put("noted.csv", clean_recording());
    bench.put(
        "noted.meta.toml",
        format!("protocol = \"{toml}\"\nsetpoint_deg = 50\n"),
    );
    bench.put("wrong.csv", clean_recording());
    bench.put("wrong.meta.toml", format!("repeat = \"{toml}\"\n"));
    bench.put("broken.csv", clean_recording());
    bench.put("broken.meta.toml", HOSTILE);
    for name in [
        "column.csv",
        "more.csv",
        "field.csv",
        "text.csv",
        "noted.csv",
        "wrong.csv",
        "broken.csv",
    ] {
        for line in [
            "simulate --model m.toml --recording",
            "compare --model m.toml",
            "gap",
            "fit --model m.toml",
            "materials fit-curve",
            "diagnose -o out.parquet --batch",
        ] {
            harmless(bench.line(line).arg(name));
        }
    }
    bench.put(
        "p.toml",
        format!(
            "schema = 1\nname = \"{toml}\"\ntitle = \"{toml}\"\n[[segment]]\nkind = \"release\"\nduration_s = 1\n"
        ),
    );
    let said = harmless(&mut bench.line("record --dry-run --protocol p.toml"));
    assert!(said.contains("\\u001b]0;title"), "{said}");
    for (from, to) in [
        ("release", toml.as_str()),
        ("duration_s", &format!("\"{toml}\"")),
    ] {
        bench.put("q.toml", bench.text("p.toml").replace(from, to));
        harmless(&mut bench.line("record --dry-run --protocol q.toml"));
    }
    bench.put(
        "batch.csv",
        format!("case,model,recordings,holdout\n{HOSTILE},{HOSTILE},{HOSTILE},{HOSTILE}\n"),
    );
    harmless(&mut bench.line("diagnose -o out.parquet --batch batch.csv"));
}

#[test]
fn a_bomb_is_refused_before_it_goes_off() {
    let bench = Bench::new();
    // Four gigabytes of empty lines in four megabytes: members may follow each other.
    let member = compressed(&"\n".repeat(1 << 24));
    bench.put("bomb.csv.gz", member.repeat(256));
    let row = compressed("time_s,pressure_kpa,angle_deg\n0,0,0\n");
    bench.put("later.csv.gz", [&row[..], &member.repeat(256)].concat());
    let field = compressed(&"9".repeat(1 << 24));
    bench.put("field.csv.gz", [&row[..], &field.repeat(256)].concat());
    for bomb in ["bomb.csv.gz", "later.csv.gz", "field.csv.gz"] {
        for reader in READERS {
            bench.refuses(
                &reader.replace("{}", bomb),
                &[
                    bomb,
                    ", line ",
                    "more than 1 MiB without a row",
                    "check that it is a recording",
                ],
            );
        }
    }
}

#[test]
fn numbers_that_no_rig_has_are_refused_with_their_range() {
    let bench = Bench::new();
    for (from, to, parts) in [
        (
            "= 4.2",
            "= 1e308",
            [
                "line 7, column 25",
                "stiffness_n_per_rad_n = 1e308",
                "from 0 to 1e12 N/radⁿ",
            ],
        ),
        (
            "= 1.727",
            "= 1e308",
            ["line 8, column 12", "exponent = 1e308", "from 0.01 to 20"],
        ),
        (
            "= 0.36",
            "= 1e-300",
            [
                "line 5, column 16",
                "inertia_kg_m = 1e-300",
                "from 1e-9 to 1e9 kg·m",
            ],
        ),
        (
            "= 0.12",
            "= -1e308",
            [
                "line 9, column 24",
                "input_gain_n_per_kpa = -1e308",
                "from -1e9 to 1e9 N/kPa",
            ],
        ),
        (
            "force_n = 0.02",
            "force_n = 1e308",
            ["line 16, column 11", "force_n = 1e308", "from 0 to 1e12 N"],
        ),
    ] {
        bench.put("wild.toml", MODEL.replace(from, to));
        for line in [
            "simulate --model wild.toml --recording good.csv -o out.csv",
            "diagnose --model wild.toml good.csv -o out.toml",
        ] {
            bench.refuses(line, &[&["wild.toml"][..], &parts].concat());
        }
    }
}

#[test]
fn whoever_reads_a_recording_is_told_that_it_is_not_complete() {
    for (meta, part) in [
        ("complete = false\n", "cut.csv: is not complete: "),
        // As versions up to 0.1 left it when they were killed.
        (
            "complete = false\nsamples = 0\n",
            "cut.csv: is not complete: ",
        ),
        (
            "complete = true\nsamples = 7\n",
            "cut.csv: has 200 rows, and ",
        ),
    ] {
        let bench = Bench::new();
        bench.put("cut.csv", clean_recording());
        bench.put("cut.meta.toml", meta);
        for line in [
            "simulate --model m.toml --recording cut.csv",
            "compare --model m.toml cut.csv",
            "fit --model m.toml cut.csv",
            "gap cut.csv",
            "diagnose --model m.toml cut.csv",
        ] {
            let said = harmless(&mut bench.line(line));
            assert_eq!(said.matches(part).count(), 1, "`rig {line}`: {said}");
        }
        bench.put("cut.meta.toml", "complete = true\nsamples = 200\n");
        let said = harmless(&mut bench.line("compare --model m.toml cut.csv"));
        assert!(!said.contains("cut.csv: "), "{said}");
    }
}

#[cfg(unix)]
/// `-o /dev/stdout`: the result goes to whoever reads, and nothing waits for what is not
/// there to be read.
#[test]
#[cfg(unix)]
fn a_result_can_go_down_a_pipe_or_behind_a_file() {
    let bench = Bench::new();
    let line = "simulate --model m.toml --recording good.csv -o";
    let shell = |script: &str| {
        Command::new("sh")
            .current_dir(bench.0.path())
            .args(["-c", script])
            .env("RIG", env!("CARGO_BIN_EXE_rig"))
            .timeout(Duration::from_secs(60))
            .assert()
            .success();
    };
    bench.line(&format!("{line} out.csv")).assert().success();
    let rows = |name: &str| -> Vec<String> {
        let text = bench.text(name);
        let is_row = |line: &&str| line.starts_with(|c: char| c.is_ascii_digit());
        text.lines().filter(is_row).map(str::to_owned).collect()
    };
    let expected = rows("out.csv");
    assert!(expected.len() > 100);
    shell(&format!("$RIG {line} /dev/stdout | cat > piped.csv"));
    assert_eq!(rows("piped.csv"), expected);
    shell(&format!(
        "mkfifo pipe; cat pipe > through.csv & $RIG {line} pipe; wait"
    ));
    assert_eq!(rows("through.csv"), expected);
    bench.put("all.csv", "kept\n");
    shell(&format!("$RIG {line} /dev/stdout >> all.csv"));
    assert!(bench.text("all.csv").starts_with("kept\n"));
    assert_eq!(rows("all.csv"), expected);
}

#[test]
fn a_full_disk_keeps_the_results_that_are_there() {
    let bench = Bench::new();
    let predicted = clean_recording().replace("angle_deg\n", "angle_deg,predicted_deg\n");
    bench.put(
        "predicted.csv",
        predicted.replace('\n', ",1\n").replacen(",1\n", "\n", 1),
    );
    for line in [
        "simulate --model m.toml --recording good.csv -o out.csv",
        "simulate --model m.toml --recording good.csv --plot out.svg",
        "compare --model m.toml good.csv -o out.csv",
        "gap predicted.csv --plot out.svg",
        "fit --model m.toml good.csv -o out.toml",
        "materials list --json out.json",
    ] {
        bench.line(line).assert().success();
        let before = bench.contents();
        // No file can have a byte: as full as a disk gets without one.
        let assert = Command::new("sh")
            .current_dir(bench.0.path())
            .args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_rig"))
            .args(line.split_whitespace())
            .assert()
            .code(2);
        let out = line.rsplit(' ').next().unwrap();
        let said = stderr(&assert);
        assert!(
            said.contains(&format!("error: {out}: cannot be written: "))
                && said.contains("make space on the disk"),
            "`rig {line}`: {said}"
        );
        assert!(
            before == bench.contents(),
            "`rig {line}` changed the folder"
        );
        std::fs::remove_file(bench.path(out)).unwrap();
        let _ = std::fs::remove_file(bench.path("out.meta.toml"));
    }
}

#[test]
fn a_model_is_exported_and_may_replace_what_was_exported() {
    let bench = Bench::new();
    for (language, extension, says) in [
        ("c", "c", "softrig_run"),
        ("python", "py", "def simulate"),
        ("matlab", "m", "function angle_deg = finger("),
        ("modelica", "mo", "package finger"),
    ] {
        let line = format!("export --model m.toml --to {language} -o finger.{extension}");
        for _ in 0..2 {
            bench
                .line(&line)
                .assert()
                .success()
                .stdout(contains("written: finger"));
        }
        let code = bench.text(&format!("finger.{extension}"));
        assert!(
            code.contains(says) && code.contains("coulomb_friction"),
            "{language}"
        );
        assert!(code.contains("bench actuator"), "{language}");
        bench
            .line(&format!("export --model m.toml --to {language}"))
            .assert()
            .success()
            .stdout(contains("0.913"));
    }
}

#[test]
fn an_export_starts_as_a_recording_does() {
    let bench = Bench::with_example("none", "0.2");
    bench
        .line("export --model demo/truth.toml --to python --recording demo/recordings/triangle.csv")
        .assert()
        .success()
        .stdout(is_match(r"(?m)^START_DEG = -?[0-9.e-]+$").unwrap())
        .stdout(is_match(r"(?m)^LARGEST_ANGLE_DEG = (8|9)[0-9.]+$").unwrap());
}

#[test]
fn an_export_replaces_nothing_else() {
    let bench = Bench::new();
    bench.put("mine.c", "int main(void) { return 0; }\n");
    bench.refuses(
        "export --model m.toml --to c -o mine.c",
        &["mine.c: is something else", "-o exported.c"],
    );
    bench.refuses(
        "export --model m.toml --to c -o good.csv",
        &["good.csv: is a recording"],
    );
    bench.refuses(
        "export --model m.toml --to c -o m.toml",
        &["m.toml: is read by this command"],
    );
    bench.refuses(
        "export --model m.toml --to matlab -o 2-fingers.m",
        &[
            "2-fingers.m: is no name of a MATLAB function",
            "-o model_2_fingers.m",
        ],
    );
    bench.put("warp.toml", MODEL.replace("coulomb_friction", "warp_drive"));
    bench.refuses(
        "export --model warp.toml --to c -o warp.c",
        &["warp.toml, line 15", "not a known kind of effect"],
    );
}
