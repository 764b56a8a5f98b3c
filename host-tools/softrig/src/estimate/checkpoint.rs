//! Keeps finished fits on disk, so that an interrupted diagnosis loses nothing.
//!
//! A folder holds one file, to which each finished fit appends a line: a fingerprint
//! of what was fitted (model, recordings, structure, initial guess) and the solver's
//! final position, bit for bit. A later run with the same folder reads these positions
//! instead of solving again, and writes the same bytes. Each line ends with a checksum of
//! itself. A line that does not have it is not believed: its fit is computed again, and the
//! number of such lines is reported, except for a last line that was cut off.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use softrig_formats::error::InputError;

/// Name of the file in the folder.
const FILE: &str = "fits.txt";

/// The final position of a solver, in its own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct SolverEnd {
    /// The unknowns.
    pub position: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
}

/// Fits that were finished before, and the file to which further ones are appended.
#[derive(Debug, Default)]
pub struct Checkpoint {
    known: BTreeMap<u64, SolverEnd>,
    damaged: Option<String>,
    file: Option<Mutex<File>>,
}

impl Checkpoint {
    /// Opens or creates a folder.
    ///
    /// # Errors
    ///
    /// If the folder cannot be created, read or written.
    pub fn open(folder: &Path) -> Result<Self, InputError> {
        let fail = |error: std::io::Error| {
            InputError::new(
                format!("cannot be used to keep fits: {error}"),
                "choose a folder that can be written",
            )
            .in_file(folder)
        };
        std::fs::create_dir_all(folder).map_err(fail)?;
        let path = folder.join(FILE);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(fail(error)),
        };
        let (mut known, mut faulty) = (BTreeMap::new(), Vec::new());
        for (number, line) in (1..).zip(text.split_inclusive('\n')) {
            match parse(line.trim_end_matches('\n')) {
                Some((fingerprint, ended)) => {
                    known.insert(fingerprint, ended);
                }
                None if line.trim().is_empty() || !line.ends_with('\n') => {}
                None => faulty.push(number),
            }
        }
        let damaged = faulty.first().map(|first| {
            format!(
                "{}, line {first}: {} of {} kept fits are damaged or of another version, and are computed again",
                path.display(),
                faulty.len(),
                faulty.len() + known.len()
            )
        });
        let mut file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(fail)?;
        if !text.is_empty() && !text.ends_with('\n') {
            // The last line was cut off; the next one must not continue it.
            file.write_all(b"\n").map_err(fail)?;
        }
        Ok(Self {
            known,
            damaged,
            file: Some(Mutex::new(file)),
        })
    }

    /// A sentence about lines that are not believed, if there are any.
    pub fn damaged(&self) -> Option<&str> {
        self.damaged.as_deref()
    }

    /// Number of fits found.
    pub fn len(&self) -> usize {
        self.known.len()
    }

    /// Whether none was found.
    pub fn is_empty(&self) -> bool {
        self.known.is_empty()
    }

    /// Whether anything is kept.
    pub fn is_used(&self) -> bool {
        self.file.is_some()
    }

    /// The final position of an earlier fit.
    pub fn recall(&self, fingerprint: u64) -> Option<&SolverEnd> {
        self.known.get(&fingerprint)
    }

    /// Appends the final position of a fit. If the disk is full, the line is lost and
    /// the diagnosis goes on.
    pub fn keep(&self, fingerprint: u64, ended: &SolverEnd) {
        let Some(file) = &self.file else { return };
        let mut line = format!("{fingerprint:016x} {}", u8::from(ended.converged));
        for value in &ended.position {
            line += &format!(" {:016x}", value.to_bits());
        }
        line += &format!(" {:016x}\n", fingerprint_of(&line));
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = file.write_all(line.as_bytes());
    }
}

/// The checksum of a line.
fn fingerprint_of(line: &str) -> u64 {
    fingerprint(line.bytes())
}

fn parse(line: &str) -> Option<(u64, SolverEnd)> {
    let (line, checksum) = line.rsplit_once(' ')?;
    (u64::from_str_radix(checksum, 16) == Ok(fingerprint_of(line))).then_some(())?;
    let fields: Vec<&str> = line.split(' ').collect();
    let [fingerprint, converged, values @ ..] = fields.as_slice() else {
        return None;
    };
    let position: Vec<f64> = values
        .iter()
        .map(|field| u64::from_str_radix(field, 16).ok().map(f64::from_bits))
        .collect::<Option<_>>()?;
    let ended = SolverEnd {
        position,
        converged: *converged == "1",
    };
    Some((u64::from_str_radix(fingerprint, 16).ok()?, ended))
}

/// A fingerprint of bytes that is the same on every machine (FNV-1a).
pub fn fingerprint(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_are_found_again_bit_for_bit_and_a_torn_line_is_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let ended = SolverEnd {
            position: vec![0.1 + 0.2, -1e-300, f64::MAX],
            converged: true,
        };
        let first = Checkpoint::open(folder.path()).unwrap();
        first.keep(7, &ended);
        first.keep(8, &ended);
        drop(first);
        let path = folder.path().join(FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 9]).unwrap();
        let second = Checkpoint::open(folder.path()).unwrap();
        assert_eq!(second.recall(7), Some(&ended));
        assert_eq!(second.recall(8), None);
        second.keep(9, &ended);
        let third = Checkpoint::open(folder.path()).unwrap();
        assert_eq!((third.len(), third.recall(9)), (2, Some(&ended)));
    }

    #[test]
    fn a_line_with_one_letter_changed_is_not_believed_and_reported() {
        let folder = tempfile::tempdir().unwrap();
        let ended = SolverEnd {
            position: vec![1.5, 2.5],
            converged: true,
        };
        let first = Checkpoint::open(folder.path()).unwrap();
        first.keep(0x17, &ended);
        first.keep(8, &ended);
        let path = folder.path().join(FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        let end = text.find('\n').unwrap();
        for place in 0..end {
            let mut bytes = text.clone().into_bytes();
            bytes[place] = if bytes[place] == b'1' { b'2' } else { b'1' };
            std::fs::write(&path, bytes).unwrap();
            let again = Checkpoint::open(folder.path()).unwrap();
            assert_eq!((again.len(), again.recall(8)), (1, Some(&ended)), "{place}");
            let said = again.damaged().unwrap();
            assert!(said.contains("line 1: 1 of 2"), "{said}");
        }
        std::fs::write(&path, &text).unwrap();
        assert_eq!(Checkpoint::open(folder.path()).unwrap().damaged(), None);
    }
}
