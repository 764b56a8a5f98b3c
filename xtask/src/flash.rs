//! Builds the image and writes it to a board, with `softrig flash`.

use std::process::Command;

use crate::{
    avr,
    shell::{Outcome, cargo, run, target_dir},
};

/// What `flash` was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Options<'a> {
    /// The serial port; without one `softrig flash` looks for the board.
    pub port: Option<&'a str>,
    /// Whether to show afterwards what the board says.
    pub console: bool,
    /// Whether to stop before anything is written.
    pub dry_run: bool,
}

impl<'a> Options<'a> {
    /// Reads the words after `flash`.
    pub fn parse(words: &[&'a str]) -> Result<Self, String> {
        let mut options = Self {
            port: None,
            console: true,
            dry_run: false,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            match word {
                "--port" | "-P" => {
                    let port = words
                        .next()
                        .ok_or("flash: --port needs a name: `cargo rig ports` lists them")?;
                    options.port = Some(port);
                }
                "--no-console" => options.console = false,
                "--dry-run" => options.dry_run = true,
                other => return Err(format!("flash does not know {other:?}")),
            }
        }
        Ok(options)
    }
}

/// Builds the image, checks it, writes it, and shows what the board says.
pub fn flash(options: Options<'_>) -> Outcome {
    let image = avr::build()?;
    avr::gates(&image)?;
    avr::print_size(&image)?;
    run(cargo().args(["build", "-q", "--release", "--locked", "-p", "softrig-cli"]))?;
    let softrig = |command: &str| {
        let mut softrig = Command::new(target_dir().join("release/softrig"));
        softrig.arg(command);
        softrig.args(options.port.iter().flat_map(|port| ["--port", port]));
        softrig
    };
    let mut write = softrig("flash");
    write.arg(avr::hex(&image));
    if options.dry_run {
        return run(write.arg("--dry-run"));
    }
    run(&mut write)?;
    if !options.console {
        return Ok(());
    }
    println!("the board says (Ctrl-C ends):");
    run(&mut softrig("monitor"))
}

#[cfg(test)]
mod tests {
    use super::Options;

    #[test]
    fn options_are_read_in_any_order() {
        let options = Options::parse(&["--no-console", "--port", "/dev/x", "--dry-run"]).unwrap();
        assert_eq!(
            options,
            Options {
                port: Some("/dev/x"),
                console: false,
                dry_run: true
            }
        );
        assert!(Options::parse(&["--prot", "/dev/x"]).is_err());
        assert_eq!(Options::parse(&[]).unwrap().port, None);
        assert!(
            Options::parse(&["--port"])
                .unwrap_err()
                .contains("needs a name")
        );
    }
}
