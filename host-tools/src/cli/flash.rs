//! `softrig flash`: writes the firmware into a board.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Parser;
use indicatif::ProgressStyle;

use super::port::PortArgs;
use softrig_formats::error::InputError;
use softrig_link::SerialConnector;
use softrig_link::flash::{self, Image, Stage};

/// Writes the firmware into a board, and checks that it arrived whole.
///
/// The Mega's own bootloader takes it; nothing else has to be installed. Afterwards the board
/// computes the checksum of what it has, which is compared with that of the file. Settings,
/// calibration and the log of faults stay. A rig that is armed is stopped: the pump is off
/// and the vent open while the board is written.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig flash --port /dev/ttyACM0
  softrig flash --port /dev/ttyACM0 firmware/softrig-mega2560.hex
  softrig flash --port /dev/ttyACM0 --dry-run

Without a file it takes firmware/softrig-mega2560.hex beside this program, as in the
archive of a release. `cargo xtask flash` builds one first.")]
pub struct Args {
    #[command(flatten)]
    port: PortArgs,
    /// The image (Intel hex)
    #[arg(value_name = "IMAGE.hex")]
    image: Option<PathBuf>,
    /// Read the image, and write nothing
    #[arg(long)]
    dry_run: bool,
}

/// The image in an archive, from where the program is.
const BESIDE: &str = "firmware/softrig-mega2560.hex";

/// Runs the command.
///
/// # Errors
///
/// A wrong image before the port is opened; then a board that does not take it, or has another
/// checksum afterwards.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let path = match &args.image {
        Some(path) => path.clone(),
        None => beside()?,
    };
    let image = Image::read(&path)?;
    let named = format!(
        "{}: {} bytes, checksum {:04x}",
        path.display(),
        image.len(),
        image.checksum()
    );
    if args.dry_run {
        return Ok(super::print(&format!("{named}; nothing was written\n"))?);
    }
    let port = args.port.find()?;
    let bar = super::spinner();
    let begun = Instant::now();
    let board = flash::flash(SerialConnector::new(&port), &image, |stage| match stage {
        Stage::Searching => bar.set_message("waiting for the bootloader"),
        Stage::Writing(done, total) => {
            if bar.length() != Some(total as u64) {
                bar.set_length(total as u64);
                if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}") {
                    bar.set_style(style);
                }
                bar.set_message("writing: do not pull the cable");
            }
            bar.set_position(done as u64);
        }
        Stage::Starting => bar.set_message("waiting for the board, which starts it"),
    })?;
    bar.finish_and_clear();
    Ok(super::print(&format!(
        "{named}\nwritten in {:.0} s; the board is softrig {} and has the same checksum\n",
        begun.elapsed().as_secs_f64(),
        board.firmware
    ))?)
}

/// The image of the archive that this program is from.
fn beside() -> Result<PathBuf, InputError> {
    // Without /proc, as in an empty root, nobody knows but who started it.
    let called = || std::env::args_os().next().map(PathBuf::from);
    let program = std::env::current_exe()
        .ok()
        .or_else(|| called().filter(|path| path.is_absolute()));
    let folder = program.as_deref().and_then(Path::parent);
    folder
        .map(|folder| folder.join(BESIDE))
        .filter(|path| path.is_file())
        .ok_or_else(|| {
            InputError::new(
                format!("there is no {BESIDE} beside this program"),
                "name the image: softrig flash --port PORT IMAGE.hex; `cargo xtask flash --port PORT` builds one",
            )
        })
}
