//! Binary formats: told apart here, decoded by what a program brings along.
//!
//! Their libraries take longer to build than all the rest, and most recordings are text. So the
//! readers are a crate of their own, `softrig-importers`, and a program that has it says so once,
//! with [`install`]. Any other names the format and where a program is that reads it.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::OnceLock;

use super::{Samples, Sheet};
use crate::bounded::Limits;
use crate::columns::Layout;
use crate::error::InputError;
use crate::recording::Meta;

/// A binary format of recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// HDF5, which MATLAB 7.3 writes too.
    Hdf5,
    /// MATLAB's own, up to version 7.
    Matlab,
    /// Logs of ROS 2 and Foxglove.
    Mcap,
    /// One array of `numpy.save`.
    NumpyArray,
    /// Arrays of `numpy.savez`, or another packed archive.
    Packed,
    /// Tables of pandas, polars and `DuckDB`.
    Parquet,
    /// Bags of ROS 2 in `SQLite`.
    Sqlite,
    /// LabVIEW's.
    Tdms,
}

/// How files begin, the longer before the shorter.
const STARTS: [(&[u8], Binary); 9] = [
    (b"MATLAB 5.0", Binary::Matlab),
    (b"MATLAB 7.3", Binary::Hdf5),
    (b"\x89HDF\r\n\x1a\n", Binary::Hdf5),
    (b"\x89MCAP0\r\n", Binary::Mcap),
    (b"\x93NUMPY", Binary::NumpyArray),
    (b"PK\x03\x04", Binary::Packed),
    (b"PAR1", Binary::Parquet),
    (b"SQLite format 3", Binary::Sqlite),
    (b"TDSm", Binary::Tdms),
];

impl Binary {
    /// The format of a file with these first bytes; none if it is text, or nothing known.
    pub fn of(start: &[u8]) -> Option<Self> {
        STARTS
            .iter()
            .find(|(magic, _)| start.starts_with(magic))
            .map(|(_, format)| *format)
    }

    /// Its name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hdf5 => "HDF5",
            Self::Matlab => "MATLAB",
            Self::Mcap => "MCAP",
            Self::NumpyArray => "NumPy",
            Self::Packed => "packed",
            Self::Parquet => "Parquet",
            Self::Sqlite => "SQLite",
            Self::Tdms => "TDMS",
        }
    }

    /// The error for a format that this program was built without.
    pub fn left_out(self) -> InputError {
        InputError::new(
            format!(
                "is a {} file, which this program was built without",
                self.name()
            ),
            format!(
                "convert it to CSV with a softrig that has all formats, {WITH_LAB}: softrig convert"
            ),
        )
    }
}

/// Where a program is that has everything.
pub const WITH_LAB: &str =
    "as that of a release and of `cargo build --release -p softrig-cli --features lab`";

/// What is read: formats that have their table of contents at the end are read here and there.
pub enum Source<'a> {
    /// A regular file, at its start.
    File(File),
    /// A pipe, a packed file or bytes in memory.
    Stream(&'a mut dyn Read),
}

impl Read for Source<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        match self {
            Self::File(file) => file.read(into),
            Self::Stream(stream) => stream.read(into),
        }
    }
}

/// Reads and writes binary formats.
pub trait Importers: Sync {
    /// Reads a recording; `path` is also named in messages.
    ///
    /// # Errors
    ///
    /// Names the file and what is wrong with it, or the columns that it has.
    fn read(
        &self,
        format: Binary,
        source: Source<'_>,
        path: &Path,
        layout: &Layout,
        limits: Limits,
    ) -> Result<Samples, InputError>;

    /// Reads the bag of ROS 2 that a folder is.
    ///
    /// # Errors
    ///
    /// Like [`Importers::read`].
    fn read_folder(&self, folder: &Path, layout: &Layout) -> Result<Samples, InputError>;

    /// The bytes of a file with these columns.
    ///
    /// # Errors
    ///
    /// Those of the libraries.
    fn write(&self, format: Binary, sheet: &Sheet, about: &Meta) -> anyhow::Result<Vec<u8>>;
}

static INSTALLED: OnceLock<&'static dyn Importers> = OnceLock::new();

/// Makes the binary formats known to every reader of this program; the first call counts.
pub fn install(importers: &'static dyn Importers) {
    let _ = INSTALLED.set(importers);
}

/// Reads a file of a binary format, if this program can.
pub(super) fn read(
    format: Binary,
    source: Source<'_>,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    match INSTALLED.get() {
        Some(importers) => importers.read(format, source, path, layout, limits),
        None => Err(format.left_out().in_file(path)),
    }
}

/// Reads a folder, if this program knows what a folder can be.
pub(super) fn read_folder(folder: &Path, layout: &Layout) -> Result<Samples, InputError> {
    match INSTALLED.get() {
        Some(importers) => importers.read_folder(folder, layout),
        None => Err(Binary::Mcap.left_out().in_file(folder)),
    }
}

/// Writes a binary format, if this program can.
pub(super) fn write(format: Binary, sheet: &Sheet, about: &Meta) -> anyhow::Result<Vec<u8>> {
    match INSTALLED.get() {
        Some(importers) => importers.write(format, sheet, about),
        None => Err(format.left_out().into()),
    }
}

/// The file back at its start, if it has one to go back to.
pub(super) fn rewound(mut file: File, path: &Path) -> Result<File, InputError> {
    file.rewind()
        .map_err(|error| InputError::from_io(path, &error))?;
    Ok(file)
}
