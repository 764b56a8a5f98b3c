//! The screen of `softrig monitor`.
//!
//! Colours are from the terminal's own sixteen, and only those that are legible on dark and
//! light backgrounds: the foreground, red, green and magenta. No information is in the
//! colour alone.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Chart, Dataset, GraphType, LegendPosition, Paragraph, Wrap};
use wire::decimal::Hundredths;
use wire::state::State;
use wire::telemetry::{Setpoint, Telemetry};

use super::{Agreement, Moment, SPAN_S, Trace, View};

const MEASURED: Style = Style::new();
const PREDICTED: Style = Style::new().fg(Color::Magenta);
const LABEL: Style = Style::new().add_modifier(Modifier::DIM);
const GOOD: Style = Style::new().fg(Color::Green);
const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);

/// The smallest span of a chart (° or kPa).
const LEAST_SPAN: f64 = 10.0;
/// A hole in the curve longer than this is not drawn over (s).
const HOLE_S: f64 = 0.1;

/// The narrowest screen on which the readings stand in three columns, and in two.
const COLUMNS: [(u16, usize); 2] = [(72, 3), (40, 2)];
/// The smallest charts: both of them, and one.
const LEAST_ROWS: [u16; 2] = [12, 6];

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, view: &View) {
    let area = frame.area();
    let (note, keys) = (note_line(view), keys_line(view));
    let readings = readings(view);
    let columns = COLUMNS
        .iter()
        .find(|(least, _)| area.width >= *least)
        .map_or(1, |(_, columns)| *columns);
    let rows = |lines: usize| u16::try_from(lines).unwrap_or(u16::MAX);
    let [title_area, charts_area, readings_area, note_area, keys_area] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(LEAST_ROWS[1]),
        Constraint::Length(rows(readings.len().div_ceil(columns))),
        Constraint::Length(rows(wrapped(&note.to_string(), area.width)).clamp(2, 6)),
        Constraint::Length(rows(wrapped(&keys.to_string(), area.width))),
    ])
    .areas(area);
    frame.render_widget(title_line(view), title_area);
    draw_charts(frame, view, charts_area);
    draw_readings(frame, &readings, columns, readings_area);
    for (line, area) in [(note, note_area), (keys, keys_area)] {
        frame.render_widget(Paragraph::new(line).wrap(Wrap { trim: true }), area);
    }
}

/// Rows that a text takes when it is broken between words.
fn wrapped(text: &str, width: u16) -> usize {
    let width = usize::from(width).max(1);
    let (mut rows, mut used, mut gap) = (1, 0, 0);
    for word in text.split(' ') {
        // Between two blanks there is nothing, and a wider gap.
        if word.is_empty() {
            gap += 1;
            continue;
        }
        let length = word.chars().count();
        if used > 0 && used + gap + length > width {
            rows += 1;
            used = 0;
        }
        used += length + if used > 0 { gap } else { 0 };
        gap = 1;
        // A word that is too long for any row goes on in the next.
        while used > width {
            rows += 1;
            used -= width;
        }
    }
    rows
}

/// The help line of keys; a key and its meaning stay on one line.
fn keys_line(view: &View) -> Line<'static> {
    let traces = Trace::ALL.map(|trace| {
        let mark = if view.shows(trace) { '●' } else { '○' };
        format!("{}\u{a0}{mark}\u{a0}{}", trace.key(), trace.name())
    });
    let commands = [
        "q quit",
        "s stop",
        "a arm",
        "c clear fault",
        "r run protocol",
        "space pause charts",
    ]
    .map(|key| key.replace(' ', "\u{a0}"));
    Line::styled([&commands[..], &traces[..]].concat().join("  "), LABEL)
}

fn title_line(view: &View) -> Line<'_> {
    let state = match (view.connected, view.last) {
        (false, _) => Span::styled(" NO CONNECTION ", BAD.add_modifier(Modifier::REVERSED)),
        (true, None) => Span::styled(" WAITING FOR THE BOARD ", LABEL),
        (true, Some(_)) if view.is_stale() => {
            Span::styled(" NO SAMPLES ", BAD.add_modifier(Modifier::REVERSED))
        }
        (true, Some(sample)) => {
            let style = match sample.state {
                State::Fault => BAD,
                State::Idle => MEASURED,
                State::Homing | State::Ready | State::Running => GOOD,
            };
            let name = sample.state.name().to_uppercase();
            Span::styled(format!(" {name} "), style.add_modifier(Modifier::REVERSED))
        }
    };
    let mut spans = vec![
        state,
        Span::raw(format!("  {}  firmware {}", view.port, view.firmware)),
    ];
    if view.paused {
        spans.push(Span::styled(
            "  CHARTS PAUSED",
            Style::new().add_modifier(Modifier::BOLD),
        ));
    }
    Line::from(spans)
}

