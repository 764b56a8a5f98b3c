//! The commands that speak to a board, with a board that misbehaves.
#![cfg(unix)]

mod fake_board;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use fake_board::{FakeBoard, Script, patient, wait_until};
use host_tools::io::recording::Recording;
use host_tools::rig::link::{Event, Link, LinkError, SerialConnector, Timing};
use tempfile::TempDir;
use wire::reply::Refusal;
use wire::settings::{Key, Settings};
use wire::state::State;

/// A folder to run commands in, with a board.
struct Bench {
    folder: TempDir,
    board: FakeBoard,
}

/// Two steps of a second, each with a release.
const TWO_STEPS: &str = r#"schema = 1
name = "two"

[[segment]]
kind = "step"
track = "angle_open_loop"
level_deg = 60.0
duration_s = 1.5

[[segment]]
kind = "release"
duration_s = 2.0

[[segment]]
kind = "repeat"
from = 1
times = 1
"#;

const MODEL: &str = r#"schema = 1
name = "bench actuator"

[dynamics]
inertia_kg_m = 0.36
damping_n_s_per_rad = 0.913
stiffness_n_per_rad_n = 4.2
exponent = 1.727
input_gain_n_per_kpa = 0.12

[[effect]]
kind = "coulomb_friction"
force_n = 0.02
"#;

impl Bench {
    fn new(script: Script) -> Self {
        Self::with_settings(script, &patient())
    }

