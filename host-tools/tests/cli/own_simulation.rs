//! A simulation of somebody's own, known by a column of its angles.

use serde_json::Value;

use super::common::Bench;

const RUNS: [&str; 5] = ["step30_1", "step60_1", "step90_1", "step90_2", "triangle"];

/// A folder with `NAME.csv` of every run, in which what `model` gives is the column theta_sim (rad).
fn with_predictions_of(model: &str) -> Bench {
    let bench = Bench::with_example("quadratic_damping", "0.4");
    for run in RUNS {
        bench.prints(&format!(
            "simulate --model demo/{model} --recording demo/recordings/{run}.csv -o {run}.csv"
        ));
        let text = bench.text(&format!("{run}.csv"));
        let mut lines = text.lines();
        let header = lines.next().unwrap();
        assert!(header.ends_with(",predicted_deg"), "{header}");
        let mut renamed = header.replace("predicted_deg", "theta_sim") + "\n";
        for line in lines {
            let (rest, degrees) = line.rsplit_once(',').unwrap();
            let angle = degrees.parse::<f64>().unwrap().to_radians();
            renamed += &format!("{rest},{angle:.6}\n");
        }
        bench.put(&format!("{run}.csv"), renamed);
    }
    bench
}

fn verdict(bench: &Bench) -> Value {
    let runs = RUNS.map(|run| format!("{run}.csv")).join(" ");
    let said = bench.prints(&format!(
        "diagnose --model demo/model.toml --prediction theta_sim:rad {runs} --json v.json"
    ));
    assert!(
        said.contains("theta_sim: the simulation behind theta_sim is"),
        "{said}"
    );
    serde_json::from_str(&bench.text("v.json")).unwrap()
}

#[test]
fn what_a_simulation_lacks_is_named_by_its_residual() {
    let bench = with_predictions_of("model.toml");
    let found = verdict(&bench);
    assert_eq!(found["verdict"], "effect_found");
    assert_eq!(found["effects"][0]["kind"], "quadratic_damping");
    let simulation = &found["simulation"];
    assert_eq!(simulation["column"], "theta_sim");
    let [off, between] =
        ["rmse_deg", "stand_in_rmse_deg"].map(|key| simulation[key].as_f64().unwrap());
    assert!(between < off, "{between} {off}");

    // The same column beside the model, on the same runs.
    let table = bench.prints(
        "compare --model demo/model.toml --prediction theta_sim:rad step30_1.csv step60_1.csv --json -",
    );
    let table: Value = serde_json::from_str(&table).unwrap();
    let rows = table["rows"].as_array().unwrap();
    let of = |row: &&Value| row["model"] == "theta_sim";
    assert_eq!(rows.iter().filter(of).count(), rows.len() / 2);
    let left = bench.prints("residuals --prediction theta_sim:rad step60_1.csv step90_1.csv");
    assert!(left.starts_with("theta_sim: RMS residual"), "{left}");

    bench.refuses(
        "compare --prediction theta_sim step60_1.csv",
        &["step60_1.csv", "as if in another unit", "theta_sim:rad"],
    );
    bench.refuses(
        "residuals --prediction theta step60_1.csv",
        &["has no column theta", "its other columns are theta_sim"],
    );
    bench.fails(
        "diagnose --model demo/model.toml --prediction theta_sim:rad step60_1.csv step30_1.csv -o r.toml",
        &["cannot be used with"],
    );
}

/// Whatever the model lacks that stands in for it.
#[test]
fn a_simulation_that_is_off_by_noise_alone_lacks_nothing() {
    let found = verdict(&with_predictions_of("truth.toml"));
    let answer = found["verdict"].as_str().unwrap();
    assert!(
        ["no_discrepancy", "parameters_only"].contains(&answer),
        "{found:#}"
    );
}
