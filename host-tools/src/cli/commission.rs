//! `softrig commission`: the acceptance test of a board and its rig.

use std::collections::VecDeque;
use std::io::{BufRead, IsTerminal};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Instant, SystemTime};

use clap::{ArgGroup, Parser};
use indicatif::{ProgressBar, ProgressStyle};

use super::Interrupt;
use super::json::JsonArgs;
use super::output::{self, FileKind, Output};
use super::port::PortArgs;
use super::virtual_rig::Companion;
use crate::commission::{Report, page, shown_limit, shown_value};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::terminal::remark;
use softrig_link::commission::session::{
    Answer, Hand, Interrupted, Operator, Plan, Session, Switch,
};
use softrig_link::commission::{Outcome, Result as Finding, Step};
use softrig_link::rig_file::{ClockRate, RigFile, board_name, rig_file};
use softrig_link::{Link, SerialConnector, Timing, is_pseudo_terminal};

/// Tests a new board and its rig, step by step, in some minutes.
///
/// Steps without motion come first. Each step states its purpose before it begins, then its
/// measurements with their limits, and a remedy if it fails. Ctrl-C
/// leaves the rig stopped and vented.
#[derive(Debug, Parser)]
#[command(group(ArgGroup::new("rig_to_test").required(true).args(["port", "virtual_rig", "list"])))]
#[command(after_help = "\
Examples:
  softrig commission --list
  softrig commission --port /dev/ttyACM0 --report board.html --json board.json
  softrig commission --port /dev/ttyACM0 --only clock
  softrig commission --port /dev/ttyACM0 --skip relief
  softrig commission --virtual --report practice.html
  softrig commission --virtual --fault leak

The clock factor goes into softrig.toml; `softrig record` corrects this board's times by it.
Exit code: 0 no failure, 1 a step failed, 2 the test could not be run.")]
#[allow(clippy::struct_excessive_bools)] // Flags, each with a name of its own.
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Practise on a virtual rig: this command starts it and presses its switches
    #[arg(long = "virtual", id = "virtual_rig", conflicts_with = "port")]
    virtual_rig: bool,
    /// Inject this fault into the virtual rig; brown-out, hang, deaf, power-cut and unplugged start
    /// in the telemetry step
    #[arg(long, value_name = "KIND", requires = "virtual_rig")]
    fault: Option<String>,
    /// Seed of the virtual rig
    #[arg(long, value_name = "N", requires = "virtual_rig")]
    seed: Option<u64>,
    /// List the steps
    #[arg(long)]
    list: bool,
    /// Run only this step; repeatable
    #[arg(long, value_name = "STEP", value_parser = step, conflicts_with = "skip")]
    only: Vec<Step>,
    /// Skip this step; repeatable
    #[arg(long, value_name = "STEP", value_parser = step)]
    skip: Vec<Step>,
    /// Run every step without prompting; skip steps that need a person
    #[arg(long)]
    yes: bool,
    /// Duration of telemetry, clock and noise tests, in seconds
    #[arg(long, value_name = "N", default_value_t = 60.0, value_parser = watch)]
    seconds: f64,
    /// Write the result as a page to attach to a question
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// File that keeps the board's clock [default: softrig.toml]
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
}

fn step(text: &str) -> Result<Step, String> {
    Step::ALL
        .into_iter()
        .find(|step| step.name() == text)
        .ok_or_else(|| {
            let names = Step::ALL.map(Step::name).join(", ");
            format!("use one of: {names}")
        })
}

fn watch(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (4.0..=3600.0).contains(&value) => Ok(value),
        _ => Err("give a number from 4 to 3600 seconds".into()),
    }
}

