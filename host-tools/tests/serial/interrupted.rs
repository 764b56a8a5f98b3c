//! Recordings that something cuts short: the cable, a signal, the disk.

use std::process::Child;
use std::time::Duration;

use softrig_formats::recording::Recording;
use wire::state::State;

use super::board::{Script, wait_until};
use super::{Bench, Said, assert_increasing};

#[test]
fn lines_lost_on_the_way_leave_the_segments_in_place() {
    let bench = Bench::new(Script {
        skip_every: 3,
        ..Script::default()
    });
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .ok();
    let segments = bench.recording("run.csv").meta.segment;
    let repeats: Vec<_> = segments.iter().map(|segment| segment.repeat).collect();
    assert_eq!(repeats, [Some(1), Some(2)]);
}

#[test]
fn damaged_and_lost_lines_are_counted_and_leave_gaps() {
    let bench = Bench::new(Script {
        corrupt_every: 50,
        skip_every: 70,
        ..Script::default()
    });
    bench.rig("record --port PORT --seconds 10 -o run.csv").ok();
    let meta = bench.meta("run.meta.toml");
    let count = |key: &str| meta[key].as_integer().unwrap();
    // Some that would have been damaged are lost.
    assert!((17..=26).contains(&count("damaged_lines")), "{meta}");
    // Those that were damaged are missing too.
    assert!((30..=42).contains(&count("dropped_lines")), "{meta}");
    let recording = bench.recording("run.csv");
    assert_increasing(&recording);
    let sequence = recording.column("seq").unwrap();
    let missing = sequence[sequence.len() - 1] - sequence[0] + 1.0 - sequence.len() as f64;
    assert!((missing - count("dropped_lines") as f64).abs() <= 2.0);
}

/// What a command says that ends by itself, soon after its board has fallen silent: with these
/// parts, and what came is kept as incomplete.
fn ends_in_silence(bench: &Bench, child: Child, name: &str, parts: &[&str]) -> String {
    bench.board.script().silent = true;
    let begun = std::time::Instant::now();
    let output = child.wait_with_output().unwrap();
    assert!(begun.elapsed().as_secs() < 20);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    for part in parts {
        assert!(said.contains(part), "{part}: {said}");
    }
    let meta = bench.meta(&format!("{name}.meta.toml"));
    assert_eq!(meta["complete"].as_bool(), Some(false));
    assert!(bench.recording(&format!("{name}.csv")).len() > 100);
    said
}

/// A board that hangs keeps its port open.
#[test]
fn a_board_that_falls_silent_ends_a_recording_with_what_there_is() {
    for what in ["--seconds 900", ""] {
        let bench = Bench::new(Script::default());
        let child = bench.start(&format!(
            "record --port PORT -o run.csv --patience 1 {what}"
        ));
        wait_until("rows", || bench.rows("run.csv") > 200);
        let parts = ["no sample has come for 1 s", "samples are kept in run.csv"];
        let said = ends_in_silence(&bench, child, "run", &parts);
        assert_eq!(what.is_empty(), said.contains("recording until Ctrl-C"));
    }
}

/// What came is kept as incomplete, and the time ends although no clock of a board says so.
#[test]
fn a_monitor_says_that_a_board_has_fallen_silent_and_ends() {
    let bench = Bench::new(Script {
        speed: 1,
        ..Script::default()
    });
    let child = bench.start("monitor --port PORT --plain --seconds 6 --log seen.csv");
    wait_until("rows", || bench.rows("seen.csv") > 101);
    let parts = ["no sample for 1.", "not a byte came", "as incomplete"];
    ends_in_silence(&bench, child, "seen", &parts);
}

#[test]
fn a_cable_that_comes_back_leaves_a_gap_and_increasing_times() {
    let bench = Bench::new(Script {
        speed: 5,
        ..Script::default()
    });
    let child = bench.start("record --port PORT --seconds 20 -o run.csv");
    wait_until("rows", || bench.rows("run.csv") > 200);
    bench.board.script().pulled = true;
    std::thread::sleep(Duration::from_millis(700));
    let before = bench.rows("run.csv");
    bench.board.script().pulled = false;
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(
        said.contains("the connection was lost") && said.contains("is back"),
        "{said}"
    );
    let told = String::from_utf8(output.stdout).unwrap();
    let last = told.lines().last().unwrap_or_default();
    assert!(last.starts_with("the board restarted after "), "{told}");
    let recording = bench.recording("run.csv");
    assert_increasing(&recording);
    assert!(recording.len() > before + 100 && recording.duration() >= 20.0);
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["connection_lost"].as_integer(), Some(1));
    let gap = &meta["gap"][0];
    assert_eq!(gap["restarted"].as_bool(), Some(true), "{meta}");
    let length = gap["to_s"].as_float().unwrap() - gap["from_s"].as_float().unwrap();
    // By our clock: the board's started again.
    assert!((0.6..3.0).contains(&length), "{length}");
    assert!(gap["clock_offset_s"].as_float().unwrap() > 1.0);
}

