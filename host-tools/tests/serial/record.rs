//! What `softrig record` leaves, and what keeps it from moving anything.

use std::time::{Duration, Instant};

use model_core::actuator::Model;
use wire::answer::SettingsId;
use wire::settings::Settings;
use wire::state::State;

use super::board::{FIRMWARE, Script, patient, wait_until};
use super::{Bench, TWO_STEPS};

#[test]
fn a_protocol_is_recorded_as_one_file_with_its_runs_as_segments() {
    let bench = Bench::new(Script::default());
    let said = bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .ok();
    said.says("softrig diagnose --model MODEL.toml run.csv");
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
        "time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq,mismatch"
    );
    let whole = bench.recording("run.csv");
    assert!(whole.time[0] == 0.0 && whole.duration() > 7.0);
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["protocol"].as_str(), Some("two"));
    assert_eq!(meta["firmware"].as_str(), Some(FIRMWARE));
    let settings = SettingsId::of(&patient()).to_string();
    assert_eq!(meta["settings"].as_str(), Some(&*settings));
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

/// A flex sensor that came off shows the rest whatever the pump does; open-loop runs go on.
#[test]
fn a_flex_sensor_that_came_off_is_in_the_recording_and_in_the_summary() {
    let bench = Bench::new(Script {
        speed: 10,
        ..Script::default()
    });
    // A rig of which the board has the right model.
    let right = firmware::plant::dynamics(&patient());
    bench.board.script().plant.model = Model::new(right, &[]).unwrap();
    let said = bench
        .rig("record --port PORT --protocol two.toml -o well.csv")
        .ok();
    assert!(!said.out.contains("disagrees"), "{}", said.out);
    let meta = bench.meta("well.meta.toml");
    assert!(meta.get("mismatch_from_s").is_none());
    let heard = bench.board.script().heard.len();
    let child = bench.start("record --port PORT --protocol two.toml -o run.csv");
    wait_until("it runs", || {
        let script = bench.board.script();
        script.heard[heard..].iter().any(|line| line == "run")
    });
    // 25 kΩ below 47 kΩ: what it shows at 0°.
    bench.board.script().plant.flex_counts = Some(1024.0 * 47.0 / 72.0);
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && said.contains("flex sensor that came off"),
        "{said}"
    );
    let recording = bench.recording("run.csv");
    let flags = recording.column("mismatch").unwrap();
    let from = flags.iter().position(|flag| *flag > 0.0).unwrap();
    let meta = bench.meta("run.meta.toml");
    let noted = meta["mismatch_from_s"].as_float().unwrap();
    assert!((noted - recording.time[from]).abs() < 0.02, "{noted}");
}

/// A motor with too little torque: the plunger stands less far in than was counted.
#[test]
fn steps_that_were_lost_in_a_run_are_in_its_summary() {
    let bench = Bench::new(Script {
        speed: 10,
        ..Script::default()
    });
    let said = bench
        .rig("record --port PORT --protocol two.toml -o well.csv")
        .ok();
    said.says("no steps lost");
    let lost = |file: &str| bench.meta(file)["lost_steps"].as_integer().unwrap();
    assert!(lost("well.meta.toml").abs() < 17);
    let heard = bench.board.script().heard.len();
    let child = bench.start("record --port PORT --protocol two.toml -o run.csv");
    wait_until("it runs", || {
        let script = bench.board.script();
        script.heard[heard..].iter().any(|line| line == "run")
    });
    // A thousand microsteps that the counter has and the plunger has not.
    bench.board.script().plant.zero -= 350.0;
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success() && said.contains("microsteps were lost"),
        "{said}"
    );
    assert!(said.contains("less far in"), "{said}");
    let found = lost("run.meta.toml");
    assert!((found - 1_000).abs() < 20, "{found}");
    // Homing for it is no part of the recording.
    let text = bench.text("run.csv");
    let (_, end) = text.rsplit_once("running").unwrap();
    assert!(!end.contains("homing"));
}

/// Nothing moves, and the sentence says what the supply is.
#[test]
fn a_low_supply_is_told_with_its_value() {
    let bench = Bench::new(Script::default());
    bench.board.script().plant.supply_v = 4.4;
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .failed(1, &["below 4.5 V (it is 4.4", "another cable"]);
    assert!(!bench.board.heard("run"));
}

