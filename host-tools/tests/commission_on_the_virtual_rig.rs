//! `rig commission` on virtual rigs, healthy and broken: which step finds what.
//!
//! `cargo xtask test` builds the image and the simulator and says where they are. Without them
//! there is nothing to test, and the tests say so.
#![cfg(unix)]

use std::env;
use std::fs;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// The steps of a run that failed, and its exit code; none without a simulator.
fn commission(arguments: &[&str]) -> Option<(Vec<String>, Option<i32>)> {
    let folder = tempfile::tempdir().unwrap();
    let output = rig(
        &folder,
        &[&["commission", "--json", "-"], arguments].concat(),
    )?;
    let said = String::from_utf8_lossy(&output.stderr);
    let report: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let failed: Vec<String> = report["steps"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|step| step["outcome"] == "failed")
        .map(|step| step["step"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(report["passed"], failed.is_empty(), "{said}");
    assert!(
        !folder.path().join("rig.toml").exists(),
        "a simulator at full speed has no clock to correct by"
    );
    Some((failed, output.status.code()))
}

fn rig(folder: &TempDir, arguments: &[&str]) -> Option<Output> {
    if env::var_os("SOFTRIG_FIRMWARE").is_none() || env::var_os("SOFTRIG_VIRTUAL_RIG").is_none() {
        println!(
            "skipped: SOFTRIG_FIRMWARE and SOFTRIG_VIRTUAL_RIG are not set; `cargo xtask test` builds both and sets them"
        );
        return None;
    }
    let rig = env!("CARGO_BIN_EXE_rig");
    let output = Command::new(rig)
        .args(arguments)
        .current_dir(folder)
        .output();
    Some(output.unwrap())
}

#[test]
fn a_healthy_rig_passes_every_step() {
    for seed in ["1", "2"] {
        let arguments = ["--virtual", "--seconds", "6", "--seed", seed];
        let Some((failed, code)) = commission(&arguments) else {
            return;
        };
        assert_eq!((failed.as_slice(), code), (&[][..], Some(0)), "seed {seed}");
    }
}

/// What each fault of the virtual rig is found by; and what only follows from it is left out, to
/// be quick.
const FOUND_BY: [(&str, &[&str], &[&str]); 12] = [
    ("open-flex", &["noise"], &["noise"]),
    ("detached-flex", &["noise"], &["noise"]),
    ("drifting-pressure", &["noise"], &["noise"]),
    ("noise", &["telemetry"], &["telemetry"]),
    ("brown-out", &["telemetry"], &["telemetry"]),
    (
        "emergency-stop",
        &["identity", "switches"],
        &["identity", "switches"],
    ),
    ("retracted-switch", &["identity", "switches"], &["switches"]),
    ("leak", &["homing", "pressure"], &["pressure"]),
    ("vent-shut", &["emergency-stop"], &["emergency-stop"]),
    ("reversed-motor", &["homing"], &["homing"]),
    ("low-supply", &["telemetry"], &["telemetry"]),
    ("lost-steps", &["stroke"], &["stroke"]),
];

#[test]
fn each_fault_is_found_by_the_step_that_is_for_it() {
    for (fault, steps, found_by) in FOUND_BY {
        let mut arguments = vec!["--virtual", "--seconds", "6", "--fault", fault];
        for step in steps {
            arguments.extend(["--only", step]);
        }
        let Some((failed, code)) = commission(&arguments) else {
            return;
        };
        assert_eq!(
            (failed.as_slice(), code),
            (&found_by.map_to_owned()[..], Some(1)),
            "{fault}"
        );
    }
}

trait MapToOwned {
    fn map_to_owned(&self) -> Vec<String>;
}

impl MapToOwned for &[&str] {
    fn map_to_owned(&self) -> Vec<String> {
        self.iter().map(|&it| it.to_owned()).collect()
    }
}

/// The simulator in real time, stopped when dropped.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The clock goes from the step into the file, from there into the metadata, and into the times.
#[test]
fn the_measured_clock_corrects_the_times_of_a_recording() {
    let (Some(image), Some(simulator)) = (
        env::var_os("SOFTRIG_FIRMWARE"),
        env::var_os("SOFTRIG_VIRTUAL_RIG"),
    ) else {
        println!("skipped: `cargo xtask test` builds image and simulator");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("port");
    let served = Command::new(simulator)
        .args(["serve", "--image"])
        .arg(image)
        .arg("--link")
        .arg(&port)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let _served = Served(served.unwrap());
    let until = Instant::now() + Duration::from_secs(30);
    while !port.exists() && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(50));
    }
    let record = |name: &str| {
        let arguments = ["record", "--port", "port", "--seconds", "1", "-o", name];
        let output = rig(&folder, &arguments).unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let last = text.lines().last().unwrap();
        let time_s: f64 = last.split(',').next().unwrap().parse().unwrap();
        let meta = folder.path().join(name).with_extension("meta.toml");
        let meta: toml::Table = fs::read_to_string(meta).unwrap().parse().unwrap();
        let factor = meta.get("clock_factor").and_then(toml::Value::as_float);
        (time_s, factor, text.lines().count(), said)
    };
    let (raw_s, factor, rows, _) = record("raw.csv");
    assert_eq!(factor, None);
    assert!(
        (raw_s - 0.01 * (rows as f64 - 2.0)).abs() < 1e-9,
        "{raw_s} {rows}"
    );

    let clock = |board: &str| {
        format!(
            "schema = 1\nboard = \"{board}\"\n[clock]\nfactor = 1.0043\nstandard_error = 1e-5\nseconds = 60.0\n"
        )
    };
    let path = folder.path().join("rig.toml");
    fs::write(&path, clock("simulated")).unwrap();
    let (corrected_s, factor, rows, _) = record("corrected.csv");
    assert_eq!(factor, Some(1.0043));
    let expected_s = 0.01 * (rows as f64 - 2.0) * 1.0043;
    assert!(
        (corrected_s - expected_s).abs() < 2e-6,
        "{corrected_s} {expected_s}"
    );

    fs::write(&path, clock("usb 2341:0042 75330")).unwrap();
    let (_, factor, _, said) = record("another.csv");
    assert_eq!(factor, None);
    assert!(
        said.contains("75330") && said.contains("not corrected"),
        "{said}"
    );
}
