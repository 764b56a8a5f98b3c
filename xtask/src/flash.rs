//! Flashes the image to a board, with checks before.
//!
//! avrdude reports a protocol time-out if a cable, a permission or a second program is the
//! cause. So these are checked first.

use std::{
    fs::{self, OpenOptions},
    io,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    avr,
    shell::{self, Outcome, cargo, run, target_dir},
};

/// What `flash` was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options<'a> {
    /// The serial port.
    pub port: &'a str,
    /// Whether to show afterwards what the board says.
    pub console: bool,
    /// Whether to stop before anything is written.
    pub dry_run: bool,
}

/// Speed of the board's bootloader (baud).
const BAUD: &str = "115200";

impl<'a> Options<'a> {
    /// Reads the words after `flash`.
    pub fn parse(words: &[&'a str]) -> Result<Self, String> {
        let mut port = None;
        let mut options = Self {
            port: "",
            console: true,
            dry_run: false,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            match word {
                "--port" | "-P" => port = words.next().copied(),
                "--no-console" => options.console = false,
                "--dry-run" => options.dry_run = true,
                other => return Err(format!("flash does not know {other:?}")),
            }
        }
        options.port = port.ok_or_else(|| match candidates().as_slice() {
            [] => {
                "flash needs --port PORT, and no board is plugged in (no /dev/ttyACM* or /dev/ttyUSB*)"
                    .to_owned()
            }
            found => format!("flash needs --port PORT; here are: {}", found.join(", ")),
        })?;
        Ok(options)
    }
}

/// Builds the image, checks it and the port, writes and verifies, and shows what
/// the board says.
pub fn flash(options: Options<'_>) -> Outcome {
    check_port(options.port)?;
    if !shell::has_program("avrdude") {
        return Err("flashing needs avrdude: run `cargo xtask setup`".into());
    }
    let image = avr::build()?;
    avr::gates(&image)?;
    avr::print_size(&image)?;
    let mut write = avrdude(&image, options.port);
    if options.dry_run {
        println!("dry run: would run {}", shell::text(&write));
        return Ok(());
    }
    run(&mut write).map_err(|failure| {
        format!(
            "{failure}\n  If it timed out: is this the right port ({}), is another program \
             (a monitor, the Arduino IDE) holding it, and is the board a Mega 2560?",
            options.port
        )
    })?;
    if !options.console {
        return Ok(());
    }
    println!("the board says (Ctrl-C ends):");
    run(cargo()
        .args(["build", "-q", "--release", "--locked", "-p", "host-tools"])
        .args(["--bin", "rig"]))?;
    run(Command::new(target_dir().join("release/rig")).args(["monitor", "--port", options.port]))
}

/// The command that writes an image and reads it back.
pub fn avrdude(image: &Path, port: &str) -> Command {
    let mut command = Command::new("avrdude");
    command
        .args(["-p", "atmega2560", "-c", "wiring", "-P", port, "-b", BAUD])
        // The bootloader erases page by page; a chip erase it would refuse.
        .args(["-D", "-q", "-U"])
        .arg(format!("flash:w:{}:e", image.display()));
    command
}

fn check_port(port: &str) -> Outcome {
    let explain = |error: io::Error| -> String {
        match error.kind() {
            io::ErrorKind::NotFound => match candidates().as_slice() {
                [] => format!("there is no {port}, and no board is plugged in"),
                found => format!("there is no {port}; here are: {}", found.join(", ")),
            },
            io::ErrorKind::PermissionDenied => format!(
                "{port} may not be opened: `sudo usermod -aG dialout $USER`, then log in again"
            ),
            _ => format!("{port} cannot be opened: {error}"),
        }
    };
    // Looked at, not opened: opening resets the board.
    fs::metadata(port).map_err(explain)?;
    if is_device(port) {
        return Ok(());
    }
    OpenOptions::new().read(true).open(port).map_err(explain)?;
    Err(format!("{port} is no serial port").into())
}

#[cfg(unix)]
fn is_device(port: &str) -> bool {
    use std::os::unix::fs::FileTypeExt;
    fs::metadata(port).is_ok_and(|metadata| metadata.file_type().is_char_device())
}

#[cfg(not(unix))]
fn is_device(_: &str) -> bool {
    true
}

/// Serial ports as Linux and macOS name those of such boards.
fn candidates() -> Vec<String> {
    let mut found: Vec<PathBuf> = fs::read_dir("/dev")
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            ["ttyACM", "ttyUSB", "cu.usbmodem", "cu.usbserial"]
                .iter()
                .any(|start| name.starts_with(start))
        })
        .collect();
    found.sort();
    found
        .iter()
        .map(|path| path.display().to_string())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::{Options, check_port};

    #[test]
    fn options_are_read_in_any_order() {
        let options = Options::parse(&["--no-console", "--port", "/dev/x", "--dry-run"]).unwrap();
        assert_eq!(
            options,
            Options {
                port: "/dev/x",
                console: false,
                dry_run: true
            }
        );
        assert!(Options::parse(&["--prot", "/dev/x"]).is_err());
        assert!(
            Options::parse(&["--port"])
                .unwrap_err()
                .contains("needs --port")
        );
    }

    #[test]
    fn what_is_no_port_is_refused_before_anything_is_built() {
        assert!(
            check_port("/dev/no-such-port")
                .unwrap_err()
                .0
                .contains("there is no")
        );
        assert!(
            check_port(env!("CARGO_MANIFEST_DIR"))
                .unwrap_err()
                .0
                .contains("no serial port")
        );
    }
}
