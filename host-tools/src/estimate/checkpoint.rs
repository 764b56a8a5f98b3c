//! Finished fits on disk, so that an interrupted diagnosis loses nothing.
//!
//! A folder holds one file to which a line is appended for each finished fit:
//! what was fitted (a fingerprint of model, recordings, structure and start)
//! and where the solver ended, bit for bit. A later run with the same folder
//! takes those up instead of solving again, and comes to the same bytes. A line
//! that was cut off by the interruption is ignored.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use crate::io::error::InputError;

/// Name of the file in the folder.
const FILE: &str = "fits.txt";

/// Where a solver ended, in its own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct Ended {
    /// The unknowns.
    pub position: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
}

/// Fits that were finished before, and where to note further ones.
#[derive(Debug, Default)]
pub struct Checkpoint {
    known: BTreeMap<u64, Ended>,
    file: Option<Mutex<File>>,
}

impl Checkpoint {
    /// Opens or creates a folder.
    ///
    /// # Errors
    ///
    /// Says why it cannot be used.
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
        let known = text.lines().filter_map(parse).collect();
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
            file: Some(Mutex::new(file)),
        })
    }

    /// Number of fits that were found.
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

    /// Where a fit ended before.
    pub fn recall(&self, fingerprint: u64) -> Option<&Ended> {
        self.known.get(&fingerprint)
    }

    /// Notes where a fit ended. A disk that is full costs the note, not the
    /// diagnosis.
    pub fn keep(&self, fingerprint: u64, ended: &Ended) {
        let Some(file) = &self.file else { return };
        let mut line = format!("{fingerprint:016x} {}", u8::from(ended.converged));
        for value in &ended.position {
            line += &format!(" {:016x}", value.to_bits());
        }
        // Its length at the end tells a whole line from one that was cut off.
        line += &format!(" {}\n", ended.position.len());
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = file.write_all(line.as_bytes());
    }
}

fn parse(line: &str) -> Option<(u64, Ended)> {
    let fields: Vec<&str> = line.split(' ').collect();
    let [fingerprint, converged, values @ .., count] = fields.as_slice() else {
        return None;
    };
    let position: Vec<f64> = values
        .iter()
        .map(|field| u64::from_str_radix(field, 16).ok().map(f64::from_bits))
        .collect::<Option<_>>()?;
    (count.parse() == Ok(position.len())).then_some(())?;
    let ended = Ended {
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
        let ended = Ended {
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
}
