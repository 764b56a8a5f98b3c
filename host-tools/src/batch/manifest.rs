//! The list of cases: a CSV with one row per case.
//!
//! ```csv
//! case,model,recordings,holdout
//! finger_01,models/finger.toml,data/01a.csv;data/01b.csv,
//! finger_02,models/finger.toml,data/02a.csv,data/02b.csv
//! ```
//!
//! A list may have millions of rows: it is checked once, and then read row by row.

use std::collections::HashSet;
use std::fs::File;
use std::hash::{BuildHasher, RandomState};
use std::io::{Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use csv::StringRecord;
use serde::Deserialize;

use softrig_formats::bounded::{self, Bounded, Limits};
use softrig_formats::columns::{Columns, Layout, Names};
use softrig_formats::error::InputError;

/// One diagnosis of a manifest.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its name, which is that of its folder.
    pub name: String,
    /// The model file.
    pub model: PathBuf,
    /// Recordings to fit.
    pub recordings: Vec<PathBuf>,
    /// Validation recordings.
    pub holdout: Vec<PathBuf>,
    /// Where they stand in their files, as far as the manifest says.
    pub layout: Layout,
}

impl Case {
    /// Checks a case before anything of it is read.
    ///
    /// # Errors
    ///
    /// Names the column that is at fault.
    fn check(&self) -> Result<(), InputError> {
        let fail = |column: &str, found, advice: &str| {
            Err(InputError::new(found, advice).in_column(column))
        };
        if !is_name(&self.name) {
            return fail(
                "case",
                format!("{:?} is not a case name", self.name),
                "use letters, digits, '.', '_' and '-': it is the name of a folder",
            );
        }
        if self.model.as_os_str().is_empty() {
            return fail("model", "no model".into(), "name the model file");
        }
        if self.recordings.is_empty() {
            let advice = "name one or more files, in a manifest separated by ';'";
            return fail("recordings", "no recording".into(), advice);
        }
        Ok(())
    }
}

/// The cases of a batch, which are read when they are needed.
pub trait Cases: Send {
    /// How many there are.
    fn count(&self) -> usize;

    /// Length of the longest name, in letters.
    fn longest_name(&self) -> usize;

    /// A case, by its place from 0.
    ///
    /// # Errors
    ///
    /// It cannot be read, or is not the one that was checked.
    ///
    /// # Panics
    ///
    /// There are not that many.
    fn case(&mut self, index: usize) -> Result<Case, InputError>;
}

/// Cases that are in memory.
pub struct List(Vec<Case>);

impl List {
    /// Checks the cases of a list.
    ///
    /// # Errors
    ///
    /// Names the case by its place from 0, and what of it is at fault.
    pub fn of(cases: Vec<Case>) -> Result<Self, InputError> {
        let mut names = HashSet::new();
        for (index, case) in cases.iter().enumerate() {
            let checked = match case.check() {
                Ok(()) if !names.insert(&case.name) => Err(twice(&case.name)),
                checked => checked,
            };
            checked.map_err(|fault| {
                let key = fault.column.unwrap_or_default();
                InputError::new(
                    format!("cases[{index}], {key}: {}", fault.found),
                    fault.advice,
                )
            })?;
        }
        if cases.is_empty() {
            return Err(InputError::new("there are no cases", "give one or more"));
        }
        Ok(Self(cases))
    }
}

impl Cases for List {
    fn count(&self) -> usize {
        self.0.len()
    }

    fn longest_name(&self) -> usize {
        self.0.iter().map(|case| case.name.len()).max().unwrap_or(0)
    }

    fn case(&mut self, index: usize) -> Result<Case, InputError> {
        Ok(self.0[index].clone())
    }
}

fn twice(name: &str) -> InputError {
    let found = format!("{name} is repeated");
    InputError::new(found, "give each case a name of its own").in_column("case")
}

/// A row as it is written.
#[derive(Debug, Deserialize)]
struct ManifestLine {
    case: String,
    model: String,
    recordings: String,
    #[serde(default)]
    holdout: String,
    #[serde(default)]
    columns: String,
    #[serde(default)]
    units: String,
    #[serde(default)]
    setup: String,
}

