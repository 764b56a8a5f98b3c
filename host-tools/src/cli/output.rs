//! Protects existing files: a command overwrites no file that it reads, no recording, and
//! no file of another kind than it writes.
//!
//! In `softrig diagnose --model m.toml -o step*.csv` the name after `-o` is missing, so the
//! shell hands the first recording to `-o`. Only its content shows that it must not be
//! replaced. Every flag that writes a file goes through [`check`], before anything is
//! computed.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::linearise::WRITTEN_BY as WRITTEN_BY_LINEARISE;
use softrig_formats::error::{InputError, check_writable, is_stream, target_of};
use softrig_formats::formats::is_binary_recording;
use softrig_formats::model_file::WRITTEN_BY_EXPORT;
use softrig_link::record::meta_path;
use softrig_report::plot::Format;

/// The kind of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A model file.
    Model,
    /// A protocol file.
    Protocol,
    /// A verdict, or another result as JSON.
    Json,
    /// A report.
    Page,
    /// A picture.
    Picture,
    /// A table of `softrig compare`.
    Table,
    /// A recording: never replaced without being told to.
    Recording,
    /// A model as a program of another language.
    Code,
}

impl FileKind {
    /// Its name, with the article.
    fn what(self) -> &'static str {
        match self {
            Self::Model => "a model",
            Self::Protocol => "a protocol",
            Self::Json => "JSON",
            Self::Page => "a report",
            Self::Picture => "a picture",
            Self::Table => "a table",
            Self::Recording => "a recording",
            Self::Code => "code",
        }
    }

    /// An example of a file name.
    fn example(self) -> &'static str {
        match self {
            Self::Model => "repaired.toml",
            Self::Protocol => "next.toml",
            Self::Json => "verdict.json",
            Self::Page => "report.html",
            Self::Picture => "picture.svg",
            Self::Table => "table.csv",
            Self::Recording => "new.csv",
            Self::Code => "exported.c",
        }
    }
}

/// A file that a command is to write.
#[derive(Clone, Copy, Debug)]
pub struct Output<'a> {
    flag: &'static str,
    kind: FileKind,
    path: Option<&'a Path>,
    may_replace: bool,
    rows_only: bool,
}

impl<'a> Output<'a> {
    /// The output of a flag, if it was given.
    pub fn of(flag: &'static str, kind: FileKind, path: Option<&'a PathBuf>) -> Self {
        Self {
            flag,
            kind,
            path: path.map(PathBuf::as_path),
            may_replace: kind != FileKind::Recording,
            rows_only: false,
        }
    }

    /// Drops the output in a dry run.
    pub(crate) fn unless(self, dry_run: bool) -> Self {
        Self {
            path: self.path.filter(|_| !dry_run),
            ..self
        }
    }

    /// Sets whether the metadata beside it is left unchanged.
    pub(crate) fn rows_only(self, rows_only: bool) -> Self {
        Self { rows_only, ..self }
    }

    /// Sets whether it may replace a recording, which can be made again or which the user
    /// agrees to lose.
    pub fn replacing(self, may_replace: bool) -> Self {
        Self {
            may_replace: self.may_replace || may_replace,
            ..self
        }
    }
}

/// The content of an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Found {
    /// Nothing: there is no such file, or it is empty.
    Nothing,
    Known(FileKind),
    Unknown,
}

