//! `softrig calibrate`, with sensors in a hand.

use std::io::Write;

use super::board::{Script, wait_until};
use super::{Bench, Said};

/// A rig whose sensors have no noise, so that counts are whole.
fn quiet() -> Script {
    let mut script = Script::default();
    script.plant.noise_counts = 0.0;
    script
}

#[test]
fn a_table_is_taken_from_a_bench() {
    let bench = Bench::new(quiet());
    bench.put(
        "t.csv",
        "angle_deg,flex_counts\n0,668.4\n90,412.5\n45,540\n",
    );
    let said = bench
        .rig_with("calibrate --port PORT --assume t.csv --lower-limits", "\n")
        .ok();
    said.says("102.0 counts at rest");
    said.says("45.0    540.0");
    said.says("the board now shows 0.1° (668.0 counts) and 0.00 kPa");
    let read = bench.rig("upload --port PORT --read").ok();
    for part in [
        "p.zero     = 102.0",
        "f.n        = 3.0",
        "f.c2       = 412.5",
        "f.a1       = 45.0",
        "max.deg    = 108.0",
        "set.deg    = 90.0",
    ] {
        read.says(part);
    }
}

#[test]
fn each_angle_is_measured_when_the_operator_says_so() {
    let bench = Bench::new(quiet());
    let mut child = bench.start("calibrate --port PORT --points 0,90 --lower-limits");
    let mut stdin = child.stdin.take().unwrap();
    let raws = |bench: &Bench| {
        bench
            .board
            .script()
            .heard
            .iter()
            .filter(|heard| *heard == "raw")
            .count()
    };
    wait_until("it shows counts", || raws(&bench) > 2);
    stdin.write_all(b"\n").unwrap();
    wait_until("the rest is taken", || raws(&bench) > 27);
    // A hand that shakes is refused, and may try again.
    bench.board.script().plant.noise_counts = 40.0;
    stdin.write_all(b"\n").unwrap();
    let before = raws(&bench);
    wait_until("the first try", || raws(&bench) > before + 25);
    bench.board.script().plant.noise_counts = 0.0;
    stdin.write_all(b"\n").unwrap();
    let before = raws(&bench);
    wait_until("the second try", || raws(&bench) > before + 25);
    bench.board.script().plant.flex_counts = Some(400.0);
    stdin.write_all(b"\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let said = Said::new("calibrate", output);
    assert!(said.err.contains("not steady"), "{}", said.err);
    let said = said.ok();
    said.says("90.0    400.0");
    said.says("the board now shows 90.0° (400.0 counts)");
}

#[test]
fn calibrations_that_make_no_sense_change_nothing() {
    let bench = Bench::new(quiet());
    bench
        .rig_with("calibrate --port PORT --points 0,90 --lower-limits", "\n")
        .failed(2, &["the input ended", "nothing was changed"]);
    bench
        .rig_with(
            "calibrate --port PORT --points 0,90 --lower-limits",
            "\n\n\n",
        )
        .failed(2, &["did not move", "668.0 counts at 0° and 668.0 at 90°"]);
    bench.put("t.csv", "angle_deg,flex_counts\n0,668\n90,412\n150,500\n");
    bench
        .rig_with("calibrate --port PORT --assume t.csv", "\n")
        .failed(2, &["are not monotonic"]);
    bench.put("t.csv", "angle_deg,flex_counts\n0,668\n90,412\n");
    bench
        .rig_with("calibrate --port PORT --assume t.csv", "\n")
        .failed(2, &["the table reaches 108°", "130°", "--lower-limits"]);
    bench.put("t.csv", "angle_deg,flex_counts\n0,668\n90,x\n");
    bench
        .rig("calibrate --port PORT --assume t.csv")
        .failed(2, &["t.csv, line 3", "\"x\" is not a number"]);
    bench
        .rig("calibrate --port PORT --points 5")
        .failed(2, &["1 points"]);
    assert!(!bench.board.heard_any("set"));
}
