//! A folder to run commands in, with the firmware behind the cable.

#[path = "board.rs"]
pub mod board;
#[path = "../common/mod.rs"]
pub mod common;

use std::ops::Deref;
use std::process::{Child, Output, Stdio};
use std::time::Duration;

use board::{Board, Script, patient};
use wire::settings::Settings;

/// Two steps of a second, each with a release.
pub const TWO_STEPS: &str = r#"schema = 1
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
pub struct Bench {
    pub folder: common::Bench,
    pub board: Board,
}

impl Deref for Bench {
    type Target = common::Bench;

    fn deref(&self) -> &common::Bench {
        &self.folder
    }
}

impl Bench {
    pub fn new(script: Script) -> Self {
        Self::with_settings(script, &patient())
    }

    pub fn with_settings(script: Script, settings: &Settings) -> Self {
        let bench = Self {
            folder: common::Bench::empty(),
            board: Board::with_settings(script, settings),
        };
        bench.put("two.toml", TWO_STEPS);
        bench.put("m.toml", common::MODEL);
        bench
    }

    pub fn meta(&self, name: &str) -> toml::Table {
        self.text(name).parse().unwrap()
    }

    pub fn words(&self, line: &str) -> Vec<String> {
        let port = self.board.port().display().to_string();
        line.split_whitespace()
            .map(|word| word.replace("PORT", &port))
            .collect()
    }

    /// Runs `softrig`; `PORT` stands for the board's.
    pub fn rig(&self, line: &str) -> Said {
        self.rig_with(line, "")
    }

    pub fn rig_with(&self, line: &str, stdin: &str) -> Said {
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
    pub fn start(&self, line: &str) -> Child {
        let mut command = std::process::Command::new(common::program());
        self.start_by(command.args(self.words(line)))
    }

    /// Starts a program and leaves it running, with pipes to talk to it.
    pub fn start_by(&self, command: &mut std::process::Command) -> Child {
        command
            .current_dir(self.folder())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    pub fn rows(&self, name: &str) -> usize {
        std::fs::read_to_string(self.path(name)).map_or(0, |text| text.lines().count())
    }

    pub fn has_armed(&self) -> bool {
        self.board.heard("arm")
    }
}

/// What a command said.
pub struct Said {
    pub line: String,
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Said {
    pub fn new(line: &str, output: Output) -> Self {
        Self {
            line: line.to_owned(),
            code: output.status.code(),
            out: String::from_utf8(output.stdout).unwrap(),
            err: String::from_utf8(output.stderr).unwrap(),
        }
    }

    pub fn ok(self) -> Self {
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
    pub fn failed(self, code: i32, parts: &[&str]) -> Self {
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

    pub fn says(&self, part: &str) {
        assert!(
            self.out.contains(part),
            "`softrig {}`: no {part:?} in {:?}",
            self.line,
            self.out
        );
    }
}
