//! Finding a board, agreeing with it, and living with what it says; `softrig monitor` and `softrig ports`.

use std::time::{Duration, Instant};

use predicates::prelude::*;
use predicates::str::contains;
use softrig_link::{Event, Link, LinkError, SerialConnector, Timing};
use wire::settings::Key;
use wire::state::State;

use super::board::{Board, Script, wait_until};
use super::{Bench, Said};

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
                &format!("softrig (process {}) has it open", first.id()),
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
        .failed(1, &["not a byte came", "power", "softrig flash"]);
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
        .failed(1, &["no softrig firmware answered", "softrig ports"]);
}

#[test]
fn another_version_names_who_has_to_move() {
    let bench = Bench::new(Script {
        version: 99,
        ..Script::default()
    });
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["version 99", "update softrig"]);
    bench.board.script().version = 0;
    bench
        .rig("upload --port PORT --model m.toml")
        .failed(1, &["version 0", "softrig flash"]);
}

#[test]
fn lost_requests_are_repeated_and_the_deaf_given_up() {
    let board = Board::start(Script::default());
    let port = board.port().display().to_string();
    let mut link = Link::open(SerialConnector::new(&port), Timing::default()).unwrap();
    board.script().deaf = 2;
    assert_eq!(link.get(Key::Damping).unwrap(), 1.8_f32.to_bits());
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

#[test]
fn what_a_board_says_is_not_obeyed_by_the_terminal() {
    const HOSTILE: &str = "\u{1b}]0;title\u{7}\u{1b}[2J\u{9b}31m\u{202e}";
    let harmless = |said: &Said| {
        for text in [&said.out, &said.err] {
            assert!(
                !text.contains(|c: char| (c.is_control() && c != '\n') || c == '\u{202e}'),
                "`softrig {}` said {text:?}",
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

/// Datagrams arrive while the link goes on: as many as lines are printed, and none is lost on it.
#[test]
fn the_monitor_sends_json_for_other_programs() {
    let bench = Bench::new(Script::default());
    let there = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = there.local_addr().unwrap().port();
    let said = bench
        .rig(&format!(
            "monitor --port PORT --every 0 --seconds 1 --udp {port}"
        ))
        .ok();
    there.set_nonblocking(true).unwrap();
    let mut buffer = [0; 2048];
    let mut received = Vec::new();
    while let Ok(length) = there.recv(&mut buffer) {
        let value: serde_json::Value = serde_json::from_slice(&buffer[..length]).unwrap();
        assert!(value["angle_deg"].is_number(), "{value}");
        received.push(value["timestamp"].as_f64().unwrap());
    }
    let rows = said.out.lines().count() - 1;
    assert!(
        received.len() >= rows && rows > 20,
        "{} of {rows}",
        received.len()
    );
    assert!(received.is_sorted(), "{received:?}");
    assert!(!said.err.contains("lost"), "{}", said.err);
    let said = bench.rig("monitor --port PORT --plain --udp nowhere");
    assert_eq!(said.code, Some(2));
    assert!(said.err.contains("HOST:PORT"), "{}", said.err);
}

/// A command line goes before the environment, that before what commissioning wrote.
#[test]
fn the_port_is_named_once_for_all_commands() {
    let bench = Bench::new(Script::default());
    let port = bench.board.port().display().to_string();
    let monitor = "monitor --plain --seconds 0.2";
    bench
        .line(monitor)
        .env_remove("SOFTRIG_PORT")
        .assert()
        .code(2)
        .stderr(contains("no port is named").and(contains("SOFTRIG_PORT")));
    bench
        .line(monitor)
        .env("SOFTRIG_PORT", &port)
        .assert()
        .success();
    let measured =
        "board = \"simulated\"\n[clock]\nfactor = 1.0\nstandard_error = 1e-5\nseconds = 60.0\n";
    bench.put(
        "softrig.toml",
        format!("schema = 1\nport = \"{port}\"\n{measured}"),
    );
    bench
        .line(monitor)
        .env_remove("SOFTRIG_PORT")
        .assert()
        .success();
    bench
        .line(monitor)
        .env("SOFTRIG_PORT", "nowhere")
        .assert()
        .code(2)
        .stderr(contains("nowhere"));
    bench
        .line(&format!("{monitor} --port {port}"))
        .env("SOFTRIG_PORT", "nowhere")
        .assert()
        .success();
}

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

#[test]
fn ports_are_listed_for_people_and_programs() {
    let bench = Bench::new(Script::default());
    bench.rig("ports").ok();
    let list: serde_json::Value =
        serde_json::from_str(&bench.rig("ports --json").ok().out).unwrap();
    assert!(list.is_array());
}
