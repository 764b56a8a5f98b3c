//! `softrig calibrate`: zero of the pressure sensor and table of the flex sensor.

use std::collections::VecDeque;
use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use clap::Parser;
use indicatif::ProgressBar;
use wire::settings::{FLEX_POINTS, Key, Settings};
use wire::state::State;

use super::Interrupt;
use super::port::PortArgs;
use softrig_formats::error::InputError;
use softrig_formats::settings_file::Assignment;
use softrig_formats::terminal::remark;
use softrig_link::{Event, Link, LinkError, SerialConnector, Timing, is_pseudo_terminal};

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

/// The board extrapolates its table by this share of the range of counts.
const BEYOND: f32 = 0.2;
/// Where a table should begin that lets an actuator swing past its rest: that of a new board has a
/// point there.
const BELOW_REST_DEG: f32 = -15.0;

/// Number of averaged readings: one second.
const READINGS: usize = 20;
/// Time between readings.
const EVERY: Duration = Duration::from_millis(50);
/// Largest spread of the readings of one second (counts). A steady hand moves by
/// less; a moving one would spoil the table.
const STEADY_COUNTS: f32 = 4.0;
/// Least distance of neighbouring points (counts): below it the table would follow
/// noise.
const APART_COUNTS: f32 = 2.0;

/// A point of the flex sensor's table.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    angle_deg: f32,
    counts: f32,
}

/// One reading of both sensors, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Raw {
    pressure: f32,
    flex: f32,
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
    let status = link.status()?;
    if !matches!(status.state, State::Idle | State::Fault) {
        return Err(link
            .late(
                &format!("the board is {}", status.state.name()),
                "calibrate at rest: stop it first (`softrig monitor`, key s)",
            )
            .into());
    }
    let settings = super::upload::read_settings(&mut link)?;
    let limit = settings.number(Key::MaxAngle);
    let (least, most) = ends(args.points.iter().copied());
    if assumed.is_none() && !args.lower_limits && most + BEYOND * (most - least) < limit {
        super::warn(&format!(
            "points up to {most}° will hardly reach the {limit}° at which the board stops the rig; bend further, or give --lower-limits"
        ));
    }
    let mut operator = Operator::new(interrupt);
    let zero = operator.measure(
        &mut link,
        "Let the actuator rest, open to the air, and press Enter",
        |raw| raw.pressure,
    )?;
    let mut points = match assumed {
        Some(points) => points,
        None => bend(args, &mut link, &mut operator)?,
    };
    points.sort_by(|a, b| a.angle_deg.total_cmp(&b.angle_deg));
    super::print(&table(zero, &points))?;
    check_table(&points)?;
    if let Some(warning) = short_below_rest(&points) {
        super::warn(&warning);
    }
    let mut wanted = assignments(zero, &points);
    wanted.extend(limits(&points, &settings, args.lower_limits)?);
    if args.dry_run {
        return Ok(());
    }
    let changes: Vec<Assignment> = wanted
        .into_iter()
        .filter(|&(key, bits)| settings.bits(key) != Some(bits))
        .collect();
    super::upload::apply(&mut link, &changes)?;
    let mut text = format!("{} settings written, stored and read back\n", changes.len());
    text += &check(&mut link)?;
    Ok(super::print(&text)?)
}

/// Measures at one angle after the other.
fn bend(args: &Args, link: &mut Link, operator: &mut Operator) -> anyhow::Result<Vec<Point>> {
    let is_simulated = is_pseudo_terminal(link.port());
    let mut points: Vec<Point> = Vec::new();
    for &angle_deg in &args.points {
        let mut ask = format!("Bend the actuator to {angle_deg}° and press Enter");
        if is_simulated {
            ask +=
                &format!("; a simulated one with `bend {angle_deg}` where `softrig virtual` runs");
        }
        let counts = operator.measure(link, &ask, |raw| raw.flex)?;
        let point = Point { angle_deg, counts };
        if let Some(&before) = points.last() {
            check_moved(before, point)?;
        }
        points.push(point);
    }
    Ok(points)
}

/// A sensor that reads the same at two angles is not on this actuator: refused at once, and
/// not only after the last point.
fn check_moved(before: Point, now: Point) -> Result<(), InputError> {
    if (now.counts - before.counts).abs() >= APART_COUNTS {
        return Ok(());
    }
    Err(InputError::new(
        format!(
            "the flex sensor did not move: {:.1} counts at {}° and {:.1} at {}°; nothing was changed",
            before.counts, before.angle_deg, now.counts, now.angle_deg
        ),
        "look whether the actuator was bent, whether the sensor is in its pocket, and whether its wire is on pin A1 with 47 kOhm to ground; then calibrate again",
    ))
}

