//! `softrig example`: simulated recordings with an effect hidden in them.

use std::path::PathBuf;

use clap::Parser;

use softrig::synth::example::{Hidden, NOISE_DEG, make, of_actuator};
use softrig_formats::model_file::ModelFile;

/// Writes a model and simulated recordings with an effect hidden in them.
///
/// Every file says that it is simulated. The answer is in truth.toml: look there
/// last.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig example -o demo --hide 7
  softrig example -o demo --effect coulomb_friction --noise-deg 0.4
  softrig example -o demo --actuator truth.toml               effects of any kind
  softrig diagnose --model demo/model.toml demo/recordings/*.csv --plot gap.svg")]
pub struct Args {
    /// Folder to write model.toml, truth.toml and recordings/ to
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Seed that decides the actuator, the noise and the hidden effect
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    hide: u64,
    /// Hide this effect instead of one drawn from the seed; "none" hides
    /// nothing but wrong parameters
    #[arg(long, value_name = "KIND")]
    effect: Option<String>,
    /// Record the actuator of this model file instead; model.toml is then its
    /// dynamics, off by as much as data sheets are, without its effects
    #[arg(long, value_name = "TRUTH.toml", conflicts_with = "effect")]
    actuator: Option<PathBuf>,
    /// RMS noise of the angle sensor, in degrees
    #[arg(long, default_value_t = NOISE_DEG)]
    noise_deg: f64,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the arguments, and folders that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let hidden = Hidden::named(args.effect.as_deref())?;
    let example = match &args.actuator {
        Some(path) => of_actuator(&ModelFile::read(path)?, args.noise_deg, args.hide)?,
        None => make(hidden, args.noise_deg, args.hide)?,
    };
    example.write(&args.output)?;
    let shown = args.output.display();
    super::print(&format!(
        "{} simulated recordings of an actuator that hides something are in {shown}/recordings.\n\
         The nominal model, without the hidden effect, is {shown}/model.toml; the answer is in {shown}/truth.toml.\n",
        example.recordings.len()
    ))?;
    Ok(())
}
