//! Errors of inputs: the problem, its place, and what to do about it.
//!
//! Every reader in this crate reports through [`InputError`], so that every
//! message names the file, the line and the column and ends with advice.

use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::terminal::printable_line;

/// The most characters of a sentence that are shown: what a file holds is quoted, and a
/// damaged file may hold a megabyte between two commas.
const LONGEST_SENTENCE: usize = 2_000;

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
    /// How the columns of a recording would be read, if their names mean what they seem to.
    pub suggestion: Option<Box<Suggestion>>,
}

/// The name in a suggestion of a column that no header looks like.
pub const UNKNOWN_COLUMN: &str = "COLUMN";

/// Columns and units as `--columns` and `--units` take them; `COLUMN` is a column that nothing in
/// the header looks like, and units may be empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Suggestion {
    /// `time=t,pressure=p_psi`.
    pub columns: String,
    /// `pressure=psi`.
    pub units: String,
}

impl InputError {
    /// Creates an error that is not in a file but in an argument.
    pub fn new(found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self {
            file: None,
            line: None,
            column: None,
            found: found.into(),
            advice: advice.into(),
            suggestion: None,
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
        let before = before(text, offset);
        let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
        self.at_line(line_of(text, offset))
            .in_column(column.to_string())
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
            write!(f, "{}", quoted(&file.display().to_string()))?;
            if let Some(line) = self.line {
                write!(f, ", line {line}")?;
            }
            if let Some(column) = &self.column {
                write!(f, ", column {}", quoted(column))?;
            }
            write!(f, ": ")?;
        }
        write!(f, "{}; {}", quoted(&self.found), quoted(&self.advice))
    }
}

fn before(text: &str, offset: usize) -> &str {
    text.get(..offset.min(text.len())).unwrap_or(text)
}

/// The line of a byte offset in `text`, from 1.
pub(crate) fn line_of(text: &str, offset: usize) -> u64 {
    before(text, offset).matches('\n').count() as u64 + 1
}

/// A text with parts of a file in it: harmless, on one line, and no longer than one reads.
fn quoted(text: &str) -> String {
    let shown = match text.char_indices().nth(LONGEST_SENTENCE) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    };
    printable_line(&shown).into_owned()
}

/// Whether `path` is an open file of this program or another, as the shell names it.
pub fn is_stream_of_shell(path: &Path) -> bool {
    const OPEN_FILES: [&str; 5] = [
        "/dev/stdin",
        "/dev/stdout",
        "/dev/stderr",
        "/dev/fd",
        "/proc",
    ];
    // A name there that does not exist is a typing error.
    OPEN_FILES.iter().any(|place| path.starts_with(place)) && path.symlink_metadata().is_ok()
}

/// Whether `path` is a pipe, a device, or what the shell made of an open file: it is
/// written to and never replaced, nor read.
pub fn is_stream(path: &Path) -> bool {
    is_stream_of_shell(path)
        || std::fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
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
    if is_stream(path) {
        // The reader of a pipe would take its opening and closing for the result.
        return Ok(());
    }
    Place::of(path).map(drop)
}

/// Says that `path` could not be written, and what to do.
pub fn not_written(path: &Path, error: &io::Error) -> InputError {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    let advice = match error.kind() {
        StorageFull | FileTooLarge | QuotaExceeded => {
            "make space on the disk, or choose another; what was there before is untouched"
        }
        _ => "check that the folder exists and can be written",
    };
    InputError::new(format!("cannot be written: {error}"), advice).in_file(path)
}

/// The file that `path` is a name of. A link whose target is not there yet is the name of
/// that target.
///
/// # Errors
///
/// Where links lead in a circle, or a folder cannot be read.
pub fn target_of(path: &Path) -> io::Result<PathBuf> {
    /// Links behind each other, as many as Linux follows.
    const MOST: usize = 40;
    if let Ok(target) = path.canonicalize() {
        return Ok(target);
    }
    let mut target = path.to_owned();
    for _ in 0..MOST {
        let Ok(next) = std::fs::read_link(&target) else {
            return Ok(target);
        };
        // Relative to the folder of the link.
        target = match target.parent() {
            Some(folder) => folder.join(next),
            None => next,
        };
    }
    Err(io::Error::other("links that lead to each other"))
}

/// Where bytes go until they are whole.
#[derive(Debug)]
enum Place {
    /// A file beside the one that it will replace, which vanishes when it is dropped.
    Beside(tempfile::NamedTempFile, PathBuf),
    /// A pipe or a device, which cannot be replaced.
    Stream(File),
}

impl Place {
    fn of(path: &Path) -> Result<Self, InputError> {
        if is_stream(path) {
            // Behind what is there: the shell may have redirected it into a file.
            let stream = OpenOptions::new().append(true).open(path);
            return Ok(Self::Stream(
                stream.map_err(|error| not_written(path, &error))?,
            ));
        }
        // A link stays a link: what it points at is replaced.
        let target = target_of(path).map_err(|error| not_written(path, &error))?;
        let folder = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        tempfile::Builder::new()
            .prefix(".softrig-")
            .tempfile_in(folder)
            // The kind alone: the message has the temporary file's name in it.
            .map_err(|error| not_written(path, &io::Error::from(error.kind())))
            .map(|file| Self::Beside(file, target))
    }

    fn file(&mut self) -> &mut File {
        match self {
            Self::Beside(file, _) => file.as_file_mut(),
            Self::Stream(file) => file,
        }
    }
}

/// A result that is whole, on the disk, and not yet where it belongs. Several of them can be
/// made ready before the first takes its place, so that a full disk replaces none.
#[derive(Debug)]
#[must_use = "a file that is not committed vanishes"]
pub struct Pending {
    path: PathBuf,
    place: Place,
}

