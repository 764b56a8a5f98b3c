//! `softrig calibrate`: zero of the pressure sensor and table of the flex sensor.

use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use clap::Parser;
use indicatif::ProgressBar;

use super::Interrupt;
use super::port::PortArgs;
use softrig_formats::error::InputError;
use softrig_formats::terminal::remark;
use softrig_link::calibrate::{Operator, Plan, Point, calibrate, check_angles};
use softrig_link::{Link, SerialConnector, Timing};

/// Calibrates the sensors of a rig, guided step by step.
///
/// First the pressure sensor's zero is taken, at rest. Then bend the actuator to
/// each angle on a protractor and press Enter: the flex sensor's counts are
/// averaged over a second, and refused while they move. Nothing is changed until
/// the last point is taken.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig calibrate --port /dev/ttyACM0
  softrig calibrate --port /dev/ttyACM0 --points 0,20,40,60,80,90 --lower-limits
  softrig calibrate --port /dev/ttyACM0 --assume bench.csv

On a simulated rig, type `bend 30` into the terminal of `softrig virtual` to bend its
actuator to 30 degrees.

--assume takes the table from a CSV file with the columns angle_deg and
flex_counts (counts of a ten-bit converter, fractions allowed).")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Angles to bend to, in degrees: two to eight, in any order
    #[arg(
        long,
        value_name = "DEG,…",
        value_delimiter = ',',
        default_value = "0,30,60,90,120",
        allow_negative_numbers = true
    )]
    points: Vec<f32>,
    /// Take the flex sensor's table from a file instead of measuring it
    #[arg(long, value_name = "FILE.csv", conflicts_with = "points")]
    assume: Option<PathBuf>,
    /// If the table ends below the angle at which the board stops the rig, lower
    /// that limit to its end, and the limit of set-points to the last point
    #[arg(long)]
    lower_limits: bool,
    /// Show the table, and change nothing
    #[arg(long)]
    dry_run: bool,
}

/// Runs the command.
///
/// # Errors
///
/// Invalid arguments before the port is opened; then unusable readings, and settings that
/// the board refuses.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let assumed = args.assume.as_deref().map(read_table).transpose()?;
    check_angles(&args.points)?;
    let interrupt = Interrupt::listen()?;
    let port = args.port.find()?;
    let mut link = Link::open(SerialConnector::new(&port), Timing::default())?;
    let plan = Plan {
        points: args.points.clone(),
        assumed,
        lower_limits: args.lower_limits,
        dry_run: args.dry_run,
    };
    let mut terminal = Terminal::new(interrupt);
    let done = calibrate(&mut link, plan, &mut terminal);
    terminal.bar.finish_and_clear();
    Ok(super::print(&done?)?)
}

/// Who stands at the rig, and the lines that they type.
struct Terminal {
    lines: Receiver<String>,
    interrupt: Interrupt,
    bar: ProgressBar,
}

impl Terminal {
    fn new(interrupt: Interrupt) -> Self {
        let (sender, lines) = channel();
        // The counts must be shown while a key is awaited.
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                let Ok(line) = line else { return };
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        let bar = if std::io::stderr().is_terminal() {
            super::spinner()
        } else {
            ProgressBar::hidden()
        };
        Self {
            lines,
            interrupt,
            bar,
        }
    }
}

impl Operator for Terminal {
    fn asks(&mut self, what: &str) {
        self.says(&format!(
            "{what}, and press Enter (q ends without a change)"
        ));
    }

    fn sees(&mut self, counts: Option<f32>) {
        self.bar.set_message(counts.map_or_else(
            || "averaging".to_owned(),
            |counts| format!("{counts:.1} counts"),
        ));
    }

    fn says(&mut self, text: &str) {
        self.bar.suspend(|| remark(text));
    }

    fn warns(&mut self, text: &str) {
        self.bar.suspend(|| super::warn(text));
    }

    fn shows(&mut self, table: &str) -> anyhow::Result<()> {
        Ok(self.bar.suspend(|| super::print(table))?)
    }

    fn is_ready(&mut self) -> anyhow::Result<bool> {
        self.may_go_on()?;
        match self.lines.recv_timeout(Duration::from_millis(10)) {
            Ok(line) if line.trim().eq_ignore_ascii_case("q") => {
                anyhow::bail!("ended by the operator; nothing was changed")
            }
            Ok(_) => Ok(true),
            Err(RecvTimeoutError::Timeout) => Ok(false),
            Err(RecvTimeoutError::Disconnected) => Err(InputError::new(
                "the input ended before the last point was taken, nothing was changed",
                "press Enter once for the rest and once for each point, and again where it was not steady",
            )
            .into()),
        }
    }

    fn may_go_on(&self) -> anyhow::Result<()> {
        if self.interrupt.requested() {
            anyhow::bail!("interrupted; nothing was changed");
        }
        Ok(())
    }
}

/// Reads `angle_deg,flex_counts`.
fn read_table(path: &Path) -> Result<Vec<Point>, InputError> {
    let text = softrig_formats::bounded::read_text(path)?;
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let fault = |line: u64, found: String| {
        InputError::new(
            found,
            "give a table with the columns angle_deg,flex_counts and a point in each row",
        )
        .in_file(path)
        .at_line(line)
    };
    let header = reader
        .headers()
        .map_err(|error| fault(1, error.to_string()))?;
    if header.iter().collect::<Vec<_>>() != ["angle_deg", "flex_counts"] {
        return Err(fault(
            1,
            format!(
                "has the columns {}",
                header.iter().collect::<Vec<_>>().join(", ")
            ),
        ));
    }
    let mut points = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| {
            let line = error.position().map_or(0, csv::Position::line);
            fault(line, "has a row of another length".into())
        })?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |field: usize| {
            let field = record.get(field).unwrap_or("");
            field
                .parse::<f32>()
                .ok()
                .filter(|value| value.is_finite())
                .ok_or_else(|| fault(line, format!("\"{field}\" is not a number")))
        };
        points.push(Point {
            angle_deg: number(0)?,
            counts: number(1)?,
        });
    }
    let angles: Vec<f32> = points.iter().map(|point| point.angle_deg).collect();
    check_angles(&angles).map_err(|error| error.in_file(path))?;
    Ok(points)
}
