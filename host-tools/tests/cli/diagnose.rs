//! `softrig diagnose`: the verdict, its schema, and a search that is ended early.

#[cfg(unix)]
use std::process::Stdio;
#[cfg(unix)]
use std::time::Duration;

use predicates::str::{contains, is_empty, is_match};
use serde_json::Value;
use softrig_formats::model_file::ModelFile;

use super::common::{Bench, stdout};

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

/// Whether `value` obeys `schema`, for the part of JSON Schema that `softrig schema`
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
        "steps",
        "test",
        "ended",
        "not_tried",
        "simulation",
        "upload_refused",
    ];
    let mut always = keys(verdict);
    always.retain(|key| !optional.contains(key));
    assert_eq!(
        always.join(" "),
        "schema verdict effects alternatives adequacy tolerance_deg remaining where rmse_deg \
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
    assert!(page.contains("softrig diagnose --model demo/model.toml --seed 5 --json v.json"));

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

/// A tolerance is a number of degrees above zero, and no batch ignores one.
#[test]
fn a_tolerance_that_cannot_count_is_refused() {
    let bench = Bench::with_example("quadratic_damping", "0.4");
    let refused = |line: &str, why: &str| {
        let stderr = is_match(why).unwrap();
        bench.line(line).assert().code(2).stderr(stderr);
    };
    let run = "demo/recordings/step60_1.csv";
    let one = format!("diagnose --model demo/model.toml {run} --tolerance");
    refused(&format!("{one} 0"), "degrees above zero");
    refused(&format!("{one} wide"), "degrees above zero");
    refused(
        "diagnose --batch cases.csv -o out --tolerance 0.5",
        "cannot be used with",
    );
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
    bench.refuses(
        "next --virtual m.toml --model m.toml good.csv --holdout good.csv",
        &["good.csv", "is given twice", "name each recording once"],
    );
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
        said.starts_with("Something is missing, but time ran out"),
        "{said}"
    );
    assert!(said.contains("The time of 1 ms ran out"), "{said}");
    assert!(bench.text("r.html").contains("The time of 1 ms ran out"));
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
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"))
        .current_dir(bench.folder())
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
    assert!(
        stage.starts_with("fits of the highest-ranked effects"),
        "{said}"
    );
    assert!(how_far.contains(" fits, ") && how_far.contains(" so far"));
    assert!(best.contains(" so far"), "{said}");
    assert!(go_on.contains("repeat the command") && go_on.contains("fits"));
    let mut after = bench.contents();
    after.retain(|path, _| !path.starts_with(bench.path("fits")));
    assert!(before == after, "{:?}", after.keys());
}
