//! The list of cases: a CSV with one row per case.
//!
//! ```csv
//! case,model,recordings,holdout
//! finger_01,models/finger.toml,data/01a.csv;data/01b.csv,
//! finger_02,models/finger.toml,data/02a.csv,data/02b.csv
//! ```
//!
//! Several files are separated by `;`. Paths are relative to the manifest. The column
//! `holdout` is optional. The optional columns `columns` and `units` hold for one case, like
//! `--columns` and `--units` on the command line, and `setup` says how the rig stood, like
//! `--setup` of `rig record`, as far as the recordings' metadata do not. Further columns are
//! ignored.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;

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

/// Reads a manifest.
///
/// # Errors
///
/// Names the line and the column that is at fault: a missing one, a name that is no name
/// of a folder or comes twice, a case without recordings.
pub fn read(path: &Path) -> Result<Vec<Case>, InputError> {
    let text = softrig_formats::bounded::read_text(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&text, folder).map_err(|error| error.in_file(path))
}

fn parse(text: &str, folder: &Path) -> Result<Vec<Case>, InputError> {
    const HEADER: &str = "the header is case,model,recordings,holdout (the last is optional)";
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let unreadable = |line: u64, error: csv::Error| {
        InputError::new(format!("cannot be read: {error}"), HEADER).at_line(line)
    };
    let header = reader
        .headers()
        .map_err(|error| unreadable(1, error))?
        .clone();
    let mut names = BTreeSet::new();
    let mut cases = Vec::new();
    for record in reader.records() {
        let record = record
            .map_err(|error| unreadable(error.position().map_or(1, csv::Position::line), error))?;
        let line = record.position().map_or(1, csv::Position::line);
        let row: ManifestLine = record
            .deserialize(Some(&header))
            .map_err(|error| unreadable(line, error))?;
        let fail = |column: &str, found: String, advice: &str| {
            InputError::new(found, advice)
                .at_line(line)
                .in_column(column)
        };
        if !is_name(&row.case) {
            return Err(fail(
                "case",
                format!("{:?} is no name of a case", row.case),
                "use letters, digits, '.', '_' and '-': it is the name of a folder",
            ));
        }
        if !names.insert(row.case.clone()) {
            return Err(fail(
                "case",
                format!("{} comes twice", row.case),
                "give each case a name of its own",
            ));
        }
        if row.model.is_empty() {
            return Err(fail("model", "no model".into(), "name the model file"));
        }
        let files = |list: &str| -> Vec<PathBuf> {
            let names = list.split(';').map(str::trim);
            names
                .filter(|name| !name.is_empty())
                .map(|name| folder.join(name))
                .collect()
        };
        let (recordings, holdout) = (files(&row.recordings), files(&row.holdout));
        if recordings.is_empty() {
            return Err(fail(
                "recordings",
                "no recording".into(),
                "name one or more files, separated by ';'",
            ));
        }
        let mut layout = Layout::default();
        let wrong = |column: &'static str| {
            move |found: String| fail(column, found, "write it as for the flag of that name")
        };
        if !row.columns.is_empty() {
            layout.names = Names::parse(&row.columns).map_err(wrong("columns"))?;
        }
        if !row.units.is_empty() {
            layout.columns = Columns::of_units(&row.units).map_err(wrong("units"))?;
        }
        layout.setup = row
            .setup
            .parse()
            .map_err(|fault: InputError| fault.at_line(line).in_column("setup"))?;
        cases.push(Case {
            layout,
            model: folder.join(&row.model),
            name: row.case,
            recordings,
            holdout,
        });
    }
    if cases.is_empty() {
        return Err(InputError::new("has no cases", HEADER));
    }
    Ok(cases)
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
    use super::*;

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
