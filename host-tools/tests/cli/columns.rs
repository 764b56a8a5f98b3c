//! Recordings whose columns or numbers are damaged or mean something else.

use predicates::str::{contains, is_empty, is_match};

use super::arguments::subcommands;
use super::common::{Bench, HEADER, clean_recording, compressed, stdout};
use super::hostile::harmless;
use super::simulate::printed_error;

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
            "0.29,30.0,3,4",
            ["column 4", "4 of 3 fields", "as many fields"],
        ),
        ("0.29,30.0", ["column 3", "2 of 3 fields", "as many fields"]),
    ] {
        let mut lines = lines.clone();
        lines[30] = row;
        bench.put("bad.csv", lines.join("\n") + "\n");
        for command in READERS {
            let line = command.replace("{}", "bad.csv") + " --strict";
            bench.refuses(&line, &[&["bad.csv, line 31, "], &parts[..]].concat());
        }
        // One of two hundred is left out, and said.
        bench
            .line("simulate --model m.toml --recording bad.csv")
            .assert()
            .success()
            .stderr(contains("bad.csv: 1 line is malformed (line 31)"));
    }
}

#[test]
fn times_that_are_wrong_are_mended_and_said() {
    let good = clean_recording();
    let lines: Vec<&str> = good.lines().collect();
    let bench = Bench::new();
    for (row, said) in [
        (lines[29], "1 row is there twice (line 31)"),
        ("0.1,30.0,3", "1 row has an implausible time (line 31)"),
        (
            "0.28,30.0,3",
            "1 time does not match the sampling (line 31)",
        ),
    ] {
        let mut lines = lines.clone();
        lines[30] = row;
        bench.put("bad.csv", lines.join("\n") + "\n");
        bench
            .line("simulate --model m.toml --recording bad.csv")
            .assert()
            .success()
            .stderr(contains(said));
    }
    bench.put("cut.csv", &good[..good.len() - 10]);
    bench
        .line("simulate --model m.toml --recording cut.csv")
        .assert()
        .success()
        .stderr(contains("1 line is malformed (line 201)"));
    let count = lines.len() - 1;
    let mut shuffled = lines.clone();
    for (at, line) in shuffled[1..].iter_mut().enumerate() {
        *line = lines[1 + at * 73 % count];
    }
    bench.put("bad.csv", shuffled.join("\n") + "\n");
    bench.refuses(
        "simulate --model m.toml --recording bad.csv",
        &["bad.csv, line ", "column time_s", "must increase"],
    );
}

