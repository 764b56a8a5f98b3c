//! An output that is no angle keeps its name and its unit wherever it is shown.

use serde_json::Value;

use super::common::Bench;

const FLAGS: &str = "--columns angle=position_mm --units angle=mm";

/// A folder with recordings whose output is `position_mm`.
fn of_positions() -> Bench {
    let bench = Bench::with_example("coulomb_friction", "0.4");
    for run in ["step30_1", "step60_1", "step90_1", "step90_2", "triangle"] {
        let text = bench.text(&format!("demo/recordings/{run}.csv"));
        assert!(text.contains("angle_deg"), "{text:.80}");
        bench.put(
            &format!("{run}.csv"),
            text.replace("angle_deg", "position_mm"),
        );
    }
    bench
}

fn assert_is_position(said: &str) {
    assert!(said.contains("mm"), "{said}");
    let said = said.replace("bending angle", "");
    assert!(!said.contains('°') && !said.contains("angle"), "{said}");
}

#[test]
fn terminal_and_pictures_show_the_unit_of_the_column() {
    let bench = of_positions();
    let runs = "step30_1.csv step60_1.csv";
    let fit = bench.prints(&format!("fit --model demo/model.toml {FLAGS} {runs}"));
    assert!(fit.contains("RMS error (mm)"), "{fit}");
    assert!(
        fit.contains("position +") || fit.contains("position -"),
        "{fit}"
    );
    assert_is_position(&fit);
    let compared = bench.prints(&format!(
        "compare --model demo/model.toml {FLAGS} {runs} --plot steps.svg"
    ));
    assert_is_position(&compared);
    assert_is_position(&bench.text("steps.svg"));
    assert!(bench.text("steps.svg").contains("position (mm)"));
    let left = bench.prints(&format!(
        "residuals --model demo/model.toml {FLAGS} {runs} --plot left.svg"
    ));
    assert_is_position(&left);
    assert_is_position(&bench.text("left.svg"));
    let simulated = bench.prints(&format!(
        "simulate --model demo/model.toml --recording step60_1.csv {FLAGS}"
    ));
    assert_is_position(&simulated);
}

#[test]
fn a_diagnosis_shows_the_unit_of_the_column() {
    let bench = of_positions();
    let said = bench.prints(&format!(
        "diagnose --model demo/model.toml {FLAGS} step30_1.csv step60_1.csv step90_1.csv \
         step90_2.csv triangle.csv --report report.html --plot gap.svg --json v.json"
    ));
    assert!(said.contains("RMS error (mm), fit"), "{said}");
    assert!(
        said.contains("position +") || said.contains("position -"),
        "{said}"
    );
    assert!(!said.contains('°') && !said.contains("angular"), "{said}");
    let picture = bench.text("gap.svg");
    assert!(picture.contains("position (mm)"), "{picture:.400}");
    // Its label has two lines.
    assert!(picture.contains(">(mm)<") && !picture.contains('°'));
    let page = bench.text("report.html");
    assert!(page.contains("RMS error of each run (mm)"));
    assert!(page.contains("RMS errors of the position"));
    assert!(page.contains("position (mm)") && !page.contains('°'));
    // The same numbers as in degrees.
    let found: Value = serde_json::from_str(&bench.text("v.json")).unwrap();
    let plain = bench.prints(
        "diagnose --model demo/model.toml demo/recordings/step30_1.csv demo/recordings/step60_1.csv \
         demo/recordings/step90_1.csv demo/recordings/step90_2.csv demo/recordings/triangle.csv --json -",
    );
    let plain: Value = serde_json::from_str(&plain).unwrap();
    assert_eq!(found["effects"], plain["effects"]);
}

#[test]
fn a_column_in_millimetres_is_not_read_as_degrees_unsaid() {
    let bench = of_positions();
    bench.refuses(
        "fit --model demo/model.toml --columns angle=position_mm step60_1.csv",
        &["position_mm", "--units angle=mm", "angle=deg"],
    );
}