/// Refuses, before long work, outputs that would overwrite something worth keeping or that
/// cannot be written. `read` are the files that the command reads.
///
/// # Errors
///
/// Names the file, the flag, and the argument that is probably missing after it.
pub fn check<'a>(
    outputs: &[Output<'_>],
    read: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<(), InputError> {
    let read: Vec<PathBuf> = read.into_iter().map(|path| same_file(path)).collect();
    let mut seen: Vec<PathBuf> = Vec::new();
    for output in outputs {
        let Some(path) = output.path else { continue };
        let folder = path.parent().unwrap_or(Path::new(""));
        if !folder.as_os_str().is_empty() && !folder.is_dir() {
            return Err(InputError::new(
                format!("cannot be written: there is no folder {}", folder.display()),
                "create it first",
            )
            .in_file(path));
        }
        check_writable(path)?;
        let file = same_file(path);
        if seen.contains(&file) {
            return Err(InputError::new(
                "is named for two results",
                "give each result a file of its own",
            )
            .in_file(path));
        }
        let refused = if read.contains(&file) {
            Some("is read by this command".to_owned())
        } else {
            match found(path) {
                Found::Nothing if output.kind == FileKind::Recording && !output.rows_only => {
                    keep_metadata(path, output.may_replace)?;
                    None
                }
                Found::Nothing => None,
                Found::Known(FileKind::Recording) if output.kind != FileKind::Recording => {
                    Some("is a recording".to_owned())
                }
                Found::Known(FileKind::Recording) if !output.may_replace => {
                    return Err(InputError::new(
                        "is a recording that exists",
                        "choose another name: what was recorded is never replaced",
                    )
                    .in_file(path));
                }
                Found::Known(kind) if kind == output.kind => None,
                Found::Known(kind) => Some(format!("is {}", kind.what())),
                Found::Unknown => Some("is something else".to_owned()),
            }
        };
        if let Some(is) = refused {
            let Output { flag, kind, .. } = output;
            return Err(InputError::new(
                format!("{is}, and {flag} would write {} over it", kind.what()),
                format!(
                    "give {flag} a file of its own, such as {flag} {}",
                    kind.example()
                ),
            )
            .in_file(path));
        }
        if output.kind == FileKind::Picture {
            Format::of(path)?.check(path)?;
        }
        seen.push(file);
    }
    Ok(())
}

/// Protects metadata like a recording: it may be all that is left of one.
fn keep_metadata(path: &Path, may_replace: bool) -> Result<(), InputError> {
    let about = meta_path(path);
    if about.exists() && !may_replace {
        return Err(InputError::new(
            "is the metadata of a recording",
            "choose another name: what was recorded is never replaced",
        )
        .in_file(&about));
    }
    Ok(())
}

/// The author that `softrig simulate` writes into metadata.
const WRITTEN_BY: &str = "softrig simulate";

/// The metadata of a recording of `softrig simulate`, which it may replace when it runs again.
pub(crate) fn about_simulated(angle_is_simulated: bool) -> String {
    format!("written_by = \"{WRITTEN_BY}\"\nsimulated = {angle_is_simulated}\n")
}

/// Whether `softrig simulate` wrote a recording, which can be made again.
pub(crate) fn is_simulated(path: &Path) -> bool {
    let about = std::fs::read_to_string(meta_path(path)).unwrap_or_default();
    about.parse::<toml::Table>().is_ok_and(|table| {
        let by = table.get("written_by").and_then(toml::Value::as_str);
        by == Some(WRITTEN_BY)
    })
}

/// The same for every name of a file, also of one that is still to be made.
pub(super) fn same_file(path: &Path) -> PathBuf {
    let target = target_of(path).unwrap_or_else(|_| path.to_owned());
    let path = target.as_path();
    path.canonicalize().unwrap_or_else(|_| {
        // A new file in a folder that may have several names.
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        match (folder.canonicalize(), path.file_name()) {
            (Ok(folder), Some(name)) => folder.join(name),
            _ => path.to_owned(),
        }
    })
}

/// Finds what a file holds; a file that cannot be read is unknown.
fn found(path: &Path) -> Found {
    /// Enough for a header or the sections of a model.
    const ENOUGH: u64 = 1 << 20;
    if is_stream(path) {
        return Found::Nothing;
    }
    let Ok(file) = File::open(path) else {
        return if path.exists() {
            Found::Unknown
        } else {
            Found::Nothing
        };
    };
    let mut bytes = Vec::new();
    if file.take(ENOUGH).read_to_end(&mut bytes).is_err() {
        return Found::Unknown;
    }
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Found::Nothing;
    }
    if is_unit(&bytes) {
        return Found::Known(FileKind::Code);
    }
    if is_picture(&bytes) {
        return Found::Known(FileKind::Picture);
    }
    if is_binary_recording(&bytes) {
        return Found::Known(FileKind::Recording);
    }
    let text = String::from_utf8_lossy(&bytes);
    of_text(text.trim_start_matches('\u{feff}').trim_start()).map_or(Found::Unknown, Found::Known)
}

/// Whether a file is a functional mock-up unit of `softrig export`: an archive whose first file is the
/// description.
fn is_unit(bytes: &[u8]) -> bool {
    const DESCRIPTION: &[u8] = b"modelDescription.xml";
    /// The header of an archive's first file, before its name.
    const NAME_AT: usize = 30;
    bytes.starts_with(b"PK\x03\x04")
        && bytes
            .get(NAME_AT..)
            .is_some_and(|rest| rest.starts_with(DESCRIPTION))
}

/// Whether a file is a PNG, or a PDF that was made of a picture: others are somebody's papers.
fn is_picture(bytes: &[u8]) -> bool {
    const MADE_BY: &[u8] = b"(svg2pdf)";
    bytes.starts_with(b"\x89PNG\r\n\x1a\n")
        || (bytes.starts_with(b"%PDF-") && bytes.windows(MADE_BY.len()).any(|it| it == MADE_BY))
}

/// The lines within which an export says what wrote it.
const EXPORT_SAYS_SO_BY: usize = 12;

