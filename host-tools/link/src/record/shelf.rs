//! Where a recording is kept: in a folder, or by a browser.

use std::fmt::Debug;
use std::fs::File;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use softrig_formats::error::{InputError, Pending, replace_with_meta, write_atomically};

/// A place for the files of a recording.
pub trait Shelf: Debug + Send {
    /// Begins a recording: a table with its header, and what is known about it. Both replace an
    /// earlier one of this name together, or neither does.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    fn begin(
        &self,
        rows: (&Path, &[u8]),
        meta: (&Path, &[u8]),
    ) -> Result<Box<dyn Table>, InputError>;

    /// Begins another table, with its header.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    fn table(&self, path: &Path, header: &[u8]) -> Result<Box<dyn Table>, InputError>;

    /// Writes a whole file, or leaves that of this name as it was.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), InputError>;

    /// Takes a file away, if it is there.
    fn remove(&self, path: &Path);
}

/// A table that grows.
pub trait Table: Debug + Send {
    /// Appends whole lines; where that fails, none of them is there.
    ///
    /// # Errors
    ///
    /// Names the file.
    fn append(&mut self, lines: &[u8]) -> Result<(), InputError>;

    /// Waits until what was appended survives a power cut.
    ///
    /// # Errors
    ///
    /// Names the file.
    fn sync(&mut self) -> Result<(), InputError>;
}

/// The files of this computer.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Shelf for Disk {
    fn begin(
        &self,
        (rows, header): (&Path, &[u8]),
        (meta, about): (&Path, &[u8]),
    ) -> Result<Box<dyn Table>, InputError> {
        // All is ready before an earlier recording of this name is replaced.
        let file = replace_with_meta(Pending::new(rows, header)?, Pending::new(meta, about)?)?;
        Ok(Box::new(TableFile::after(rows, header, file)))
    }

    fn table(&self, path: &Path, header: &[u8]) -> Result<Box<dyn Table>, InputError> {
        let file = Pending::new(path, header)?.commit()?;
        Ok(Box::new(TableFile::after(path, header, file)))
    }

    fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), InputError> {
        write_atomically(path, bytes)
    }

    fn remove(&self, path: &Path) {
        let _ = std::fs::remove_file(path);
    }
}

/// A table in a file, unbuffered: a program that is killed leaves whole lines.
#[derive(Debug)]
struct TableFile {
    path: PathBuf,
    file: File,
    /// Bytes of whole lines.
    length: u64,
}

impl TableFile {
    /// Goes on after the header, which was written to the file.
    fn after(path: &Path, header: &[u8], file: File) -> Self {
        Self {
            path: path.to_owned(),
            file,
            length: header.len() as u64,
        }
    }

    fn not_written(&self, error: &std::io::Error) -> InputError {
        InputError::new(
            format!("cannot be written: {error}"),
            "check the folder and make space on the disk; the rows that were written are kept",
        )
        .in_file(&self.path)
    }
}

impl Table for TableFile {
    fn append(&mut self, lines: &[u8]) -> Result<(), InputError> {
        if let Err(error) = self.file.write_all(lines) {
            // A full disk takes a part of a line, which would be read as a wrong number.
            // Taking back needs no room; pipes and devices keep what they got.
            let _ = self.file.set_len(self.length);
            let _ = self.file.seek(SeekFrom::Start(self.length));
            return Err(self.not_written(&error));
        }
        self.length += lines.len() as u64;
        Ok(())
    }

    fn sync(&mut self) -> Result<(), InputError> {
        match self.file.sync_data() {
            // Pipes and devices have no disk.
            Err(error) if error.kind() != std::io::ErrorKind::InvalidInput => {
                Err(self.not_written(&error))
            }
            _ => Ok(()),
        }
    }
}
