//! The results of a batch as one Parquet table, one row per case.
//!
//! They are collected from the folders of the cases. Parquet keeps types, and pandas, polars,
//! DuckDB, R and MATLAB read it.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use serde_json::Value;

use super::Folder;
use super::manifest::Case;
use softrig_formats::error::write_atomically;

/// The results of a case.
#[derive(Clone, Debug)]
pub struct CaseResult {
    /// Its name.
    pub case: String,
    /// `diagnosed`, `failed` or `missing`.
    pub status: &'static str,
    /// Why it failed.
    pub error: Option<String>,
    /// Warnings about its recordings, a line each.
    pub warnings: Option<String>,
    /// Its verdict.
    pub verdict: Option<Value>,
}

impl CaseResult {
    /// Reads what the folder of a case holds. A verdict that is no JSON, and a link in place of
    /// the folder, are the error of this case.
    pub fn read(out: &Path, case: &Case) -> Self {
        let folder = Folder::of(out, case);
        let link = folder.refuse_link().err();
        let read = |path: &Path| match link {
            None => std::fs::read_to_string(path).ok(),
            Some(_) => None,
        };
        let mut error = link
            .as_ref()
            .map(ToString::to_string)
            .or_else(|| read(&folder.error()));
        let mut verdict = None;
        if let (Some(text), None) = (read(&folder.verdict()), &error) {
            match serde_json::from_str(&text) {
                Ok(read) => verdict = Some(read),
                Err(fault) => {
                    error = Some(format!(
                        "{}: is damaged: {fault}; diagnose the case again",
                        folder.verdict().display()
                    ));
                }
            }
        }
        Self {
            case: case.name.clone(),
            status: match (&error, &verdict) {
                (Some(_), _) => "failed",
                (None, Some(_)) => "diagnosed",
                (None, None) => "missing",
            },
            error: error.map(|text| text.trim_end().to_owned()),
            warnings: read(&folder.warnings()).map(|text| text.trim_end().to_owned()),
            verdict,
        }
    }

    /// The answer in a few words, for a terminal.
    pub fn summary(&self) -> String {
        let verdict = self.text("/verdict").unwrap_or_else(|| self.status.into());
        match self.effects().or_else(|| self.text("/family")) {
            Some(what) => format!("{verdict}: {what}"),
            None => verdict,
        }
    }

    /// How many warnings there are, for a terminal; none if there are none.
    pub fn warned(&self) -> Option<String> {
        match self.warnings.as_ref()?.lines().count() {
            1 => Some("1 warning".to_owned()),
            count => Some(format!("{count} warnings")),
        }
    }

    fn at(&self, pointer: &str) -> Option<&Value> {
        self.verdict.as_ref()?.pointer(pointer)
    }

    fn text(&self, pointer: &str) -> Option<String> {
        Some(self.at(pointer)?.as_str()?.to_owned())
    }

    fn number(&self, pointer: &str) -> Option<f64> {
        self.at(pointer)?.as_f64()
    }

    /// The names of the effects; none where none is named.
    fn effects(&self) -> Option<String> {
        let named: Vec<_> = self
            .at("/effects")?
            .as_array()?
            .iter()
            .filter_map(|effect| effect.get("kind")?.as_str())
            .collect();
        (!named.is_empty()).then(|| named.join(" + "))
    }

    /// Every rival, one a `|`.
    fn alternatives(&self) -> Option<String> {
        let rivals: Vec<String> = self
            .at("/alternatives")?
            .as_array()?
            .iter()
            .filter_map(|rival| {
                let kinds = rival.get("kinds")?.as_array()?;
                let names: Vec<_> = kinds.iter().filter_map(Value::as_str).collect();
                Some(names.join(" + "))
            })
            .collect();
        (!rivals.is_empty()).then(|| rivals.join(" | "))
    }

    /// What the named effects have under a key, as JSON.
    fn of_effects(&self, key: &str) -> Option<String> {
        let effects = self.at("/effects")?.as_array()?;
        let parameters: Vec<_> = effects.iter().filter_map(|it| it.get(key)).collect();
        (!parameters.is_empty()).then(|| serde_json::to_string(&parameters).unwrap_or_default())
    }
}

