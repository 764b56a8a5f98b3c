//! Parquet: the tables of pandas, polars, DuckDB and R.
//!
//! Flat columns of numbers and texts are read, by name and type. The unit of a time column with a
//! timestamp type is known. Files of `softrig convert` contain the metadata of the recording.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{
    Compression, ConvertedType, LogicalType, Repetition, TimeUnit as Stamp, Type as Physical,
};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ColumnChunkMetaData, KeyValue, RowGroupMetaData};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnDescriptor, Type};

use crate::guard::guarded;
use softrig_formats::bounded::Limits;
use softrig_formats::columns::{Layout, Quantity, TimeUnit};
use softrig_formats::error::InputError;
use softrig_formats::formats::write::Kept;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged};

/// Rows that are read at a time.
const BATCH: usize = 8192;

/// Reads a Parquet file.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the columns that it has.
pub fn read(
    file: impl ChunkReader + 'static,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    guarded(|| sheet(file, path, layout, limits))
        .map_err(|said| damaged(path, "Parquet", &said))??
        .samples(path, layout, limits, "column")
}

fn sheet(
    file: impl ChunkReader + 'static,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Sheet, InputError> {
    let fail = |error: ParquetError| damaged(path, "Parquet", &error);
    let reader = SerializedFileReader::new(file).map_err(fail)?;
    let about = reader.metadata().file_metadata();
    let schema = about.schema_descr();
    // What it says to hold, before anything is read of it.
    let rows = u64::try_from(about.num_rows()).unwrap_or(u64::MAX);
    let check = |rows: u64| {
        let checked = limits.check(rows, schema.num_columns());
        checked.map_err(|error| error.in_file(path))
    };
    check(rows)?;
    let packed = reader.metadata().row_groups().iter();
    if packed
        .map(|group| u64::try_from(group.total_byte_size()).unwrap_or(u64::MAX))
        .fold(0, u64::saturating_add)
        > limits.bytes
    {
        return Err(softrig_formats::bounded::too_large(limits.bytes).in_file(path));
    }
    let columns = reader.metadata().row_groups().iter();
    if let Some(unread) = columns
        .flat_map(RowGroupMetaData::columns)
        .map(ColumnChunkMetaData::compression)
        .find(|codec| {
            matches!(codec, Compression::LZO)
                || (cfg!(not(feature = "native")) && matches!(codec, Compression::ZSTD(_)))
        })
    {
        return Err(InputError::new(
            format!("is compressed with {unread}, which is not read"),
            "write it again with another compression: pandas with to_parquet(\"run.parquet\", compression=\"snappy\")",
        )
        .in_file(path));
    }
    let kept = Kept::of(|key| {
        let entries = about.key_value_metadata()?.iter();
        let mut found = entries.filter(|entry| entry.key == key);
        found.next()?.value.clone()
    });
    let mut sheet = Sheet {
        meta: kept.meta.clone(),
        ..Sheet::default()
    };
    for (place, column) in schema.columns().iter().enumerate() {
        if column.max_rep_level() > 0 || column.path().parts().len() > 1 {
            // A list or a record in each row: no sensor's column.
            continue;
        }
        let name = column.name();
        if name == layout.names.of(Quantity::Time)
            && let Some(unit) = unit_of_stamps(column)
        {
            sheet.columns_say.time = Some(unit);
        }
        let mut values: Option<Values> = None;
        for group in 0..reader.num_row_groups() {
            let group = reader.get_row_group(group).map_err(fail)?;
            let count = usize::try_from(group.metadata().num_rows()).unwrap_or(0);
            let part = read_column(group.get_column_reader(place).map_err(fail)?, column, count)
                .map_err(fail)?;
            values = match (values, part) {
                (Some(Values::Numbers(mut all, decimals)), Some(Values::Numbers(part, _))) => {
                    all.extend(part);
                    Some(Values::Numbers(all, decimals))
                }
                (Some(Values::Texts(mut all)), Some(Values::Texts(part))) => {
                    all.extend(part);
                    Some(Values::Texts(all))
                }
                (_, part) => part,
            };
            check(values.as_ref().map_or(0, |it| it.len() as u64))?;
        }
        if let Some(mut values) = values {
            if let (Values::Numbers(_, decimals), Some(known)) = (&mut values, kept.decimals(name))
            {
                *decimals = Decimals::All(known);
            }
            sheet.columns.push((name.to_owned(), values));
        }
    }
    Ok(sheet)
}

/// The unit of a column of time stamps.
fn unit_of_stamps(column: &ColumnDescriptor) -> Option<TimeUnit> {
    let of = |unit: Stamp| match unit {
        Stamp::MILLIS => TimeUnit::Ms,
        Stamp::MICROS => TimeUnit::Us,
        Stamp::NANOS => TimeUnit::Ns,
    };
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(stamp) | LogicalType::Time(stamp)), _) => Some(of(stamp.unit)),
        (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => Some(TimeUnit::Ms),
        (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => Some(TimeUnit::Us),
        _ => None,
    }
}

