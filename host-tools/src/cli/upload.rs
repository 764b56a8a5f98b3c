//! `softrig upload`: writes a model, calibration and limits to a board, and checks every bit.

use std::path::PathBuf;

use clap::{ArgGroup, Parser};
use indicatif::{ProgressBar, ProgressStyle};
use wire::settings::{Key, Settings};

use super::port::PortArgs;
use softrig::diagnose::decide::verdict::read_zeros;
use softrig::estimate::Placement;
use softrig::estimate::placement::without_law;
use softrig::sim::board;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::settings_file::{self, Assignment, key_text};
use softrig_formats::setup::Setup;
use softrig_link::{Link, SerialConnector, Timing};

/// Writes a model or settings to a board, and reads everything back.
///
/// The board uses its old settings until it has accepted all new ones, and stores
/// them permanently.
#[derive(Debug, Parser)]
#[command(group(ArgGroup::new("what").required(true).multiple(true).args(["model", "settings", "zeros", "read"])))]
#[command(after_help = "\
Examples:
  softrig upload --port /dev/ttyACM0 --model repaired.toml --dry-run
  softrig upload --port /dev/ttyACM0 --model repaired.toml
  softrig upload --port /dev/ttyACM0 --model repaired.toml --zeros verdict.json
  softrig upload --port /dev/ttyACM0 --model repaired.toml --setup tilt_deg=90
  softrig upload --port /dev/ttyACM0 --settings limits.toml
  softrig upload --port /dev/ttyACM0 --read > board.toml

A settings file has lines like `max.kpa = 150.0`; --read prints all there are,
with their units.")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// Model file whose dynamics and effects the board is to use
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
    /// Rig setup: with tilt_deg=90 the board's prediction allows for a base turned since the angle
    /// was zeroed
    #[arg(long, value_name = "KEY=VALUE,…", requires = "model")]
    setup: Option<Setup>,
    /// File of settings: calibration, limits, gains
    #[arg(long, value_name = "SETTINGS.toml")]
    settings: Option<PathBuf>,
    /// Verdict of `softrig diagnose --json` whose sensor zeros correct the calibration:
    /// p.zero (counts) and the angles of the flex sensor's table (°). If several, the last is used
    #[arg(long, value_name = "VERDICT.json")]
    zeros: Option<PathBuf>,
    /// Print the board's settings as a settings file instead
    #[arg(long, conflicts_with_all = ["model", "settings", "zeros"])]
    read: bool,
    /// Show what would change, and change nothing
    #[arg(long)]
    dry_run: bool,
}

/// Runs the command.
///
/// # Errors
///
/// Invalid files before the port is opened; then settings that the board refuses.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut wanted: Vec<Assignment> = Vec::new();
    let mut model = args.model.as_deref().map(super::read_model).transpose()?;
    if let (Some(file), Some(setup)) = (&mut model, &args.setup) {
        if let Some((key, lacks, advice)) = without_law(setup, file) {
            let found = format!("--setup has {key}, and {lacks}");
            return Err(InputError::new(found, advice).in_file(&file.path).into());
        }
        file.model = Placement::of(setup, file.recording.setup.tube_mm).place(&file.model);
    }
    if let Some(model) = &model {
        wanted.extend(settings_file::from_model(model)?);
    }
    if let Some(path) = &args.settings {
        for (key, bits) in settings_file::read(path)? {
            if wanted.iter().any(|(known, _)| *known == key) {
                return Err(InputError::new(
                    format!("{} is given twice", key_text(key)),
                    "give it in the model or in the settings",
                )
                .in_file(path)
                .into());
            }
            wanted.push((key, bits));
        }
    }
    let zeros = args.zeros.as_deref().map(read_zeros).transpose()?;
    let mut link = Link::open(SerialConnector::new(&args.port.find()?), Timing::default())?;
    let settings = read_settings(&mut link)?;
    if let (Some(zeros), Some(path)) = (zeros, &args.zeros) {
        wanted.extend(
            zeros
                .taken_from(&settings, &wanted)
                .map_err(|error| error.in_file(path))?,
        );
    }
    if args.read {
        let board = link.board();
        let about = format!("settings {} of firmware {}", board.settings, board.firmware);
        return Ok(super::print(&settings_file::to_text(&settings, &about))?);
    }
    let changes = settings_file::changes(&settings, wanted);
    if changes.is_empty() {
        return Ok(super::print("The board has these settings already.\n")?);
    }
    super::print(&settings_file::changes_text(&settings, &changes))?;
    if let Some(model) = &model {
        let farthest = changes
            .iter()
            .find(|(key, _)| *key == Key::MaxAngle)
            .map_or(settings.number(Key::MaxAngle), |&(_, bits)| {
                f32::from_bits(bits)
            });
        super::print(&stepped(model, farthest)?)?;
    }
    if args.dry_run {
        return Ok(());
    }
    apply(&mut link, &changes)?;
    Ok(super::print(&format!(
        "{} settings written, stored and read back\n",
        changes.len()
    ))?)
}

/// The board's load by a model, for angles up to `farthest_deg`.
fn stepped(file: &ModelFile, farthest_deg: f32) -> Result<String, InputError> {
    let plan = board::plan(&file.model, farthest_deg.to_radians()).map_err(|why| {
        InputError::new(
            format!("{why}; the board would refuse it"),
            "use it on the computer (`softrig simulate`), or fit one with another effect",
        )
        .in_file(&file.path)
    })?;
    Ok(format!(
        "the board predicts with {} of this model in 10 ms, at most {:.1} % of its processor\n",
        match plan.substeps {
            1 => "1 step".to_owned(),
            steps => format!("{steps} steps"),
        },
        board::percent_of(plan.cycles),
    ))
}

/// Changes settings, with a progress bar.
pub(crate) fn apply(link: &mut Link, changes: &[Assignment]) -> anyhow::Result<()> {
    let bar = bar("writing");
    let outcome = link.change_settings(changes, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    Ok(outcome?)
}

/// Reads all settings, with a progress bar.
pub(crate) fn read_settings(link: &mut Link) -> anyhow::Result<Settings> {
    let bar = bar("reading");
    let settings = link.read_settings(|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    Ok(settings)
}

fn bar(message: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(1);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}") {
        bar.set_style(style);
    }
    bar.with_message(message)
}
