//! Keeps finished fits on disk, so that an interrupted diagnosis loses nothing.
//!
//! A folder holds one file, to which each finished fit appends a line: a fingerprint
//! of what was fitted (model, recordings, structure, initial guess) and the solver's
//! final position, bit for bit. A later run with the same folder reads these positions
//! instead of solving again, and writes the same bytes. An incomplete last line is
//! ignored.

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
pub struct Ended {
    /// The unknowns.
    pub position: Vec<f64>,
    /// Whether the solver met its tolerance.
    pub converged: bool,
}

/// Fits that were finished before, and the file to which further ones are appended.
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
    pub fn recall(&self, fingerprint: u64) -> Option<&Ended> {
        self.known.get(&fingerprint)
    }

    /// Appends the final position of a fit. If the disk is full, the line is lost and
    /// the diagnosis goes on.
    pub fn keep(&self, fingerprint: u64, ended: &Ended) {
        let Some(file) = &self.file else { return };
        let mut line = format!("{fingerprint:016x} {}", u8::from(ended.converged));
        for value in &ended.position {
            line += &format!(" {:016x}", value.to_bits());
        }
        // The length at the end tells a whole line from an incomplete one.
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
