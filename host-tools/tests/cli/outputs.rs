//! Where results go, and what they never replace.

use std::path::Path;
use std::process::Stdio;
#[cfg(unix)]
use std::time::Duration;

use assert_cmd::Command;

use super::common::{Bench, MODEL, clean_recording, compressed, stderr};

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
    bench.put("packed.csv.gz", compressed(clean_recording()));
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

/// `-o /dev/stdout`: the result goes to whoever reads, and nothing waits for what is not
/// there to be read.
#[cfg(unix)]
#[test]
fn a_result_can_go_down_a_pipe_or_behind_a_file() {
    let bench = Bench::new();
    let line = "simulate --model m.toml --recording good.csv -o";
    let shell = |script: &str| {
        Command::new("sh")
            .current_dir(bench.folder())
            .args(["-c", script])
            .env("SOFTRIG", env!("CARGO_BIN_EXE_softrig"))
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
    shell(&format!("$SOFTRIG {line} /dev/stdout | cat > piped.csv"));
    assert_eq!(rows("piped.csv"), expected);
    shell(&format!(
        "mkfifo pipe; cat pipe > through.csv & $SOFTRIG {line} pipe; wait"
    ));
    assert_eq!(rows("through.csv"), expected);
    bench.put("all.csv", "kept\n");
    shell(&format!("$SOFTRIG {line} /dev/stdout >> all.csv"));
    assert!(bench.text("all.csv").starts_with("kept\n"));
    assert_eq!(rows("all.csv"), expected);
}

#[test]
fn the_gap_as_json_is_that_of_the_table() {
    let bench = Bench::empty();
    let header = "time_s,pressure_kpa,angle_deg,predicted_deg\n";
    for (name, rows) in [
        ("a.csv", "0,0,0,3\n1,0,0,-4\n"),
        ("b.csv", "0,0,0,0\n1,0,0,5\n"),
        ("c.csv", "0,0,1,2\n1,0,1,2\n"),
    ] {
        bench.put(name, header.to_owned() + rows);
    }
    let json = |line: &str| -> (String, serde_json::Value) {
        let said = bench.prints(&format!("{line} --json gap.json"));
        assert_eq!(said, bench.prints(line));
        (said, serde_json::from_str(&bench.text("gap.json")).unwrap())
    };
    let (said, gap) = json("gap a.csv b.csv --after c.csv");
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert_eq!(gap["schema"], 1);
    let before = &gap["before"];
    assert!((number(&before["rms_deg"]) - 12.5_f64.sqrt()).abs() < 1e-12);
    assert!((number(&before["largest_deg"]) - 5.0).abs() < 1e-12);
    assert_eq!(before["runs"][0]["name"], "a");
    assert!((number(&before["runs"][1]["largest_deg"]) - 5.0).abs() < 1e-12);
    assert!((number(&gap["after"]["rms_deg"]) - 1.0).abs() < 1e-12);
    assert!(said.contains(gap["sentence"].as_str().unwrap()), "{said}");
    let (_, alone) = json("gap a.csv");
    assert!(alone["after"].is_null() && alone["sentence"].is_null());
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
        "gap predicted.csv --json out.json",
        "fit --model m.toml good.csv -o out.toml",
        "materials list --json out.json",
    ] {
        bench.line(line).assert().success();
        let before = bench.contents();
        // No file can have a byte: as full as a disk gets without one.
        let assert = Command::new("sh")
            .current_dir(bench.folder())
            .args(["-c", "trap '' XFSZ; ulimit -f 0; exec \"$0\" \"$@\""])
            .arg(env!("CARGO_BIN_EXE_softrig"))
            .args(line.split_whitespace())
            .assert()
            .code(2);
        let out = line.rsplit(' ').next().unwrap();
        let said = stderr(&assert);
        assert!(
            said.contains(&format!("error: {out}: cannot be written: "))
                && said.contains("make space on the disk"),
            "`softrig {line}`: {said}"
        );
        assert!(
            before == bench.contents(),
            "`softrig {line}` changed the folder"
        );
        std::fs::remove_file(bench.path(out)).unwrap();
        let _ = std::fs::remove_file(bench.path("out.meta.toml"));
    }
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
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"))
            .current_dir(bench.folder())
            .args(line.split_whitespace())
            .stdout(writer)
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said, "", "`softrig {line}`");
        assert!(
            output.status.success(),
            "`softrig {line}` ends with {}",
            output.status
        );
    }
    // What was asked for was written all the same.
    assert!(bench.path("fitted.toml").exists() && bench.path("table.csv").exists());
}

/// The extension of a picture says its format, and the look of one needs one.
#[test]
fn a_picture_in_a_format_that_is_not_written_is_refused() {
    let bench = Bench::new();
    let simulate = "simulate --model m.toml --protocol step";
    for name in ["fig.jpg", "fig.eps", "fig"] {
        bench.refuses(
            &format!("{simulate} --plot {name}"),
            &[name, ".svg, .pdf or .png"],
        );
    }
    bench.refuses(
        &format!("{simulate} --width 89mm"),
        &["no picture", "--plot"],
    );
    bench.fails(
        &format!("{simulate} --plot fig.svg --width 89"),
        &["89mm, 3.5in"],
    );
    bench.prints(&format!(
        "{simulate} --plot fig.svg --width 89mm --panels pressure"
    ));
    let picture = bench.text("fig.svg");
    assert!(picture.contains("width=\"89mm\""), "{picture}");
    assert!(picture.contains("pressure (kPa)") && !picture.contains("angle (°)"));
}