/// Runs the command.
///
/// # Errors
///
/// [`InputError`] where the test could not be made; otherwise that a step failed.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.list {
        return Ok(super::print(&list())?);
    }
    let rig = args.rig.clone().unwrap_or_else(|| rig_file().to_owned());
    output::check(
        &[
            args.json.output(),
            Output::of("--report", FileKind::Page, args.report.as_ref()),
        ],
        [&rig],
    )?;
    let interrupt = Interrupt::listen()?;
    let companion = args
        .virtual_rig
        .then(|| Companion::start(None, args.seed))
        .transpose()?;
    let port = match &companion {
        Some(companion) => companion.port().to_owned(),
        None => args.port.find()?,
    };
    let mut terminal = Terminal::new(interrupt, args, companion, &port, rig);
    terminal.break_at_start()?;
    let begun = Instant::now();
    let started = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    terminal
        .bar
        .set_message("waiting for the board, which restarts");
    let link = Link::open(SerialConnector::new(&port), Timing::default()).map_err(cannot)?;
    let plan = Plan {
        steps: Step::ALL
            .into_iter()
            .filter(|step| args.only.is_empty() || args.only.contains(step))
            .filter(|step| !args.skip.contains(step))
            .collect(),
        watch_s: args.seconds,
        at_full_speed: args.virtual_rig,
    };
    let mut session = Session::new(link, &mut terminal, plan);
    let outcome = session.run();
    let (board, clock) = (session.link().board().clone(), session.clock);
    terminal.bar.finish_and_clear();
    let steps = match outcome {
        Err(error) if error.is::<Interrupted>() => {
            anyhow::bail!("stopped by the operator: the pump is off and the vent open")
        }
        other => other?,
    };
    let report = Report {
        schema: 1,
        passed: steps.iter().all(|it| it.outcome != Outcome::Failed),
        simulated: is_pseudo_terminal(&port),
        started,
        seconds: begun.elapsed().as_secs_f64(),
        board: board_name(&port),
        port,
        firmware: board.firmware,
        wire: board.wire,
        settings: board.settings.to_string(),
        rig: env!("CARGO_PKG_VERSION").to_owned(),
        computer: format!("{} on {}", std::env::consts::OS, std::env::consts::ARCH),
        clock,
        steps,
    };
    finish(args, &report)
}

/// Writes the results.
fn finish(args: &Args, report: &Report) -> anyhow::Result<()> {
    if let Some(path) = &args.report {
        write_atomically(path, page(report)?.as_bytes())?;
    }
    let sentence = if report.passed {
        format!("{}\n", report.sentence())
    } else {
        String::new()
    };
    args.json.deliver(report, &sentence)?;
    if !report.passed {
        let send = match &args.report {
            Some(path) => format!(
                "; {} says what to do, and can be sent with a question",
                path.display()
            ),
            None => {
                "; with --report FILE.html it is a page that can be sent with a question".to_owned()
            }
        };
        anyhow::bail!("{}{send}", report.sentence());
    }
    Ok(())
}

/// A link that does not open is no verdict on the rig.
#[allow(clippy::needless_pass_by_value)] // For `map_err`.
fn cannot(error: softrig_link::LinkError) -> anyhow::Error {
    let text = error.to_string();
    let (found, advice) = text
        .rsplit_once("; ")
        .unwrap_or((&text, "see `softrig ports`"));
    InputError::new(found, advice).into()
}

fn list() -> String {
    let mut text = String::new();
    for step in Step::ALL {
        text += &format!("{:<16}{}\n", step.name(), step.purpose());
        if let Some(moves) = step.moves() {
            text += &format!("{:<16}Moves: {moves}.\n", "");
        }
    }
    text
}

/// Who stands at the rig: a person at the terminal, or the virtual rig itself.
struct Terminal {
    interrupt: Interrupt,
    companion: Option<Companion>,
    fault: Option<String>,
    /// The board's, behind which a rig of `softrig virtual` may be, in another terminal.
    port: String,
    /// Where the board's clock is written to.
    rig_file: PathBuf,
    /// Nobody is asked.
    is_alone: bool,
    agrees: bool,
    lines: Option<Receiver<String>>,
    /// What a person typed and nothing has looked at.
    typed: VecDeque<String>,
    pending: Option<Answer>,
    bar: ProgressBar,
}

