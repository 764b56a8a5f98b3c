//! What is wrong with an input, where, and what to do about it.
//!
//! Every reader in this crate reports through [`InputError`], so that every
//! message names the file, the line and the column and ends in an action.

use std::fmt;
use std::path::{Path, PathBuf};

/// A fault in something that the user gave.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct InputError {
    /// The file, if the fault is in one.
    pub file: Option<PathBuf>,
    /// Line, from 1.
    pub line: Option<u64>,
    /// Column: a name in a table, or a position from 1 in a text.
    pub column: Option<String>,
    /// What was found and what was expected.
    pub found: String,
    /// What to do next.
    pub advice: String,
}

impl InputError {
    /// Creates an error that is in no file: an argument.
    pub fn new(found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            file: None,
            line: None,
            column: None,
            found: found.into(),
            advice: advice.into(),
        }
    }

    /// Names the file.
    pub fn in_file(mut self, path: &Path) -> Self {
        self.file = Some(path.to_owned());
        self
    }

    /// Names the line, from 1.
    pub fn at_line(mut self, line: u64) -> Self {
        self.line = Some(line);
        self
    }

    /// Names the column.
    pub fn in_column(mut self, column: impl Into<String>) -> Self {
        self.column = Some(column.into());
        self
    }

    /// Names the place of a byte offset in `text`.
    pub fn at_offset(self, text: &str, offset: usize) -> Self {
        let before = text.get(..offset.min(text.len())).unwrap_or(text);
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
        self.at_line(line as u64).in_column(column.to_string())
    }

    /// Turns a failure to open or read `path` into an error with advice.
    pub fn from_io(path: &Path, error: &std::io::Error) -> Self {
        let advice = match error.kind() {
            std::io::ErrorKind::NotFound => "check the path",
            std::io::ErrorKind::PermissionDenied => "check its permissions",
            std::io::ErrorKind::UnexpectedEof => {
                "the file ends in the middle; copy it again from where it was recorded"
            }
            std::io::ErrorKind::InvalidData => "give a CSV or TOML text file in UTF-8",
            _ => "check the file and the disk",
        };
        Self::new(format!("cannot be read: {error}"), advice).in_file(path)
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}", file.display())?;
            if let Some(line) = self.line {
                write!(f, ", line {line}")?;
            }
            if let Some(column) = &self.column {
                write!(f, ", column {column}")?;
            }
            write!(f, ": ")?;
        }
        write!(f, "{}; {}", self.found, self.advice)
    }
}

/// Checks that `path` can be written, and leaves no trace.
///
/// # Errors
///
/// Says why not.
pub fn check_writable(path: &Path) -> Result<(), InputError> {
    if path.is_dir() {
        return Err(
            InputError::new("is a folder", "give the name of a file to write").in_file(path),
        );
    }
    temporary_beside(path).map(drop)
}

/// A file in the folder of `path` that vanishes when it is dropped.
fn temporary_beside(path: &Path) -> Result<tempfile::NamedTempFile, InputError> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    tempfile::Builder::new()
        .prefix(".rig-")
        .tempfile_in(folder)
        // The kind alone: the message has the temporary file's name in it.
        .map_err(|error| not_written(path, &std::io::Error::from(error.kind())))
}

fn not_written(path: &Path, error: &std::io::Error) -> InputError {
    InputError::new(
        format!("cannot be written: {error}"),
        "check that the folder exists and can be written",
    )
    .in_file(path)
}

/// Writes `bytes` to `path` through a temporary file in the same folder, so
/// that a reader sees the old content or the new and never a part.
///
/// # Errors
///
/// Says which folder cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    let fail = |error: &std::io::Error| not_written(path, error);
    let mut file = temporary_beside(path)?;
    std::io::Write::write_all(&mut file, bytes).map_err(|error| fail(&error))?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Temporary files are private; what replaces a result should be as
        // readable as any other file.
        let mode = std::fs::metadata(path).map_or(0o644, |meta| meta.permissions().mode() & 0o777);
        file.as_file()
            .set_permissions(std::fs::Permissions::from_mode(mode))
            .map_err(|error| fail(&error))?;
    }
    file.persist(path).map_err(|error| fail(&error.error))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn message_names_the_place_and_the_action() {
        let text = "schema = 1\n[dynamics]\nexponent = -2\n";
        let offset = text.find("-2").unwrap();
        let error = InputError::new("exponent is -2", "give a value above 0")
            .in_file(Path::new("m.toml"))
            .at_offset(text, offset);
        assert_eq!(
            error.to_string(),
            "m.toml, line 3, column 12: exponent is -2; give a value above 0"
        );
    }

    #[test]
    fn failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        write_atomically(&path, b"old").unwrap();
        write_atomically(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        let absent = folder.path().join("absent").join("out.csv");
        assert!(
            write_atomically(&absent, b"x")
                .unwrap_err()
                .to_string()
                .contains("folder exists")
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
