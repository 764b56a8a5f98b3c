//! `softrig diagnose --batch`: many cases, shared between jobs.

use predicates::prelude::*;
use predicates::str::contains;
use serde_json::Value;

use super::common::{Bench, stderr, stdout};

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
        .stdout(contains("1/1 first   effect_found: coulomb_friction"));
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

    // Results that are not as they were written are not believed.
    let verdict = bench.text("out/first/verdict.json");
    bench.put(
        "out/first/verdict.json",
        verdict.replace("coulomb_friction", "gravity"),
    );
    bench
        .line(batch)
        .assert()
        .success()
        .stdout(contains("first   effect_found: coulomb_friction").and(contains("1 warning")));
    assert!(
        bench
            .text("out/first/warnings.txt")
            .contains("diagnosed again")
    );

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

/// What is wrong with the folder of one case is that case's error.
#[cfg(unix)]
#[test]
fn a_link_in_place_of_a_folder_is_the_error_of_one_case() {
    let bench = Bench::with_example("none", "0.1");
    bench.put(
        "demo/cases.csv",
        "case,model,recordings\nfirst,model.toml,recordings/triangle.csv\nsecond,model.toml,recordings/triangle.csv\n",
    );
    std::fs::create_dir_all(bench.path("elsewhere")).unwrap();
    std::fs::create_dir_all(bench.path("out")).unwrap();
    std::os::unix::fs::symlink(bench.path("elsewhere"), bench.path("out/first")).unwrap();
    bench
        .line("diagnose --batch demo/cases.csv -o out --budget 2s")
        .assert()
        .code(1)
        .stdout(contains("is a link").and(contains("2 cases in")))
        .stderr(contains("1 of 2 cases"));
    let left = std::fs::read_dir(bench.path("elsewhere")).unwrap();
    assert_eq!(left.count(), 0, "nothing is written through the link");
    assert!(bench.path("out/second/verdict.json").exists());

    // A share that only collects finds a damaged verdict.
    bench.put("out/second/verdict.json", "{\"verdict\": ");
    bench
        .line("diagnose --batch demo/cases.csv -o out --share 0/2 --budget 2s")
        .assert()
        .code(1);
    std::fs::remove_file(bench.path("out/first")).unwrap();
    bench
        .line("diagnose --batch demo/cases.csv -o out --budget 2s")
        .assert()
        .success()
        .stdout(contains("2 cases in"));
}

/// Cases that are diagnosed at a time are those of one after the other; the first that failed is
/// the first of the manifest.
#[test]
fn several_cases_at_a_time_are_the_same_cases() {
    let bench = Bench::with_example("coulomb_friction", "0.1");
    let rows: String = ["a", "b", "c", "d", "e"]
        .iter()
        .enumerate()
        .map(|(index, name)| match index {
            1 | 3 => format!("{name},model.toml,lost_{name}.csv\n"),
            _ => format!("{name},model.toml,recordings/step60_1.csv\n"),
        })
        .collect();
    bench.put("demo/cases.csv", format!("case,model,recordings\n{rows}"));
    let batch = |out: &str, jobs: &str| {
        let line = format!("diagnose --batch demo/cases.csv -o {out} --budget 0s {jobs}");
        let assert = bench.line(&line).assert().code(1);
        assert!(stderr(&assert).contains(&format!("for the first, see {out}/b/error.txt")));
        let mut said: Vec<String> = stdout(&assert)
            .lines()
            .map(|line| line.split(" (").next().unwrap().to_owned())
            .collect();
        said.pop();
        said.sort();
        said
    };
    let said = batch("one", "");
    assert_eq!(said.len(), 5);
    assert_eq!(batch("many", "--jobs 3"), said);
    assert!(bench.path("many/results.parquet").exists());
    bench.fails("fit --model demo/model.toml --jobs 2", &["--jobs"]);
    bench.fails(
        "diagnose demo/recordings/step60_1.csv --jobs 2",
        &["--batch"],
    );
    bench.fails("diagnose --batch demo/cases.csv -o x --jobs 0", &["--jobs"]);
}
