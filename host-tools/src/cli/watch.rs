//! Progress of long work on the terminal, and its interruption.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use softrig::diagnose::work::progress::State;
use softrig::diagnose::{Budget, Job};
use softrig_formats::terminal::{printable, remark};

/// Exit code of an interrupted command, as shells give it: 128 and the number of SIGINT.
const INTERRUPTED: i32 = 130;

/// How often a terminal is drawn.
const DRAWN: Duration = Duration::from_millis(120);

/// How often a line is written where there is no terminal.
const LOGGED: Duration = Duration::from_secs(10);

/// Work that is shown on stderr. After Ctrl-C it ends and reports the best so far.
pub(crate) struct Watched {
    /// The progress of the work.
    pub job: Arc<Job>,
    /// None once the work is done. Locked while results are written, so that an
    /// interruption waits for whole files.
    display: Arc<Mutex<Option<Display>>>,
}

impl Watched {
    /// Starts the display, and takes over Ctrl-C; `go_on` says how to resume the work. The
    /// budget counts from `begun`.
    pub(crate) fn start(
        go_on: String,
        budget: Option<Budget>,
        begun: Instant,
    ) -> anyhow::Result<Self> {
        let job = Arc::new(Job::within(budget).since(begun));
        let display = Arc::new(Mutex::new(Some(Display::of(Arc::clone(&job)))));
        let (known, shown) = (Arc::clone(&job), Arc::clone(&display));
        super::on_interrupt(move || {
            if let Some(display) = lock(&shown).take() {
                display.close();
                remark(unfinished(&known.state(), &go_on).trim_end());
            }
            std::process::exit(INTERRUPTED);
        })?;
        Ok(Self { job, display })
    }

    /// Ends the display. An interruption waits as long as the returned guard lives.
    pub(crate) fn finish(&self) -> impl Drop {
        let mut display = lock(&self.display);
        if let Some(display) = display.take() {
            display.close();
        }
        display
    }
}

fn lock(display: &Mutex<Option<Display>>) -> MutexGuard<'_, Option<Display>> {
    display.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The message of an interrupted diagnosis.
fn unfinished(state: &State, go_on: &str) -> String {
    format!(
        "unfinished: not a diagnosis\n{}\n{}\n{}\nNo results were written. {go_on}\n",
        state.stage,
        state.how_far(),
        state.best_so_far()
    )
}

/// A thread that shows progress until it is closed.
struct Display {
    close: Sender<()>,
    thread: JoinHandle<()>,
}

impl Display {
    fn of(job: Arc<Job>) -> Self {
        let (close, closed) = channel();
        let thread = std::thread::spawn(move || {
            let spinner = spinner();
            let pause = if spinner.is_some() { DRAWN } else { LOGGED };
            while closed.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let state = job.state();
                match &spinner {
                    Some(spinner) => {
                        spinner.set_position(per_mille(state.share));
                        spinner.set_message(printable(&lines(&state)).into_owned());
                        spinner.tick();
                    }
                    None => {
                        remark(&state.to_string());
                    }
                }
            }
            if let Some(spinner) = &spinner {
                spinner.finish_and_clear();
            }
        });
        Self { close, thread }
    }

    /// Returns once the terminal is as it was.
    fn close(self) {
        // A thread that has ended needs no message.
        let _ = self.close.send(());
        let _ = self.thread.join();
    }
}

/// A share of the whole on the bar.
fn per_mille(share: f64) -> u64 {
    // Within the bar by the clamp.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let position = (share.clamp(0.0, 1.0) * WHOLE as f64).round() as u64;
    position
}

/// Steps of the bar.
const WHOLE: u64 = 1000;

/// A spinner and a bar over the whole work on stderr; none if that is no terminal, or one that
/// cannot erase.
fn spinner() -> Option<ProgressBar> {
    let spinner = ProgressBar::new(WHOLE);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {bar:24} {percent:>3} %  {msg}") {
        spinner.set_style(style.progress_chars("━╸─"));
    }
    let is_dumb = std::env::var_os("TERM").map_or(cfg!(unix), |term| term == "dumb");
    (!spinner.is_hidden() && !is_dumb).then_some(spinner)
}

/// The lines of a terminal: stage, progress, best so far.
fn lines(state: &State) -> String {
    format!(
        "{}\n  {}\n  {}",
        state.stage,
        state.how_far(),
        state.best_so_far()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_says_that_it_is_no_diagnosis_and_how_to_go_on() {
        let state = State {
            stage: "screening".into(),
            done: 3,
            planned: 12,
            fits: 3,
            ..State::default()
        };
        let text = unfinished(&state, "Repeat the command.");
        assert_eq!(
            text,
            "unfinished: not a diagnosis\nscreening\n3 of 12 fits, 0 s so far\nno explanation so far\nNo results were written. Repeat the command.\n"
        );
    }
}
