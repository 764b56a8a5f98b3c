//! The subcommands of `softrig`, one file each: arguments, and calls of the library.

mod address;
pub mod calibrate;
pub(crate) mod choice;
pub mod commission;
pub mod compare;
pub mod convert;
pub mod diagnose;
pub mod example;
#[cfg_attr(not(feature = "lab"), path = "export_left_out.rs")]
pub mod export;
pub mod fit;
pub mod flash;
pub mod gap;
pub mod import;
pub mod init;
pub mod input;
pub(crate) mod json;
pub mod linearise;
#[cfg_attr(not(feature = "lab"), path = "live_left_out.rs")]
mod live;
pub mod log;
pub mod materials;
pub(crate) mod model;
pub mod monitor;
pub mod next;
pub mod output;
mod picture;
pub mod plan;
pub(crate) mod port;
pub mod ports;
pub mod record;
pub mod residuals;
mod row;
pub mod schema;
pub mod simulate;
mod udp;
pub mod upload;
pub mod virtual_rig;
mod watch;

use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use self::input::InputArgs;
use softrig::estimate::placement::with_tip_load;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, read_all};
use softrig_formats::setup::Setup;
use softrig_formats::terminal::remark;

pub use softrig_formats::terminal::{print, print_own};

/// Prints a warning to stderr.
pub(crate) fn warn(text: &str) {
    softrig_formats::terminal::remark(&format!("warning: {text}"));
}

/// Reads a model, with its warnings.
pub(crate) fn read_model(path: &Path) -> Result<ModelFile, InputError> {
    let file = ModelFile::read(path)?;
    for warning in &file.warnings {
        warn(warning);
    }
    Ok(file)
}

/// Reads a model and recordings, with their warnings.
pub(crate) fn read(
    model: &Path,
    recordings: &[PathBuf],
    input: &InputArgs,
) -> Result<(ModelFile, Vec<Recording>), InputError> {
    let file = read_model(model)?;
    let recordings = read_all(recordings, &input.layout_over(&file.recording)?, warn)?;
    Ok((with_tip_load(file, &recordings), recordings))
}

/// Says what is to be done at the rig before a recording, and waits until Enter says that it
/// is done.
///
/// # Errors
///
/// Where nobody can be asked, and nothing was said beforehand.
pub(crate) fn ask_to_set_up(setup: &Setup) -> anyhow::Result<()> {
    let steps = setup.instructions().join(", and ");
    if steps.is_empty() {
        return Ok(());
    }
    if !std::io::stdin().is_terminal() {
        return Err(InputError::new(
            format!("the protocol asks you to {steps}, but there is no terminal to confirm it"),
            "do it, then add --ready",
        )
        .into());
    }
    remark(&format!(
        "Now {steps}.\nPress Enter when done; Ctrl-C quits before anything moves."
    ));
    std::io::stdin().lock().read_line(&mut String::new())?;
    Ok(())
}

/// The width of a column of text: that of the longest, and at least the usual one.
pub(crate) fn width<'a>(least: usize, texts: impl Iterator<Item = &'a str>) -> usize {
    texts
        .map(|text| text.chars().count())
        .fold(least, usize::max)
}

/// A spinner for long work on a terminal, silent elsewhere.
pub(crate) fn spinner() -> indicatif::ProgressBar {
    let bar = indicatif::ProgressBar::new_spinner();
    bar.enable_steady_tick(std::time::Duration::from_millis(120));
    bar
}

/// What Ctrl-C does.
type Handler = Box<dyn FnMut() + Send>;

/// What it does now.
static ON_INTERRUPT: Mutex<Option<Handler>> = Mutex::new(None);

/// From now on Ctrl-C, and the signals of a closing session, do this and not what they did
/// before: the system has one handler, and a command may work and then record.
pub(crate) fn on_interrupt(handler: impl FnMut() + Send + 'static) -> anyhow::Result<()> {
    let current = || ON_INTERRUPT.lock().unwrap_or_else(PoisonError::into_inner);
    let is_first = current().replace(Box::new(handler)).is_none();
    if is_first {
        ctrlc::set_handler(move || {
            if let Some(handler) = current().as_mut() {
                handler();
            }
        })?;
    }
    Ok(())
}

/// Whether the user asked the program to end. From the moment it listens, Ctrl-C no
/// longer ends the program by itself: a moving rig has to be stopped first.
#[derive(Clone, Debug)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Takes over Ctrl-C, and the signals of a closing session.
    pub(crate) fn listen() -> anyhow::Result<Self> {
        let flag = Arc::new(AtomicBool::new(false));
        let raised = Arc::clone(&flag);
        on_interrupt(move || raised.store(true, Ordering::Relaxed))?;
        Ok(Self(flag))
    }

    /// Whether an interruption was requested.
    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