#[test]
fn steps_are_cut_into_files_when_asked() {
    let bench = Bench::new(Script::default());
    let said = bench
        .rig("record --port PORT --protocol two.toml -o run.csv --split")
        .ok();
    said.says("run_60_1.csv");
    said.says("softrig diagnose --model MODEL.toml run.csv");
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
fn only_protocols_of_steps_are_cut_and_old_scripts_still_run() {
    let bench = Bench::new(Script::default());
    bench
        .rig("record --port PORT --protocol triangle -o run.csv --split")
        .failed(2, &["triangle is not one of steps", "omit --split"]);
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
    assert!(!bench.board.heard_any("load"));
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
    // Two seconds of its patience are 0.4 s of ours, and by ours a beat comes every 0.5 s.
    let bench = Bench::with_settings(
        Script {
            speed: 5,
            ..Script::default()
        },
        &Settings::DEFAULT,
    );
    bench
        .rig("record --port PORT --protocol two.toml -o run.csv")
        .ok();
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
    bench.put("far.toml", TWO_STEPS.replace("60.0", "110.01"));
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
        TWO_STEPS.replace("level_deg = 60.0", "level_deg = sixty"),
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
fn rows_without_a_reading_never_become_numbers() {
    let bench = Bench::new(Script::default());
    let child = bench.start("record --port PORT --seconds 20 -o run.csv");
    wait_until("rows", || bench.rows("run.csv") > 100);
    bench.board.script().plant.flex_counts = Some(0.0);
    wait_until("rows without a reading", || {
        bench.rows("run.faulty.csv") > 100
    });
    bench.board.script().plant.flex_counts = None;
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
fn refusals_are_sentences() {
    let bench = Bench::new(Script::default());
    bench.board.script().plant.flex_counts = Some(0.0);
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
fn a_latched_fault_forbids_to_move_until_it_is_cleared() {
    let bench = Bench::new(Script::default());
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

/// The run is cut off; the second before it is beside the recording, on its time axis, and the
/// board's log names the fault.
#[test]
fn the_second_before_a_fault_is_beside_the_recording() {
    let bench = Bench::new(Script::default());
    assert!(
        bench
            .rig("log --port PORT")
            .ok()
            .out
            .contains("No fault is in the board's log")
    );
    let child = bench.start("record --port PORT --protocol steps -o run.csv");
    wait_until("it runs", || bench.board.script().state == State::Running);
    std::thread::sleep(Duration::from_millis(300));
    bench.board.script().plant.emergency_stop = true;
    let said = child.wait_with_output().unwrap();
    let error = String::from_utf8(said.stderr).unwrap();
    assert!(
        error.contains("emergency stop") && error.contains("run.blackbox.csv"),
        "{error}"
    );
    let meta = bench.meta("run.meta.toml");
    assert_eq!(meta["black_box"].as_str(), Some("run.blackbox.csv"));
    let black_box = bench.text("run.blackbox.csv");
    let rows: Vec<Vec<&str>> = black_box
        .lines()
        .skip(1)
        .map(|row| row.split(',').collect())
        .collect();
    assert_eq!(rows.len(), 51, "{black_box}");
    // Each row is one of the recording, to the last digit.
    let recording = bench.text("run.csv");
    for row in &rows {
        let start = row[..3].join(",");
        assert!(
            recording
                .lines()
                .any(|line| line.starts_with(&format!("{start},"))),
            "{start}"
        );
    }
    let fault = recording
        .lines()
        .find(|line| line.contains(",fault,1,"))
        .expect("a row in the fault");
    assert!(fault.starts_with(rows[50][0]), "{fault}");
    assert_eq!(rows[50][4], "running");

    let log = bench.rig("log --port PORT --json").ok();
    let log: serde_json::Value = serde_json::from_str(&log.out).unwrap();
    assert_eq!(log[0]["fault"], "emergency stop");
    assert_eq!(log[0]["state"], "running");
    assert_eq!(log.as_array().unwrap().len(), 1);
    bench.board.script().plant.emergency_stop = false;
    // What an earlier recording left is not taken for this one's.
    bench
        .rig("record --port PORT --seconds 1 -o run.csv --clear --force")
        .ok();
    assert!(!bench.path("run.blackbox.csv").exists());
}
