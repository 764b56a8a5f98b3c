//! Provenance of a report: its command and its files.
//!
//! A report outlives the folder in which it was made. The hashes show later which files
//! belong to it.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::Serialize;
use sha2::{Digest, Sha256};

use softrig_formats::error::InputError;
use softrig_formats::recording::meta_beside;
use softrig_formats::terminal::quoted;

/// Role of a recording that was fitted.
pub const FITTED: &str = "fitted";

/// Role of the metadata of a recording.
pub const METADATA: &str = "metadata";

/// Role of a recording that was held out.
pub const HELD_OUT: &str = "held out";

/// Role of the model.
pub const MODEL: &str = "model";

/// Role of a file of one's own effects.
pub const EFFECTS: &str = "effects";

/// How a page was made.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Provenance {
    /// The command as it was typed.
    pub command: String,
    /// Version of the tool.
    pub version: &'static str,
    /// The day on which it was made (2026-05-31); empty where nobody said it.
    pub date: String,
    /// The model, the file of effects, then the recordings, each followed by its metadata.
    pub files: Vec<Source>,
}

/// An input file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// Its role.
    pub role: &'static str,
    /// The path as it was given.
    pub path: String,
    /// Its size.
    pub bytes: usize,
    /// The SHA-256 of its bytes, in hexadecimal.
    pub sha256: String,
}

impl Provenance {
    /// Hashes the files of a diagnosis.
    ///
    /// # Errors
    ///
    /// A file that cannot be read any more.
    pub fn of(
        model: &Path,
        effects: Option<&Path>,
        recordings: &[PathBuf],
        holdout: &[PathBuf],
        command: String,
    ) -> Result<Self, InputError> {
        let fitted = recordings.iter().map(|path| (FITTED, path.as_path()));
        let held_out = holdout.iter().map(|path| (HELD_OUT, path.as_path()));
        let mut files = vec![Source::read(MODEL, model)?];
        if let Some(effects) = effects {
            files.push(Source::read(EFFECTS, effects)?);
        }
        for (role, path) in fitted.chain(held_out) {
            files.extend(Source::recording(role, path)?);
        }
        Ok(Self {
            command,
            version: env!("CARGO_PKG_VERSION"),
            date: today(),
            files,
        })
    }
}

impl Source {
    /// Hashes a file.
    ///
    /// # Errors
    ///
    /// It cannot be read any more.
    pub fn read(role: &'static str, path: &Path) -> Result<Self, InputError> {
        let bytes = std::fs::read(path).map_err(|error| InputError::from_io(path, &error))?;
        Ok(Self::of(role, path.display().to_string(), &bytes))
    }

    /// Hashes a recording, and its metadata if there are any.
    ///
    /// # Errors
    ///
    /// One of the files cannot be read any more.
    pub fn recording(role: &'static str, path: &Path) -> Result<Vec<Self>, InputError> {
        let mut files = vec![Self::read(role, path)?];
        let meta = meta_beside(path);
        if meta.exists() {
            files.push(Self::read(METADATA, &meta)?);
        }
        Ok(files)
    }

    /// Hashes bytes that are in no file.
    pub fn of(role: &'static str, path: String, bytes: &[u8]) -> Self {
        Self {
            role,
            path,
            bytes: bytes.len(),
            sha256: sha256(bytes),
        }
    }
}

/// The SHA-256 hash of bytes, in hexadecimal digits.
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    let mut text = String::with_capacity(2 * bytes.len());
    for byte in bytes {
        text += &format!("{byte:02x}");
    }
    text
}

/// This day (2026-05-31, UTC), or that of `SOURCE_DATE_EPOCH` (s), so that a page can be made again
/// byte for byte.
pub fn today() -> String {
    let said = std::env::var("SOURCE_DATE_EPOCH")
        .ok()
        .and_then(|seconds| seconds.parse().ok());
    let now = said.map_or_else(SystemTime::now, |seconds| {
        SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
    });
    let moment = humantime::format_rfc3339_seconds(now).to_string();
    moment.chars().take_while(|&it| it != 'T').collect()
}

/// The command line of this process, so that it can be typed again.
pub fn command_line() -> String {
    let arguments = std::env::args_os()
        .skip(1)
        .map(|argument| quoted(&argument.to_string_lossy()));
    std::iter::once("softrig".to_owned())
        .chain(arguments)
        .collect::<Vec<_>>()
        .join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_standard() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.toml");
        std::fs::write(&path, "abc").unwrap();
        let found = Provenance::of(&path, None, &[], &[], String::new()).unwrap();
        // The test vector of FIPS 180-2.
        assert_eq!(
            found.files[0].sha256,
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        for path in ["a.b.csv", "a.b.csv.gz", "c.csv", "a.b.meta.toml"] {
            std::fs::write(folder.path().join(path), path).unwrap();
        }
        let recordings = ["a.b.csv", "a.b.csv.gz", "c.csv"].map(|name| folder.path().join(name));
        let found = Provenance::of(&path, Some(&path), &recordings, &[], String::new()).unwrap();
        let roles: Vec<&str> = found.files.iter().map(|file| file.role).collect();
        assert_eq!(
            roles,
            [
                "model", "effects", FITTED, METADATA, FITTED, METADATA, FITTED
            ]
        );
        let absent = folder.path().join("absent.csv");
        assert!(Provenance::of(&path, None, &[absent], &[], String::new()).is_err());
    }
}