#[test]
fn damaged_files_are_refused_with_their_place() {
    let good = clean_recording();
    let packed = compressed(&good);
    let cases: [(&str, Vec<u8>, &[&str]); 6] = [
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

#[test]
fn a_bomb_is_refused_before_it_goes_off() {
    let bench = Bench::new();
    // Four gigabytes of empty lines in four megabytes: members may follow each other.
    let member = compressed("\n".repeat(1 << 24));
    bench.put("bomb.csv.gz", member.repeat(256));
    let row = compressed("time_s,pressure_kpa,angle_deg\n0,0,0\n");
    bench.put("later.csv.gz", [&row[..], &member.repeat(256)].concat());
    let field = compressed("9".repeat(1 << 24));
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
fn whoever_reads_a_recording_is_told_that_it_is_not_complete() {
    for (meta, part) in [
        ("complete = false\n", "cut.csv: is incomplete: "),
        // As versions up to 0.1 left it when they were killed.
        (
            "complete = false\nsamples = 0\n",
            "cut.csv: is incomplete: ",
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
            assert_eq!(said.matches(part).count(), 1, "`softrig {line}`: {said}");
        }
        bench.put("cut.meta.toml", "complete = true\nsamples = 200\n");
        let said = harmless(&mut bench.line("compare --model m.toml cut.csv"));
        assert!(!said.contains("cut.csv: "), "{said}");
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

const MENDED: [Mended; 7] = [
    ("--units time=ms", |[t, p, a]| [t * 1e3, p, a]),
    ("--units pressure=psi", |[t, p, a]| [t, p / 6.894_757, a]),
    ("--units pressure=bar", |[t, p, a]| [t, p / 100.0, a]),
    ("--absolute-pressure", |[t, p, a]| [t, p + 101.325, a]),
    ("--absolute-pressure=95", |[t, p, a]| [t, p + 95.0, a]),
    ("--units angle=rad", |[t, p, a]| [t, p, a.to_radians()]),
    ("--exchange-columns", |[t, p, a]| [t, a, p]),
];

/// The same of columns with which a fit goes on, and says so.
const SAID: [Mended; 2] = [
    ("--flip-angle", |[t, p, a]| [t, p, -a]),
    ("--angle-zero=116", |[t, p, a]| [t, p, a + 116.0]),
];

#[test]
fn flags_mend_what_columns_hold() {
    let bench = Bench::with_example("none", "0.2");
    let simulate = "simulate --model demo/model.toml --recording";
    let right = bench.text("demo/recordings/step60_1.csv");
    bench.put("right.csv", &right);
    let error = |line: &str| printed_error(&bench.line(line).assert().success());
    let expected = error(&format!("{simulate} right.csv"));
    for (flags, change) in MENDED.into_iter().chain(SAID) {
        bench.put("other.csv", rewritten(&right, change));
        let found = error(&format!("{simulate} other.csv {flags}"));
        assert!(
            (found - expected).abs() < 0.02,
            "{flags}: {found}° instead of {expected}°"
        );
    }
}

#[test]
fn what_holds_a_model_to_recordings_refuses_other_columns_at_once_and_names_the_flags() {
    let commands = [
        "fit --model demo/model.toml a.csv b.csv",
        "diagnose --model demo/model.toml a.csv b.csv",
        "compare --model demo/model.toml a.csv b.csv",
        "simulate --model demo/model.toml --recording a.csv",
        "plan --model demo/model.toml --between coulomb_friction,gravity a.csv b.csv",
    ];
    let bench = Bench::with_example("none", "0.2");
    let right = bench.text("demo/recordings/step60_1.csv");
    for (flags, change) in MENDED {
        bench.put("a.csv", rewritten(&right, change));
        bench.put("b.csv", rewritten(&right, change));
        // 95.0 kPa is what such a recording rests at, but for its noise.
        let flags = flags.strip_suffix("95").unwrap_or(flags);
        for command in commands {
            let clock = std::time::Instant::now();
            bench.refuses(command, &["a.csv", "every recording", flags]);
            assert!(clock.elapsed().as_secs() < 20, "{command} {flags}");
        }
    }
}

/// A model that is far off itself says nothing of the units if another agrees.
#[test]
fn one_model_that_agrees_is_enough_for_a_comparison() {
    let bench = Bench::with_example("none", "0.2");
    let model = bench.text("demo/model.toml");
    let weak = |line: &str| match line.split_once("input_gain_n_per_kpa = ") {
        Some((before, value)) => {
            let gain: f64 = value.split_whitespace().next().unwrap().parse().unwrap();
            format!("{before}input_gain_n_per_kpa = {}", gain / 6.894_757)
        }
        None => line.to_owned(),
    };
    let lines: Vec<String> = model.lines().map(weak).collect();
    bench.put("psi.toml", lines.join("\n"));
    let run = "demo/recordings/step60_1.csv";
    bench.refuses(&format!("compare --model psi.toml {run}"), &["psi"]);
    bench.prints(&format!(
        "compare --model psi.toml --model demo/model.toml {run}"
    ));
}

/// A sign and an offset are plain once the model is fitted.
#[test]
fn a_fit_goes_on_where_sign_or_rest_are_plain_and_names_the_flag() {
    let bench = Bench::with_example("none", "0.2");
    let right = bench.text("demo/recordings/step60_1.csv");
    for (flags, change) in SAID {
        bench.put("a.csv", rewritten(&right, change));
        // The rest is known to a degree or so.
        let flag = flags.trim_end_matches(char::is_numeric);
        bench
            .line("fit --model demo/model.toml a.csv")
            .assert()
            .success()
            .stderr(contains(flag));
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
            "--angle-zero",
            "--flip-angle",
            "--exchange-columns",
        ] {
            assert!(flags.contains(flag), "{command} {flag}");
        }
    }
}

/// What a laboratory's logger writes, and the section that says what it is.
const OF_THE_LAB: &str = "[recording]\ncolumns = { time = \"t\", pressure = \"p\", angle = \"w\", predicted_deg = \"m\" }\nunits = { time = \"ms\" }\n";

/// Command lines that read `lab.csv`, one for each command that takes recordings, and for each of
/// its ways to take them.
const READ_THE_LAB: [&str; 14] = [
    "compare --model m.toml lab.csv",
    "convert lab.csv -o out.csv",
    "diagnose --model m.toml --budget 1s lab.csv",
    "diagnose --model m.toml --budget 1s good.csv --holdout lab.csv",
    "diagnose --batch cases.csv --budget 1s -o out",
    "export --model m.toml --to c --recording lab.csv",
    "fit --model m.toml lab.csv",
    "gap lab.csv",
    "import lab.csv --yes",
    "init --recording lab.csv --dry-run",
    "next --model m.toml --port none lab.csv -o out",
    "plan --model m.toml --between gravity,exponent_shift lab.csv",
    "residuals --model m.toml lab.csv",
    "simulate --model m.toml --recording lab.csv",
];

/// Whether a line is stopped by columns that it cannot find.
fn finds_no_column(bench: &Bench, line: &str) -> bool {
    let assert = bench.line(line).assert();
    let output = assert.get_output();
    let mut said = String::from_utf8_lossy(&output.stderr).into_owned();
    // A batch says it of each case in its folder.
    said += &std::fs::read_to_string(bench.path("out/lab/error.txt")).unwrap_or_default();
    assert!(!said.contains("panicked"), "{line}: {said}");
    said.contains("has no column")
}

#[test]
fn every_command_that_reads_recordings_does_as_the_folder_or_the_model_says() {
    let with = |folder: bool, model: bool| {
        let bench = Bench::new();
        let mut lab = "t;p;w;m\n".to_owned();
        for row in clean_recording().lines().skip(1) {
            let [time, pressure, angle] = row.split(',').collect::<Vec<_>>()[..] else {
                panic!("{row}");
            };
            let ms = 1e3 * time.parse::<f64>().unwrap();
            lab += &format!("{ms:.0};{pressure};{angle};{angle}\n");
        }
        bench.put("lab.csv", &lab);
        bench.put("good.csv", &lab);
        bench.put("cases.csv", "case,model,recordings\nlab,m.toml,lab.csv\n");
        if folder {
            bench.put("softrig.toml", format!("schema = 1\n{OF_THE_LAB}"));
        }
        if model {
            bench.put("m.toml", format!("{}\n{OF_THE_LAB}", super::common::MODEL));
        }
        bench
    };
    let bench = with(false, false);
    // The list has each command that has the flag, as far as this build has it.
    let reads: Vec<String> = subcommands(&bench.prints("--help"))
        .into_iter()
        .filter(|name| {
            bench
                .prints(&format!("{name} --help"))
                .contains("--columns")
        })
        .collect();
    assert!(reads.len() >= 11, "{reads:?}");
    let of = |line: &str| line.split(' ').next().unwrap().to_owned();
    let listed: Vec<String> = READ_THE_LAB.iter().map(|line| of(line)).collect();
    for name in &reads {
        assert!(listed.contains(name), "no line for {name}");
    }
    for line in READ_THE_LAB.iter().filter(|it| reads.contains(&of(it))) {
        // An import guesses, and these two have no model.
        let has_model = line.contains("m.toml") || line.contains("--batch");
        if !line.starts_with("import") {
            assert!(finds_no_column(&with(false, false), line), "{line}");
        }
        assert!(!finds_no_column(&with(true, false), line), "{line}");
        assert!(
            !has_model || !finds_no_column(&with(false, true), line),
            "{line}"
        );
    }
}