/// The angles above, the pressure below; what is hidden leaves its place to the other.
fn draw_charts(frame: &mut Frame<'_>, view: &View, area: Rect) {
    let angles = [Trace::Measured, Trace::Predicted];
    let has_angles = angles.iter().any(|&trace| view.shows(trace)) || !view.shows(Trace::Pressure);
    let has_pressure = view.shows(Trace::Pressure);
    if !has_pressure || (has_angles && area.height < LEAST_ROWS[0]) {
        return draw_chart(frame, view, Quantity::Angle, area);
    }
    if !has_angles {
        return draw_chart(frame, view, Quantity::Pressure, area);
    }
    let [above, below] = Layout::vertical([Constraint::Fill(3), Constraint::Fill(2)]).areas(area);
    draw_chart(frame, view, Quantity::Angle, above);
    draw_chart(frame, view, Quantity::Pressure, below);
}

/// The quantity of a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Quantity {
    Angle,
    Pressure,
}

impl Quantity {
    const fn unit(self) -> &'static str {
        match self {
            Self::Angle => "°",
            Self::Pressure => " kPa",
        }
    }

    /// Its curves, the one on top last.
    const fn traces(self) -> &'static [Trace] {
        match self {
            Self::Angle => &[Trace::Setpoint, Trace::Predicted, Trace::Measured],
            Self::Pressure => &[Trace::Setpoint, Trace::Pressure],
        }
    }

    fn of(self, trace: Trace, moment: &Moment) -> Option<f64> {
        let level = |level: Hundredths| f64::from(level.0) / 100.0;
        match (trace, self, moment.setpoint) {
            (Trace::Measured, ..) => moment.angle,
            (Trace::Predicted, ..) => moment.predicted,
            (Trace::Pressure, ..) => moment.pressure,
            (Trace::Setpoint, Self::Angle, Setpoint::Angle(value))
            | (Trace::Setpoint, Self::Pressure, Setpoint::Pressure(value)) => Some(level(value)),
            (Trace::Setpoint, ..) => None,
        }
    }
}

fn draw_chart(frame: &mut Frame<'_>, view: &View, quantity: Quantity, area: Rect) {
    let end = view.history.back().map_or(0.0, |moment| moment.time_s);
    let drawn: Vec<(Trace, CurveSegments)> = quantity
        .traces()
        .iter()
        .filter(|&&trace| view.shows(trace))
        .map(|&trace| {
            (
                trace,
                curves(view, end, |moment| quantity.of(trace, moment)),
            )
        })
        .collect();
    let all: Vec<_> = drawn.iter().flat_map(|(_, segments)| segments).collect();
    let (low, high) = bounds(&all);
    let mut datasets = Vec::new();
    for (trace, segments) in &drawn {
        let (style, marker) = match trace {
            Trace::Measured | Trace::Pressure => (MEASURED, Marker::Braille),
            Trace::Predicted => (PREDICTED, Marker::Braille),
            Trace::Setpoint => (GOOD, Marker::Dot),
        };
        for (number, points) in segments.iter().enumerate() {
            let dataset = Dataset::default()
                .marker(marker)
                .graph_type(GraphType::Line)
                .style(style)
                .data(points);
            datasets.push(if number == 0 {
                dataset.name(trace.name())
            } else {
                dataset
            });
        }
    }
    let label = |value: f64| format!("{value:>4.0}{}", quantity.unit());
    let chart = Chart::new(datasets)
        .x_axis(
            Axis::default()
                .bounds([-SPAN_S, 0.0])
                .labels(["-30 s", "-20", "-10", "now"])
                .style(LABEL),
        )
        .y_axis(
            Axis::default()
                .bounds([low, high])
                .labels([label(low), label(f64::midpoint(low, high)), label(high)])
                .style(LABEL),
        )
        // On the other side than what is new.
        .legend_position(Some(LegendPosition::TopLeft))
        // The names fit beside the curves from here on.
        .hidden_legend_constraints((Constraint::Ratio(1, 2), Constraint::Ratio(2, 3)));
    frame.render_widget(chart, area);
}

