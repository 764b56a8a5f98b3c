//! What tests of the `softrig` command share: a folder to run it in, and what to put there.
#![allow(dead_code)] // Each test program uses its part.

pub mod pages;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use assert_cmd::assert::Assert;
use predicates::str::is_empty;
use softrig_formats::recording::Recording;
use tempfile::TempDir;

pub const MODEL: &str = r#"schema = 1
name = "bench actuator"

[dynamics]
inertia_kg_m = 0.36
damping_n_s_per_rad = 0.913
stiffness_n_per_rad_n = 4.2
exponent = 1.727
input_gain_n_per_kpa = 0.12

[fit]
free = ["damping", "stiffness", "input_gain"]

[[effect]]
kind = "coulomb_friction"
force_n = 0.02
"#;

pub const HEADER: &str = "time_s,pressure_kpa,angle_deg\n";

/// A step that rises to 50°, with neither noise nor fault.
pub fn clean_recording() -> String {
    let rows = (0..200).map(|k| {
        let time = f64::from(k) * 0.01;
        let angle = 50.0 * (1.0 - (-2.0 * time).exp());
        format!("{time:.2},30.0,{angle:.4}\n")
    });
    HEADER.to_owned() + &rows.collect::<String>()
}

pub fn compressed(content: impl AsRef<[u8]>) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(content.as_ref()).unwrap();
    encoder.finish().unwrap()
}

/// The program: cargo says where it is to the tests of its own package, and it is beside those of
/// the others.
pub fn program() -> PathBuf {
    option_env!("CARGO_BIN_EXE_softrig").map_or_else(
        || {
            let test = std::env::current_exe().unwrap();
            let built = test.ancestors().nth(2).unwrap().join("softrig");
            assert!(
                built.is_file(),
                "{} is not built: cargo build -p softrig-cli --features lab",
                built.display()
            );
            built
        },
        PathBuf::from,
    )
}

/// A folder to run commands in.
pub struct Bench(TempDir);

impl Bench {
    /// A folder with `m.toml` and the recordings `good.csv` and `other.csv`.
    pub fn new() -> Self {
        let bench = Self::empty();
        bench.put("m.toml", MODEL);
        bench.put("good.csv", clean_recording());
        bench.put("other.csv", clean_recording());
        bench
    }

    pub fn empty() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with an example that hides `effect`, in `demo`.
    pub fn with_example(effect: &str, noise_deg: &str) -> Self {
        let bench = Self::empty();
        bench
            .line("example -o demo --hide 11")
            .args(["--effect", effect, "--noise-deg", noise_deg])
            .assert()
            .success();
        bench
    }

    pub fn folder(&self) -> &Path {
        self.0.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder().join(name)
    }

    pub fn put(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    pub fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    pub fn recording(&self, name: &str) -> Recording {
        Recording::read(&self.path(name)).unwrap().0
    }

    /// `softrig` with a command line without quotes.
    pub fn line(&self, line: &str) -> Command {
        let mut command = Command::new(program());
        command
            .current_dir(self.folder())
            // A panic would print its backtrace.
            .env("RUST_BACKTRACE", "1")
            .args(line.split_whitespace());
        command
    }

    /// What a command that succeeds prints.
    pub fn prints(&self, line: &str) -> String {
        stdout(&self.line(line).assert().success())
    }

    /// Every file and folder with its content.
    pub fn contents(&self) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
        fn collect(folder: &Path, into: &mut BTreeMap<PathBuf, Option<Vec<u8>>>) {
            for entry in std::fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    into.insert(path.clone(), None);
                    collect(&path, into);
                } else {
                    let bytes = std::fs::read(&path).unwrap();
                    into.insert(path, Some(bytes));
                }
            }
        }
        let mut contents = BTreeMap::new();
        collect(self.folder(), &mut contents);
        contents
    }

    /// Asserts that the command ends with 2, that it says these parts, and that it leaves the
    /// folder as it was; what it said.
    pub fn fails(&self, line: &str, parts: &[&str]) -> String {
        let before = self.contents();
        let said = stderr(&self.line(line).assert().code(2).stdout(is_empty()));
        for part in parts {
            assert!(
                said.contains(part),
                "`softrig {line}`: no {part:?} in {said:?}"
            );
        }
        assert!(!said.contains("panicked"), "{said}");
        assert!(
            before == self.contents(),
            "`softrig {line}` changed the folder, and said {said:?}"
        );
        said
    }

    /// As [`Bench::fails`], in one sentence with these parts in this order and advice at its end.
    pub fn refuses(&self, line: &str, parts: &[&str]) {
        let said = self.fails(line, &[]);
        let sentence = said.strip_prefix("error: ").unwrap_or_else(|| {
            panic!("`softrig {line}` does not begin with \"error: \": {said:?}")
        });
        assert_eq!(said.lines().count(), 1, "`softrig {line}` says {said:?}");
        let mut rest = sentence;
        for part in parts {
            rest = rest
                .split_once(part)
                .unwrap_or_else(|| panic!("`softrig {line}`: no {part:?} (in order) in {said:?}"))
                .1;
        }
        let advice = sentence.rsplit_once("; ").map_or("", |(_, advice)| advice);
        assert!(
            advice.len() > 8,
            "`softrig {line}` gives no advice: {said:?}"
        );
    }
}

pub fn stdout(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stdout.clone()).unwrap()
}

pub fn stderr(assert: &Assert) -> String {
    String::from_utf8(assert.get_output().stderr.clone()).unwrap()
}