/// The largest manifest: ten million cases of a kilobyte. Rows are read from the file when they
/// are needed, so that a case takes no more memory than [`Row`].
const LIMITS: Limits = Limits {
    bytes: 10 << 30,
    row_bytes: 1 << 20,
    rows: 10_000_000,
    fields: u64::MAX,
};

const HEADER: &str = "the header is case,model,recordings,holdout (the last is optional)";

/// Where a case stands in its file.
#[derive(Clone, Copy, Debug)]
struct Row {
    byte: u64,
    line: u64,
    /// Of its text: whether it is still the row that was checked.
    hash: u64,
}

/// The cases of a file, every one checked.
pub struct Manifest<R> {
    reader: csv::Reader<R>,
    header: StringRecord,
    path: PathBuf,
    rows: Vec<Row>,
    hasher: RandomState,
    /// Length of the longest name of a case.
    longest: usize,
}

/// Opens a manifest, and reads it once to check every row.
///
/// Several files are separated by `;`. Paths are relative to the manifest. The column `holdout` is
/// optional. The optional columns `columns` and `units` hold for one case, like `--columns` and
/// `--units` on the command line, and `setup` says how the rig stood, like `--setup` of
/// `softrig record`, as far as the recordings' metadata do not. Further columns are ignored.
///
/// # Errors
///
/// Names the line and the column that is at fault: a missing one, a name that is no name
/// of a folder or comes twice, a case without recordings.
pub fn open(path: &Path) -> Result<Manifest<Box<dyn Text>>, InputError> {
    bounded::refuse_pipe(path)?;
    let fail = |error| InputError::from_io(path, &error);
    let of = |through, again| Manifest::of(through, again, path).map_err(|it| it.in_file(path));
    if std::fs::metadata(path).is_ok_and(|about| about.is_file()) {
        let open = || -> Result<Box<dyn Text>, InputError> {
            Ok(Box::new(File::open(path).map_err(fail)?))
        };
        return of(open()?, open()?);
    }
    // What a shell makes of `<(…)` can be read once.
    let text = bounded::read_bytes(path)?;
    let open = || -> Box<dyn Text> { Box::new(Cursor::new(text.clone())) };
    of(open(), open())
}

/// A text of which any place can be read.
pub trait Text: Read + Seek + Send {}
impl<T: Read + Seek + Send> Text for T {}

impl<R: Read + Seek> Manifest<R> {
    /// Checks the cases of a text, which is given twice: to be read through, and to read a case
    /// when it is asked for.
    fn of(through: R, again: R, path: &Path) -> Result<Self, InputError> {
        let mut through = reader(Bounded::new(through, LIMITS));
        let header = headers(&mut through)?;
        let mut manifest = Self {
            reader: reader(again),
            header,
            path: path.to_owned(),
            rows: Vec::new(),
            hasher: RandomState::new(),
            longest: 0,
        };
        // Names are kept as hashes: of ten million, two are taken for one in three of a million runs.
        let mut names = HashSet::new();
        let mut record = StringRecord::new();
        loop {
            through.get_mut().found_row();
            let more = through.read_record(&mut record);
            if let Some(fault) = through.get_ref().fault() {
                return Err(fault);
            }
            let line = |error: &csv::Error| error.position().map_or(1, csv::Position::line);
            if !more.map_err(|error| unreadable(line(&error), &error))? {
                break;
            }
            let case = manifest.read(&record)?;
            let position = record.position();
            let line = position.map_or(1, csv::Position::line);
            if !names.insert(manifest.hasher.hash_one(&case.name)) {
                return Err(twice(&case.name).at_line(line));
            }
            LIMITS.check(manifest.rows.len() as u64 + 1, 0)?;
            manifest.longest = manifest.longest.max(case.name.len());
            manifest.rows.push(Row {
                byte: position.map_or(0, csv::Position::byte),
                line,
                hash: manifest.hasher.hash_one(record.as_slice()),
            });
        }
        if manifest.rows.is_empty() {
            return Err(InputError::new("has no cases", HEADER));
        }
        Ok(manifest)
    }

