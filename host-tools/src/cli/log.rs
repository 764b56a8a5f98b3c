//! `softrig log`: the last faults of a board.

use clap::Parser;
use serde::Serialize;
use wire::fault::Fault;
use wire::history::FaultRecord;

use super::port::PortArgs;
use softrig_link::{Link, SerialConnector, Timing};

/// Lists the last eight faults of a board; they survive a power cut.
///
/// Fault times count from the board's last start before it: there is no calendar.
/// Opening the port restarts a Mega; what is in the log stays.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig log --port /dev/ttyACM0
  softrig log --port /dev/ttyACM0 --json | jq -r '.[0].fault'")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Print a JSON list, the latest first
    #[arg(long)]
    json: bool,
}

/// A fault, for programs.
#[derive(Debug, Serialize)]
struct Entry {
    /// Counts the board's faults from 0, and wraps at 65536.
    number: u16,
    /// Its code in telemetry.
    code: u8,
    /// Its name; none for one of a newer firmware.
    fault: Option<&'static str>,
    /// Cause and advice.
    sentence: Option<&'static str>,
    /// The state in which it struck.
    state: &'static str,
    /// Time from the start of the board (s).
    time_s: f64,
    /// Gauge pressure (kPa); none without a reading.
    pressure_kpa: Option<f64>,
    /// Volume that the pump had displaced (ml).
    volume_ml: f64,
    /// Why the board had started.
    started_by: &'static str,
}

impl From<&FaultRecord> for Entry {
    fn from(record: &FaultRecord) -> Self {
        let fault = Fault::from_code(record.fault);
        Self {
            number: record.number,
            code: record.fault,
            fault: fault.map(Fault::name),
            sentence: fault.map(Fault::sentence),
            state: record.state.name(),
            time_s: f64::from(record.time_ms) / 1000.0,
            pressure_kpa: record.pressure_kpa.map(|value| f64::from(value.0) / 100.0),
            volume_ml: f64::from(record.volume_ul) / 1000.0,
            started_by: record.reset.name(),
        }
    }
}

/// Runs the command.
///
/// # Errors
///
/// When the port cannot be opened, the board does not answer, or its firmware has no log.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut link = Link::open(SerialConnector::new(&args.port.find()?), Timing::default())?;
    let log: Vec<Entry> = link.fault_log()?.iter().map(Entry::from).collect();
    let text = if args.json {
        format!("{}\n", serde_json::to_string_pretty(&log)?)
    } else {
        table(&log)
    };
    Ok(super::print(&text)?)
}

fn table(log: &[Entry]) -> String {
    let Some(latest) = log.first() else {
        return "No fault is in the board's log.\n".into();
    };
    let mut text = format!(
        "{:>5}  {:<16}  {:<7}  {:>12}  {:>12}  {:>9}  {}\n",
        "no.", "fault", "while", "after start", "pressure", "volume", "started by"
    );
    for entry in log {
        let pressure = entry
            .pressure_kpa
            .map_or("no reading".into(), |kpa| format!("{kpa:.2} kPa"));
        let name = entry
            .fault
            .map_or_else(|| format!("code {}", entry.code), str::to_owned);
        text += &format!(
            "{:>5}  {name:<16}  {:<7}  {:>10.2} s  {pressure:>12}  {:>6.2} ml  {}\n",
            entry.number, entry.state, entry.time_s, entry.volume_ml, entry.started_by
        );
    }
    if let Some(sentence) = latest.sentence {
        text += &format!("\nThe latest: {sentence}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use wire::decimal::Hundredths;
    use wire::history::ResetCause;
    use wire::state::State;

    use super::*;

    #[test]
    fn a_table_has_units_and_the_advice_for_the_latest() {
        assert!(table(&[]).contains("No fault"));
        let record = FaultRecord {
            number: 12,
            fault: 2,
            state: State::Running,
            reset: ResetCause::Watchdog,
            time_ms: 512_340,
            pressure_kpa: Some(Hundredths(18_120)),
            volume_ul: 14_210,
        };
        let unknown = FaultRecord {
            fault: 200,
            pressure_kpa: None,
            ..record
        };
        let text = table(&[Entry::from(&record), Entry::from(&unknown)]);
        let lines: Vec<&str> = text.lines().collect();
        for part in [
            "12  over-pressure",
            "running",
            "512.34 s",
            "181.20 kPa",
            "14.21 ml",
            "watchdog",
        ] {
            assert!(lines[1].contains(part), "{part}: {text}");
        }
        assert!(lines[2].contains("code 200") && lines[2].contains("no reading"));
        assert!(text.contains(Fault::OverPressure.sentence()));
        assert_eq!(lines[0].find("started by"), lines[1].find("watchdog"));
    }
}
