//! The screen of `rig monitor`.
//!
//! Colours are the terminal's own sixteen, and only those that can be read on
//! dark and on light ground: the foreground, red, green and magenta. Nothing is
//! said by colour alone.

use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::symbols::Marker;
use ratatui::text::{Line, Span};
use ratatui::widgets::{Axis, Chart, Dataset, GraphType, LegendPosition, Paragraph, Wrap};
use wire::decimal::Hundredths;
use wire::state::State;
use wire::telemetry::Setpoint;

use super::{Moment, SPAN_S, View};

const MEASURED: Style = Style::new();
const PREDICTED: Style = Style::new().fg(Color::Magenta);
const LABEL: Style = Style::new().add_modifier(Modifier::DIM);
const GOOD: Style = Style::new().fg(Color::Green);
const BAD: Style = Style::new().fg(Color::Red).add_modifier(Modifier::BOLD);

/// The smallest span of the chart (°).
const LEAST_SPAN_DEG: f64 = 10.0;
/// A hole in the curve longer than this is not drawn over (s).
const HOLE_S: f64 = 0.1;

/// Draws everything.
pub fn draw(frame: &mut Frame<'_>, view: &View) {
    let [title, chart, readings, note, keys] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Min(8),
        Constraint::Length(5),
        Constraint::Length(2),
        Constraint::Length(1),
    ])
    .areas(frame.area());
    frame.render_widget(title_line(view), title);
    draw_chart(frame, view, chart);
    draw_readings(frame, view, readings);
    frame.render_widget(note_text(view), note);
    frame.render_widget(
        Line::styled(
            "q quit  s stop  a arm  c clear fault  r run paper  space pause",
            LABEL,
        ),
        keys,
    );
}

fn title_line(view: &View) -> Line<'_> {
    let state = match (view.connected, view.last) {
        (false, _) => Span::styled(" NO CONNECTION ", BAD.add_modifier(Modifier::REVERSED)),
        (true, None) => Span::styled(" waiting ", LABEL),
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
        Span::raw(format!("  {}  softrig {}", view.port, view.firmware)),
    ];
    if view.paused {
        spans.push(Span::styled(
            "  PAUSED",
            Style::new().add_modifier(Modifier::BOLD),
        ));
    }
    Line::from(spans)
}

fn draw_chart(frame: &mut Frame<'_>, view: &View, area: Rect) {
    let end = view.history.back().map_or(0.0, |moment| moment.time_s);
    let measured = curves(view, end, |moment| moment.angle);
    let predicted = curves(view, end, |moment| moment.predicted);
    let (low, high) = bounds(&[&measured[..], &predicted[..]].concat());
    let mut datasets = Vec::new();
    for (curves, style, name) in [
        (&predicted, PREDICTED, "predicted"),
        (&measured, MEASURED, "measured"),
    ] {
        for (number, points) in curves.iter().enumerate() {
            let dataset = Dataset::default()
                .marker(Marker::Braille)
                .graph_type(GraphType::Line)
                .style(style)
                .data(points);
            datasets.push(if number == 0 {
                dataset.name(name)
            } else {
                dataset
            });
        }
    }
    let degrees = |value: f64| format!("{value:>4.0}°");
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
                .labels([
                    degrees(low),
                    degrees(f64::midpoint(low, high)),
                    degrees(high),
                ])
                .style(LABEL),
        )
        // On the other side than what is new.
        .legend_position(Some(LegendPosition::TopLeft))
        // Both names fit beside the curves from here on.
        .hidden_legend_constraints((Constraint::Ratio(1, 2), Constraint::Ratio(1, 2)));
    frame.render_widget(chart, area);
}

/// The curve in pieces without a hole.
fn curves(view: &View, end: f64, pick: impl Fn(&Moment) -> Option<f64>) -> Vec<Vec<(f64, f64)>> {
    let mut pieces: Vec<Vec<(f64, f64)>> = Vec::new();
    let mut last = f64::NEG_INFINITY;
    for moment in &view.history {
        let Some(value) = pick(moment) else { continue };
        let point = (moment.time_s - end, value);
        match pieces.last_mut() {
            Some(piece) if moment.time_s - last <= HOLE_S => piece.push(point),
            _ => pieces.push(vec![point]),
        }
        last = moment.time_s;
    }
    pieces
}

/// Round numbers around everything that is drawn.
fn bounds(curves: &[Vec<(f64, f64)>]) -> (f64, f64) {
    let values = || curves.iter().flatten().map(|point| point.1);
    let low = values().fold(0.0, f64::min);
    let high = values().fold(low + LEAST_SPAN_DEG, f64::max);
    ((low / 10.0).floor() * 10.0, (high / 10.0).ceil() * 10.0)
}

