//! `softrig commission` on virtual rigs, healthy and broken: which step finds what.

#[path = "../../../../host-tools/tests/common/schema.rs"]
mod schema;

use std::fs;
use std::io::{BufRead, BufReader, Lines, Write};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::{Duration, Instant};

use super::common::program;
use super::served::{VirtualRig, programs, rig, wait_until};
use rustix::process::{Pid, Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use schema::follows;

/// The steps of a run that failed, and its exit code; none without a simulator.
fn commission(arguments: &[&str]) -> Option<(Vec<String>, Option<i32>)> {
    programs()?;
    let folder = tempfile::tempdir().unwrap();
    let output = rig(
        &folder,
        &[&["commission", "--json", "-"], arguments].concat(),
    );
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
    let schema = rig(&folder, &["schema", "commission"]);
    let schema: serde_json::Value = serde_json::from_slice(&schema.stdout).unwrap();
    follows(&schema, &schema, &report, "commission");
    assert!(
        !folder.path().join("softrig.toml").exists(),
        "a simulator at full speed has no clock to correct by"
    );
    Some((failed, output.status.code()))
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
const FOUND_BY: [(&str, &[&str], &[&str]); 19] = [
    ("open-flex", &["noise"], &["noise"]),
    ("detached-flex", &["noise"], &["noise"]),
    ("drifting-pressure", &["noise"], &["noise"]),
    ("flickering-pressure", &["noise"], &["noise"]),
    ("reference", &["noise"], &["noise"]),
    ("ground", &["noise"], &["noise"]),
    ("mains", &["noise"], &["noise"]),
    ("noise", &["telemetry"], &["telemetry"]),
    ("brown-out", &["telemetry"], &["telemetry"]),
    (
        "emergency-stop",
        &["identity", "switches"],
        &["identity", "switches"],
    ),
    ("retracted-switch", &["identity", "switches"], &["switches"]),
    ("leak", &["homing"], &["homing"]),
    ("vent-open", &["homing"], &["homing"]),
    ("late=0.8s", &["homing"], &["homing"]),
    ("branch", &["homing"], &["homing"]),
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

/// The clock goes from the step into the file, from there into the metadata, and into the times.
#[test]
fn the_measured_clock_corrects_the_times_of_a_recording() {
    let Some(served) = VirtualRig::start(&["--clock-error", "0.43"]) else {
        return;
    };
    let record = |name: &str| {
        let arguments = ["record", "--port", "port", "--seconds", "1", "-o", name];
        let output = served.rig(&arguments);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        let path = served.folder.path().join(name);
        let text = fs::read_to_string(&path).unwrap();
        let last = text.lines().last().unwrap();
        let time_s: f64 = last.split(',').next().unwrap().parse().unwrap();
        let meta = fs::read_to_string(path.with_extension("meta.toml")).unwrap();
        let meta: toml::Table = meta.parse().unwrap();
        let factor = meta.get("clock_factor").and_then(toml::Value::as_float);
        // By the board's clock there are 10 ms from row to row.
        (
            time_s,
            factor,
            0.01 * (text.lines().count() as f64 - 2.0),
            said,
        )
    };
    let (raw_s, factor, board_s, _) = record("raw.csv");
    assert_eq!(factor, None);
    assert!((raw_s - board_s).abs() < 1e-9, "{raw_s} {board_s}");

    let measured = served.rig(&[
        "commission",
        "--port",
        "port",
        "--only",
        "clock",
        "--seconds",
        "12",
        "--json",
        "-",
    ]);
    let said = String::from_utf8_lossy(&measured.stderr);
    assert!(measured.status.success(), "{said}");
    let report: serde_json::Value = serde_json::from_slice(&measured.stdout).unwrap();
    let clock = |key: &str| report["clock"][key].as_f64().unwrap();
    let (found, error) = (clock("factor"), clock("standard_error"));
    assert!((found - 1.0043).abs() < 5.0 * error, "{found} {error}");

    let (corrected_s, factor, board_s, _) = record("corrected.csv");
    assert_eq!(factor, Some(found));
    assert!(
        (corrected_s - board_s * found).abs() < 2e-6,
        "{corrected_s} {board_s}"
    );

    let path = served.folder.path().join("softrig.toml");
    let of_another = fs::read_to_string(&path).unwrap();
    let of_another = of_another.replace("\"simulated\"", "\"usb 2341:0042 75330\"");
    fs::write(&path, of_another).unwrap();
    let (_, factor, _, said) = record("another.csv");
    assert_eq!(factor, None);
    assert!(
        said.contains("75330") && said.contains("not corrected"),
        "{said}"
    );
}

/// A person at the keyboard of `softrig commission`, who does at the rig what it says.
struct Person {
    rig: Child,
    keyboard: fs::File,
    said: Lines<BufReader<ChildStderr>>,
}

impl Person {
    fn start(served: &VirtualRig, steps: &[&str]) -> Self {
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        let terminal = ptsname(&keyboard, Vec::new()).unwrap();
        let terminal = fs::File::open(terminal.to_str().unwrap()).unwrap();
        let mut command = Command::new(program());
        command.args(["commission", "--port", "port", "--json", "board.json"]);
        for step in steps {
            command.args(["--only", step]);
        }
        let mut rig = command
            .current_dir(&served.folder)
            .stdin(terminal)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = BufReader::new(rig.stderr.take().unwrap()).lines();
        Self {
            rig,
            keyboard: keyboard.into(),
            said,
        }
    }

    fn types(&mut self, text: &str) {
        self.keyboard.write_all(text.as_bytes()).unwrap();
    }

    /// The next line that it says; none at its end.
    fn hears(&mut self) -> Option<String> {
        self.said.next().map(Result::unwrap)
    }

    fn exit_code(&mut self) -> Option<i32> {
        self.rig.wait().unwrap().code()
    }
}

#[test]
fn a_person_who_does_what_it_says_passes() {
    let Some(mut served) = VirtualRig::start(&[]) else {
        return;
    };
    let mut person = Person::start(&served, &["switches", "emergency-stop"]);
    let (mut all, mut done, mut agreed, mut answered) = (String::new(), 0, 0, 0);
    while let Some(line) = person.hears() {
        all += &format!("{line}\n");
        if line.contains("Enter begins") {
            person.types("perhaps\n\n");
            agreed += 1;
        } else if line.contains("(y or n, then Enter)") {
            person.types("y\n");
            answered += 1;
        } else if let Some(hand) = line.split('`').find(|it| it.starts_with("fault ")) {
            let answer = served.obey(hand);
            assert!(answer.starts_with("ok"), "{answer}");
            done += 1;
        }
    }
    assert_eq!(person.exit_code(), Some(0), "{all}");
    // Three switches, each pressed and pulled, and the button.
    assert_eq!((done, agreed, answered), (2 * (2 * 3 + 1), 1, 1), "{all}");
    assert!(all.contains("Answer with y, n, s or q."), "{all}");
}

#[test]
fn a_person_skips_and_ends_it_while_the_pump_runs() {
    for way in ["q", "Ctrl-C"] {
        let Some(mut served) = VirtualRig::start(&[]) else {
            return;
        };
        let mut person = Person::start(&served, &["switches", "homing"]);
        let mut all = String::new();
        while let Some(line) = person.hears() {
            all += &format!("{line}\n");
            if line.contains("press and hold") {
                person.types("s\n");
            } else if line.contains("Enter begins") {
                person.types("\n");
                let moves = || served.obey("status").contains("driver=on");
                let until = Instant::now() + Duration::from_secs(20);
                wait_until(until, moves);
                match way {
                    "q" => person.types("q\n"),
                    _ => kill_process(Pid::from_child(&person.rig), Signal::INT).unwrap(),
                }
            }
        }
        assert_eq!(person.exit_code(), Some(1), "{way}: {all}");
        assert!(all.contains("Skipped by the operator."), "{way}: {all}");
        assert!(all.contains("stopped by the operator"), "{way}: {all}");
        let rests = || {
            let status = served.obey("status");
            status.contains("driver=off") && status.contains("valve=open")
        };
        wait_until(Instant::now() + Duration::from_secs(5), rests);
    }
}
