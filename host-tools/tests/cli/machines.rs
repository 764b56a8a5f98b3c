//! What commands print for machines.

use serde_json::Value;

use super::common::Bench;
use super::schema::follows;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// With `--json -` standard output is JSON and nothing else, of the schema that is printed, and a
/// file holds the same.
#[test]
fn every_command_writes_the_json_of_its_schema() {
    let bench = Bench::with_example("none", "0.2");
    bench.put(
        "predicted.csv",
        "time_s,pressure_kpa,angle_deg,predicted_deg\n0,0,0,3\n1,0,0,-4\n",
    );
    let pull = |k: i32| {
        format!(
            "{},{}\n",
            0.02 * f64::from(k),
            0.3 * (0.02 * f64::from(k)).powf(0.8)
        )
    };
    let pull = "strain,stress_mpa\n".to_owned() + &(1..40).map(pull).collect::<String>();
    bench.put("pull.csv", &pull);
    bench.put("again.csv", &pull);
    let run = "demo/recordings/step60_1.csv";
    for (command, line) in [
        ("fit", format!("fit --model demo/model.toml {run}")),
        (
            "fit",
            format!("fit --model demo/model.toml {run} --profile profiles.svg"),
        ),
        (
            "linearise",
            "linearise --model demo/model.toml --at 20kpa --plot bode.svg -o linear.m".to_owned(),
        ),
        ("compare", format!("compare --model demo/model.toml {run}")),
        (
            "simulate",
            format!("simulate --model demo/model.toml --recording {run}"),
        ),
        ("gap", "gap predicted.csv".to_owned()),
        (
            "residuals",
            format!("residuals --model demo/model.toml {run}"),
        ),
        ("materials", "materials list".to_owned()),
        (
            "materials",
            "materials predict --modulus-mpa 0.338 --viscosity-cps 20000 --tensile-mpa 3.79"
                .to_owned(),
        ),
        ("materials", "materials fit-curve pull.csv".to_owned()),
        (
            "materials",
            "materials fit-curve pull.csv again.csv".to_owned(),
        ),
        ("init", format!("init --dry-run --recording {run}")),
        ("record", "record --list".to_owned()),
        (
            "plan",
            format!("plan --model demo/model.toml --between coulomb_friction,gravity {run}"),
        ),
        (
            "diagnose",
            format!("diagnose --model demo/model.toml {run} --budget 1s"),
        ),
    ] {
        let value = json(&bench.prints(&format!("{line} --json -")));
        assert_eq!(value["schema"], 1, "{command}");
        let schema = json(&bench.prints(&format!("schema {command}")));
        follows(&schema, &schema, &value, command);
        let said = bench.prints(&format!("{line} --json out.json"));
        assert!(!said.trim_start().starts_with('{'), "{said}");
        assert_eq!(json(&bench.text("out.json"))["schema"], 1, "{command}");
        assert!(!bench.path("-").exists());
    }
}

#[test]
fn the_numbers_are_those_of_the_table() {
    let bench = Bench::with_example("none", "0.2");
    let run = "demo/recordings/step60_1.csv";
    let fit = format!("fit --model demo/model.toml {run}");
    let value = json(&bench.prints(&format!("{fit} --json -")));
    let gain = value["parameters"].as_array().unwrap().iter();
    let gain = gain
        .into_iter()
        .find(|it| it["name"] == "input_gain")
        .unwrap();
    assert_eq!(gain["unit"], "N/kPa");
    let [low, high] = [0, 1].map(|end| gain["interval95"][end].as_f64().unwrap());
    let found = gain["value"].as_f64().unwrap();
    assert!(low < found && found < high);
    let text = bench.prints(&fit);
    let line = text
        .lines()
        .find(|it| it.starts_with("input_gain"))
        .unwrap();
    assert!(line.contains(&format!("{found:.3}")), "{line} {found}");
}

/// The schema of protocol files takes what the reader takes, and not what it refuses.
#[test]
fn the_schema_of_a_protocol_is_that_of_its_reader() {
    let bench = Bench::with_example("none", "0.2");
    let schema = json(&bench.prints("schema protocol"));
    let plan = "plan --model demo/model.toml --between gravity,exponent_shift -o next.toml --force";
    bench.line(plan).assert().success();
    let written: toml::Value = toml::from_str(&bench.text("next.toml")).unwrap();
    let every_kind = r#"
schema = 1
name = "every kind"
[setup]
tilt_deg = 90.0
new_part = "sensor"
[[segment]]
kind = "step"
track = "angle_open_loop"
level_deg = 30.0
duration_s = 2.0
[[segment]]
kind = "multisine"
track = "pressure"
centre_kpa = 30.0
amplitude_kpa = 5.0
period_s = 20.0
duration_s = 40.0
[[segment]]
kind = "hold"
duration_s = 1.0
[[segment]]
kind = "release"
duration_s = 2.0
[[segment]]
kind = "repeat"
from = 1
times = 2
"#;
    let every: toml::Value = toml::from_str(every_kind).unwrap();
    for value in [written, every] {
        follows(
            &schema,
            &schema,
            &serde_json::to_value(value).unwrap(),
            "protocol",
        );
    }
}