/// The operator, and the lines that they type.
struct Operator {
    lines: Receiver<String>,
    interrupt: Interrupt,
    bar: ProgressBar,
}

impl Operator {
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

    /// Asks, shows the counts until Enter is pressed, and averages a second.
    fn measure(
        &mut self,
        link: &mut Link,
        ask: &str,
        pick: impl Fn(Raw) -> f32,
    ) -> anyhow::Result<f32> {
        self.bar
            .suspend(|| remark(&format!("{ask} (q ends without a change)")));
        loop {
            self.wait_for_enter(link, &pick)?;
            let mut window: VecDeque<f32> = VecDeque::new();
            while window.len() < READINGS {
                self.unless_interrupted()?;
                window.push_back(pick(raw(link)?));
                self.bar.set_message("averaging");
                pause(link, EVERY);
            }
            let least = window.iter().copied().fold(f32::INFINITY, f32::min);
            let most = window.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            if most - least <= STEADY_COUNTS {
                let mean = window.iter().sum::<f32>() / READINGS as f32;
                self.bar.suspend(|| remark(&format!("  {mean:.1} counts")));
                return Ok(mean);
            }
            self.bar.suspend(|| {
                remark(&format!(
                    "  not steady: the counts moved by {:.1} in a second; hold still and press Enter again",
                    most - least
                ));
            });
        }
    }

    fn wait_for_enter(&self, link: &mut Link, pick: &impl Fn(Raw) -> f32) -> anyhow::Result<()> {
        loop {
            self.unless_interrupted()?;
            match self.lines.recv_timeout(Duration::from_millis(10)) {
                Ok(line) if line.trim().eq_ignore_ascii_case("q") => {
                    anyhow::bail!("ended by the operator; nothing was changed")
                }
                Ok(_) => return Ok(()),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(InputError::new(
                        "the input ended before the last point was taken, nothing was changed",
                        "press Enter once for the rest and once for each point, and again where it was not steady",
                    )
                    .into());
                }
                Err(RecvTimeoutError::Timeout) => {
                    let counts = pick(raw(link)?);
                    self.bar.set_message(format!("{counts:.1} counts"));
                    pause(link, 2 * EVERY);
                }
            }
        }
    }

    fn unless_interrupted(&self) -> anyhow::Result<()> {
        if self.interrupt.requested() {
            anyhow::bail!("interrupted; nothing was changed");
        }
        Ok(())
    }
}

/// Lets time pass without letting lines pile up.
fn pause(link: &mut Link, wait: Duration) {
    let until = std::time::Instant::now() + wait;
    while let Some(left) = until.checked_duration_since(std::time::Instant::now()) {
        let _ = link.next_event(left);
    }
}

fn raw(link: &mut Link) -> Result<Raw, LinkError> {
    let [pressure, flex] = link.raw()?.counts();
    Ok(Raw { pressure, flex })
}