fn of_text(text: &str) -> Option<FileKind> {
    let start: String = text.chars().take(200).collect::<String>().to_lowercase();
    if start.starts_with("<!doctype html") || start.starts_with("<html") {
        return Some(FileKind::Page);
    }
    if start.starts_with("<svg") || (start.starts_with("<?xml") && text.contains("<svg")) {
        return Some(FileKind::Picture);
    }
    // Every export says so in its first lines, whatever the language; other code is
    // somebody's work.
    let head = text.lines().take(EXPORT_SAYS_SO_BY);
    if head.into_iter().any(|line| {
        [WRITTEN_BY_EXPORT, WRITTEN_BY_LINEARISE]
            .iter()
            .any(|by| line.contains(by))
    }) {
        return Some(FileKind::Code);
    }
    if start.starts_with('{') {
        return Some(FileKind::Json);
    }
    if let Ok(table) = text.parse::<toml::Table>() {
        return of_toml(&table);
    }
    let header = text
        .lines()
        .find(|line| !line.trim_start().starts_with('#'))?;
    let columns: Vec<String> = header
        .split([',', ';', '\t'])
        .map(|name| name.trim().trim_matches('"').to_lowercase())
        .collect();
    let names = |name: &str| columns.iter().any(|column| column.contains(name));
    if columns.len() > 1 && names("rms_deg") && names("setpoint_deg") {
        return Some(FileKind::Table);
    }
    // A time beside others is a measurement, by whatever names.
    let measured = ["pressure", "angle", "deg", "kpa", "psi", "volt"];
    if columns.len() > 1
        && (measured.into_iter().any(names) || columns[0] == "t" || columns[0].contains("time"))
    {
        return Some(FileKind::Recording);
    }
    None
}

fn of_toml(table: &toml::Table) -> Option<FileKind> {
    if table.contains_key("dynamics") {
        return Some(FileKind::Model);
    }
    // Metadata list segments too, without a kind.
    let is_played = |segment: &toml::Value| segment.get("kind").is_some();
    let mut segments = table.get("segment")?.as_array()?.iter();
    segments.any(is_played).then_some(FileKind::Protocol)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_what_is_in_them() {
        for (text, expected) in [
            (
                "time_s,pressure_kpa,angle_deg\n0,1,2\n",
                Some(FileKind::Recording),
            ),
            ("t;p;theta\n0;1;2\n", Some(FileKind::Recording)),
            (
                "# of Monday\n\"Time (ms)\"\tPressure (psi)\n",
                Some(FileKind::Recording),
            ),
            (
                "run,setpoint_deg,repeats,model,rms_deg,rms_percent\n",
                Some(FileKind::Table),
            ),
            ("<svg xmlns=\"a\">", Some(FileKind::Picture)),
            ("<?xml version=\"1.0\"?>\n<svg>", Some(FileKind::Picture)),
            ("<!DOCTYPE html>", Some(FileKind::Page)),
            ("{ \"schema\": 1 }", Some(FileKind::Json)),
            (
                "schema = 1\n[dynamics]\nexponent = 1\n",
                Some(FileKind::Model),
            ),
            (
                "schema = 1\n[[segment]]\nkind = \"step\"\n",
                Some(FileKind::Protocol),
            ),
            ("rate_hz = 100\n[[segment]]\nfrom_s = 1\n", None),
            (
                "name = \"slow, to 30 deg\"\n[dynamics]\n",
                Some(FileKind::Model),
            ),
            ("schema = 1\n[settings]\n", None),
            ("Dear diary, today", None),
            (
                "/*\n * Model \"a\"\n *\n * Written by `softrig export` of softrig 0.1.0.\n */",
                Some(FileKind::Code),
            ),
            ("int main(void) { return 0; }\n", None),
        ] {
            assert_eq!(of_text(text), expected, "{text}");
        }
    }

    #[test]
    fn a_file_has_one_name_by_whatever_path() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("run.csv");
        std::fs::write(&run, "time_s,pressure_kpa,angle_deg\n").unwrap();
        let roundabout = folder.path().join(".").join("run.csv");
        let outputs = [Output::of("-o", FileKind::Recording, Some(&roundabout)).replacing(true)];
        let error = check(&outputs, [&run]).unwrap_err().to_string();
        assert!(error.contains("is read by this command"), "{error}");
    }

    #[test]
    fn what_may_be_anything_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("theirs.mat");
        let outputs = [Output::of("-o", FileKind::Recording, Some(&file)).replacing(true)];
        let none: [&PathBuf; 0] = [];
        for (start, is_ours) in [
            (&b"MATLAB 5.0 MAT-file"[..], true),
            (b"PAR1", true),
            (b"\x89MCAP0\r\n", true),
            (b"\x89HDF\r\n\x1a\n", false),
            (b"\x89PNG\r\n\x1a\n", false),
        ] {
            std::fs::write(&file, start).unwrap();
            assert_eq!(check(&outputs, none).is_ok(), is_ours, "{start:?}");
        }
    }
}
