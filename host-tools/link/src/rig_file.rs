//! `softrig.toml`: what is known of the rig whose recordings a folder holds: its port, its model, and
//! what was measured of its board.
//!
//! `softrig commission` writes it into the folder in which it runs, and `softrig record` reads it from
//! there. A clock names its board, so that that of one board never corrects the times of another.

use std::path::{Path, PathBuf};
use std::sync::Once;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::terminal::remark;
use toml::Spanned;

#[cfg(not(target_family = "wasm"))]
use crate::port::{is_pseudo_terminal, ports};

/// The file's usual name.
pub const RIG_FILE: &str = "softrig.toml";

/// Its name before 0.1.0.
const OLD_RIG_FILE: &str = "rig.toml";

/// The file of the folder in which the command runs, under its old name where only that is there,
/// with a remark.
pub fn rig_file() -> &'static Path {
    static TOLD: Once = Once::new();
    let [new, old] = [RIG_FILE, OLD_RIG_FILE].map(Path::new);
    if new.exists() || !old.exists() {
        return new;
    }
    TOLD.call_once(|| {
        remark(&format!(
            "Using {OLD_RIG_FILE}: rename it to {RIG_FILE}, its new name."
        ));
    });
    old
}

/// The farthest from 1 that a board's clock can be: a ceramic resonator has 0.5 %, and at 2 % the
/// serial line would not work.
pub const FARTHEST_RATE: f64 = 0.02;

/// What is known of one rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// The version of the format: 1.
    pub schema: u8,
    /// The port that commands take where nothing else names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub port: Option<String>,
    /// The model file that commands take where the command line names none, relative to the folder
    /// of this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<Spanned<PathBuf>>,
    /// The board whose clock was measured: see [`board_name`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board: Option<String>,
    /// Its clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockRate>,
    /// The columns of recordings, as `softrig import` writes them: the section of a model file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<toml::Table>,
}

/// How fast a board's clock is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClockRate {
    /// Seconds of the computer in one of the board's: above 1 the board is slow.
    pub factor: f64,
    /// Its standard error.
    pub standard_error: f64,
    /// How long it was watched (s).
    pub seconds: f64,
}

impl RigFile {
    /// Reads the file at `path`; none where there is none.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn find(path: &Path) -> Result<Option<Self>, InputError> {
        let text = text_of(path)?;
        text.map(|text| Self::parse(&text, path)).transpose()
    }

    /// The model file that the file at `path` names; none where there is no file, or it names none.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy, also where that model is not there.
    pub fn find_model(path: &Path) -> Result<Option<PathBuf>, InputError> {
        let Some(text) = text_of(path)? else {
            return Ok(None);
        };
        let Some(named) = Self::parse(&text, path)?.model else {
            return Ok(None);
        };
        let model = path.with_file_name(named.get_ref());
        if model.is_file() {
            return Ok(Some(model));
        }
        let found = format!("the model {} is not there", model.display());
        let advice =
            "correct its name, or name another with --model; `softrig init` makes a first one";
        Err(InputError::new(found, advice)
            .in_file(path)
            .at_offset(&text, named.span().start))
    }

    /// Parses the text of the file; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        const KEYS: &str = "its keys are schema = 1, port, model, board, [clock] and [recording]; `softrig commission --only clock` writes board and [clock] anew";
        const ADVICE: &str = "measure it again with `softrig commission --only clock`, or delete [clock]: without it times are the board's";
        let file: Self = toml::from_str(text).map_err(|error| {
            let fault = InputError::new(error.message(), KEYS).in_file(path);
            match error.span() {
                Some(span) => fault.at_offset(text, span.start),
                None => fault,
            }
        })?;
        if file.schema != 1 {
            let found = format!("is of schema {}, and this softrig reads 1", file.schema);
            return Err(InputError::new(found, "update softrig").in_file(path));
        }
        let found = match (&file.clock, &file.board) {
            (None, _) => return Ok(file),
            (Some(_), None) => "has [clock] but does not name a board".to_owned(),
            // Written so that not-a-number is not one.
            (Some(clock), _) if (clock.factor - 1.0).abs() <= FARTHEST_RATE => return Ok(file),
            (Some(clock), _) => format!(
                "the clock factor is {}; no readable board differs from 1 by more than {FARTHEST_RATE}",
                clock.factor
            ),
        };
        Err(InputError::new(found, ADVICE).in_file(path))
    }

    /// Writes the file.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), InputError> {
        // Plain values: nothing in it can fail to be written.
        let text = toml::to_string(self).unwrap_or_default();
        let head = "# Measured by `softrig commission`; `softrig record` corrects the times of this board by it.\n# Commands take the port from here where neither --port nor SOFTRIG_PORT names one, and the model where\n# --model does not: model = \"model.toml\".\n";
        write_atomically(path, format!("{head}{text}").as_bytes())
    }
}

/// The text of a file; none where there is none.
fn text_of(path: &Path) -> Result<Option<String>, InputError> {
    match std::fs::read_to_string(path) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(InputError::from_io(path, &error)),
    }
}

/// The name by which a board is known again: the serial number of its USB chip, or the kind of
/// that chip where it has none (most copies of the Mega); `simulated` behind a pseudo-terminal.
#[cfg(not(target_family = "wasm"))]
pub fn board_name(port: &str) -> String {
    if is_pseudo_terminal(port) {
        return "simulated".to_owned();
    }
    let found = ports().unwrap_or_default();
    let this = found.into_iter().find(|found| found.name == port);
    this.and_then(|found| {
        let kind = format!("usb {}:{}", found.vendor_id?, found.product_id?);
        Some(match found.serial_number {
            Some(number) => format!("{kind} {number}"),
            None => kind,
        })
    })
    .unwrap_or_else(|| port.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_and_nonsense_is_refused_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(RIG_FILE);
        assert_eq!(RigFile::find(&path).unwrap(), None);
        let file = RigFile {
            schema: 1,
            port: Some("/dev/ttyACM0".into()),
            model: Some(Spanned::new(0..0, "finger.toml".into())),
            board: Some("usb 2341:0042 75330".into()),
            clock: Some(ClockRate {
                factor: 1.0043,
                standard_error: 2e-5,
                seconds: 60.0,
            }),
            recording: None,
        };
        file.write(&path).unwrap();
        assert_eq!(RigFile::find(&path).unwrap(), Some(file));
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, says) in [
            ("factor = 1.0043", "factor = 1.5", "1.5"),
            ("factor = 1.0043", "factor = nan", "NaN"),
            ("schema = 1", "schema = 2", "update softrig"),
            ("factor = ", "faktor = ", "line"),
            ("board = ", "# board = ", "does not name a board"),
        ] {
            let error = RigFile::parse(&text.replace(from, to), &path).unwrap_err();
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn a_file_by_hand_names_a_model_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(RIG_FILE);
        assert_eq!(RigFile::find_model(&path).unwrap(), None);
        std::fs::write(&path, "schema = 1\n").unwrap();
        assert_eq!(RigFile::find_model(&path).unwrap(), None);
        std::fs::write(&path, "schema = 1\nmodel = \"models/m.toml\"\n").unwrap();
        let error = RigFile::find_model(&path).unwrap_err().to_string();
        for part in [
            "softrig.toml, line 2, column 9",
            "m.toml is not there",
            "--model",
        ] {
            assert!(error.contains(part), "{error}");
        }
        let model = folder.path().join("models/m.toml");
        std::fs::create_dir(folder.path().join("models")).unwrap();
        std::fs::write(&model, "").unwrap();
        assert_eq!(RigFile::find_model(&path).unwrap(), Some(model));
    }
}