/// The schema of model files has what the reader has: every kind of effect, every key.
#[test]
fn the_schema_of_a_model_is_that_of_its_reader() {
    let bench = Bench::with_example("stribeck_friction", "0.2");
    let schema = json(&bench.prints("schema model"));
    let truth: toml::Value = toml::from_str(&bench.text("demo/truth.toml")).unwrap();
    let properties = &schema["properties"];
    for (section, content) in truth.as_table().unwrap() {
        assert!(properties.get(section).is_some(), "{section}");
        for key in content.as_table().into_iter().flat_map(toml::Table::keys) {
            assert!(
                properties[section]["properties"].get(key).is_some(),
                "{key}"
            );
        }
    }
    let kinds = properties["effect"]["items"]["oneOf"].as_array().unwrap();
    let of = |name: &str| {
        let mut kinds = kinds.iter();
        kinds.find(|it| it["properties"]["kind"]["const"] == name)
    };
    let effect = truth["effect"][0].as_table().unwrap();
    let known = &of("stribeck_friction").unwrap()["properties"];
    assert!(effect.keys().all(|key| known.get(key).is_some()));
    let damping = &properties["dynamics"]["properties"]["damping_n_s_per_rad"];
    // The ends of the range are those that the reader has.
    let most = damping["maximum"].as_f64().unwrap();
    let model = bench.text("demo/model.toml");
    let line = model.lines().find(|it| it.starts_with("damping")).unwrap();
    for (factor, code) in [(0.5, 0), (2.0, 2)] {
        let number = format!("damping_n_s_per_rad = {:e}", factor * most);
        bench.put("m.toml", model.replace(line, &number));
        bench
            .line("simulate --model m.toml --protocol step --angle-deg 10 --hold-s 0.1")
            .assert()
            .code(code);
    }
    // What softrig init writes says where editors find it.
    bench.prints("init --recording demo/recordings/step60_1.csv -o first.toml");
    assert!(
        bench
            .text("first.toml")
            .starts_with("#:schema model.schema.json\n")
    );
}

/// The model that made the recordings leaves white noise of the size that was added; without its
/// friction the residual has structure, and grows with the time ahead.
#[test]
fn residuals_of_the_truth_are_white_and_of_a_poorer_model_are_not() {
    let bench = Bench::with_example("coulomb_friction", "0.2");
    let runs =
        "demo/recordings/step60_1.csv demo/recordings/step90_1.csv demo/recordings/triangle.csv";
    let of = |model: &str| {
        json(&bench.prints(&format!(
            "residuals --model demo/{model}.toml {runs} --json -"
        )))
    };
    let (truth, poor) = (of("truth"), of("model"));
    assert_eq!(
        truth["with_itself"]["by_chance"], true,
        "{}",
        truth["with_itself"]["outside"]
    );
    assert_eq!(truth["with_pressure"]["by_chance"], true);
    let deviation = truth["distribution"]["deviation_deg"].as_f64().unwrap();
    assert!((deviation - 0.2).abs() < 0.03, "{deviation}");
    assert!(
        truth["distribution"]["excess_kurtosis"]
            .as_f64()
            .unwrap()
            .abs()
            < 0.5
    );
    assert_eq!(poor["with_itself"]["by_chance"], false);
    let errors = |of: &Value| -> Vec<f64> {
        let ahead = of["ahead"].as_array().unwrap().iter();
        ahead.map(|it| it["rmse_deg"].as_f64().unwrap()).collect()
    };
    let (right, wrong) = (errors(&truth), errors(&poor));
    let last = right.len() - 1;
    // Of the truth it is that of the noise at any time ahead.
    assert!(right.iter().all(|it| (it - 0.2).abs() < 0.05), "{right:?}");
    assert!(wrong[last] > 3.0 * wrong[0], "{wrong:?}");

    bench.prints(&format!(
        "residuals --model demo/model.toml {runs} --report page.html --plot left.svg"
    ));
    let page = bench.text("page.html");
    for part in ["<svg", "is not white", "Histogram", "Quantiles", "99 %"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("http://") || page.contains("http://www.w3.org"));
    assert!(bench.text("left.svg").starts_with('<'));
}