fn draw_readings(frame: &mut Frame<'_>, view: &View, area: Rect) {
    let [left, middle, right] = Layout::horizontal([
        Constraint::Ratio(1, 3),
        Constraint::Ratio(1, 3),
        Constraint::Ratio(1, 3),
    ])
    .areas(area);
    let sample = view.last.as_ref();
    let number = |value: Option<Hundredths>, unit: &str| match value {
        Some(value) => format!("{:.2} {unit}", value.to_f32()),
        None => "no reading".into(),
    };
    let angle = sample.and_then(|sample| sample.angle_deg);
    let predicted = sample.and_then(|sample| sample.predicted_deg);
    let gap = predicted
        .zip(angle)
        .map(|(predicted, angle)| Hundredths(predicted.0.saturating_sub(angle.0)));
    let (setpoint, unit) = match sample.map(|sample| sample.setpoint) {
        Some(Setpoint::Angle(level)) => (Some(level), "°"),
        Some(Setpoint::Pressure(level)) => (Some(level), "kPa"),
        Some(Setpoint::None) | None => (None, ""),
    };
    let lines = |rows: Vec<(&'static str, String, Style)>| {
        Paragraph::new(
            rows.into_iter()
                .map(|(label, value, style)| {
                    Line::from(vec![
                        Span::styled(format!("{label:<10}"), LABEL),
                        Span::styled(value, style),
                    ])
                })
                .collect::<Vec<_>>(),
        )
    };
    let mismatch = sample.is_some_and(|sample| sample.mismatch);
    frame.render_widget(
        lines(vec![
            ("measured", number(angle, "°"), MEASURED),
            ("predicted", number(predicted, "°"), PREDICTED),
            ("gap", number(gap, "°"), MEASURED),
            (
                "model",
                if mismatch { "MISMATCH" } else { "agrees" }.into(),
                if mismatch { BAD } else { GOOD },
            ),
        ]),
        left,
    );
    frame.render_widget(
        lines(vec![
            (
                "pressure",
                number(sample.and_then(|sample| sample.pressure_kpa), "kPa"),
                MEASURED,
            ),
            (
                "set-point",
                setpoint.map_or_else(|| "none".into(), |level| number(Some(level), unit)),
                MEASURED,
            ),
            (
                "pump",
                format!("{} µl", sample.map_or(0, |sample| sample.volume_ul)),
                MEASURED,
            ),
            (
                "time",
                format!(
                    "{:.1} s",
                    sample.map_or(0.0, |sample| f64::from(sample.time_ms) / 1000.0)
                ),
                MEASURED,
            ),
        ]),
        middle,
    );
    let count = |count: u64| {
        let style = if count == 0 { MEASURED } else { BAD };
        (count.to_string(), style)
    };
    let (dropped, dropped_style) = count(view.counters.dropped);
    let (damaged, damaged_style) = count(view.counters.damaged);
    let (restarts, restarts_style) = count(view.counters.restarts);
    frame.render_widget(
        lines(vec![
            ("lines/s", view.rate().to_string(), MEASURED),
            ("dropped", dropped, dropped_style),
            ("damaged", damaged, damaged_style),
            ("restarts", restarts, restarts_style),
        ]),
        right,
    );
}

/// The fault's sentence, or what was said last.
fn note_text(view: &View) -> Paragraph<'_> {
    let line = match view.fault() {
        Some(fault) if !view.asking && view.connected => Line::from(vec![
            Span::styled(format!("fault {}, {}: ", fault.code(), fault.name()), BAD),
            Span::raw(fault.sentence()),
        ]),
        _ => Line::raw(view.message.as_str()),
    };
    Paragraph::new(line).wrap(Wrap { trim: true })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::{Counters, Event, Received};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use std::path::Path;
    use std::time::{Duration, Instant};
    use wire::fault::Fault;
    use wire::telemetry::Telemetry;

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
            "MISMATCH",
            "60.00 °",
            "14210 µl",
            "lines/s   100",
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
    fn a_question_covers_everything_else() {
        let mut view = stepped(State::Ready, 0, false);
        view.ask();
        assert!(screen(&view, 120, 40).contains("y: yes"));
        assert!(view.take_question() && !view.take_question());
        assert!(!screen(&view, 120, 40).contains("y: yes"));
    }

    #[test]
    fn nothing_yet_and_no_readings_are_no_numbers() {
        let view = View::new("port", "0.1.0");
        let text = screen(&view, 80, 24);
        assert!(
            text.contains("waiting") && text.contains("no reading"),
            "{text}"
        );
        assert_screen("waiting.txt", &text);
    }

    #[test]
    fn every_fault_fits_its_two_lines() {
        for &fault in Fault::ALL {
            let text = screen(&stepped(State::Fault, fault.code(), false), 80, 24);
            let end: String = fault.sentence().chars().rev().take(8).collect();
            let end: String = end.chars().rev().collect();
            assert!(text.contains(&end), "{fault:?}:\n{text}");
        }
    }

    #[test]
    fn small_terminals_are_no_panic() {
        let view = stepped(State::Running, 0, false);
        for (width, height) in [(1, 1), (20, 5), (40, 12), (200, 60)] {
            screen(&view, width, height);
        }
    }
}
