//! Writing a recording in another format, so that it reads back the same.
//!
//! A number in binary has no decimals, and a table of text has nothing but them. So the
//! formats that `rig convert` writes carry along how many each column had, and the metadata
//! of the recording: back as CSV, every digit is where it was.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use super::{Decimals, Samples, Sheet, Values};
use crate::columns::Quantity;
use crate::recording::{Column, Meta};

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Text, a row a sample
    Csv,
    /// The same, packed
    #[value(name = "csv.gz")]
    CsvGz,
    /// For pandas, polars, DuckDB and R
    Parquet,
    /// For Foxglove and PlotJuggler
    Mcap,
}

impl Format {
    /// What the names of such files end in.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::CsvGz => "csv.gz",
            Self::Parquet => "parquet",
            Self::Mcap => "mcap",
        }
    }

    /// The format that the name of a file asks for.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        [Self::CsvGz, Self::Csv, Self::Parquet, Self::Mcap]
            .into_iter()
            .find(|format| name.ends_with(&format!(".{}", format.ending())))
    }

    /// Whether metadata stand in the file itself, and not beside it.
    pub fn holds_metadata(self) -> bool {
        matches!(self, Self::Parquet | Self::Mcap)
    }
}

/// What a binary file carries along of a recording, besides its numbers.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Its metadata, as TOML.
    pub meta: Option<String>,
    decimals: BTreeMap<String, usize>,
}

/// Keys of what is kept.
const META: &str = "softrig.meta";
const DECIMALS: &str = "softrig.decimals";

impl Kept {
    /// Looks it up among the entries of a file.
    pub(super) fn of(entry: impl Fn(&str) -> Option<String>) -> Self {
        let decimals = entry(DECIMALS).unwrap_or_default();
        let mut decimals: BTreeMap<String, usize> =
            serde_json::from_str(&decimals).unwrap_or_default();
        // More than any number has, and not so many that they fill the memory.
        decimals.retain(|_, count| *count <= 30);
        Self {
            meta: entry(META),
            decimals,
        }
    }

    pub(super) fn of_sheet(sheet: &Sheet) -> Self {
        let known = |(name, values): &(String, Values)| match values {
            Values::Numbers(_, Decimals::All(count)) => Some((name.clone(), *count)),
            _ => None,
        };
        Self {
            meta: sheet.meta.clone(),
            decimals: sheet.columns.iter().filter_map(known).collect(),
        }
    }

    pub(super) fn decimals(&self, column: &str) -> Option<usize> {
        self.decimals.get(column).copied()
    }

    pub(super) fn entries(self) -> Vec<(String, String)> {
        let decimals = serde_json::to_string(&self.decimals).unwrap_or_default();
        let meta = self.meta.map(|meta| (META.to_owned(), meta));
        meta.into_iter()
            .chain([(DECIMALS.to_owned(), decimals)])
            .collect()
    }
}

/// The bytes of a file with these samples; `meta` is what is known about them, as TOML.
///
/// # Errors
///
/// Those of the libraries.
pub fn bytes(samples: Samples, meta: Option<String>, format: Format) -> anyhow::Result<Vec<u8>> {
    let about: Meta = meta
        .as_deref()
        .and_then(|text| toml::from_str(text).ok())
        .unwrap_or_default();
    let mut sheet = sheet(samples);
    sheet.meta = meta;
    match format {
        Format::Csv => csv(&sheet),
        Format::CsvGz => {
            let mut packed =
                flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
            packed.write_all(&csv(&sheet)?)?;
            Ok(packed.finish()?)
        }
        Format::Parquet => super::parquet::write(&sheet),
        Format::Mcap => super::mcap::write(&sheet, &about),
    }
}

fn sheet(samples: Samples) -> Sheet {
    let Samples {
        time_s,
        pressure_kpa,
        angle_deg,
        decimals,
        extra,
        ..
    } = samples;
    let mut columns: Vec<(String, Values)> = Quantity::ALL
        .into_iter()
        .zip([time_s, pressure_kpa, angle_deg])
        .map(|(quantity, numbers)| {
            let values = Values::Numbers(numbers, decimals[quantity as usize]);
            (quantity.column().to_owned(), values)
        })
        .collect();
    for Column { name, fields } in extra {
        // A file may have a column time_s besides the one that was named as the time.
        let mut free = name.clone();
        while columns.iter().any(|(taken, _)| *taken == free) {
            free += "_2";
        }
        columns.push((free, values(fields)));
    }
    Sheet {
        columns,
        ..Sheet::default()
    }
}

/// The numbers of a column, if it has nothing else and loses nothing by it.
fn values(fields: Vec<String>) -> Values {
    let mut decimals = Decimals::None;
    for field in fields.iter().filter(|field| !field.is_empty()) {
        decimals.count(field);
    }
    let number = |field: &String| match field.as_str() {
        "" => Some(f64::NAN),
        field => {
            let number = field.parse::<f64>().ok().filter(|it| it.is_finite())?;
            // 007 is a name.
            let is_same = matches!(decimals, Decimals::Various) || decimals.show(number) == field;
            is_same.then_some(number)
        }
    };
    match fields.iter().map(number).collect::<Option<Vec<f64>>>() {
        Some(numbers) if decimals != Decimals::None => Values::Numbers(numbers, decimals),
        _ => Values::Texts(fields),
    }
}

fn csv(sheet: &Sheet) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(sheet.columns.iter().map(|(name, _)| name))?;
    let rows = sheet.columns.first().map_or(0, |(_, values)| values.len());
    let mut record = csv::StringRecord::new();
    for row in 0..rows {
        record.clear();
        for (_, values) in &sheet.columns {
            match values {
                Values::Texts(texts) => record.push_field(&texts[row]),
                Values::Numbers(numbers, decimals) => {
                    record.push_field(&decimals.show(numbers[row]));
                }
            }
        }
        writer.write_record(&record)?;
    }
    Ok(writer.into_inner()?)
}