/// The cells of a column, none where a case has no such value.
#[derive(Clone, Debug, PartialEq)]
pub enum Cells {
    /// Words.
    Text(Vec<Option<String>>),
    /// Numbers, in the unit that the name of the column ends with.
    Number(Vec<Option<f64>>),
    /// Yes or no.
    Flag(Vec<Option<bool>>),
}

/// The table's columns, in its order, with a cell for each row.
pub fn columns(rows: &[CaseResult]) -> Vec<(&'static str, Cells)> {
    let text =
        |of: &dyn Fn(&CaseResult) -> Option<String>| Cells::Text(rows.iter().map(of).collect());
    let number = |at: &str| Cells::Number(rows.iter().map(|row| row.number(at)).collect());
    vec![
        ("case", text(&|row| Some(row.case.clone()))),
        ("status", text(&|row| Some(row.status.to_owned()))),
        ("error", text(&|row| row.error.clone())),
        ("warnings", text(&|row| row.warnings.clone())),
        ("verdict", text(&|row| row.text("/verdict"))),
        ("strength", text(&|row| row.text("/strength"))),
        ("family", text(&|row| row.text("/family"))),
        ("effects", text(&CaseResult::effects)),
        ("parameters_json", text(&|row| row.of_effects("parameters"))),
        ("alternatives", text(&CaseResult::alternatives)),
        ("probability", number("/effects/0/probability")),
        ("closure_overall", number("/closure/overall")),
        ("closure_full", number("/closure/full")),
        ("rmse_nominal_deg", number("/rmse_deg/nominal")),
        ("rmse_refit_deg", number("/rmse_deg/refit")),
        ("rmse_repaired_deg", number("/rmse_deg/repaired")),
        ("noise_floor_deg", number("/rmse_deg/noise_floor")),
        (
            "holdout_rmse_nominal_deg",
            number("/holdout_rmse_deg/nominal"),
        ),
        ("holdout_rmse_refit_deg", number("/holdout_rmse_deg/refit")),
        (
            "holdout_rmse_repaired_deg",
            number("/holdout_rmse_deg/repaired"),
        ),
        ("remaining_rmse_deg", number("/remaining/rmse_deg")),
        (
            "upload",
            Cells::Flag(
                rows.iter()
                    .map(|row| row.at("/upload").and_then(Value::as_bool))
                    .collect(),
            ),
        ),
        ("seconds", number("/seconds")),
        ("tool_version", text(&|row| row.text("/tool_version"))),
        ("interval95_json", text(&|row| row.of_effects("interval95"))),
        ("ended", text(&|row| row.text("/ended"))),
        ("seed", number("/seed")),
    ]
}

/// Rows that are written at once: verdicts of more would take gigabytes.
const GROUP: usize = 10_000;