/// Faults that last for a moment only, with what brings them about.
const MOMENTS: [(&str, &str); 5] = [
    ("brown-out", "fault brown-out on"),
    ("hang", "fault hang on"),
    ("deaf", "fault deaf on"),
    ("power-cut", "power-cycle"),
    ("unplugged", "fault unplugged on"),
];

impl Terminal {
    fn new(
        interrupt: Interrupt,
        args: &Args,
        companion: Option<Companion>,
        port: &str,
        rig_file: PathBuf,
    ) -> Self {
        let is_alone = companion.is_none() && (args.yes || !std::io::stdin().is_terminal());
        let lines = (companion.is_none() && !is_alone).then(|| {
            let (sender, lines) = channel();
            std::thread::spawn(move || {
                for line in std::io::stdin().lock().lines() {
                    let Ok(line) = line else { return };
                    if sender.send(line).is_err() {
                        return;
                    }
                }
            });
            lines
        });
        Self {
            interrupt,
            companion,
            fault: args.fault.clone(),
            port: port.to_owned(),
            rig_file,
            is_alone,
            agrees: args.yes,
            lines,
            typed: VecDeque::new(),
            pending: None,
            bar: super::spinner(),
        }
    }

    fn say(&self, text: &str) {
        self.bar.suspend(|| remark(text));
    }

    /// Takes what was typed; an error where that ends the test.
    fn listen(&mut self) -> anyhow::Result<()> {
        let Some(lines) = &self.lines else {
            return Ok(());
        };
        loop {
            match lines.try_recv() {
                Ok(line) => match line.trim().to_lowercase() {
                    line if matches!(line.as_str(), "q" | "quit") => {
                        return Err(Interrupted.into());
                    }
                    line => self.typed.push_back(line),
                },
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => return Err(Interrupted.into()),
            }
        }
    }

    /// Asks a person: what was typed before is no answer to it.
    fn ask_person(&mut self, text: &str) -> anyhow::Result<()> {
        self.listen()?;
        self.typed.clear();
        self.say(text);
        Ok(())
    }

    /// A fault that is there from the start.
    fn break_at_start(&mut self) -> anyhow::Result<()> {
        match (&self.fault, &mut self.companion) {
            (Some(fault), Some(companion)) if !MOMENTS.iter().any(|(name, _)| name == fault) => {
                companion.obey(&format!("fault {fault} on"))
            }
            _ => Ok(()),
        }
    }
}

/// A line that the virtual rig obeys.
fn control_line(hand: Hand) -> String {
    let (switch, on) = match hand {
        Hand::Press(switch) | Hand::Pull(switch) => (switch, "on"),
        Hand::Release(switch) | Hand::Plug(switch) => (switch, "off"),
    };
    let fault = match switch {
        Switch::Retracted => "retracted-switch",
        Switch::Pushed => "end-switch",
        Switch::EmergencyStop => "emergency-stop",
    };
    format!("fault {fault} {on}")
}

impl Operator for Terminal {
    fn begin(&mut self, step: Step, number: usize, of: usize) -> anyhow::Result<()> {
        let mut text = format!("\n{number}/{of}  {}\n     {}", step.title(), step.purpose());
        if let Some(moves) = step.moves() {
            text += &format!("\n     Moves: {moves}.");
        }
        self.say(&text);
        let moment = MOMENTS
            .iter()
            .find(|(name, _)| self.fault.as_deref() == Some(name));
        if let (Step::Telemetry, Some((_, line)), Some(companion)) =
            (step, moment, &mut self.companion)
        {
            companion.obey(line)?;
        }
        Ok(())
    }

    fn agrees(&mut self, _: Step) -> anyhow::Result<()> {
        if self.companion.is_some() || self.agrees {
            self.pending = Some(Answer::Yes);
        } else if self.is_alone {
            self.say("     No terminal to confirm on: use --yes to run it.");
            self.pending = Some(Answer::Skip);
        } else {
            self.ask_person("     Enter begins, s skips, q ends.")?;
        }
        Ok(())
    }