fn check_angles(angles: &[f32]) -> Result<(), InputError> {
    let fault = |found: String| {
        Err(InputError::new(
            found,
            format!(
                "give 2 to {FLEX_POINTS} different angles from -180 to 360 degrees, as in --points 0,30,60,90"
            ),
        ))
    };
    if !(2..=usize::from(FLEX_POINTS)).contains(&angles.len()) {
        return fault(format!("{} points are given", angles.len()));
    }
    for (number, angle) in angles.iter().enumerate() {
        if !(-180.0..=360.0).contains(angle) {
            return fault(format!("{angle} is no bending angle"));
        }
        if angles[..number]
            .iter()
            .any(|other| (other - angle).abs() < 0.5)
        {
            return fault(format!("{angle}° is given twice"));
        }
    }
    Ok(())
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

/// The counts must rise or fall throughout: otherwise one reading would mean two angles.
fn check_table(points: &[Point]) -> Result<(), InputError> {
    let falling = points
        .first()
        .zip(points.last())
        .is_some_and(|(first, last)| last.counts < first.counts);
    for pair in points.windows(2) {
        let rise = pair[1].counts - pair[0].counts;
        if (if falling { -rise } else { rise }) < APART_COUNTS {
            return Err(InputError::new(
                format!(
                    "the flex sensor's counts do not go one way: {:.1} at {}° and {:.1} at {}°; nothing was changed",
                    pair[0].counts, pair[0].angle_deg, pair[1].counts, pair[1].angle_deg
                ),
                "measure again, and check that the sensor does not slip in its pocket",
            ));
        }
    }
    Ok(())
}

fn ends(values: impl Iterator<Item = f32>) -> (f32, f32) {
    values.fold(
        (f32::INFINITY, f32::NEG_INFINITY),
        |(least, most), value| (least.min(value), most.max(value)),
    )
}

/// The smallest and the largest angle that the board can read with a table: the first and the
/// last segment are extrapolated by a share of the range of counts.
fn reach(points: &[Point]) -> (f32, f32) {
    let (least, most) = ends(points.iter().map(|point| point.counts));
    let beyond = |from: Option<&Point>, to: Option<&Point>| match (from, to) {
        (Some(from), Some(to)) => {
            let slope = (to.angle_deg - from.angle_deg) / (to.counts - from.counts).abs();
            to.angle_deg + slope * BEYOND * (most - least)
        }
        _ => f32::NAN,
    };
    let (first, last) = (points.first(), points.last());
    let second = points.get(1);
    let before = points
        .len()
        .checked_sub(2)
        .and_then(|place| points.get(place));
    (beyond(second, first), beyond(before, last))
}

/// What to say of a table that an actuator leaves when it swings back past its rest: the board
/// then takes its flex sensor for faulty, and stops.
fn short_below_rest(points: &[Point]) -> Option<String> {
    let (least, _) = reach(points);
    (least > BELOW_REST_DEG).then(|| {
        format!(
            "the table ends at {least:.0}°: an actuator that swings back further stops the rig with a fault of the flex sensor; take points farther apart, or one at {BELOW_REST_DEG}°"
        )
    })
}

/// The board refuses a limit that its sensor cannot read.
fn limits(
    points: &[Point],
    settings: &Settings,
    lower: bool,
) -> Result<Vec<Assignment>, InputError> {
    let ((_, reach), limit) = (reach(points), settings.number(Key::MaxAngle));
    if reach >= limit {
        return Ok(Vec::new());
    }
    if !lower {
        return Err(InputError::new(
            format!(
                "the table reaches {reach:.0}°, below the {limit}° (max.deg) at which the board stops the rig, so the board could never read that angle; nothing was changed"
            ),
            "take a further point, or give --lower-limits",
        ));
    }
    let last = points.last().map_or(limit, |point| point.angle_deg);
    let setpoint = settings.number(Key::SetpointMax).min(last);
    // Short of the end by more than the board's rounding.
    let limit = (reach - 0.01).floor();
    Ok(vec![
        (Key::MaxAngle, limit.to_bits()),
        (Key::SetpointMax, setpoint.to_bits()),
    ])
}

fn assignments(zero: f32, points: &[Point]) -> Vec<Assignment> {
    let mut list = vec![
        (Key::PressureZero, zero.to_bits()),
        (Key::FlexPoints, (points.len() as f32).to_bits()),
    ];
    // Slots beyond the points are not used. They repeat the last point, so that the
    // table stays in order.
    for slot in 0..FLEX_POINTS {
        let point = points.get(usize::from(slot)).or(points.last());
        if let Some(point) = point {
            list.push((Key::FlexCounts(slot), point.counts.to_bits()));
            list.push((Key::FlexAngle(slot), point.angle_deg.to_bits()));
        }
    }
    list
}

/// The table, with each point's deviation from the straight line through the ends: it
/// shows a point taken at a wrong angle.
fn table(zero: f32, points: &[Point]) -> String {
    let mut text = format!("pressure sensor: {zero:.1} counts at rest\n\n");
    text += "angle (°)   counts   off the line (°)\n";
    if let (Some(first), Some(last)) = (points.first(), points.last()) {
        let slope = (last.angle_deg - first.angle_deg) / (last.counts - first.counts);
        for point in points {
            let line = first.angle_deg + slope * (point.counts - first.counts);
            text += &format!(
                "{:>9.1} {:>8.1} {:>18.1}\n",
                point.angle_deg,
                point.counts,
                // Without the sign of a zero.
                ((point.angle_deg - line) * 10.0).round() / 10.0 + 0.0
            );
        }
    }
    if points.len() > 1 {
        let (least, most) = reach(points);
        text += &format!("the board reads from {least:.0}° to {most:.0}° with it\n");
    }
    text.push('\n');
    text
}

/// The board's reading by its new table.
fn check(link: &mut Link) -> Result<String, LinkError> {
    let mut last = None;
    for _ in 0..200 {
        if let Some(Event::Sample(received)) = link.next_event(EVERY) {
            last = Some(received.sample);
            if received.sample.sequence % 16 == 0 {
                break;
            }
        }
    }
    let flex = raw(link)?.flex;
    Ok(
        match last.and_then(|sample| sample.angle_deg.zip(sample.pressure_kpa)) {
            Some((angle, pressure)) => format!(
                "the board now shows {:.1}° ({flex:.1} counts) and {:.2} kPa\n",
                angle.to_f32(),
                pressure.to_f32()
            ),
            None => "the board shows no reading: look at `softrig monitor`\n".into(),
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(counts: &[f32]) -> Vec<Point> {
        counts
            .iter()
            .zip([0.0, 30.0, 60.0, 90.0])
            .map(|(&counts, angle_deg)| Point { angle_deg, counts })
            .collect()
    }

    #[test]
    fn tables_that_turn_back_are_refused() {
        for counts in [[600.0, 500.0, 400.0, 300.0], [300.0, 400.0, 500.0, 600.0]] {
            assert_eq!(check_table(&points(&counts)), Ok(()));
        }
        for counts in [
            [600.0, 500.0, 510.0, 300.0],
            [600.0, 599.0, 400.0, 300.0],
            [500.0, 500.0, 500.0, 500.0],
        ] {
            let message = check_table(&points(&counts)).unwrap_err().to_string();
            assert!(message.contains("one way"), "{message}");
        }
    }

    #[test]
    fn a_sensor_that_does_not_move_is_told_at_the_second_angle() {
        let points = points(&[600.0, 598.5, 500.0]);
        let message = check_moved(points[0], points[1]).unwrap_err().to_string();
        for part in [
            "600.0 counts at 0°",
            "598.5 at 30°",
            "nothing was changed",
            "A1",
        ] {
            assert!(message.contains(part), "{message}");
        }
        assert_eq!(check_moved(points[1], points[2]), Ok(()));
    }

    #[test]
    fn angles_are_checked_before_anything_is_opened() {
        assert_eq!(check_angles(&[0.0, 90.0]), Ok(()));
        for angles in [
            &[0.0][..],
            &[0.0; 9],
            &[0.0, 0.1],
            &[0.0, 400.0],
            &[0.0, f32::NAN],
        ] {
            assert!(check_angles(angles).is_err(), "{angles:?}");
        }
    }

    #[test]
    fn a_point_at_a_wrong_angle_stands_out() {
        let text = table(102.4, &points(&[600.0, 500.0, 400.0, 300.0]));
        assert!(
            text.contains("     60.0    400.0                0.0"),
            "{text}"
        );
        let text = table(102.4, &points(&[600.0, 500.0, 450.0, 300.0]));
        assert!(
            text.contains("     60.0    450.0               15.0"),
            "{text}"
        );
    }

    #[test]
    fn a_table_must_reach_the_limit_that_stops_the_rig() {
        let points = points(&[600.0, 500.0, 400.0, 300.0]);
        assert!((reach(&points).1 - 108.0).abs() < 1e-3);
        let mut settings = Settings::DEFAULT;
        for (key, value) in [(Key::MaxAngle, 130.0_f32), (Key::SetpointMax, 110.0)] {
            settings.set(key, value.to_bits()).unwrap();
        }
        let message = limits(&points, &settings, false).unwrap_err().to_string();
        assert!(
            message.contains("108°") && message.contains("130°"),
            "{message}"
        );
        assert_eq!(
            limits(&points, &settings, true).unwrap(),
            [
                (Key::MaxAngle, 107.0_f32.to_bits()),
                (Key::SetpointMax, 90.0_f32.to_bits()),
            ]
        );
        settings.set(Key::MaxAngle, 100.0_f32.to_bits()).unwrap();
        assert_eq!(limits(&points, &settings, true), Ok(vec![]));
    }

    #[test]
    fn the_whole_table_is_written() {
        let list = assignments(102.0, &points(&[600.0, 500.0, 400.0, 300.0]));
        assert_eq!(list.len(), 2 + 16);
        assert!(list.contains(&(Key::FlexPoints, 4.0_f32.to_bits())));
        assert!(list.contains(&(Key::FlexCounts(3), 300.0_f32.to_bits())));
        assert!(list.contains(&(Key::FlexCounts(7), 300.0_f32.to_bits())));
    }

    #[test]
    fn a_table_says_how_far_it_reaches_below_rest() {
        // The sensor of a new board: 15° below zero are beyond its points at 0, 30, 60 and 90°.
        let wide = points(&[668.4, 585.2, 497.9, 411.3]);
        let (least, most) = reach(&wide);
        assert!((-21.0..-15.0).contains(&least), "{least}");
        assert!((105.0..115.0).contains(&most), "{most}");
        assert_eq!(short_below_rest(&wide), None);
        assert!(table(102.4, &wide).contains("the board reads from -19° to 108° with it"));
        let narrow = points(&[668.4, 585.2]);
        let warning = short_below_rest(&narrow).unwrap();
        assert!(warning.contains("-6°"), "{warning}");
    }
}