/// Writes the table.
///
/// # Errors
///
/// Errors of the rows, the library and the disk.
pub fn write(
    path: &Path,
    rows: impl IntoIterator<Item = anyhow::Result<CaseResult>>,
) -> anyhow::Result<()> {
    let fields = columns(&[])
        .iter()
        .map(|(name, cells)| {
            let (physical, logical) = match cells {
                Cells::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                Cells::Number(_) => (Physical::DOUBLE, None),
                Cells::Flag(_) => (Physical::BOOLEAN, None),
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical)
                .build()?;
            Ok(Arc::new(field))
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let schema = Type::group_type_builder("results")
        .with_fields(fields)
        .build()?;
    let mut writer = SerializedFileWriter::new(
        Vec::new(),
        Arc::new(schema),
        Arc::new(WriterProperties::default()),
    )?;
    let mut rows = rows.into_iter();
    loop {
        let some: Vec<CaseResult> = rows.by_ref().take(GROUP).collect::<Result<_, _>>()?;
        if some.is_empty() {
            break;
        }
        write_group(&mut writer, &columns(&some))?;
    }
    let bytes = writer.into_inner()?;
    Ok(write_atomically(path, &bytes)?)
}

/// Writes the cells of some rows.
fn write_group(
    writer: &mut SerializedFileWriter<Vec<u8>>,
    columns: &[(&str, Cells)],
) -> anyhow::Result<()> {
    let mut group = writer.next_row_group()?;
    for (_, cells) in columns {
        let mut column = group
            .next_column()?
            .context("as many columns as in the schema")?;
        match (column.untyped(), cells) {
            (ColumnWriter::ByteArrayColumnWriter(writer), Cells::Text(cells)) => {
                let bytes = |text: &String| ByteArray::from(text.as_str());
                let (values, levels) = present(cells, bytes);
                writer.write_batch(&values, Some(&levels), None)?;
            }
            (ColumnWriter::DoubleColumnWriter(writer), Cells::Number(cells)) => {
                let (values, levels) = present(cells, |&number| number);
                writer.write_batch(&values, Some(&levels), None)?;
            }
            (ColumnWriter::BoolColumnWriter(writer), Cells::Flag(cells)) => {
                let (values, levels) = present(cells, |&flag| flag);
                writer.write_batch(&values, Some(&levels), None)?;
            }
            _ => anyhow::bail!("a column is not of the type of its schema"),
        }
        column.close()?;
    }
    group.close()?;
    Ok(())
}

/// The values that are there, and for each cell whether it is.
fn present<T, V>(cells: &[Option<T>], value: impl Fn(&T) -> V) -> (Vec<V>, Vec<i16>) {
    let levels = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    (cells.iter().flatten().map(value).collect(), levels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;

    #[test]
    fn a_table_is_read_back_with_its_gaps() {
        let verdict = serde_json::json!({
            "verdict": "effect_found",
            "effects": [{"kind": "gravity", "parameters": {"force_n": 0.5},
                         "interval95": {"force_n": [0.4, 0.6]}, "probability": 0.9}],
            "ended": "budget",
            "seed": 7,
            "alternatives": [{"kinds": ["gravity"]}, {"kinds": ["end_stop", "leak"]}],
            "rmse_deg": {"nominal": 4.5},
            "upload": true,
        });
        let rows = [
            CaseResult {
                case: "a".into(),
                status: "diagnosed",
                error: None,
                warnings: Some("a.csv: is not complete".into()),
                verdict: Some(verdict),
            },
            CaseResult {
                case: "b".into(),
                status: "failed",
                error: Some("no such file".into()),
                warnings: None,
                verdict: None,
            },
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("results.parquet");
        write(&path, rows.into_iter().map(Ok)).unwrap();
        let reader = SerializedFileReader::new(std::fs::File::open(&path).unwrap()).unwrap();
        let read: Vec<_> = reader
            .get_row_iter(None)
            .unwrap()
            .map(Result::unwrap)
            .collect();
        assert_eq!(read.len(), 2);
        let column = |name: &str| {
            read[0]
                .get_column_iter()
                .position(|(column, _)| column == name)
                .unwrap()
        };
        let effects = column("effects");
        assert_eq!(read[0].get_string(effects).unwrap(), "gravity");
        let rivals = column("alternatives");
        assert_eq!(
            read[0].get_string(rivals).unwrap(),
            "gravity | end_stop + leak"
        );
        let nominal = read[0].get_double(column("rmse_nominal_deg")).unwrap();
        assert!((nominal - 4.5).abs() < 1e-12);
        assert!(read[0].get_bool(column("upload")).unwrap());
        assert_eq!(read[1].get_string(column("error")).unwrap(), "no such file");
        let text = |name: &str| read[0].get_string(column(name)).unwrap().clone();
        assert_eq!(text("ended"), "budget");
        assert_eq!(text("interval95_json"), r#"[{"force_n":[0.4,0.6]}]"#);
        let seed = read[0].get_double(column("seed")).unwrap();
        assert!((seed - 7.0).abs() < 1e-12);
        assert!(read[1].get_string(effects).is_err(), "a gap");
    }
}