    fn check(&mut self) -> anyhow::Result<()> {
        if self.interrupt.requested() {
            return Err(Interrupted.into());
        }
        self.listen()
    }

    fn progress(&mut self, passed: f64, total: f64, what: &str) {
        if self.bar.length() != Some(1000) {
            self.bar.set_length(1000);
            if let Ok(style) = ProgressStyle::with_template("     {bar:40} {percent:>3} %  {msg}") {
                self.bar.set_style(style);
            }
        }
        // At most a thousand.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let position = (1000.0 * (passed / total).clamp(0.0, 1.0)) as u64;
        self.bar.set_position(position);
        self.bar.set_message(what.to_owned());
    }

    fn ended(&mut self, finding: &Finding) {
        self.pending = None;
        let mut text = String::new();
        for measured in &finding.measured {
            let mark = if measured.passed { ' ' } else { '!' };
            let limit = shown_limit(measured);
            let limit = if limit.is_empty() {
                String::new()
            } else {
                format!("  ({limit})")
            };
            text += &format!(
                "   {mark} {}: {}{limit}\n",
                measured.name,
                shown_value(measured)
            );
        }
        let word = match finding.outcome {
            Outcome::Passed => "passed",
            Outcome::Failed => "FAILED",
            Outcome::Skipped => "not made",
        };
        text += &format!("     {word}. {}", finding.sentence);
        if let Some(advice) = finding.advice {
            text += &format!("\n     What to do: {advice}");
        }
        self.say(&text);
    }

    fn has_hands(&self) -> bool {
        !self.is_alone
    }

    fn hand(&mut self, hand: Hand) -> anyhow::Result<()> {
        if let Some(companion) = &mut self.companion {
            return companion.obey(&control_line(hand));
        }
        let mut text = match hand {
            Hand::Press(switch) => format!("Now press and hold: {}", switch.name()),
            Hand::Release(switch) => format!("Release: {}", switch.name()),
            Hand::Pull(switch) => format!("Pull one wire of: {}", switch.name()),
            Hand::Plug(switch) => format!("Plug the wire in again: {}", switch.name()),
        };
        if is_pseudo_terminal(&self.port) {
            text += &format!("; where `softrig virtual` runs: `{}`", control_line(hand));
        }
        self.ask_person(&format!("  →  {text}  (s skips)"))
    }

    fn ask(&mut self, question: &str) -> anyhow::Result<()> {
        if self.companion.is_some() {
            self.pending = Some(Answer::Yes);
            return Ok(());
        }
        self.ask_person(&format!("  ?  {question}  (y or n, then Enter)"))
    }

    fn answer(&mut self) -> anyhow::Result<Option<Answer>> {
        self.check()?;
        if let Some(answer) = self.pending.take() {
            return Ok(Some(answer));
        }
        Ok(match self.typed.pop_front().as_deref() {
            None => None,
            Some("" | "y" | "yes") => Some(Answer::Yes),
            Some("n" | "no") => Some(Answer::No),
            Some("s" | "skip") => Some(Answer::Skip),
            Some(_) => {
                self.say("     Answer with y, n, s or q.");
                None
            }
        })
    }

    fn keep_clock(&mut self, rate: ClockRate) -> anyhow::Result<String> {
        let path = &self.rig_file;
        // One that cannot be read is replaced, as the error about it says.
        let before = RigFile::find(path).ok().flatten();
        RigFile {
            schema: 1,
            // The next virtual rig is behind another.
            port: (!is_pseudo_terminal(&self.port)).then(|| self.port.clone()),
            recording: before.as_ref().and_then(|file| file.recording.clone()),
            model: before.and_then(|file| file.model),
            board: Some(board_name(&self.port)),
            clock: Some(rate),
        }
        .write(path)?;
        Ok(format!(
            "Written to {}: `softrig record` corrects the times of this board by the factor {:.5}.",
            path.display(),
            rate.factor
        ))
    }

    fn warn(&mut self, text: &str) {
        self.bar.suspend(|| super::warn(text));
    }
}