/// The segments of a curve, without gaps.
type CurveSegments = Vec<Vec<(f64, f64)>>;

/// The curve of what is picked.
fn curves(view: &View, end: f64, pick: impl Fn(&Moment) -> Option<f64>) -> CurveSegments {
    let mut segments = CurveSegments::new();
    let mut last = f64::NEG_INFINITY;
    for moment in &view.history {
        let Some(value) = pick(moment) else { continue };
        let point = (moment.time_s - end, value);
        match segments.last_mut() {
            Some(segment) if moment.time_s - last <= HOLE_S => segment.push(point),
            _ => segments.push(vec![point]),
        }
        last = moment.time_s;
    }
    segments
}

/// Round numbers around everything that is drawn.
fn bounds(curves: &[&Vec<(f64, f64)>]) -> (f64, f64) {
    let values = || curves.iter().copied().flatten().map(|point| point.1);
    let low = values().fold(0.0, f64::min);
    let high = values().fold(low + LEAST_SPAN, f64::max);
    ((low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0)
}

/// Readings of the last sample, in front of those of the link.
const STALE: usize = 8;

/// A reading with its name.
type Reading = (&'static str, String, Style);

/// Everything that is shown as a number, three columns one after the other.
fn readings(view: &View) -> Vec<Reading> {
    let sample = view.last.as_ref();
    let number = |value: Option<Hundredths>, unit: &str| match value {
        Some(value) => format!("{:.2} {unit}", value.to_f32()),
        None => "no reading".into(),
    };
    // What the board itself counts.
    let of_board = |text: &dyn Fn(&Telemetry) -> String| sample.map_or_else(|| "–".into(), text);
    let angle = sample.and_then(|sample| sample.angle_deg);
    let predicted = sample.and_then(|sample| sample.predicted_deg);
    let error = predicted
        .zip(angle)
        .map(|(predicted, angle)| Hundredths(predicted.0.saturating_sub(angle.0)));
    let setpoint = match sample.map(|sample| sample.setpoint) {
        Some(Setpoint::Angle(level)) => number(Some(level), "°"),
        Some(Setpoint::Pressure(level)) => number(Some(level), "kPa"),
        Some(Setpoint::None) | None => "none".into(),
    };
    let (model, model_style) = match view.agreement() {
        Agreement::Mismatch => ("DISAGREES", BAD),
        Agreement::Unknown => ("no data", MEASURED),
        Agreement::NoRun => ("no run", MEASURED),
        Agreement::Agrees => ("agrees", GOOD),
    };
    let count = |count: u64| (count.to_string(), if count == 0 { MEASURED } else { BAD });
    let (dropped, dropped_style) = count(view.counters.dropped);
    let (damaged, damaged_style) = count(view.counters.damaged);
    let (restarts, restarts_style) = count(view.counters.restarts);
    let mut readings = vec![
        ("measured", number(angle, "°"), MEASURED),
        ("predicted", number(predicted, "°"), PREDICTED),
        ("error", number(error, "°"), MEASURED),
        ("model", model.into(), model_style),
        (
            "pressure",
            number(sample.and_then(|sample| sample.pressure_kpa), "kPa"),
            MEASURED,
        ),
        ("set-point", setpoint, MEASURED),
        (
            "volume",
            of_board(&|sample| format!("{:.2} ml", f64::from(sample.volume_ul) / 1000.0)),
            MEASURED,
        ),
        (
            "uptime",
            of_board(&|sample| format!("{:.1} s", f64::from(sample.time_ms) / 1000.0)),
            MEASURED,
        ),
        ("samples/s", view.rate().to_string(), MEASURED),
        ("lost", dropped, dropped_style),
        ("damaged", damaged, damaged_style),
        ("restarts", restarts, restarts_style),
    ];
    if view.is_stale() {
        // What is old is grey, as the names are, and what counts the lines is not old.
        for (_, _, style) in readings.iter_mut().take(STALE) {
            *style = LABEL;
        }
    }
    readings
}

fn draw_readings(frame: &mut Frame<'_>, readings: &[Reading], columns: usize, area: Rect) {
    // Beside a name of ten characters the longest value has ten.
    let width = (area.width / u16::try_from(columns).unwrap_or(1)).max(20);
    let areas = Layout::horizontal(vec![Constraint::Length(width); columns])
        .spacing(1)
        .split(area);
    for (readings, &area) in readings
        .chunks(readings.len().div_ceil(columns))
        .zip(areas.iter())
    {
        let lines: Vec<Line<'_>> = readings
            .iter()
            .map(|(label, value, style)| {
                Line::from(vec![
                    Span::styled(format!("{label:<10}"), LABEL),
                    Span::styled(value.as_str(), *style),
                ])
            })
            .collect();
        frame.render_widget(Paragraph::new(lines), area);
    }
}

/// The fault's sentence, or what was said last.
fn note_line(view: &View) -> Line<'_> {
    match view.fault() {
        Some(fault) if !view.asking && view.connected => Line::from(vec![
            Span::styled(format!("fault {}, {}: ", fault.code(), fault.name()), BAD),
            Span::raw(fault.sentence()),
        ]),
        _ => Line::raw(view.message.as_str()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use softrig_link::{Counters, Event, Received};
    use std::path::Path;
    use std::time::{Duration, Instant};
    use wire::fault::Fault;

    fn screen(view: &View, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal.draw(|frame| draw(frame, view)).unwrap();
        let buffer = terminal.backend().buffer();
        let mut text = String::new();
        for y in 0..height {
            let row: String = (0..width)
                .map(|x| buffer[(x, y)].symbol().to_owned())
                .collect();
            text += row.trim_end();
            text.push('\n');
        }
        text
    }

    #[test]
    fn what_a_board_says_does_not_reach_the_screen_as_it_is() {
        let hostile = "\u{1b}[2J\u{9b}31m\u{202e}\r";
        let mut view = View::new(hostile, hostile);
        view.take(&Event::Remark(hostile.into()));
        let obeyed = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
        let seen = screen(&view, 100, 30);
        assert!(!seen.contains(obeyed), "{seen:?}");
        assert!(seen.contains("\\u001b[2J\\u009b31m\\u202e"), "{seen}");
        view.take(&Event::Lost(hostile.into()));
        let seen = screen(&view, 100, 30);
        assert!(seen.contains("(\\u001b[2J"), "{seen}");
        assert!(!seen.contains(obeyed), "{seen:?}");
    }

    /// Compares with the screen that is checked in; `SOFTRIG_BLESS=1` replaces it.
    fn assert_screen(name: &str, text: &str) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("src/monitor/screens")
            .join(name);
        if std::env::var_os("SOFTRIG_BLESS").is_some() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
        }
        let expected = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(text == expected, "{name} is\n{text}\nand was\n{expected}");
    }

    /// Ten seconds: a rest, a step to 60°, a prediction that is 4° too high.
    fn stepped(state: State, fault: u8, mismatch: bool) -> View {
        let start = Instant::now();
        let mut view = View::new("/dev/ttyACM0", "0.1.0");
        for k in 0..1_000_u32 {
            let time = f64::from(k) * 0.01;
            let rise = if time < 2.0 {
                0.0
            } else {
                1.0 - (-(time - 2.0)).exp()
            };
            #[allow(clippy::cast_possible_truncation)]
            let hundredths = |degrees: f64| Some(Hundredths((degrees * 100.0) as i32));
            view.take(&Event::Sample(Received {
                sample: Telemetry {
                    sequence: u16::try_from(k).unwrap(),
                    time_ms: k * 10,
                    pressure_kpa: hundredths(40.0 * rise),
                    angle_deg: hundredths(60.0 * rise),
                    predicted_deg: hundredths(64.0 * rise),
                    setpoint: if time < 2.0 {
                        Setpoint::None
                    } else {
                        Setpoint::Angle(Hundredths(6_000))
                    },
                    volume_ul: 14_210,
                    state,
                    fault,
                    mismatch,
                },
                arrived: start + Duration::from_millis(u64::from(k) * 10),
                restarted: false,
                dropped: 0,
            }));
        }
        view.refresh(Counters::default(), start + Duration::from_millis(9_995));
        view
    }

    #[test]
    fn a_running_rig_on_the_smallest_screen() {
        let view = stepped(State::Running, 0, true);
        let text = screen(&view, 80, 24);
        for part in [
            "RUNNING",
            "59.97 °",
            "63.97 °",
            "DISAGREES",
            "60.00 °",
            "14.21 ml",
            "samples/s 100",
        ] {
            assert!(text.contains(part), "{part:?} not in\n{text}");
        }
        assert_screen("running.txt", &text);
    }

    #[test]
    fn a_fault_is_shown_with_its_sentence() {
        let mut view = stepped(State::Fault, Fault::HostLost.code(), false);
        let text = screen(&view, 80, 24);
        assert!(
            text.contains("fault 8, computer lost: The computer fell silent"),
            "{text}"
        );
        assert!(
            text.contains("start the run again."),
            "the sentence is cut off:\n{text}"
        );
        assert_screen("fault.txt", &text);
        view.take(&Event::Lost("gone".into()));
        assert!(screen(&view, 80, 24).contains("NO CONNECTION"));
    }

    #[test]
    fn what_is_old_is_grey_and_said_to_be() {
        let mut view = stepped(State::Running, 0, false);
        let styles = |view: &View| -> Vec<Style> {
            let readings = readings(view).into_iter();
            readings.map(|(_, _, style)| style).collect()
        };
        assert!(!styles(&view)[..STALE].contains(&LABEL));
        assert!(screen(&view, 80, 24).contains("RUNNING"));
        let later = view.now + Duration::from_millis(1_500);
        view.refresh(Counters::default(), later);
        assert!(styles(&view)[..STALE].iter().all(|&style| style == LABEL));
        // The counts are of now.
        assert!(!styles(&view)[STALE..].contains(&LABEL));
        let text = screen(&view, 80, 24);
        assert!(
            text.contains("NO SAMPLES") && !text.contains("RUNNING"),
            "{text}"
        );
        assert!(text.contains("59.97 °"), "the last value stays:\n{text}");
    }

    #[test]
    fn a_question_covers_everything_else() {
        let mut view = stepped(State::Ready, 0, false);
        view.ask();
        assert!(screen(&view, 120, 40).contains("y: yes"));
        assert!(view.take_question() && !view.take_question());
        assert!(!screen(&view, 120, 40).contains("y: yes"));
    }

    #[test]
    fn what_the_board_would_refuse_is_not_asked() {
        for (state, why) in [
            (State::Idle, "not armed"),
            (State::Homing, "homing"),
            (State::Running, "is running"),
            (State::Fault, "fault is latched"),
        ] {
            let mut view = stepped(state, 0, false);
            view.ask();
            let text = screen(&view, 120, 40);
            assert!(
                text.contains("Cannot run the protocol") && text.contains(why),
                "{text}"
            );
            assert!(!text.contains("y: yes"), "{text}");
            assert!(!view.take_question());
        }
        let mut view = View::new("port", "0.1.0");
        view.ask();
        assert!(!view.take_question());
    }

    #[test]
    fn nothing_yet_and_no_readings_are_no_numbers() {
        let view = View::new("port", "0.1.0");
        let text = screen(&view, 80, 24);
        assert!(
            text.contains("WAITING FOR THE BOARD")
                && text.contains("no reading")
                && text.contains("uptime    –"),
            "{text}"
        );
        assert_screen("waiting.txt", &text);
    }

    /// The words of a screen.
    fn words(text: &str) -> Vec<&str> {
        text.split_whitespace().collect()
    }

    #[test]
    fn every_fault_and_every_key_is_whole_on_every_width() {
        for width in [40, 80, 120] {
            for &fault in Fault::ALL {
                let text = screen(&stepped(State::Fault, fault.code(), false), width, 30);
                let said = words(&text).join(" ");
                // Broken between words only, and to its end.
                assert!(
                    said.contains(fault.sentence()),
                    "{width}, {fault:?}:\n{text}"
                );
                for key in [
                    "q quit",
                    "c clear fault",
                    "space pause charts",
                    "4 ● pressure",
                ] {
                    assert!(said.contains(key), "{width}, {key}:\n{text}");
                }
            }
        }
    }

    #[test]
    fn rows_are_counted_as_they_are_drawn() {
        for text in [
            "",
            "one",
            "fault 8, computer lost: The computer fell silent while the rig was armed",
            "two  blanks  between  words  are  wider  than  one",
            "a-word-that-is-far-too-long-for-any-of-these-screens and another",
        ] {
            for width in [5, 11, 40, 80] {
                let mut terminal = Terminal::new(TestBackend::new(width, 30)).unwrap();
                terminal
                    .draw(|frame| {
                        let text = Paragraph::new(text).wrap(Wrap { trim: true });
                        frame.render_widget(text, frame.area());
                    })
                    .unwrap();
                let buffer = terminal.backend().buffer();
                let used = (0..30)
                    .filter(|&y| (0..width).any(|x| buffer[(x, y)].symbol() != " "))
                    .count();
                assert_eq!(wrapped(text, width), used.max(1), "{width}: {text}");
            }
        }
    }

    #[test]
    fn readings_are_whole_in_as_many_columns_as_there_is_room_for() {
        let view = stepped(State::Running, 0, false);
        for (width, columns) in [(30, 1), (40, 2), (80, 3), (120, 3)] {
            let text = screen(&view, width, 40);
            for reading in [
                "59.97 °",
                "63.97 °",
                "39.98 kPa",
                "60.00 °",
                "14.21 ml",
                "10.0 s",
            ] {
                assert!(text.contains(reading), "{width}, {reading}:\n{text}");
            }
            let row = text
                .lines()
                .find(|line| line.starts_with("measured "))
                .unwrap();
            let labels = ["measured", "pressure", "volume", "samples/s"];
            let seen = labels.iter().filter(|label| row.contains(**label)).count();
            assert_eq!(seen, columns, "{width}: {row}");
        }
        assert_screen("narrow.txt", &screen(&view, 40, 30));
        assert_screen("wide.txt", &screen(&view, 120, 36));
    }

    #[test]
    fn curves_are_chosen_by_key() {
        let mut view = stepped(State::Running, 0, false);
        let text = screen(&view, 80, 30);
        for part in [
            "1 ● measured",
            "4 ● pressure",
            "70°",
            "40 kPa",
            "│set-point",
            "│pressure",
        ] {
            assert!(
                text.contains(&part.replace(' ', "\u{a0}")) || text.contains(part),
                "{part}:\n{text}"
            );
        }
        view.toggle(Trace::of_key('4').unwrap());
        let text = screen(&view, 80, 30);
        assert!(text.contains("4\u{a0}○\u{a0}pressure"), "{text}");
        assert!(text.contains("70°") && !text.contains("40 kPa"), "{text}");
        view.toggle(Trace::Pressure);
        for trace in [Trace::Measured, Trace::Predicted] {
            view.toggle(trace);
        }
        let text = screen(&view, 80, 30);
        assert!(!text.contains("70°") && text.contains("40 kPa"), "{text}");
        // A pressure is tracked: its set-point stands beside it.
        if let Some(moment) = view.history.back_mut() {
            moment.setpoint = Setpoint::Pressure(Hundredths(11_000));
        }
        assert!(screen(&view, 80, 30).contains("110 kPa"));
        assert_eq!(Trace::of_key('5'), None);
    }

    #[test]
    fn with_an_open_sensor_no_model_agrees() {
        let model = |view: &View| {
            let text = screen(view, 80, 24);
            let row = text
                .lines()
                .find(|line| line.starts_with("model "))
                .unwrap();
            // Between the first two names of the row.
            let all = words(row);
            let next = all.iter().position(|word| *word == "uptime").unwrap();
            all[1..next].join(" ")
        };
        let mut view = stepped(State::Running, 0, false);
        assert_eq!(model(&view), "agrees");
        for (angle, pressure, predicted) in [
            (None, Some(1), Some(1)),
            (Some(1), None, Some(1)),
            (Some(1), Some(1), None),
        ] {
            let last = view.last.as_mut().unwrap();
            last.angle_deg = angle.map(Hundredths);
            last.pressure_kpa = pressure.map(Hundredths);
            last.predicted_deg = predicted.map(Hundredths);
            for state in State::ALL {
                view.last.as_mut().unwrap().state = state;
                assert_eq!(model(&view), "no data", "{state:?}");
            }
        }
        assert_eq!(model(&stepped(State::Ready, 0, false)), "no run");
        assert_eq!(model(&stepped(State::Ready, 0, true)), "DISAGREES");
        let mut view = stepped(State::Running, 0, false);
        view.take(&Event::Lost("gone".into()));
        assert_eq!(model(&view), "no data");
    }

    #[test]
    fn small_terminals_are_no_panic() {
        let view = stepped(State::Running, 0, false);
        for (width, height) in [(1, 1), (20, 5), (40, 12), (200, 60)] {
            screen(&view, width, height);
        }
    }
}
