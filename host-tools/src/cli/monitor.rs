//! `softrig monitor`: the rig, live.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Parser;
use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use wire::command::Command;
use wire::protocol::Named;

use super::live::Live;
use super::port::PortArgs;
use super::row::Row;
use super::udp::Datagrams;
use super::{Interrupt, record};
use crate::monitor::{Trace, View, draw};
use softrig_formats::error::InputError;
use softrig_formats::terminal::remark;
use softrig_link::record::{COLUMNS, Recorder};
use softrig_link::{Clock, Event, Link, SerialConnector, Timing};

/// Shows a rig live: angle, prediction, pressure, state, faults.
///
/// On a terminal it fills the screen; into a pipe it prints one line per sample.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig monitor --port /dev/ttyACM0
  softrig monitor --port /dev/ttyACM0 --log seen.csv
  softrig monitor --port /dev/ttyACM0 --plain --every 0.5
  softrig monitor --port /dev/ttyACM0 --every 0 --seconds 5 > five.csv
  softrig monitor --port /dev/ttyACM0 --udp 9870    for PlotJuggler's UDP server, with JSON
  softrig monitor --port /dev/ttyACM0 --foxglove --mcap seen.mcap

Keys: q quit, s stop, a arm, c clear a fault, r run the protocol \"paper\" (asks
first), space pause the charts; 1 to 4 show or hide the curves: measured and
predicted angle (°), set-point, pressure (kPa). Quitting stops an armed rig.

Readings: error is predicted minus measured angle; model says whether they agree,
which the board tests during a run; volume is what the pump pushed in; uptime
counts from the board's reset; lost and damaged are lines of the serial port.")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Print lines instead of filling the screen
    #[arg(long)]
    plain: bool,
    /// Least time between printed lines, in seconds of the board's clock; 0 for all
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = interval)]
    every: f64,
    /// End after this time, in seconds of the board's clock
    #[arg(long, value_name = "S", value_parser = interval)]
    seconds: Option<f64>,
    /// Write everything that is received to this recording
    #[arg(long, value_name = "OUT.csv")]
    log: Option<PathBuf>,
    /// Send each sample as JSON to a UDP server, such as PlotJuggler's; a bare port means this
    /// machine
    #[arg(long, value_name = "[HOST:]PORT")]
    udp: Option<String>,
    /// Serve Foxglove and Lichtblick: a topic for each column of a recording. Without a host: this
    /// machine only
    #[arg(long, value_name = "[HOST:]PORT", num_args = 0..=1, default_missing_value = "8765")]
    foxglove: Option<String>,
    /// Write the same topics to this log, which is a recording too
    #[arg(long, value_name = "OUT.mcap")]
    mcap: Option<PathBuf>,
}

/// Who takes what the link says beside the screen.
struct Listeners {
    clock: Clock,
    log: Option<Recorder>,
    datagrams: Option<Datagrams>,
    live: Option<Live>,
}

impl Listeners {
    /// Hands on an event; returns the row of a sample.
    fn take(&mut self, event: &Event) -> Result<Option<Row>, InputError> {
        let row = Row::of(event, &mut self.clock);
        if let Some(row) = &row {
            if let Some(datagrams) = &self.datagrams {
                datagrams.take(row);
            }
            if let Some(live) = &mut self.live {
                live.take(row)?;
            }
        }
        record::note(&mut self.log, event)?;
        Ok(row)
    }

    /// What to say to whoever looks on.
    fn invitation(&self) -> Option<String> {
        self.live.as_ref().and_then(Live::invitation)
    }

    /// Ends the logs.
    fn end(self, link: &Link, complete: bool) -> Result<(), InputError> {
        let logged = self
            .log
            .map_or(Ok(()), |log| record::end_log(log, link, complete));
        self.live.map_or(Ok(()), Live::end)?;
        logged
    }
}

fn interval(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=1e6).contains(&value) => Ok(value),
        _ => Err("give a number from 0 to 1000000 seconds".into()),
    }
}

/// Time between pictures.
const FRAME: Duration = Duration::from_millis(50);

