//! Writes a recording in another format, so that it can be read back unchanged.
//!
//! A binary number does not keep its number of decimals. So the formats of `softrig convert` store
//! it for each column, with the metadata of the recording: converted back to CSV, every digit
//! is the same.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

use super::binary::{self, Binary};
use super::{Decimals, Samples, Sheet, Values};
use crate::columns::Quantity;
use crate::recording::{Column, Meta};

/// A format that is written.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, EnumMessage, EnumString, IntoStaticStr, VariantArray,
)]
#[strum(serialize_all = "lowercase")]
pub enum Format {
    /// Text, a row a sample
    Csv,
    /// The same, packed
    #[strum(serialize = "csv.gz")]
    CsvGz,
    /// For pandas, polars, DuckDB and R
    Parquet,
    /// For Foxglove and PlotJuggler
    Mcap,
}

impl Format {
    /// The extension of such files.
    pub fn ending(self) -> &'static str {
        self.into()
    }

    /// The format that the name of a file asks for.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?;
        Self::VARIANTS
            .iter()
            .copied()
            .find(|format| name.ends_with(&format!(".{}", format.ending())))
    }

    /// Whether metadata are in the file itself, not beside it.
    pub fn holds_metadata(self) -> bool {
        matches!(self, Self::Parquet | Self::Mcap)
    }
}

/// The parts of a recording that a binary file keeps besides its numbers.
#[derive(Clone, Debug, Default)]
pub struct Kept {
    /// Its metadata, as TOML.
    pub meta: Option<String>,
    decimals: BTreeMap<String, usize>,
}

/// Keys of what is kept.
const META: &str = "softrig.meta";
const DECIMALS: &str = "softrig.decimals";

impl Kept {
    /// Looks it up among the entries of a file.
    pub fn of(entry: impl Fn(&str) -> Option<String>) -> Self {
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

    /// Those of a table.
    pub fn of_sheet(sheet: &Sheet) -> Self {
        let known = |(name, values): &(String, Values)| match values {
            Values::Numbers(_, Decimals::All(count)) => Some((name.clone(), *count)),
            _ => None,
        };
        Self {
            meta: sheet.meta.clone(),
            decimals: sheet.columns.iter().filter_map(known).collect(),
        }
    }

    /// How many decimals the numbers of a column have.
    pub fn decimals(&self, column: &str) -> Option<usize> {
        self.decimals.get(column).copied()
    }

    /// The entries of a file that keep it.
    pub fn entries(self) -> Vec<(String, String)> {
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
/// Errors of the libraries.
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
        Format::Parquet => binary::write(Binary::Parquet, &sheet, &about),
        Format::Mcap => binary::write(Binary::Mcap, &sheet, &about),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::{Columns, Layout};
    use crate::error::InputError;

    /// A recording of `softrig record`, with what is not known left empty.
    const RECORDED: &str = "\
time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq
0.000,-0.05,59.81,60.00,,-12,,idle,0,007
0.010,10.10,59.90,60.00,,0,59.81,running,0,008
0.030,1234.56,-0.00,,40.50,12000,1.00,\"a, b\",0,009
";

    const META: &str = "protocol = \"paper\"\nstarted = \"2024-05-01T12:00:00Z\"\nsamples = 3\n";

    fn read(bytes: &[u8], name: &str) -> Result<Samples, InputError> {
        crate::formats::read_bytes(bytes, Path::new(name), &Layout::default())
    }

    fn written(format: Format) -> Vec<u8> {
        let samples = read(RECORDED.as_bytes(), "run.csv").unwrap();
        bytes(samples, Some(META.into()), format).unwrap()
    }

    #[test]
    fn there_and_back_every_digit_is_where_it_was() {
        for format in [Format::Csv, Format::CsvGz] {
            let samples = read(&written(format), "run").unwrap();
            let again = bytes(samples, None, Format::Csv).unwrap();
            assert_eq!(String::from_utf8(again).unwrap(), RECORDED, "{format:?}");
        }
    }

    #[test]
    fn what_is_converted_is_in_the_units_of_a_recording() {
        let layout = Layout {
            names: crate::columns::Names::parse("time=t").unwrap(),
            columns: Columns::of_units("time=ms,pressure=bar").unwrap(),
            ..Layout::default()
        };
        let text = "t,time_s,pressure_kpa,angle_deg\n0,7,0.25,1.50\n20,8,0.5,2.50\n";
        let samples =
            crate::formats::read_bytes(text.as_bytes(), Path::new("a.csv"), &layout).unwrap();
        let csv = bytes(samples, None, Format::Csv).unwrap();
        assert_eq!(
            String::from_utf8(csv).unwrap(),
            "time_s,pressure_kpa,angle_deg,time_s_2\n0,25,1.50,7\n0.02,50,2.50,8\n"
        );
    }
}