impl Pending {
    /// Writes `bytes` beside `path`.
    ///
    /// # Errors
    ///
    /// Says why they cannot be written. What is at `path` is untouched.
    pub fn new(path: &Path, bytes: &[u8]) -> Result<Self, InputError> {
        let fail = |error: &io::Error| not_written(path, error);
        let mut place = Place::of(path)?;
        place
            .file()
            .write_all(bytes)
            .map_err(|error| fail(&error))?;
        if let Place::Beside(file, target) = &place {
            #[cfg(not(unix))]
            let _ = target;
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                // Temporary files are private; what replaces a result should be as
                // readable as any other file.
                let mode =
                    std::fs::metadata(target).map_or(0o644, |it| it.permissions().mode() & 0o777);
                file.as_file()
                    .set_permissions(std::fs::Permissions::from_mode(mode))
                    .map_err(|error| fail(&error))?;
            }
            // Some disks say only now that they are full.
            file.as_file().sync_all().map_err(|error| fail(&error))?;
        }
        Ok(Self {
            path: path.to_owned(),
            place,
        })
    }

    /// Puts it in its place, and returns the file to go on writing.
    ///
    /// # Errors
    ///
    /// Says why it cannot take its place.
    pub fn commit(self) -> Result<File, InputError> {
        match self.place {
            Place::Beside(file, target) => file
                .persist(target)
                .map_err(|error| not_written(&self.path, &error.error)),
            Place::Stream(file) => Ok(file),
        }
    }
}

/// Writes `bytes` to `path` through a temporary file in the same folder, so
/// that a reader sees the old content or the new and never a part.
///
/// # Errors
///
/// Says which folder cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), InputError> {
    Pending::new(path, bytes)?.commit().map(drop)
}

/// Writes a recording and its metadata beside it. Whatever fails, the metadata of one recording are
/// never beside the rows of another: at worst there are none.
///
/// # Errors
///
/// Says which file cannot be written.
pub fn write_with_meta(
    (path, rows): (&Path, &[u8]),
    (meta_path, meta): (&Path, &[u8]),
) -> Result<(), InputError> {
    let rows = Pending::new(path, rows)?;
    if matches!(rows.place, Place::Stream(_)) {
        // Beside a pipe or a device there is no place for a file.
        return rows.commit().map(drop);
    }
    replace_with_meta(rows, Pending::new(meta_path, meta)?).map(drop)
}

/// Puts rows and the metadata about them in their places, and returns the file of the rows.
///
/// # Errors
///
/// Like [`write_with_meta`].
pub fn replace_with_meta(rows: Pending, meta: Pending) -> Result<File, InputError> {
    if let Place::Beside(_, target) = &meta.place
        && let Err(error) = std::fs::remove_file(target)
        && error.kind() != io::ErrorKind::NotFound
    {
        return Err(not_written(&meta.path, &error));
    }
    let file = rows.commit()?;
    meta.commit()?;
    Ok(file)
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

    #[test]
    fn what_a_file_holds_is_quoted_harmlessly() {
        let error = InputError::new(
            format!("\u{1b}[31m{} is not a number", "9".repeat(1 << 20)),
            "a\nb",
        )
        .in_file(Path::new("\u{1b}]0;title\u{7}.csv"))
        .in_column("x\u{9b}\n");
        let said = error.to_string();
        assert!(said.len() < 3_000, "{}", said.len());
        assert!(!said.contains(char::is_control), "{said}");
        assert!(said.starts_with("\\u001b]0;title\\u0007.csv, column x\\u009b\\n: "));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link() {
        let folder = tempfile::tempdir().unwrap();
        let [link, target] = ["link.csv", "target.csv"].map(|name| folder.path().join(name));
        std::fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        write_atomically(&link, b"new").unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"new");
        assert!(link.is_symlink());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_file_that_is_not_there_stays_a_link() {
        use std::os::unix::fs::symlink;

        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("results")).unwrap();
        symlink("results/target.csv", at("link.csv")).unwrap();
        symlink("link.csv", at("other.csv")).unwrap();
        check_writable(&at("other.csv")).unwrap();
        write_atomically(&at("other.csv"), b"new").unwrap();
        assert_eq!(std::fs::read(at("results/target.csv")).unwrap(), b"new");
        assert!(at("link.csv").is_symlink() && at("other.csv").is_symlink());

        symlink("absent/target.csv", at("nowhere.csv")).unwrap();
        symlink("b.csv", at("a.csv")).unwrap();
        symlink("a.csv", at("b.csv")).unwrap();
        for (link, why) in [("nowhere.csv", "folder exists"), ("a.csv", "each other")] {
            let error = write_atomically(&at(link), b"new").unwrap_err().to_string();
            assert!(error.contains(link) && error.contains(why), "{error}");
            assert!(at(link).is_symlink());
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_file_in_memory_is_a_file() {
        let Ok(file) = tempfile::NamedTempFile::new_in("/dev/shm") else {
            return;
        };
        assert!(!is_stream(file.path()) && is_stream(Path::new("/dev/stdout")));
        for text in ["old and long", "new"] {
            write_atomically(file.path(), text.as_bytes()).unwrap();
            assert_eq!(std::fs::read_to_string(file.path()).unwrap(), text);
        }
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_device_stays_a_device() {
        let folder = tempfile::tempdir().unwrap();
        let [full, null, meta] =
            ["full.csv", "null.csv", "null.meta.toml"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink("/dev/full", &full).unwrap();
        let error = write_atomically(&full, b"new").unwrap_err().to_string();
        assert!(
            error.contains("full.csv") && error.contains("make space"),
            "{error}"
        );
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_with_meta((&null, b"new"), (&meta, b"about")).unwrap();
        assert!(full.is_symlink() && null.is_symlink() && !meta.exists());
    }
}