/// Runs the command.
///
/// # Errors
///
/// When the port cannot be opened or the board does not answer.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let datagrams = args.udp.as_deref().map(Datagrams::to).transpose()?;
    let streamed = Live::of(args.foxglove.as_deref(), args.mcap.as_ref())?;
    let interrupt = Interrupt::listen()?;
    let mut link = Link::open(SerialConnector::new(&args.port.find()?), Timing::default())?;
    link.learn_patience()?;
    let log = args
        .log
        .as_deref()
        .map(|path| record::log(path, &link))
        .transpose()?;
    let mut listeners = Listeners {
        clock: Clock::default(),
        log,
        datagrams,
        live: streamed,
    };
    let outcome = if args.plain || !std::io::stdout().is_terminal() {
        plain(args, &interrupt, &mut link, &mut listeners)
    } else {
        let mut terminal = ratatui::init();
        let outcome = live(args, &interrupt, &mut link, &mut listeners, &mut terminal);
        ratatui::restore();
        outcome
    };
    let ended = listeners.end(&link, outcome.is_ok());
    outcome?;
    Ok(ended?)
}

fn plain(
    args: &Args,
    interrupt: &Interrupt,
    link: &mut Link,
    listeners: &mut Listeners,
) -> anyhow::Result<()> {
    let mut due_s = 0.0;
    let mut quiet = Quiet::default();
    if let Some(invitation) = listeners.invitation() {
        remark(&invitation);
    }
    super::print(&format!("{COLUMNS}\n"))?;
    while !interrupt.requested() {
        let event = link.next_event(FRAME);
        if let Some(news) = quiet.look(link) {
            super::warn(&news);
        }
        if args.seconds.is_some_and(|end| quiet.is_over(link, end)) {
            return Err(silent_at_the_end(link));
        }
        let Some(event) = event else {
            if !link.is_connected() && link.reconnect().is_ok() {
                super::warn("the connection is back");
            }
            continue;
        };
        let row = listeners.take(&event)?;
        match &event {
            Event::Sample(_) => {
                let Some(row) = row else {
                    continue;
                };
                let time_s = row.time_ms as f64 / 1000.0;
                quiet.shown_s = time_s;
                if args.seconds.is_some_and(|end| time_s > end) {
                    break;
                }
                // The board's milliseconds are exact; half of one is none.
                if time_s + 0.0005 >= due_s {
                    due_s = (due_s + args.every).max(time_s);
                    super::print(&row.text)?;
                }
            }
            Event::Remark(text) => remark(&format!("# {text}")),
            Event::Lost(reason) => super::warn(&format!(
                "{}: the connection was lost ({reason}); waiting for it to come back",
                link.port()
            )),
            Event::Other(_) | Event::Useless => {}
        }
    }
    let counters = link.counters();
    if counters.dropped + counters.damaged > 0 {
        super::warn(&format!(
            "{} lines were lost and {} arrived damaged",
            counters.dropped, counters.damaged
        ));
    }
    Ok(())
}

/// Time without a sample after which that is said: a board sends one each 10 ms.
const QUIET: Duration = Duration::from_millis(1_500);

/// A port from which no samples come, although it is open.
#[derive(Debug, Default)]
struct Quiet {
    /// Whether it was said.
    said: bool,
    /// Time of the last sample (s).
    shown_s: f64,
}

impl Quiet {
    /// What is new about it.
    fn look(&mut self, link: &Link) -> Option<String> {
        let silence = link.without_sample_for();
        let is_quiet = silence > QUIET && link.is_connected();
        if is_quiet == self.said || (!is_quiet && silence > QUIET) {
            return None;
        }
        self.said = is_quiet;
        let port = link.port();
        Some(if is_quiet {
            format!(
                "{port}: no sample for {:.1} s, although the port is open: {}",
                silence.as_secs_f64(),
                link.what_came()
            )
        } else {
            format!("{port}: samples arrive again")
        })
    }