    fn with_settings(script: Script, settings: &Settings) -> Self {
        let bench = Self {
            folder: tempfile::tempdir().unwrap(),
            board: FakeBoard::with_settings(script, settings),
        };
        bench.put("two.toml", TWO_STEPS);
        bench.put("m.toml", MODEL);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn meta(&self, name: &str) -> toml::Table {
        self.text(name).parse().unwrap()
    }

    fn recording(&self, name: &str) -> Recording {
        Recording::read(&self.path(name)).unwrap().0
    }

    fn words(&self, line: &str) -> Vec<String> {
        let port = self.board.port().display().to_string();
        line.split_whitespace()
            .map(|word| word.replace("PORT", &port))
            .collect()
    }

    /// Runs `rig`; `PORT` stands for the board's.
    fn rig(&self, line: &str) -> Said {
        self.rig_with(line, "")
    }

    fn rig_with(&self, line: &str, stdin: &str) -> Said {
        let output = Command::new(env!("CARGO_BIN_EXE_rig"))
            .current_dir(self.folder.path())
            .args(self.words(line))
            .write_stdin(stdin)
            .timeout(Duration::from_secs(90))
            .output()
            .unwrap();
        Said::new(line, output)
    }

    /// Starts `rig` and leaves it running.
    fn start(&self, line: &str) -> Child {
        std::process::Command::new(env!("CARGO_BIN_EXE_rig"))
            .current_dir(self.folder.path())
            .args(self.words(line))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn rows(&self, name: &str) -> usize {
        std::fs::read_to_string(self.path(name)).map_or(0, |text| text.lines().count())
    }

    fn has_armed(&self) -> bool {
        self.board.heard("arm")
    }
}

/// What a command said.
struct Said {
    line: String,
    code: Option<i32>,
    out: String,
    err: String,
}

impl Said {
    fn new(line: &str, output: Output) -> Self {
        Self {
            line: line.to_owned(),
            code: output.status.code(),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }

    fn ok(self) -> Self {
        assert_eq!(
            self.code,
            Some(0),
            "`rig {}` said\n{}{}",
            self.line,
            self.out,
            self.err
        );
        self
    }

    /// Asserts that it failed with this code and said these parts.
    fn failed(self, code: i32, parts: &[&str]) -> Self {
        assert_eq!(
            self.code,
            Some(code),
            "`rig {}` said\n{}{}",
            self.line,
            self.out,
            self.err
        );
        for part in parts {
            assert!(self.err.contains(part), "no {part:?} in {:?}", self.err);
        }
        assert!(!self.err.contains("panicked"), "{}", self.err);
        self
    }

    fn says(&self, part: &str) {
        assert!(
            self.out.contains(part),
            "`rig {}`: no {part:?} in {:?}",
            self.line,
            self.out
        );
    }
}

fn assert_increasing(recording: &Recording) {
    assert!(recording.time.windows(2).all(|pair| pair[1] > pair[0]));
}

// ---- recording ----

#[test]
fn a_protocol_is_recorded_as_one_file_with_its_runs_as_segments() {
    let bench = Bench::new(Script::default());
    let said = bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .ok();
    said.says("rig diagnose --model MODEL.toml run.csv");
    assert!(!bench.path("run_60_1.csv").exists());
    for heard in [
        "arm",
        "load 3",
        "seg 0 step open 60.00 1500",
        "seg 2 repeat 0 1",
        "run",
        "disarm",
    ] {
        assert!(
            bench.board.heard(heard),
            "{heard}: {:?}",
            bench.board.script().heard
        );
    }
    assert!(bench.board.script().beats > 3);
    let header = bench.text("run.csv").lines().next().unwrap().to_owned();
    assert_eq!(
        header,
        "time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq"
    );
    let whole = bench.recording("run.csv");
    assert!(whole.time[0] == 0.0 && whole.duration() > 7.0);
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["protocol"].as_str(), Some("two"));
    assert_eq!(meta["firmware"].as_str(), Some("9.9.9"));
    assert_eq!(meta["settings"].as_str(), Some("1d0f"));
    assert_eq!(meta["complete"].as_bool(), Some(true));
    assert_eq!(meta["simulated"].as_bool(), Some(true));
    assert_eq!(meta["dropped_lines"].as_integer(), Some(0));
    assert_eq!(meta["segments"][0].as_str(), Some("step open 60.00 1500"));
    assert_eq!(
        meta["samples"].as_integer().unwrap(),
        i64::try_from(whole.len()).unwrap()
    );
    // The board's clock had run before it was listened to.
    let uptime = whole.meta.uptime_s.unwrap();
    assert!((0.0..60.0).contains(&uptime), "{uptime}");
    let setpoint = whole.column("setpoint_deg").unwrap();
    let segments = &whole.meta.segment;
    assert_eq!(segments.len(), 2, "{segments:?}");
    assert_eq!(Some(segments[0].to_s), Some(segments[1].from_s));
    for (repeat, segment) in (1..).zip(segments) {
        assert_eq!(segment.setpoint_deg, Some(60.0));
        assert_eq!(segment.setpoint_kpa, None);
        assert_eq!(segment.repeat, Some(repeat));
        let onset = (0..whole.len())
            .find(|&row| whole.time[row] >= segment.from_s && !setpoint[row].is_nan())
            .unwrap();
        let rest = whole.time[onset] - segment.from_s;
        assert!((0.45..=0.55).contains(&rest), "{rest}");
        let length = segment.to_s - segment.from_s;
        assert!((length - 3.5).abs() < 0.7, "{length}");
    }
}

#[test]
fn steps_are_cut_into_files_when_asked() {
    let bench = Bench::new(Script::default());
    let said = bench
        .rig("record --port PORT --protocol two.toml -o run.csv --split")
        .ok();
    said.says("run_60_1.csv");
    said.says("rig diagnose --model MODEL.toml run.csv");
    let whole = bench.recording("run.csv");
    assert_eq!(whole.meta.segment.len(), 2);
    assert_eq!(whole.meta.part_of, None);
    for (repeat, segment) in (1..).zip(&whole.meta.segment) {
        let run = bench.recording(&format!("run_60_{repeat}.csv"));
        assert_eq!(run.meta.repeat, Some(repeat));
        assert_eq!(run.meta.setpoint_deg, Some(60.0));
        assert_eq!(run.meta.protocol.as_deref(), Some("two"));
        assert_eq!(run.meta.part_of.as_deref(), Some("run.csv"));
        assert_eq!(run.meta.begins_s, Some(segment.from_s));
        assert_eq!(run.meta.uptime_s, whole.meta.uptime_s);
        assert_eq!(run.meta.started, whole.meta.started);
        assert!(run.meta.segment.is_empty());
        assert!(run.time[0] == 0.0);
        let setpoint = run.column("setpoint_deg").unwrap();
        let onset = setpoint.iter().position(|level| !level.is_nan()).unwrap();
        assert!(
            (0.45..=0.55).contains(&run.time[onset]),
            "{}",
            run.time[onset]
        );
        assert!((run.duration() - 3.5).abs() < 0.7, "{}", run.duration());
        assert!(run.angle.iter().fold(0.0_f64, |a, b| a.max(*b)) > 0.9);
    }
    bench
        .rig("compare --model m.toml run_60_1.csv run_60_2.csv")
        .ok();
}

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
fn only_protocols_of_steps_are_cut_and_old_scripts_still_run() {
    let bench = Bench::new(Script::default());
    bench
        .rig("record --port PORT --protocol triangle -o run.csv --split")
        .failed(2, &["triangle is not one of steps", "leave --split away"]);
    assert!(!bench.has_armed());
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv --whole")
        .ok();
    assert_eq!(bench.recording("run.csv").meta.segment.len(), 2);
}

#[test]
fn a_named_protocol_needs_no_loading() {
    let bench = Bench::new(Script {
        speed: 40,
        ..Script::default()
    });
    bench
        .rig("record --port PORT --protocol hold -o hold.csv")
        .ok();
    assert!(bench.board.heard("run hold"));
    assert!(
        !bench
            .board
            .script()
            .heard
            .iter()
            .any(|heard| heard.starts_with("load"))
    );
    assert!(bench.recording("hold.csv").duration() > 30.0);
    // It goes from rest to rest once, and not by a step.
    assert_eq!(bench.recording("hold.csv").meta.segment, []);
}

#[test]
fn a_rig_at_rest_is_recorded_without_moving_it() {
    let bench = Bench::new(Script::default());
    bench.rig("record --port PORT --seconds 3 -o rest.csv").ok();
    let recording = bench.recording("rest.csv");
    assert!((2.9..3.5).contains(&recording.duration()));
    assert!(!bench.has_armed());
}

#[test]
fn beats_keep_a_board_alive_whose_clock_runs_ahead() {
    // Two seconds of its patience are a fifth of a second of ours.
    let bench = Bench::with_settings(
        Script {
            speed: 10,
            ..Script::default()
        },
        &Settings::DEFAULT,
    );
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .ok();
}

#[test]
fn dry_runs_and_lists_need_no_board() {
    let bench = Bench::new(Script {
        pulled: true,
        ..Script::default()
    });
    let list = bench.rig("record --list").ok();
    list.says("paper");
    list.says("2:20");
    let dry = bench.rig("record --protocol two.toml --dry-run").ok();
    dry.says("0:07 min");
    dry.says("step to 60° open loop, 1.5 s");
    dry.says("seg 1 release 2000");
}

#[test]
fn what_exists_is_not_replaced() {
    let bench = Bench::new(Script::default());
    bench.put("run_60_2.csv", "precious");
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv --split")
        .failed(2, &["run_60_2.csv: exists", "--force"]);
    assert!(!bench.has_armed() && !bench.path("run.csv").exists());
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv --split --force")
        .ok();
    assert_ne!(bench.text("run_60_2.csv"), "precious");
}

#[test]
fn protocols_over_the_limits_move_nothing() {
    let bench = Bench::new(Script::default());
    bench.put("far.toml", &TWO_STEPS.replace("60.0", "110.01"));
    bench
        .rig("record --port PORT --protocol far.toml -o far.csv")
        .failed(
            2,
            &[
                "far.toml, line 4: segment 1: asks for 110.01 °",
                "110 °",
                "set.deg",
            ],
        );
    assert!(!bench.has_armed() && !bench.path("far.csv").exists());
}

#[test]
fn malformed_protocols_are_refused_with_their_place() {
    let bench = Bench::new(Script::default());
    bench.put(
        "bad.toml",
        &TWO_STEPS.replace("level_deg = 60.0", "level_deg = sixty"),
    );
    bench
        .rig("record --port PORT --protocol bad.toml -o bad.csv")
        .failed(2, &["bad.toml, line 7, column 13"]);
    bench
        .rig("record --port PORT --protocol papre -o bad.csv")
        .failed(2, &["there is no protocol \"papre\"", "paper"]);
    assert!(bench.board.script().heard.is_empty());
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
    assert!((18..=26).contains(&count("damaged_lines")), "{meta}");
    // Those that were damaged are missing too.
    assert!((30..=42).contains(&count("dropped_lines")), "{meta}");
    let recording = bench.recording("run.csv");
    assert_increasing(&recording);
    let sequence = recording.column("seq").unwrap();
    let missing = sequence[sequence.len() - 1] - sequence[0] + 1.0 - sequence.len() as f64;
    assert!((missing - count("dropped_lines") as f64).abs() <= 2.0);
}

#[test]
fn rows_without_a_reading_never_become_numbers() {
    let bench = Bench::new(Script::default());
    let child = bench.start("record --port PORT --seconds 20 -o run.csv");
    wait_until("rows", || bench.rows("run.csv") > 100);
    bench.board.script().no_flex = true;
    wait_until("rows without a reading", || {
        bench.rows("run.faulty.csv") > 100
    });
    bench.board.script().no_flex = false;
    assert!(child.wait_with_output().unwrap().status.success());
    let recording = bench.recording("run.csv");
    assert!(recording.duration() > 19.0);
    let faulty = bench.text("run.faulty.csv");
    let row: Vec<&str> = faulty.lines().nth(1).unwrap().split(',').collect();
    assert!(!row[1].is_empty() && row[2].is_empty(), "{row:?}");
    let meta = bench.meta("run.meta.toml");
    let kept = meta["samples"].as_integer().unwrap();
    let without = meta["rows_without_reading"].as_integer().unwrap();
    assert_eq!(without, i64::try_from(faulty.lines().count() - 1).unwrap());
    assert_eq!(kept, i64::try_from(recording.len()).unwrap());
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
    if let Some(gap) = meta.get("gap") {
        assert_eq!(gap[0]["restarted"].as_bool(), Some(false), "{meta}");
    }
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
        warnings[0].contains("run.csv: is not complete: ")
            && warnings[0].contains("run.meta.toml says"),
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
    assert!(said.err.contains("is not complete"), "{}", said.err);
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

/// Starts `rig` where no file can have more than `blocks` blocks of a shell: as full as a disk
/// gets without one. The shell that is killed by the signal for it is told to ignore it.
fn start_with_room(bench: &Bench, blocks: u32, line: &str) -> Child {
    std::process::Command::new("sh")
        .current_dir(bench.folder.path())
        .arg("-c")
        .arg(format!(
            "trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\""
        ))
        .arg(env!("CARGO_BIN_EXE_rig"))
        .args(bench.words(line))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
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
    let left = std::fs::read_dir(bench.folder.path()).unwrap();
    let left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
    assert!(
        !left
            .iter()
            .any(|name| name.to_string_lossy().starts_with(".rig-")),
        "{left:?}"
    );
}

#[test]
fn what_a_board_says_is_not_obeyed_by_the_terminal() {
    const HOSTILE: &str = "\u{1b}]0;title\u{7}\u{1b}[2J\u{9b}31m\u{202e}";
    let harmless = |said: &Said| {
        for text in [&said.out, &said.err] {
            assert!(
                !text.contains(|c: char| (c.is_control() && c != '\n') || c == '\u{202e}'),
                "`rig {}` said {text:?}",
                said.line
            );
        }
    };
    let bench = Bench::new(Script {
        remark: Some(HOSTILE),
        ..Script::default()
    });
    let said = bench.rig("monitor --port PORT --seconds 3").ok();
    assert!(
        said.err.contains("# \\u001b]0;title\\u0007"),
        "{}",
        said.err
    );
    harmless(&said);
    for line in [
        "monitor --port PORT --seconds 2 --log seen.csv",
        "record --port PORT --seconds 2 -o run.csv",
        "record --port PORT --protocol two.toml -o two.csv",
        "upload --port PORT --model m.toml",
        "upload --port PORT --read",
    ] {
        harmless(&bench.rig(line).ok());
    }
    // Quoted in files it is as TOML quotes it.
    for meta in ["seen.meta.toml", "run.meta.toml"] {
        assert!(!bench.text(meta).contains('\u{1b}'), "{meta}");
    }
    let babble = Bench::new(Script {
        babble: Some("\u{1b}[2J\u{9b}31m login: \r\n"),
        ..Script::default()
    });
    let said = babble.rig("monitor --port PORT --seconds 2");
    assert_ne!(said.code, Some(0));
    harmless(&said);
    bench.put("s.toml", "max.kpa = \"\u{1b}[2J\"\n");
    let said = bench.rig("upload --port PORT --settings s.toml");
    assert_eq!(said.code, Some(2));
    harmless(&said);
    bench.put("s.toml", "\"\\u001b[2J\" = 1\n");
    let said = bench.rig("upload --port PORT --settings s.toml");
    assert_eq!(said.code, Some(2));
    harmless(&said);
}

#[test]
fn every_line_is_in_the_file_within_a_second() {
    let bench = Bench::new(Script {
        speed: 1,
        ..Script::default()
    });
    let mut child = bench.start("record --port PORT -o run.csv");
    wait_until("a first row", || bench.rows("run.csv") > 1);
    let (begun, before) = (Instant::now(), bench.rows("run.csv"));
    std::thread::sleep(Duration::from_millis(1_500));
    let expected = begun.elapsed().as_millis() / 10 - 100;
    let came = bench.rows("run.csv") - before;
    assert!(came as u128 > expected, "{came} of {expected}");
    child.kill().unwrap();
    child.wait().unwrap();
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

#[test]
fn a_latched_fault_forbids_to_move_until_it_is_cleared() {
    let bench = Bench::with_settings(
        Script {
            speed: 10,
            ..Script::default()
        },
        &Settings::DEFAULT,
    );
    let mut child = bench.start("record --port PORT --protocol steps -o first.csv");
    wait_until("it runs", || bench.board.script().state == State::Running);
    child.kill().unwrap();
    child.wait().unwrap();
    wait_until("the board notices", || {
        bench.board.script().state == State::Fault
    });
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .failed(1, &["computer lost", "--clear"]);
    assert!(!bench.path("run.csv").exists());
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv --clear")
        .ok();
}

// ---- the link ----

#[test]
fn a_port_that_is_absent_is_a_fault_of_the_input() {
    let bench = Bench::new(Script {
        pulled: true,
        ..Script::default()
    });
    for line in [
        "record --port PORT --seconds 1 -o run.csv",
        "monitor --port PORT --plain",
        "upload --port PORT --model m.toml",
        "calibrate --port PORT",
    ] {
        bench.rig(line).failed(2, &["port: is not there"]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_port_that_another_program_has_open_is_left_to_it_by_name() {
    let bench = Bench::new(Script::default());
    let mut first = bench.start("monitor --port PORT --plain");
    let port = bench.board.port().canonicalize().unwrap();
    wait_until("the first one has it", || {
        let files = std::fs::read_dir(format!("/proc/{}/fd", first.id())).unwrap();
        files
            .flatten()
            .any(|file| std::fs::read_link(file.path()).is_ok_and(|target| target == port))
    });
    let said = bench
        .rig("record --port PORT --seconds 1 -o run.csv")
        .failed(
            2,
            &[
                &format!("rig (process {}) has it open", first.id()),
                "close that program",
            ],
        );
    assert!(!said.err.contains("use one of"), "{}", said.err);
    first.kill().unwrap();
    first.wait().unwrap();
    bench.rig("record --port PORT --seconds 1 -o run.csv").ok();
}

#[test]
fn a_silent_board_is_given_up() {
    let bench = Bench::new(Script {
        silent: true,
        ..Script::default()
    });
    let begun = Instant::now();
    bench
        .rig("monitor --port PORT --plain")
        .failed(1, &["not a byte came", "power", "cargo xtask flash"]);
    assert!(begun.elapsed() < Duration::from_secs(12));
}

#[test]
fn a_board_in_its_bootloader_is_waited_for_and_not_disturbed() {
    let bench = Bench::new(Script {
        boot_ms: 2_000,
        ..Script::default()
    });
    bench.rig("record --port PORT --seconds 1 -o run.csv").ok();
    // The one question came after the banner.
    assert_eq!(
        bench
            .board
            .script()
            .heard
            .iter()
            .filter(|heard| *heard == "hello")
            .count(),
        1
    );
}

#[test]
fn something_else_than_softrig_is_told_from_silence() {
    let bench = Bench::new(Script {
        babble: Some("echo: Marlin 2.1\nstart\n"),
        ..Script::default()
    });
    bench
        .rig("monitor --port PORT --plain")
        .failed(1, &["no softrig firmware answered", "rig ports"]);
}

#[test]
fn another_version_names_who_has_to_move() {
    let bench = Bench::new(Script {
        version: 99,
        ..Script::default()
    });
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["version 99", "update rig"]);
    bench.board.script().version = 0;
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["version 0", "cargo xtask flash"]);
}

#[test]
fn refusals_are_sentences() {
    let bench = Bench::new(Script {
        refuse: vec![("arm", Refusal::NoReading)],
        ..Script::default()
    });
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .failed(
            1,
            &[
                "refused `arm`",
                "a sensor has no valid reading: check its wires",
                "kept in run.csv",
            ],
        );
}

#[test]
fn lost_requests_are_repeated_and_the_deaf_given_up() {
    let board = FakeBoard::start(Script::default());
    let port = board.port().display().to_string();
    let mut link = Link::open(SerialConnector::new(&port), Timing::default()).unwrap();
    board.script().deaf = 2;
    assert_eq!(link.get(Key::Exponent).unwrap(), 2.365_f32.to_bits());
    board.script().deaf = 1000;
    let error = link.status().unwrap_err();
    assert!(
        matches!(error, LinkError::NoReply { attempts: 4, .. }),
        "{error}"
    );
    board.script().deaf = 0;
    assert_eq!(link.status().unwrap().state, State::Idle);
    // What came meanwhile was kept.
    let mut last = None;
    while let Some(event) = link.next_event(Duration::ZERO) {
        let Event::Sample(received) = event else {
            continue;
        };
        if let Some(last) = last {
            assert_eq!(received.sample.sequence, last + 1);
        }
        last = Some(received.sample.sequence);
    }
    assert!(last.is_some());
    assert_eq!(link.counters().dropped, 0);
}

// ---- monitor ----

#[test]
fn into_a_pipe_the_monitor_prints_lines() {
    let bench = Bench::new(Script::default());
    let said = bench
        .rig("monitor --port PORT --every 0.5 --seconds 5 --log seen.csv")
        .ok();
    let lines: Vec<&str> = said.out.lines().collect();
    assert!(lines[0].starts_with("time_s,pressure_kpa,angle_deg"));
    assert!((10..=12).contains(&lines.len()), "{}", said.out);
    assert!(
        lines[1].starts_with("0.000,") && lines[2].starts_with("0.500,"),
        "{}",
        said.out
    );
    // The log has everything, and is a recording.
    assert!(bench.recording("seen.csv").len() > 450);
    assert!(!bench.has_armed());
}

// ---- upload ----

#[test]
fn a_model_is_uploaded_and_read_back() {
    let bench = Bench::new(Script::default());
    let dry = bench
        .rig("upload --port PORT --model m.toml --dry-run")
        .ok();
    dry.says("damping");
    dry.says("1.8 → 0.913");
    dry.says("coulomb_friction");
    assert!(
        !bench
            .board
            .script()
            .heard
            .iter()
            .any(|heard| heard.starts_with("set"))
    );
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
        &read.out.replace("max.kpa    = 180.0", "max.kpa    = 150.0"),
    );
    let said = bench.rig("upload --port PORT --settings all.toml").ok();
    said.says("180 → 150");
    said.says("1 settings written");
}

#[test]
fn settings_that_the_board_refuses_change_nothing() {
    let bench = Bench::new(Script {
        refuse: vec![("save", Refusal::BadSettings)],
        ..Script::default()
    });
    bench.rig("upload --port PORT --model m.toml").failed(
        1,
        &[
            "still uses its old settings",
            "refused `save`",
            "do not fit together",
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

// ---- calibrate ----

#[test]
fn a_table_is_taken_from_a_bench() {
    let bench = Bench::new(Script::default());
    bench.put(
        "t.csv",
        "angle_deg,flex_counts\n0,668.4\n90,412.5\n45,540\n",
    );
    let said = bench
        .rig_with("calibrate --port PORT --assume t.csv --lower-limits", "\n")
        .ok();
    said.says("102.0 counts at rest");
    said.says("45.0    540.0");
    said.says("the board now shows");
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
    let bench = Bench::new(Script::default());
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_rig"))
        .current_dir(bench.folder.path())
        .args(bench.words("calibrate --port PORT --points 0,90 --lower-limits"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
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
    bench.board.script().shake = 16 * 6;
    stdin.write_all(b"\n").unwrap();
    let before = raws(&bench);
    wait_until("the first try", || raws(&bench) > before + 25);
    bench.board.script().shake = 0;
    stdin.write_all(b"\n").unwrap();
    let before = raws(&bench);
    wait_until("the second try", || raws(&bench) > before + 25);
    bench.board.script().raw.1 = 16 * 400;
    stdin.write_all(b"\n").unwrap();
    let output = child.wait_with_output().unwrap();
    let said = Said::new("calibrate", output);
    assert!(said.err.contains("not steady"), "{}", said.err);
    let said = said.ok();
    said.says("90.0    400.0");
}

#[test]
fn calibrations_that_make_no_sense_change_nothing() {
    let bench = Bench::new(Script::default());
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
        .failed(2, &["do not go one way"]);
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
    assert!(
        !bench
            .board
            .script()
            .heard
            .iter()
            .any(|heard| heard.starts_with("set"))
    );
}

// ---- virtual ----

#[test]
fn a_simulator_that_is_not_built_says_how_to_build_it() {
    let folder = tempfile::tempdir().unwrap();
    let rig = folder.path().join("rig");
    std::fs::copy(env!("CARGO_BIN_EXE_rig"), &rig).unwrap();
    let run = |args: &[&str], simulator: Option<&Path>| {
        let mut command = std::process::Command::new(&rig);
        command.current_dir(folder.path()).arg("virtual").args(args);
        command
            .env_remove("SOFTRIG_VIRTUAL_RIG")
            .env_remove("SOFTRIG_FIRMWARE");
        if let Some(path) = simulator {
            command.env("SOFTRIG_VIRTUAL_RIG", path);
        }
        Said::new("virtual", command.output().unwrap())
    };
    run(&[], None).failed(2, &["virtual-rig is not built", "cargo xtask setup"]);
    let simulator = folder.path().join("virtual-rig");
    executable(&simulator, "echo \"port $6 of $*\"\nexit 0\n");
    run(&[], None).failed(2, &["firmware is not built", "cargo xtask firmware"]);
    let image = folder.path().join("image.elf");
    std::fs::write(&image, "").unwrap();
    let image = image.to_str().unwrap();
    let said = run(&["--image", image, "--hide", "7", "--link", "here"], None).ok();
    said.says("serve --control --image");
    said.says("--link here --hide 7 --speed realtime");
    said.says("rig monitor --port");
    executable(&simulator, "echo broken >&2\nexit 3\n");
    run(&["--image", image], Some(&simulator)).failed(1, &["broken", "exit status: 3"]);
}

#[test]
fn the_simulator_is_told_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let simulator = folder.path().join("virtual-rig");
    executable(
        &simulator,
        "trap 'echo ended > ended; exit 0' TERM\necho port somewhere\nwhile :; do sleep 0.05; done\n",
    );
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_rig"))
        .current_dir(folder.path())
        .args(["virtual", "--image", "virtual-rig"])
        .env("SOFTRIG_VIRTUAL_RIG", &simulator)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut stdout = std::io::BufReader::new(child.stdout.take().unwrap());
    std::io::BufRead::read_line(&mut stdout, &mut line).unwrap();
    assert!(line.contains("somewhere"), "{line}");
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
    assert!(child.wait().unwrap().success());
    assert!(folder.path().join("ended").exists());
}

fn executable(path: &Path, script: &str) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::write(path, format!("#!/bin/sh\n{script}")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

#[test]
fn ports_are_listed_for_people_and_programs() {
    let bench = Bench::new(Script::default());
    bench.rig("ports").ok();
    let list: serde_json::Value =
        serde_json::from_str(&bench.rig("ports --json").ok().out).unwrap();
    assert!(list.is_array());
}

#[test]
fn what_a_board_plays_can_be_simulated_first() {
    let bench = Bench::new(Script {
        pulled: true,
        ..Script::default()
    });
    bench
        .rig("simulate --model m.toml --protocol two.toml -o two.csv")
        .ok();
    assert!((bench.recording("two.csv").duration() - 7.5).abs() < 0.05);
    bench
        .rig("simulate --model m.toml --protocol board:triangle -o triangle.csv")
        .ok();
    assert!(bench.recording("triangle.csv").duration() > 70.0);
    bench
        .rig("simulate --model m.toml --protocol papre")
        .failed(2, &["there is no protocol \"papre\""]);
}