/// The values of a column in one group of rows; none if they are of a type that is not read.
fn read_column(
    reader: ColumnReader,
    column: &ColumnDescriptor,
    count: usize,
) -> Result<Option<Values>, ParquetError> {
    fn numbers<T: DataType>(
        reader: ColumnReaderImpl<T>,
        column: &ColumnDescriptor,
        count: usize,
        decimals: Decimals,
        number: impl Fn(&T::T) -> f64,
    ) -> Result<Option<Values>, ParquetError> {
        let values = cells(reader, column, count, f64::NAN, number)?;
        Ok(Some(Values::Numbers(values, decimals)))
    }
    let whole = Decimals::All(0);
    match reader {
        ColumnReader::BoolColumnReader(reader) => {
            numbers(reader, column, count, whole, |&it| f64::from(u8::from(it)))
        }
        ColumnReader::Int32ColumnReader(reader) => {
            numbers(reader, column, count, whole, |&it| f64::from(it))
        }
        ColumnReader::Int64ColumnReader(reader) => {
            numbers(reader, column, count, whole, |&it| it as f64)
        }
        ColumnReader::FloatColumnReader(reader) => {
            numbers(reader, column, count, Decimals::Various, |&it| it.into())
        }
        ColumnReader::DoubleColumnReader(reader) => {
            numbers(reader, column, count, Decimals::Various, |&it| it)
        }
        ColumnReader::ByteArrayColumnReader(reader) => {
            let text = |it: &ByteArray| {
                // Without bytes in it, it has none to show.
                let bytes = if it.is_empty() { &[][..] } else { it.data() };
                String::from_utf8_lossy(bytes).into_owned()
            };
            cells(reader, column, count, String::new(), text).map(|it| Some(Values::Texts(it)))
        }
        ColumnReader::Int96ColumnReader(_) | ColumnReader::FixedLenByteArrayColumnReader(_) => {
            Ok(None)
        }
    }
}

/// One value a row, `nothing` where there is none.
fn cells<T: DataType, V: Clone>(
    mut reader: ColumnReaderImpl<T>,
    column: &ColumnDescriptor,
    count: usize,
    nothing: V,
    value: impl Fn(&T::T) -> V,
) -> Result<Vec<V>, ParquetError> {
    let is_optional = column.max_def_level() > 0;
    let mut cells = Vec::new();
    let (mut values, mut levels) = (Vec::new(), Vec::new());
    while cells.len() < count {
        values.clear();
        levels.clear();
        let wanted = BATCH.min(count - cells.len());
        let (rows, ..) = reader.read_records(
            wanted,
            is_optional.then_some(&mut levels),
            None,
            &mut values,
        )?;
        if rows == 0 {
            return Err(ParquetError::General(format!(
                "column {} has {} of {count} values",
                column.name(),
                cells.len()
            )));
        }
        let mut present = values.iter();
        if is_optional {
            cells.extend(levels.iter().map(|&level| {
                let here = (level == column.max_def_level()).then(|| present.next());
                here.flatten().map_or_else(|| nothing.clone(), &value)
            }));
        } else {
            cells.extend(present.map(&value));
        }
    }
    Ok(cells)
}

/// A recording as a Parquet file.
///
/// # Errors
///
/// Errors of the library.
pub(crate) fn write(table: &Sheet) -> anyhow::Result<Vec<u8>> {
    let fields = table
        .columns
        .iter()
        .map(|(name, cells)| {
            let (physical, logical) = match cells {
                Values::Texts(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                Values::Numbers(..) => (Physical::DOUBLE, None),
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_repetition(Repetition::OPTIONAL)
                .with_logical_type(logical)
                .build()?;
            Ok(Arc::new(field))
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    let schema = Type::group_type_builder("recording")
        .with_fields(fields)
        .build()?;
    let kept = Kept::of_sheet(table).entries();
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::SNAPPY)
        .set_key_value_metadata(Some(
            kept.into_iter()
                .map(|(key, value)| KeyValue::new(key, value))
                .collect(),
        ))
        .build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    let mut group = writer.next_row_group()?;
    for (_, cells) in &table.columns {
        let Some(mut column) = group.next_column()? else {
            anyhow::bail!("there are more columns than in the schema");
        };
        match (column.untyped(), cells) {
            (ColumnWriter::ByteArrayColumnWriter(writer), Values::Texts(texts)) => {
                let there = texts.iter().filter(|text| !text.is_empty());
                let values: Vec<ByteArray> =
                    there.map(|text| ByteArray::from(text.as_str())).collect();
                let levels = levels(texts.iter().map(|text| !text.is_empty()));
                writer.write_batch(&values, Some(&levels), None)?;
            }
            (ColumnWriter::DoubleColumnWriter(writer), Values::Numbers(numbers, _)) => {
                let values: Vec<f64> = numbers.iter().copied().filter(|it| !it.is_nan()).collect();
                let levels = levels(numbers.iter().map(|it| !it.is_nan()));
                writer.write_batch(&values, Some(&levels), None)?;
            }
            _ => anyhow::bail!("a column is not of the type of its schema"),
        }
        column.close()?;
    }
    group.close()?;
    Ok(writer.into_inner()?)
}

/// For each cell whether it is there.
fn levels(there: impl Iterator<Item = bool>) -> Vec<i16> {
    there.map(i16::from).collect()
}
