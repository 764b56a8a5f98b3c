//! Model files at fault.

use super::common::{Bench, MODEL, stderr, stdout};

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
        bench.refuses(command, &["bad.toml", "is empty", "softrig init"]);
    }
    std::fs::remove_file(bench.path("bad.toml")).unwrap();
    for command in MODEL_READERS {
        bench.refuses(command, &["bad.toml", "No such file", "check the path"]);
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
fn a_protocol_of_thousands_of_segments_is_refused_at_once() {
    let bench = Bench::new();
    let segments = "[[segment]]\nkind = \"hold\"\nduration_s = 0.1\n".repeat(30_000);
    bench.put("long.toml", format!("schema = 1\n{segments}"));
    let begun = std::time::Instant::now();
    bench.refuses(
        "record --dry-run --protocol long.toml",
        &["long.toml, line 98", "32 segments"],
    );
    assert!(begun.elapsed().as_secs() < 5, "{:?}", begun.elapsed());
}

/// What is said of the rig is not dropped without a word where the model has no law for it.
#[test]
fn a_setup_that_a_model_knows_nothing_of_is_not_uploaded() {
    let bench = Bench::new();
    bench.put("m.toml", MODEL);
    for (setup, parts) in [
        ("tip_load_g=20", ["m.toml", "does not say what a load does"]),
        ("tube_mm=300", ["m.toml", "for which tube it is written"]),
    ] {
        let line = format!("upload --port nowhere --model m.toml --setup {setup}");
        bench.fails(&line, &parts);
        bench.put(
            "good.meta.toml",
            format!("[setup]\n{}\n", setup.replace('=', " = ")),
        );
        for line in [
            "compare --model m.toml good.csv",
            "simulate --model m.toml --recording good.csv",
        ] {
            let said = super::common::stderr(&bench.line(line).assert().success());
            for part in parts.into_iter().chain(["[setup] of good"]) {
                assert!(said.contains(part), "{said}");
            }
        }
    }
}

/// `softrig.toml` names the model of a folder; the command line counts more.
#[test]
fn the_model_of_a_folder_is_named_once() {
    let bench = Bench::new();
    bench.put("finger.toml", MODEL);
    bench.put("softrig.toml", "schema = 1\nmodel = \"finger.toml\"\n");
    let line = "simulate --protocol step --angle-deg 30 --json - -o";
    let assert = bench.line(&format!("{line} a.csv")).assert().success();
    let remark = stderr(&assert);
    assert!(
        remark.contains("Using model finger.toml, set in softrig.toml."),
        "{remark}"
    );
    // What is said of it does not mix with the result.
    assert!(stdout(&assert).starts_with('{'));

    // Under the name that it had before, with the remark that it has another now.
    let new = std::fs::read_to_string(bench.path("softrig.toml")).unwrap();
    std::fs::remove_file(bench.path("softrig.toml")).unwrap();
    bench.put("rig.toml", &new);
    let assert = bench.line(&format!("{line} old.csv")).assert().success();
    let remark = stderr(&assert);
    assert!(
        remark.contains("Using rig.toml: rename it to softrig.toml")
            && remark.contains("Using model finger.toml, set in rig.toml."),
        "{remark}"
    );
    bench.put("softrig.toml", &new);

    let softer = MODEL.replace("stiffness_n_per_rad_n = ", "stiffness_n_per_rad_n = 0.5 # ");
    assert_ne!(softer, MODEL);
    bench.put("softer.toml", softer);
    let assert = bench
        .line(&format!("{line} b.csv --model softer.toml"))
        .assert()
        .success();
    assert_eq!(stderr(&assert), "");
    assert_ne!(bench.text("a.csv"), bench.text("b.csv"));

    for command in [
        "compare good.csv",
        "diagnose good.csv",
        #[cfg(feature = "lab")]
        "export --to c",
        "fit good.csv",
        "linearise --at 30deg",
        "next --virtual finger.toml good.csv",
        "plan --between gravity,exponent_shift",
        "residuals good.csv",
        "simulate --protocol step",
    ] {
        bench.put("softrig.toml", "schema = 1\n\nmodel = \"gone.toml\"\n");
        bench.refuses(
            command,
            &[
                "softrig.toml, line 3, column 9",
                "gone.toml is not there",
                "--model",
            ],
        );
        bench.put("softrig.toml", "schema = 1\n");
        bench.refuses(command, &["no model is named", "give --model MODEL.toml"]);
    }
    let line = format!("{line} c.csv");
    bench.put("softrig.toml", "schema = 1\nmodell = \"finger.toml\"\n");
    bench.refuses(
        &line,
        &["softrig.toml, line 2, column 1", "modell", "its keys are"],
    );
    bench.put("softrig.toml", "schema = 1\nmodel = 3\n");
    bench.refuses(&line, &["softrig.toml, line 2, column 9"]);
}
