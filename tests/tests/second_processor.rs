//! The image on a second simulated processor: avr8js beside simavr.
//!
//! A mistake of one simulator, or firmware that leans on it, shows where another one differs. Both
//! get the same stimuli at the same cycles, with nothing around the board that answers to it; see
//! `tests/second_processor/`. `cargo xtask test` builds the image and the simulator, and installs
//! avr8js where Node.js is; without them there is nothing to compare, and the test says so.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use wire::command::{Command as Order, Request};
use wire::decimal::Hundredths;
use wire::protocol::{ControlMode, Segment};
use wire::settings::Key;
use wire::text::Text;

/// Lines of telemetry, 100 a second, after which the prediction has forgotten its start.
const SETTLED_LINES: usize = 600;

/// What a board said and did.
struct Run {
    lines: Vec<String>,
    marks: Vec<String>,
    position: i64,
}

impl Run {
    fn of(output: &Output) -> Self {
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let did = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{did}");
        let position = did
            .lines()
            .find_map(|line| line.strip_prefix("position ")?.parse().ok())
            .unwrap_or_else(|| panic!("no position in {did}"));
        // The last line may be cut off where the script ends.
        let whole = said.rsplit_once('\n').map_or("", |(whole, _)| whole);
        Self {
            lines: whole.lines().map(|it| it.trim_end().to_owned()).collect(),
            marks: did
                .lines()
                .filter(|line| line.starts_with("mark "))
                .map(str::to_owned)
                .collect(),
            position,
        }
    }

    /// Everything but telemetry and counters of the RAM, which depend on when interrupts came.
    fn answers(&self) -> Vec<&str> {
        self.lines
            .iter()
            .map(String::as_str)
            .filter(|line| !line.starts_with("T ") && !line.starts_with("#: free"))
            .collect()
    }

    fn telemetry(&self) -> Vec<&str> {
        let all = self.lines.iter().map(String::as_str);
        all.filter(|line| line.starts_with("T ")).collect()
    }
}

/// Settings, EEPROM, homing by switches that open when the script says, a run, and the self-test.
fn script() -> String {
    let mut lines = vec![
        // Closed, as at rest.
        "0 pin E4 0".to_owned(),
        "0 pin E5 0".to_owned(),
        "0 pin D0 0".to_owned(),
        "0 counts 0 102".to_owned(),
        "0 counts 1 668".to_owned(),
        // The retracted switch answers, and lets go again.
        "9.5 pin E4 1".to_owned(),
        "10.2 pin E4 0".to_owned(),
        // The sensor shows what is pushed in at the start position, and that the vent lets it out.
        "13.7 counts 0 111".to_owned(),
        "16.1 counts 0 102".to_owned(),
    ];
    let mut id = 0;
    let mut say = |seconds: f64, command: Order| {
        id += 1;
        let mut text = Text::default();
        let Ok(()) = Request { id, command }.write(&mut text);
        lines.push(format!("{seconds:.3} send {}", text.0.trim_end()));
    };
    say(0.5, Order::Hello);
    say(0.7, Order::Status);
    say(0.9, Order::Raw);
    say(1.1, Order::Switches);
    say(1.3, Order::Help);
    say(
        2.0,
        Order::Set {
            key: Key::Damping,
            bits: 1.25_f32.to_bits(),
        },
    );
    say(2.1, Order::Save);
    say(6.5, Order::Get(Key::Damping));
    say(7.0, Order::Arm);
    for quarter in 30..104 {
        if quarter != 84 {
            say(f64::from(quarter) * 0.25 + 0.1, Order::Beat);
        }
    }
    say(20.0, Order::Load(1));
    let segment = Segment::Ramp {
        mode: ControlMode::AngleOpenLoop,
        level: Hundredths(1_000),
        duration_ms: 2_000,
    };
    say(20.2, Order::Segment { index: 0, segment });
    say(20.4, Order::Run(None));
    say(23.0, Order::Status);
    say(26.0, Order::Stop);
    say(26.3, Order::Clear);
    say(26.6, Order::Status);
    say(27.0, Order::SelfTest);
    lines.sort_by(|a, b| time(a).total_cmp(&time(b)));
    lines.push("40 end\n".to_owned());
    lines.join("\n")
}

fn time(line: &str) -> f64 {
    let seconds = line.split(' ').next().and_then(|it| it.parse().ok());
    seconds.unwrap_or_else(|| panic!("no time: {line}"))
}

#[test]
fn two_processors_of_different_authors_do_the_same() {
    let (Some(image), Some(simulator)) = (
        env::var_os("SOFTRIG_FIRMWARE"),
        env::var_os("SOFTRIG_VIRTUAL_RIG"),
    ) else {
        println!("skipped: `cargo xtask test` builds image and simulator");
        return;
    };
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("second_processor");
    if !folder.join("node_modules/avr8js").exists() {
        println!(
            "skipped: avr8js is not installed; `npm ci` in tests/second_processor does it, with Node.js 20 or later"
        );
        return;
    }
    let target = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = target.join("second_processor.script");
    fs::write(&path, script()).unwrap();
    let first = Command::new(simulator)
        .args(["run", "--script"])
        .arg(&path)
        .arg(&image)
        .output();
    let second = Command::new("node")
        .arg(folder.join("run.mjs"))
        .arg(&image)
        .arg(&path)
        .output();
    let Ok(second) = second else {
        println!("skipped: there is no Node.js; `apt-get install nodejs npm` has one");
        return;
    };
    let (first, second) = (Run::of(&first.unwrap()), Run::of(&second));

    let answers = first.answers();
    assert_eq!(answers, second.answers());
    // That both say nothing would be equal too.
    let replies = |kind: &str| answers.iter().filter(|line| line.contains(kind)).count();
    assert!(replies("A: ") >= 60, "{answers:#?}");
    assert!(
        replies("step ") >= 30 && replies("self-test: done") == 1,
        "{answers:#?}"
    );
    assert!(replies(" no ") == 0, "{answers:#?}");
    assert!(replies("#: saved") == 1, "{answers:#?}");

    assert_eq!(first.marks, second.marks, "cycles of the measured sections");
    assert!(first.marks.len() >= 30, "{:?}", first.marks);

    assert_eq!(first.position, second.position, "microsteps");
    assert!(first.position.abs() > 1_000, "{}", first.position);

    // The first reading comes a period later in one of them, and with it the prediction, which
    // creeps to its rest for some seconds. From then on lines are the same to the last digit, but
    // for a microstep at the end of a period now and then.
    let (first, second) = (first.telemetry(), second.telemetry());
    assert_eq!(first.len(), second.len());
    let settled = first.iter().zip(&second).skip(SETTLED_LINES);
    let different: Vec<_> = settled.clone().filter(|(a, b)| a != b).collect();
    assert!(
        settled.len() > 2_000 && different.len() <= 10,
        "{different:#?}"
    );
}