#[test]
fn a_board_that_went_on_meanwhile_keeps_its_clock() {
    let bench = Bench::new(Script {
        speed: 5,
        resets: false,
        ..Script::default()
    });
    let child = bench.start("record --port PORT --seconds 15 -o run.csv");
    wait_until("rows", || bench.rows("run.csv") > 200);
    bench.board.script().pulled = true;
    std::thread::sleep(Duration::from_millis(300));
    bench.board.script().pulled = false;
    assert!(child.wait_with_output().unwrap().status.success());
    assert_increasing(&bench.recording("run.csv"));
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["connection_lost"].as_integer(), Some(1));
    let gap = &meta["gap"][0];
    assert_eq!(gap["restarted"].as_bool(), Some(false), "{meta}");
    // By its clock, which runs five times as fast as ours.
    let length = gap["to_s"].as_float().unwrap() - gap["from_s"].as_float().unwrap();
    assert!(length > 1.4, "{length}");
}

#[test]
fn a_cable_pulled_in_a_protocol_keeps_what_was_received() {
    let bench = Bench::new(Script {
        speed: 5,
        ..Script::default()
    });
    let child =
        bench.start("record --port PORT --protocol two.toml -o run.csv --split --patience 20");
    wait_until("it runs", || bench.board.heard("run"));
    let begun = bench.rows("run.csv");
    // The second step begins 350 rows after the first and ends with its release
    // after 700.
    wait_until("the second step", || bench.rows("run.csv") > begun + 450);
    bench.board.script().pulled = true;
    std::thread::sleep(Duration::from_millis(300));
    bench.board.script().pulled = false;
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("samples are kept in run.csv"), "{said}");
    assert!(said.contains("the protocol ended after"), "{said}");
    assert_increasing(&bench.recording("run.csv"));
    assert_eq!(
        bench.meta("run.meta.toml")["complete"].as_bool(),
        Some(false)
    );
    // The first run was whole, the second was not.
    assert_eq!(bench.recording("run.csv").meta.segment.len(), 1);
    assert_eq!(bench.recording("run_60_1.csv").meta.repeat, Some(1));
    assert!(!bench.path("run_60_2.csv").exists());
}

#[test]
fn a_cable_that_stays_away_ends_the_recording() {
    let bench = Bench::new(Script::default());
    let child = bench.start("record --port PORT --seconds 60 -o run.csv --patience 0.5");
    wait_until("rows", || bench.rows("run.csv") > 100);
    bench.board.script().pulled = true;
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.contains("did not come back within") && said.contains("kept in run.csv"),
        "{said}"
    );
    assert!(bench.recording("run.csv").len() > 90);
}

#[test]
fn a_recording_that_is_killed_is_whole_up_to_the_last_line() {
    let bench = Bench::new(Script::default());
    let mut child = bench.start("record --port PORT --protocol two.toml -o run.csv");
    wait_until("rows", || bench.rows("run.csv") > 400);
    child.kill().unwrap();
    child.wait().unwrap();
    let (recording, warnings) = Recording::read(&bench.path("run.csv")).unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(
        warnings[0].contains("run.csv: is incomplete: ")
            && warnings[0].contains("run.meta.toml it ended"),
        "{warnings:?}"
    );
    assert!(recording.len() >= 399);
    assert_eq!(recording.meta.protocol.as_deref(), Some("two"));
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["complete"].as_bool(), Some(false));
    // How much there is was not known yet: better unsaid than 0.
    for count in ["samples", "dropped_lines", "damaged_lines"] {
        assert!(!meta.contains_key(count), "{meta}");
    }
    let said = bench
        .rig("simulate --model m.toml --recording run.csv -o sim.csv")
        .ok();
    assert!(said.err.contains("is incomplete"), "{}", said.err);
}

