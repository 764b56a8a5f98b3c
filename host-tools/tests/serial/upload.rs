//! `softrig upload`: models and settings, read back.

use softrig_link::{Link, SerialConnector, Timing};
use wire::settings::Key;

use super::Bench;
use super::board::Script;

#[test]
fn a_model_is_uploaded_and_read_back() {
    let bench = Bench::new(Script::default());
    let dry = bench
        .rig("upload --port PORT --model m.toml --dry-run")
        .ok();
    dry.says("damping");
    dry.says("1.8 → 0.913");
    dry.says("coulomb_friction");
    assert!(!bench.board.heard_any("set"));
    bench
        .rig("upload --port PORT --model m.toml")
        .ok()
        .says("read back");
    assert!(
        bench.board.heard("set gain 38fba882"),
        "{:?}",
        bench.board.script().heard
    );
    bench
        .rig("upload --port PORT --model m.toml")
        .ok()
        .says("already");
    let read = bench.rig("upload --port PORT --read").ok();
    read.says("damping    = 0.913");
    read.says("e0.kind    = \"coulomb_friction\"");
    // What was read can be written.
    bench.put(
        "all.toml",
        read.out.replace("max.kpa    = 180.0", "max.kpa    = 170.0"),
    );
    let said = bench.rig("upload --port PORT --settings all.toml").ok();
    said.says("180 → 170");
    said.says("1 settings written");
}

#[test]
fn settings_that_the_board_refuses_change_nothing() {
    let bench = Bench::new(Script::default());
    // Set-points up to 160 kPa are allowed.
    bench.put("low.toml", "max.kpa = 150.0\n");
    bench.rig("upload --port PORT --settings low.toml").failed(
        1,
        &[
            "still uses its old settings",
            "refused `save`",
            "do not fit together: set.kpa and set.deg may not exceed max.kpa",
        ],
    );
    assert_eq!(bench.board.script().heard.last().unwrap(), "discard");
}

#[test]
fn a_save_that_is_not_confirmed_is_an_error() {
    let bench = Bench::new(Script {
        confirms: false,
        ..Script::default()
    });
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["not certain that they are stored", "did not confirm"]);
}

#[test]
fn what_reads_back_otherwise_is_an_error() {
    let bench = Bench::new(Script {
        forgets: Some(Key::Damping),
        ..Script::default()
    });
    bench.rig("upload --port PORT --model m.toml").failed(
        1,
        &["damping was written as 3f69ba5e and read back as 3fe66666"],
    );
}

#[test]
fn nothing_is_uploaded_while_something_moves() {
    let bench = Bench::new(Script::default());
    let board = &bench.board;
    let mut link = Link::open(
        SerialConnector::new(board.port().display().to_string()),
        Timing::default(),
    )
    .unwrap();
    assert!(link.arm(&mut |_| true).unwrap());
    // From here on nobody beats: half a minute is to be one of ours.
    board.script().speed = 1;
    drop(link);
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["still uses its old settings", "the board is ready"]);
}

#[test]
fn faults_of_settings_files_have_their_place() {
    let bench = Bench::new(Script::default());
    bench.put("s.toml", "max.kpa = 150.0\nmax.deg = 900\n");
    bench.rig("upload --port PORT --settings s.toml").failed(
        2,
        &["s.toml, line 2, column 11: max.deg is 900", "1 to 330 deg"],
    );
    assert!(bench.board.script().heard.is_empty());
}
