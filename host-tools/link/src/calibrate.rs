//! Calibrating the sensors of a rig: zero of the pressure sensor and table of the flex sensor.
//!
//! Who bends the actuator is an [`Operator`], at a terminal or at a page. Nothing is changed until
//! the last point is taken.

use std::collections::VecDeque;
use std::time::Duration;

use softrig_formats::error::InputError;
use softrig_formats::instant::Instant;
use softrig_formats::settings_file::{Assignment, changes};
use wire::settings::{FLEX_POINTS, Key, Settings};

use crate::{Event, Link, LinkError};

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
pub struct Point {
    /// Angle to which the actuator is bent (°).
    pub angle_deg: f32,
    /// What the converter reads there (counts of ten bits).
    pub counts: f32,
}

/// One reading of both sensors, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Raw {
    pressure: f32,
    flex: f32,
}

/// What is to be measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Angles to bend to (°).
    pub points: Vec<f32>,
    /// The flex sensor's table, where it is known already.
    pub assumed: Option<Vec<Point>>,
    /// Whether limits that the table does not reach are lowered.
    pub lower_limits: bool,
    /// Whether nothing is changed at all.
    pub dry_run: bool,
}

/// Who stands at the rig.
pub trait Operator {
    /// Asks for something, after which they are ready.
    fn asks(&mut self, what: &str);

    /// The counts at the moment; none while they are averaged.
    fn sees(&mut self, counts: Option<f32>);

    /// Something that was found.
    fn says(&mut self, text: &str);

    /// Something to be careful about.
    fn warns(&mut self, text: &str);

    /// The table that was measured.
    ///
    /// # Errors
    ///
    /// Where it cannot be shown.
    fn shows(&mut self, table: &str) -> anyhow::Result<()>;

    /// Whether they have done what was asked.
    ///
    /// # Errors
    ///
    /// Where they want to end it.
    fn is_ready(&mut self) -> anyhow::Result<bool>;

    /// Whether the work may go on.
    ///
    /// # Errors
    ///
    /// Where they want to end it.
    fn may_go_on(&self) -> anyhow::Result<()>;
}

/// Calibrates a rig at rest; says what was written and what the board then shows.
///
/// # Errors
///
/// Unusable readings, an operator who ends it, settings that the board refuses.
pub fn calibrate(
    link: &mut Link,
    plan: Plan,
    operator: &mut dyn Operator,
) -> anyhow::Result<String> {
    link.check_rest("calibrate at rest: stop it first (`softrig monitor`, key s)")?;
    let settings = link.read_settings(|_, _| ())?;
    if plan.assumed.is_none() {
        warn_of_reach(&plan, &settings, operator);
    }
    let zero = measure(
        link,
        operator,
        "Let the actuator rest, open to the air",
        |raw| raw.pressure,
    )?;
    let mut points = match plan.assumed {
        Some(points) => points,
        None => bend(&plan.points, link, operator)?,
    };
    points.sort_by(|a, b| a.angle_deg.total_cmp(&b.angle_deg));
    operator.shows(&table(zero, &points))?;
    check_table(&points)?;
    if let Some(warning) = short_below_rest(&points) {
        operator.warns(&warning);
    }
    let mut wanted = assignments(zero, &points);
    wanted.extend(limits(&points, &settings, plan.lower_limits)?);
    if plan.dry_run {
        return Ok(String::new());
    }
    let changes = changes(&settings, wanted);
    link.change_settings(&changes, |_, _| ())?;
    let written = format!("{} settings written, stored and read back\n", changes.len());
    Ok(written + &check(link)?)
}

/// Points that end short of the board's limit are told before anybody bends to them.
fn warn_of_reach(plan: &Plan, settings: &Settings, operator: &mut dyn Operator) {
    let limit = settings.number(Key::MaxAngle);
    let (least, most) = ends(plan.points.iter().copied());
    if !plan.lower_limits && most + BEYOND * (most - least) < limit {
        operator.warns(&format!(
            "points up to {most}° will hardly reach the {limit}° at which the board stops the rig; bend further, or use --lower-limits"
        ));
    }
}

/// Measures at one angle after the other.
fn bend(
    angles: &[f32],
    link: &mut Link,
    operator: &mut dyn Operator,
) -> anyhow::Result<Vec<Point>> {
    let mut points: Vec<Point> = Vec::new();
    for &angle_deg in angles {
        let mut ask = format!("Bend the actuator to {angle_deg}°");
        if link.is_simulated() {
            ask +=
                &format!(" (a simulated one with `bend {angle_deg}` where `softrig virtual` runs)");
        }
        let counts = measure(link, operator, &ask, |raw| raw.flex)?;
        let point = Point { angle_deg, counts };
        if let Some(&before) = points.last() {
            check_moved(before, point)?;
        }
        points.push(point);
    }
    Ok(points)
}

/// Asks, shows the counts until the operator is ready, and averages a second.
fn measure(
    link: &mut Link,
    operator: &mut dyn Operator,
    ask: &str,
    pick: impl Fn(Raw) -> f32,
) -> anyhow::Result<f32> {
    operator.asks(ask);
    loop {
        while !operator.is_ready()? {
            operator.sees(Some(pick(raw(link)?)));
            pause(link, 2 * EVERY);
        }
        operator.sees(None);
        let mut window: VecDeque<f32> = VecDeque::new();
        while window.len() < READINGS {
            operator.may_go_on()?;
            window.push_back(pick(raw(link)?));
            pause(link, EVERY);
        }
        let (least, most) = ends(window.iter().copied());
        if most - least <= STEADY_COUNTS {
            let mean = window.iter().sum::<f32>() / READINGS as f32;
            operator.says(&format!("  {mean:.1} counts"));
            return Ok(mean);
        }
        operator.says(&format!(
            "  not steady: the counts moved by {:.1} in a second; hold still and try again",
            most - least
        ));
    }
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

/// Lets time pass without letting lines pile up.
fn pause(link: &mut Link, wait: Duration) {
    let until = Instant::now() + wait;
    loop {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return;
        }
        let _ = link.next_event(left);
    }
}

fn raw(link: &mut Link) -> Result<Raw, LinkError> {
    let [pressure, flex] = link.raw()?.counts();
    Ok(Raw { pressure, flex })
}

/// Refuses angles that no table can be made of.
///
/// # Errors
///
/// Says why, and what to give.
pub fn check_angles(angles: &[f32]) -> Result<(), InputError> {
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
            return fault(format!("{angle} is out of range"));
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
                    "the flex sensor's counts are not monotonic: {:.1} at {}° and {:.1} at {}°; nothing was changed",
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
            "take a further point, or let the limits be lowered (--lower-limits)",
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
            assert!(message.contains("monotonic"), "{message}");
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