    /// Reads a row.
    fn read(&self, record: &StringRecord) -> Result<Case, InputError> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let line = record.position().map_or(1, csv::Position::line);
        let row: ManifestLine = record
            .deserialize(Some(&self.header))
            .map_err(|error| unreadable(line, &error))?;
        let files = |list: &str| -> Vec<PathBuf> {
            let names = list.split(';').map(str::trim);
            names
                .filter(|name| !name.is_empty())
                .map(|name| folder.join(name))
                .collect()
        };
        let wrong = |column: &'static str| {
            move |found: String| {
                InputError::new(found, "write it as for the flag of that name").in_column(column)
            }
        };
        let layout = || -> Result<Layout, InputError> {
            let mut layout = Layout::default();
            if !row.columns.is_empty() {
                layout.names = Names::parse(&row.columns).map_err(wrong("columns"))?;
            }
            if !row.units.is_empty() {
                layout.columns = Columns::of_units(&row.units).map_err(wrong("units"))?;
            }
            let setup = row.setup.parse();
            layout.setup = setup.map_err(|fault: InputError| fault.in_column("setup"))?;
            Ok(layout)
        };
        let case = || {
            let case = Case {
                // A folder is no model.
                model: match row.model.as_str() {
                    "" => PathBuf::new(),
                    name => folder.join(name),
                },
                recordings: files(&row.recordings),
                holdout: files(&row.holdout),
                layout: layout()?,
                name: row.case.clone(),
            };
            case.check().map(|()| case)
        };
        case().map_err(|fault| fault.at_line(line))
    }
}

impl<R: Read + Seek + Send> Cases for Manifest<R> {
    fn count(&self) -> usize {
        self.rows.len()
    }

    fn longest_name(&self) -> usize {
        self.longest
    }

    fn case(&mut self, index: usize) -> Result<Case, InputError> {
        let row = self.rows[index];
        let changed = || {
            InputError::new(
                "has changed since the batch began",
                "start the batch again: cases that are done are skipped",
            )
            .at_line(row.line)
            .in_file(&self.path)
        };
        let mut position = csv::Position::new();
        position.set_byte(row.byte).set_line(row.line);
        let mut record = StringRecord::new();
        let read = self
            .reader
            .seek(position)
            .and_then(|()| self.reader.read_record(&mut record));
        if !read.map_err(|_| changed())? || self.hasher.hash_one(record.as_slice()) != row.hash {
            return Err(changed());
        }
        self.read(&record)
            .map_err(|error| error.in_file(&self.path))
    }
}

fn reader<R: Read>(text: R) -> csv::Reader<R> {
    csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text)
}

fn headers<R: Read>(reader: &mut csv::Reader<R>) -> Result<StringRecord, InputError> {
    let header = reader.headers().map_err(|error| unreadable(1, &error))?;
    Ok(header.clone())
}

fn unreadable(line: u64, error: &csv::Error) -> InputError {
    InputError::new(format!("cannot be read: {error}"), HEADER).at_line(line)
}