#[test]
fn a_recording_that_replaces_another_and_is_killed_has_no_metadata_of_that() {
    let bench = Bench::new(Script::default());
    bench.rig("record --port PORT --seconds 2 -o run.csv").ok();
    let meta = bench.meta("run.meta.toml");
    assert_eq!(
        meta["samples"].as_integer(),
        i64::try_from(bench.rows("run.csv") - 1).ok()
    );
    let mut child = bench.start("record --port PORT --seconds 600 -o run.csv --force");
    wait_until("rows", || bench.rows("run.csv") > 400);
    child.kill().unwrap();
    child.wait().unwrap();
    let meta = bench.meta("run.meta.toml");
    assert!(!meta.contains_key("samples"), "{meta}");
    assert_eq!(meta["complete"].as_bool(), Some(false));
}

#[test]
fn ctrl_c_stops_the_pump_and_keeps_the_recording() {
    for signal in [rustix::process::Signal::INT, rustix::process::Signal::TERM] {
        let bench = Bench::new(Script::default());
        let child = bench.start("record --port PORT --protocol steps -o run.csv");
        wait_until("it runs", || bench.board.script().state == State::Running);
        rustix::process::kill_process(rustix::process::Pid::from_child(&child), signal).unwrap();
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains("interrupted") && said.contains("kept in run.csv"),
            "{said}"
        );
        assert!(bench.board.heard("stop"));
        assert_eq!(bench.board.script().state, State::Idle);
        let recording = bench.recording("run.csv");
        // The recording shows that it stopped.
        let state = recording
            .extra
            .iter()
            .find(|column| column.name == "state")
            .unwrap();
        assert_eq!(state.fields.last().unwrap(), "idle");
    }
}

/// Starts `softrig` where no file can have more than `blocks` blocks of a shell: as full as a disk
/// gets without one. The shell that is killed by the signal for it is told to ignore it.
fn start_with_room(bench: &Bench, blocks: u32, line: &str) -> Child {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = std::process::Command::new("sh");
    let command = command.args(["-c", &script, env!("CARGO_BIN_EXE_softrig")]);
    bench.start_by(command.args(bench.words(line)))
}

#[test]
fn a_full_disk_leaves_whole_rows_and_stops_the_pump() {
    for (line, stopped) in [
        ("record --port PORT --seconds 600 -o run.csv", false),
        ("record --port PORT --protocol two.toml -o run.csv", true),
        ("monitor --port PORT --seconds 600 --log run.csv", false),
    ] {
        let bench = Bench::new(Script::default());
        let child = start_with_room(&bench, 16, line);
        let said = Said::new(line, child.wait_with_output().unwrap());
        let text = bench.text("run.csv");
        let rows = text.lines().count() - 1;
        assert!(rows > 50, "{line}: {rows}");
        assert!(text.ends_with('\n'), "{line}: {text}");
        let fields = |row: &str| row.matches(',').count();
        let columns = fields(text.lines().next().unwrap());
        assert!(text.lines().all(|row| fields(row) == columns), "{line}");
        let said = said.failed(
            2,
            &["run.csv: cannot be written: ", "make space on the disk"],
        );
        if !line.starts_with("monitor") {
            let kept = format!("{rows} samples are kept in run.csv");
            assert!(said.err.contains(&kept), "{rows}: {}", said.err);
        }
        let meta = bench.meta("run.meta.toml");
        assert_eq!(meta["complete"].as_bool(), Some(false), "{line}");
        assert_eq!(
            meta["samples"].as_integer(),
            i64::try_from(rows).ok(),
            "{line}"
        );
        assert_eq!(bench.recording("run.csv").len(), rows, "{line}");
        assert_eq!(bench.board.heard("stop"), stopped, "{line}");
    }
}

#[test]
fn a_disk_that_is_full_from_the_start_keeps_the_recording_that_is_there() {
    let bench = Bench::new(Script::default());
    bench.rig("record --port PORT --seconds 2 -o run.csv").ok();
    let before = [bench.text("run.csv"), bench.text("run.meta.toml")];
    let line = "record --port PORT --seconds 2 -o run.csv --force";
    let child = start_with_room(&bench, 0, line);
    Said::new(line, child.wait_with_output().unwrap()).failed(2, &["run.csv: cannot be written: "]);
    assert!([bench.text("run.csv"), bench.text("run.meta.toml")] == before);
    let left = std::fs::read_dir(bench.folder()).unwrap();
    let left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
    assert!(
        !left
            .iter()
            .any(|name| name.to_string_lossy().starts_with(".softrig-")),
        "{left:?}"
    );
}
