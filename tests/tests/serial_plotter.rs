//! What the serial plotter of the Arduino IDE 2 makes of the board's lines.
//!
//! The plotter has one rule for every line that arrives, whatever it was meant for: a line
//! with a colon is taken for `name:number` pairs, one without for plain numbers, each a
//! curve. So a reply like `A 17 ok` would leave curves called "value 2" behind.

use firmware::app::HELP;
use wire::checksum::Crc16;
use wire::decimal::Hundredths;
use wire::fault::Fault;
use wire::reply::{self, REMARK, Refusal};
use wire::self_test::DONE;
use wire::state::State;
use wire::step_report::StepReport;
use wire::telemetry::{Setpoint, Telemetry};
use wire::text::Text;

/// The curves to which a line adds a point, with the point. As
/// `src/msgAggregatorWorker.ts` of arduino/arduino-serial-plotter-webapp has it: names and
/// values are told apart at the first colon of each part, a pair needs both, and a value
/// is what `parseFloat` makes of it.
fn plotted(line: &str) -> Vec<(String, f64)> {
    let line = line.trim_end_matches(['\r', '\n']);
    let parts = line.split([',', ' ', '\t']).filter(|part| !part.is_empty());
    if line.find(':').is_some_and(|at| at > 0) {
        parts
            .filter_map(|part| {
                let mut halves = part.split(':');
                let (name, value) = (halves.next()?.trim(), halves.next()?.trim());
                (!name.is_empty() && !value.is_empty()).then(|| (name.into(), parsed(value)))
            })
            .collect()
    } else {
        (1..)
            .zip(parts)
            .map(|(number, value)| (format!("value {number}"), parsed(value)))
            .collect()
    }
}

/// The longest number that a text begins with; what is none makes a curve all the same.
fn parsed(text: &str) -> f64 {
    (0..=text.len())
        .rev()
        .filter_map(|end| text.get(..end))
        .filter(|start| !start.ends_with(|c: char| c.is_ascii_alphabetic()))
        .find_map(|start| start.parse().ok())
        .unwrap_or(f64::NAN)
}

fn sealed(text: &str) -> String {
    format!("{text} *{:04x}", Crc16::of(text.as_bytes()).value())
}

#[test]
fn the_rule_is_that_of_the_plotter() {
    assert_eq!(
        plotted("a:1.5,b:-2\tc: 3 4 d:5e1x:9\r\n"),
        [("a".into(), 1.5), ("b".into(), -2.0), ("d".into(), 50.0)]
    );
    assert_eq!(
        plotted("1 2.5"),
        [("value 1".into(), 1.0), ("value 2".into(), 2.5)]
    );
    // Words too, as curves without a point; they stand in the legend.
    assert_eq!(plotted("A 17 ok *3a2f").len(), 4);
    // A colon at the very start does not count.
    assert_eq!(plotted(":1").len(), 1);
}

#[test]
fn telemetry_is_drawn_with_words() {
    let sample = Telemetry {
        sequence: 512,
        time_ms: 5_120,
        pressure_kpa: Some(Hundredths(3_842)),
        angle_deg: Some(Hundredths(5_981)),
        predicted_deg: Some(Hundredths(6_002)),
        setpoint: Setpoint::Angle(Hundredths(6_000)),
        volume_ul: 14_210,
        state: State::Running,
        fault: 0,
        mismatch: true,
    };
    let curves = |sample: &Telemetry| {
        let mut text = Text::default();
        let Ok(()) = sample.write(&mut text);
        plotted(&text.0)
    };
    let expected = [
        ("pressure", 38.42),
        ("angle", 59.81),
        ("predicted", 60.02),
        ("setpoint", 60.0),
        ("volume", 14.21),
    ];
    assert_eq!(
        curves(&sample),
        expected.map(|(name, value)| (name.to_owned(), value))
    );
    let at_rest = curves(&Telemetry {
        setpoint: Setpoint::None,
        angle_deg: None,
        ..sample
    });
    let names: Vec<_> = at_rest.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["pressure", "angle", "predicted", "volume"]);
    assert!(at_rest[1].1.is_nan(), "a gap in the curve");
    let in_pressure = curves(&Telemetry {
        setpoint: Setpoint::Pressure(Hundredths(11_000)),
        ..sample
    });
    assert_eq!(in_pressure[3], ("setpoint_kpa".into(), 110.0));
}

#[test]
fn nothing_else_is_drawn() {
    let manual = include_str!("../../docs/serial.md");
    let mut lines: Vec<String> = manual
        .lines()
        .filter_map(|line| line.strip_prefix("< "))
        .filter(|line| !line.starts_with("T "))
        .map(str::to_owned)
        .collect();
    assert!(lines.len() >= 10, "{lines:?}");
    let remarks = Fault::ALL.iter().map(|fault| fault.sentence());
    let remarks = remarks.chain(HELP).chain([
        "softrig 0.1.0 wire 3 settings f21b image 4f2a, brown-out",
        "softrig 0.1.0 wire 3 settings f21b image 91c3 built 4f2a",
        "saved",
        "not saved",
        "free 2672 lost 0 dropped 0",
    ]);
    lines.extend(remarks.map(|remark| sealed(&format!("{REMARK}{remark}"))));
    for &refusal in Refusal::ALL {
        let mut out = Text::default();
        let Ok(()) = reply::no(&mut out, 255, refusal);
        lines.push(out.0);
    }
    let mut out = Text::default();
    let report = StepReport {
        power: "micromath",
        effect: Some(3),
        angle_rad: 0.3,
        rate_rad_per_s: -0.1,
    };
    let Ok(()) = report.write(&mut out);
    lines.push(out.0);
    lines.push(sealed(DONE));
    for line in lines {
        assert_eq!(plotted(&line), [], "{line}");
    }
}