    /// Whether a time (s) is over although nothing says so any more: by this computer's clock.
    fn is_over(&self, link: &Link, end_s: f64) -> bool {
        let silence = link.without_sample_for();
        silence > QUIET && self.shown_s + silence.as_secs_f64() > end_s
    }
}

/// What was to be seen did not come.
fn silent_at_the_end(link: &Link) -> anyhow::Error {
    anyhow::anyhow!(
        "{}: no sample arrived in the last {:.1} s before the end of --seconds; a log keeps what came before, as incomplete",
        link.port(),
        link.without_sample_for().as_secs_f64()
    )
}

fn live(
    args: &Args,
    interrupt: &Interrupt,
    link: &mut Link,
    listeners: &mut Listeners,
    terminal: &mut DefaultTerminal,
) -> anyhow::Result<()> {
    let mut view = View::new(link.port(), &link.board().firmware);
    if let Some(invitation) = listeners.invitation() {
        view.say(&invitation);
    }
    let mut first_ms = None;
    let mut quiet = Quiet::default();
    let mut drawn = Instant::now();
    while !interrupt.requested() {
        while let Some(event) = link.next_event(FRAME.saturating_sub(drawn.elapsed())) {
            listeners.take(&event)?;
            view.take(&event);
            if drawn.elapsed() >= FRAME {
                break;
            }
        }
        if !link.is_connected() && link.reconnect().is_ok() {
            view.say("the connection is back");
        }
        if let Some(news) = quiet.look(link) {
            view.say(&news);
        }
        if args.seconds.is_some_and(|end| quiet.is_over(link, end)) {
            return leave(&view, link).and(Err(silent_at_the_end(link)));
        }
        view.refresh(link.counters(), Instant::now());
        terminal.draw(|frame| draw(frame, &view))?;
        drawn = Instant::now();
        while event::poll(Duration::ZERO)? {
            if let event::Event::Key(key) = event::read()?
                && key.kind == KeyEventKind::Press
                && !press(key, &mut view, link, listeners)?
            {
                return leave(&view, link);
            }
        }
        if let (Some(end), Some(sample)) = (args.seconds, link.last()) {
            let now = sample.time_ms;
            let first = *first_ms.get_or_insert(now);
            quiet.shown_s = f64::from(now.wrapping_sub(first)) / 1000.0;
            if quiet.shown_s > end {
                break;
            }
        }
    }
    leave(&view, link)
}

/// Leaves the monitor and stops an armed rig, since nobody watches it any more.
fn leave(view: &View, link: &mut Link) -> anyhow::Result<()> {
    if view.is_armed() && link.is_connected() {
        link.request(Command::Stop)?;
    }
    Ok(())
}

/// Handles a key; false to leave.
fn press(
    key: KeyEvent,
    view: &mut View,
    link: &mut Link,
    listeners: &mut Listeners,
) -> anyhow::Result<bool> {
    let confirmed = view.take_question() && key.code == KeyCode::Char('y');
    let command = match key.code {
        KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return Ok(false),
        KeyCode::Char('q') => return Ok(false),
        KeyCode::Char(' ') => {
            view.toggle_pause();
            return Ok(true);
        }
        KeyCode::Char(key @ '1'..='9') => {
            if let Some(trace) = Trace::of_key(key) {
                view.toggle(trace);
            }
            return Ok(true);
        }
        KeyCode::Char('r') => {
            view.ask();
            return Ok(true);
        }
        KeyCode::Char('s') => Command::Stop,
        KeyCode::Char('a') => Command::Arm,
        KeyCode::Char('c') => Command::Clear,
        KeyCode::Char('y') if confirmed => Command::Run(Some(Named::Paper)),
        _ => return Ok(true),
    };
    let mut seen = Vec::new();
    let outcome = link.request_with(command, &mut |event| seen.push(event));
    for event in seen {
        listeners.take(&event)?;
        view.take(&event);
    }
    match outcome {
        Ok(_) => view.say(&format!(
            "the board accepted: {}",
            softrig_link::line::command_text(command)
        )),
        Err(error) => view.say(&error.to_string()),
    }
    Ok(true)
}
