//! Reads external files up to a limit.
//!
//! A few megabytes can unpack to a thousand times as much, and a path can name an endless
//! device. No recording or model needs that much, so reading stops at a limit, which the error
//! names, and unread data is not held in memory.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use crate::error::InputError;

/// The most bytes of a file that is read whole: a model, a protocol, metadata, settings. The
/// metadata of a session with ten thousand gaps in it have one.
const TEXT_BYTES: u64 = 64 * MIB;

/// Bytes in a mebibyte.
const MIB: u64 = 1 << 20;

/// The largest recording that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Bytes of text, after unpacking.
    pub bytes: u64,
    /// Bytes of one row, or between two rows: empty lines are not rows.
    pub row_bytes: u64,
    /// Rows.
    pub rows: u64,
    /// Fields of all rows together; kept text needs its memory field by field.
    pub fields: u64,
}

impl Limits {
    /// For a recording: a rig at 100 Hz for eleven hours, or one at 1 kHz for more than an
    /// hour, with the ten columns of `softrig record` and a hundred bytes a row.
    pub const RECORDING: Self = Self {
        bytes: 512 * MIB,
        row_bytes: MIB,
        rows: 4_000_000,
        fields: 40_000_000,
    };

    /// For a table that is not a recording, from a file that was read whole and so has a limit.
    pub const TABLE: Self = Self {
        bytes: u64::MAX,
        row_bytes: MIB,
        rows: u64::MAX,
        fields: u64::MAX,
    };

    /// Says that there are more rows or fields than are read.
    ///
    /// # Errors
    ///
    /// Names the limit.
    pub fn check(&self, rows: u64, columns: usize) -> Result<(), InputError> {
        if rows > self.rows {
            return Err(InputError::new(
                format!(
                    "has more than {} rows; at 100 Hz that is {:.0} hours",
                    self.rows,
                    self.rows as f64 / 100.0 / 3600.0
                ),
                "split it into several recordings, or keep every tenth row",
            ));
        }
        if rows.saturating_mul(columns as u64) > self.fields {
            return Err(InputError::new(
                format!("has more than {} fields in {columns} columns", self.fields),
                "delete the columns that are not needed, or split it into several recordings",
            ));
        }
        Ok(())
    }
}

/// A limit of bytes that a reader went beyond.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beyond {
    Bytes(u64),
    Row(u64),
}

/// A reader that ends with an error where a recording is larger than any.
#[derive(Debug)]
pub struct Bounded<R> {
    inner: R,
    limits: Limits,
    read: u64,
    since_row: u64,
    last: Option<u8>,
    beyond: Option<Beyond>,
}

impl<R: Read> Bounded<R> {
    /// Reads as far as the limits allow.
    pub fn new(inner: R, limits: Limits) -> Self {
        Self {
            inner,
            limits,
            read: 0,
            since_row: 0,
            last: None,
            beyond: None,
        }
    }

    /// Notes that a row was found. The reader of the table is a buffer ahead; what a row has
    /// left of its bytes is exact to that.
    pub fn found_row(&mut self) {
        self.since_row = 0;
    }

    /// Whether the text so far ends with a line.
    pub fn ends_with_line(&self) -> bool {
        self.last == Some(b'\n')
    }

    /// The error, if a limit ended the reading.
    pub fn fault(&self) -> Option<InputError> {
        let mebibytes = |bytes: u64| bytes as f64 / MIB as f64;
        Some(match self.beyond? {
            Beyond::Bytes(limit) => too_large(limit),
            Beyond::Row(limit) => InputError::new(
                format!(
                    "goes on for more than {} MiB without a row that ends",
                    mebibytes(limit)
                ),
                "check that it is a recording, with one row a line and no stretch of empty lines; export it again",
            ),
        })
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(into)?;
        self.read = self.read.saturating_add(count as u64);
        self.since_row = self.since_row.saturating_add(count as u64);
        if count > 0 {
            self.last = into.get(count - 1).copied();
        }
        if self.read > self.limits.bytes {
            self.beyond = Some(Beyond::Bytes(self.limits.bytes));
        } else if self.since_row > self.limits.row_bytes {
            self.beyond = Some(Beyond::Row(self.limits.row_bytes));
        }
        match self.beyond {
            Some(_) => Err(io::Error::from(io::ErrorKind::FileTooLarge)),
            None => Ok(count),
        }
    }
}

/// Says that a recording has more bytes than are read.
pub fn too_large(limit: u64) -> InputError {
    InputError::new(
        format!(
            "holds more than {} MiB, which is more than any recording is read for",
            limit as f64 / MIB as f64
        ),
        "check that it is a recording, and split it into several if it is",
    )
}

/// Refuses a named pipe: opening it waits for a writer, and what was read from it is gone for the
/// next reader. What the shell makes of `<(…)` has a writer.
///
/// # Errors
///
/// Names the pipe, and how to make a file of it.
pub fn refuse_pipe(path: &Path) -> Result<(), InputError> {
    #[cfg(unix)]
    {
        use crate::error::is_stream_of_shell;
        use std::os::unix::fs::FileTypeExt;
        let is_pipe = std::fs::metadata(path).is_ok_and(|about| about.file_type().is_fifo());
        if is_pipe && !is_stream_of_shell(path) {
            return Err(InputError::new(
                "is a pipe, which can be read only once and has no end while nobody writes",
                format!("make a file of it: cat {} > run.csv", path.display()),
            )
            .in_file(path));
        }
    }
    #[cfg(not(unix))]
    let _ = path;
    Ok(())
}

/// Reads a file whole.
///
/// # Errors
///
/// Names the file, and the limit if it is larger than that.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, InputError> {
    let fail = |error: io::Error| InputError::from_io(path, &error);
    refuse_pipe(path)?;
    let file = File::open(path).map_err(fail)?;
    let mut bytes = Vec::new();
    file.take(TEXT_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(fail)?;
    if bytes.len() as u64 > TEXT_BYTES {
        return Err(InputError::new(
            format!("holds more than {} MiB", TEXT_BYTES / MIB),
            "check that it is the file that was meant",
        )
        .in_file(path));
    }
    Ok(bytes)
}

/// Reads a text whole.
///
/// # Errors
///
/// Like [`read_bytes`], and if it is not UTF-8 text.
pub fn read_text(path: &Path) -> Result<String, InputError> {
    String::from_utf8(read_bytes(path)?).map_err(|_| not_text(path))
}

/// Says that a file is not UTF-8 text.
pub fn not_text(path: &Path) -> InputError {
    let error = io::Error::new(
        io::ErrorKind::InvalidData,
        "stream did not contain valid UTF-8",
    );
    InputError::from_io(path, &error)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_never_ends_is_refused() {
        let endless = Path::new("/dev/zero");
        if !endless.exists() {
            return;
        }
        let error = read_text(endless).unwrap_err().to_string();
        assert!(
            error.contains("/dev/zero: holds more than 64 MiB"),
            "{error}"
        );
    }
}