/// Whether a name can be that of a folder anywhere.
fn is_name(name: &str) -> bool {
    !name.is_empty()
        && !name.starts_with('.')
        // The table of all cases.
        && name != "results.parquet"
        && name
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-'))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// The cases of a manifest that stands in this folder.
    fn parse(text: &str, folder: &Path) -> Result<Vec<Case>, InputError> {
        let path = folder.join("cases.csv");
        let [through, again] = [(); 2].map(|()| Cursor::new(text.as_bytes().to_vec()));
        let mut manifest = Manifest::of(through, again, &path)?;
        // In any order, as jobs of an array read them.
        let mut cases: Vec<Case> = (0..manifest.count())
            .rev()
            .map(|index| manifest.case(index))
            .collect::<Result<_, _>>()?;
        cases.reverse();
        Ok(cases)
    }

    #[test]
    fn a_manifest_that_changes_meanwhile_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cases.csv");
        let header = "case,model,recordings\n";
        std::fs::write(&path, format!("{header}a,m,x.csv\nb,m,y.csv\n")).unwrap();
        let mut manifest = open(&path).unwrap();
        assert_eq!(manifest.case(1).unwrap().name, "b");
        std::fs::write(&path, format!("{header}b,m,y.csv\na,m,x.csv\n")).unwrap();
        let error = manifest.case(1).unwrap_err().to_string();
        assert!(
            error.contains("cases.csv, line 3") && error.contains("changed"),
            "{error}"
        );
    }

    #[test]
    fn a_manifest_may_be_larger_than_a_text_that_is_read_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cases.csv");
        let file = "a_recording_with_a_long_name.csv;".repeat(30_000);
        let mut out = std::io::BufWriter::new(File::create(&path).unwrap());
        writeln!(out, "case,model,recordings").unwrap();
        for number in 0..70 {
            writeln!(out, "c{number},m.toml,{file}").unwrap();
        }
        drop(out);
        assert!(std::fs::metadata(&path).unwrap().len() > 64 << 20);
        let mut manifest = open(&path).unwrap();
        assert_eq!(manifest.count(), 70);
        let case = manifest.case(69).unwrap();
        assert_eq!((case.name.as_str(), case.recordings.len()), ("c69", 30_000));
    }

    #[test]
    fn a_row_that_never_ends_is_refused() {
        let endless = Path::new("/dev/zero");
        if endless.exists() {
            let error = open(endless).err().unwrap().to_string();
            assert!(error.contains("/dev/zero"), "{error}");
        }
    }

    #[test]
    fn files_are_relative_to_the_manifest_and_holdout_is_optional() {
        let text =
            "case,model,recordings,holdout\na,m.toml,x.csv; y.csv ,z.csv\nb,m.toml,/w.csv,\n";
        let cases = parse(text, Path::new("lab")).unwrap();
        assert_eq!(cases[0].model, Path::new("lab/m.toml"));
        assert_eq!(
            cases[0].recordings,
            [Path::new("lab/x.csv"), Path::new("lab/y.csv")]
        );
        assert_eq!(cases[0].holdout, [Path::new("lab/z.csv")]);
        assert_eq!(cases[1].recordings, [Path::new("/w.csv")]);
        assert!(cases[1].holdout.is_empty());
        let short = parse("model,case,recordings\nm.toml,a,x.csv\n", Path::new("")).unwrap();
        assert!(short[0].holdout.is_empty());
    }

    #[test]
    fn a_case_says_how_its_rig_stood() {
        let text =
            "case,model,recordings,setup\na,m,x.csv,\"tilt_deg=90,tube_mm=300\"\nb,m,y.csv,\n";
        let cases = parse(text, Path::new("")).unwrap();
        assert_eq!(cases[0].layout.setup.tilt_deg, Some(90.0));
        assert_eq!(cases[0].layout.setup.tube_mm, Some(300.0));
        assert_eq!(cases[1].layout, Layout::default());
        let error = parse(
            "case,model,recordings,setup\na,m,x.csv,tilt=90\n",
            Path::new(""),
        )
        .unwrap_err()
        .in_file(Path::new("cases.csv"))
        .to_string();
        assert!(
            error.contains("line 2, column setup") && error.contains("tilt"),
            "{error}"
        );
    }

    #[test]
    fn faults_name_line_and_column() {
        let fault = |text: &str| {
            let error = parse(text, Path::new("")).unwrap_err();
            error.in_file(Path::new("cases.csv")).to_string()
        };
        let header = "case,model,recordings\n";
        let of = |rows: &str| fault(&format!("{header}{rows}"));
        assert!(
            of("a,m,x\na,m,y\n").contains("line 3"),
            "{}",
            of("a,m,x\na,m,y\n")
        );
        assert!(of("../a,m,x\n").contains("column case"));
        assert!(of("a,m, ; \n").contains("column recordings"));
        assert!(of("a,m\n").contains("line 2"), "{}", of("a,m\n"));
        assert!(fault("case,recordings\na,x\n").contains("model"));
        assert!(fault(header).contains("no cases"));
    }
}
