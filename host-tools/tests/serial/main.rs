//! The commands that speak to a board, with the firmware behind the cable.
#![cfg(unix)]

mod board;
mod calibrate;
#[path = "../common/mod.rs"]
mod common;
mod interrupted;
mod link;
mod record;
mod simulator;
mod upload;

use std::ops::Deref;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use board::{Board, Script, patient};
use softrig_formats::recording::Recording;
use wire::settings::Settings;

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

/// A folder to run commands in, with a board.
struct Bench {
    folder: common::Bench,
    board: Board,
}

impl Deref for Bench {
    type Target = common::Bench;

    fn deref(&self) -> &common::Bench {
        &self.folder
    }
}

impl Bench {
    fn new(script: Script) -> Self {
        Self::with_settings(script, &patient())
    }

    fn with_settings(script: Script, settings: &Settings) -> Self {
        let bench = Self {
            folder: common::Bench::empty(),
            board: Board::with_settings(script, settings),
        };
        bench.put("two.toml", TWO_STEPS);
        bench.put("m.toml", common::MODEL);
        bench
    }

    fn meta(&self, name: &str) -> toml::Table {
        self.text(name).parse().unwrap()
    }

    fn words(&self, line: &str) -> Vec<String> {
        let port = self.board.port().display().to_string();
        line.split_whitespace()
            .map(|word| word.replace("PORT", &port))
            .collect()
    }

    /// Runs `softrig`; `PORT` stands for the board's.
    fn rig(&self, line: &str) -> Said {
        self.rig_with(line, "")
    }

    fn rig_with(&self, line: &str, stdin: &str) -> Said {
        let output = self
            .folder
            .line("")
            .args(self.words(line))
            .write_stdin(stdin)
            .timeout(Duration::from_secs(90))
            .output()
            .unwrap();
        Said::new(line, output)
    }

    /// Starts `softrig` and leaves it running.
    fn start(&self, line: &str) -> Child {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"));
        self.start_by(command.args(self.words(line)))
    }

    /// Starts a program and leaves it running, with pipes to talk to it.
    fn start_by(&self, command: &mut std::process::Command) -> Child {
        command
            .current_dir(self.folder())
            .stdin(Stdio::piped())
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
            "`softrig {}` said\n{}{}",
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
            "`softrig {}` said\n{}{}",
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
            "`softrig {}`: no {part:?} in {:?}",
            self.line,
            self.out
        );
    }
}

fn assert_increasing(recording: &Recording) {
    assert!(recording.time.windows(2).all(|pair| pair[1] > pair[0]));
}
