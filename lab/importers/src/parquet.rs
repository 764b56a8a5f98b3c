//! Parquet: the tables of pandas, polars, DuckDB and R.
//!
//! Flat columns of numbers and texts are read, by name and type: decimals with their scale, half
//! floats, `INT96` of Spark, dates. The unit of a time column with a type of timestamps or durations
//! is known; durations are told by the schema of Arrow alone, which is in the file. What is not read
//! is named with its type. Files of `softrig convert` contain the metadata of the recording.

use std::path::Path;
use std::sync::Arc;

use parquet::basic::{
    Compression, ConvertedType, LogicalType, Repetition, TimeUnit as Stamp, Type as Physical,
};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::{ByteArray, DataType, Int96};
use parquet::errors::ParquetError;
use parquet::file::metadata::{ColumnChunkMetaData, KeyValue, RowGroupMetaData};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{ChunkReader, FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnDescriptor, Type};

use crate::guard::guarded;
use crate::half;
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
    let arrow = about.key_value_metadata().and_then(|entries| {
        let mut found = entries.iter().filter(|entry| entry.key == "ARROW:schema");
        found.next()?.value.clone()
    });
    let durations = arrow.map_or_else(Vec::new, |text| arrow::durations(&text));
    for (place, column) in schema.columns().iter().enumerate() {
        if let Some(is) = nested(column) {
            let name = column.path().parts()[0].clone();
            if !sheet.unread.iter().any(|(known, _)| *known == name) {
                sheet.unread.push((name, is.to_owned()));
            }
            continue;
        }
        let name = column.name();
        if name == layout.names.of(Quantity::Time) {
            let duration = durations.iter().find(|(known, _)| known == name);
            let by_arrow = duration.map(|(_, unit)| *unit);
            if let Some(unit) = unit_of_stamps(column).or(by_arrow) {
                sheet.columns_say.time = Some(unit);
            }
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
        } else {
            sheet.unread.push((name.to_owned(), type_of(column)));
        }
    }
    say_unread(&mut sheet, path);
    Ok(sheet)
}

/// What a column is that has a list or a record in each row, and so is no sensor's.
fn nested(column: &ColumnDescriptor) -> Option<&'static str> {
    match (column.max_rep_level(), column.path().parts().len()) {
        (0, 1) => None,
        (0, _) => Some("a column of records"),
        _ => Some("a column of lists"),
    }
}

/// Says which columns are left out.
fn say_unread(sheet: &mut Sheet, path: &Path) {
    if sheet.unread.is_empty() {
        return;
    }
    let all: Vec<String> = sheet
        .unread
        .iter()
        .map(|(name, is)| format!("{name} ({is})"))
        .collect();
    sheet.warnings.push(format!(
        "{}: not read, and left out: {}",
        path.display(),
        all.join(", ")
    ));
}

/// The unit of a column of time stamps.
fn unit_of_stamps(column: &ColumnDescriptor) -> Option<TimeUnit> {
    let of = |unit: Stamp| match unit {
        Stamp::MILLIS => TimeUnit::Ms,
        Stamp::MICROS => TimeUnit::Us,
        Stamp::NANOS => TimeUnit::Ns,
    };
    if column.physical_type() == Physical::INT96 {
        // They are read as seconds.
        return Some(TimeUnit::S);
    }
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Timestamp(stamp) | LogicalType::Time(stamp)), _) => Some(of(stamp.unit)),
        (_, ConvertedType::TIMESTAMP_MILLIS | ConvertedType::TIME_MILLIS) => Some(TimeUnit::Ms),
        (_, ConvertedType::TIMESTAMP_MICROS | ConvertedType::TIME_MICROS) => Some(TimeUnit::Us),
        (Some(LogicalType::Date), _) | (_, ConvertedType::DATE) => Some(TimeUnit::Day),
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
    if let Some(scale) = scale_of(column) {
        let shown = usize::try_from(scale).map_or(Decimals::Various, Decimals::All);
        let big = |bytes: &[u8]| of_two_complement(bytes) / 10f64.powi(scale);
        return match reader {
            ColumnReader::Int32ColumnReader(reader) => {
                numbers(reader, column, count, shown, |&it| {
                    f64::from(it) / 10f64.powi(scale)
                })
            }
            ColumnReader::Int64ColumnReader(reader) => {
                numbers(reader, column, count, shown, |&it| {
                    it as f64 / 10f64.powi(scale)
                })
            }
            ColumnReader::ByteArrayColumnReader(reader) => {
                numbers(reader, column, count, shown, |it| big(it.data()))
            }
            ColumnReader::FixedLenByteArrayColumnReader(reader) => {
                numbers(reader, column, count, shown, |it| big(it.data()))
            }
            _ => Ok(None),
        };
    }
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
        ColumnReader::Int96ColumnReader(reader) => {
            numbers(reader, column, count, Decimals::Various, seconds_of_int96)
        }
        ColumnReader::FixedLenByteArrayColumnReader(reader)
            if matches!(column.logical_type_ref(), Some(LogicalType::Float16)) =>
        {
            numbers(reader, column, count, Decimals::Various, |it| {
                half(it.data())
            })
        }
        ColumnReader::FixedLenByteArrayColumnReader(_) => Ok(None),
    }
}

/// How many decimals the whole numbers of a column have.
fn scale_of(column: &ColumnDescriptor) -> Option<i32> {
    match (column.logical_type_ref(), column.converted_type()) {
        (Some(LogicalType::Decimal(decimal)), _) => Some(decimal.scale),
        (_, ConvertedType::DECIMAL) => Some(column.type_scale()),
        _ => None,
    }
}

/// A whole number with a sign, its highest byte first.
fn of_two_complement(bytes: &[u8]) -> f64 {
    let Some((first, rest)) = bytes.split_first() else {
        return f64::NAN;
    };
    let first = i128::from(first.cast_signed());
    // Of more than sixteen bytes the first are signs: no decimal of 38 digits has more.
    let all = rest
        .iter()
        .fold(first, |all, byte| all.wrapping_shl(8) | i128::from(*byte));
    all as f64
}

/// The time (s since 1970) of Spark and Impala: nanoseconds of a Julian day.
fn seconds_of_int96(stamp: &Int96) -> f64 {
    const DAY_OF_1970: f64 = 2_440_588.0;
    let &[low, high, day] = stamp.data() else {
        return f64::NAN;
    };
    let nanoseconds = u64::from(high) << 32 | u64::from(low);
    (f64::from(day) - DAY_OF_1970) * 86_400.0 + nanoseconds as f64 / 1e9
}

/// The type of a column, for messages.
fn type_of(column: &ColumnDescriptor) -> String {
    let physical = column.physical_type();
    match column.logical_type_ref() {
        Some(logical) => format!("of the type {logical:?}, stored as {physical}"),
        None => format!("of the type {physical}"),
    }
}

/// The schema of Arrow that a Parquet file may have in it, for what Parquet itself cannot say.
mod arrow {
    use super::TimeUnit;

    /// The types of columns, by their numbers in Arrow's format.
    const DURATION: u8 = 18;

    /// The columns that hold durations, and their units; none if the schema cannot be read.
    pub(super) fn durations(schema: &str) -> Vec<(String, TimeUnit)> {
        read(&bytes_of(schema)).unwrap_or_default()
    }

    /// Base 64, without what is no letter of it.
    fn bytes_of(text: &str) -> Vec<u8> {
        let letters = text.bytes().filter_map(|byte| {
            Some(match byte {
                b'A'..=b'Z' => byte - b'A',
                b'a'..=b'z' => byte - b'a' + 26,
                b'0'..=b'9' => byte - b'0' + 52,
                b'+' => 62,
                b'/' => 63,
                _ => return None,
            })
        });
        let letters: Vec<u8> = letters.collect();
        let mut bytes = Vec::with_capacity(letters.len() * 3 / 4);
        for four in letters.chunks(4) {
            let all = four
                .iter()
                .fold(0_u32, |all, letter| all << 6 | u32::from(*letter));
            let all = all << (6 * (4 - four.len()));
            bytes.extend(&all.to_be_bytes()[1..four.len()]);
        }
        bytes
    }

    fn number<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
        bytes.get(at..at.checked_add(N)?)?.try_into().ok()
    }

    fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
        number(bytes, at).map(|it| u32::from_le_bytes(it) as usize)
    }

    /// Where a flat buffer refers to from a place.
    fn follow(bytes: &[u8], at: usize) -> Option<usize> {
        at.checked_add(u32_at(bytes, at)?)
    }

    /// Where a field of a table of a flat buffer stands; none if it has its default.
    fn field(bytes: &[u8], table: usize, number_of: usize) -> Option<usize> {
        let back = i32::from_le_bytes(number(bytes, table)?);
        let fields = usize::try_from(i64::try_from(table).ok()? - i64::from(back)).ok()?;
        let size = usize::from(u16::from_le_bytes(number(bytes, fields)?));
        let entry = 4 + 2 * number_of;
        if entry + 2 > size {
            return None;
        }
        match u16::from_le_bytes(number(bytes, fields + entry)?) {
            0 => None,
            offset => table.checked_add(usize::from(offset)),
        }
    }

    fn read(message: &[u8]) -> Option<Vec<(String, TimeUnit)>> {
        // A mark and the length stand before the message.
        let begins = if message.starts_with(&[0xff; 4]) {
            8
        } else {
            4
        };
        let bytes = message.get(begins..)?;
        let root = follow(bytes, 0)?;
        let schema = follow(bytes, field(bytes, root, 2)?)?;
        let fields = follow(bytes, field(bytes, schema, 1)?)?;
        let mut found = Vec::new();
        for index in 0..u32_at(bytes, fields)? {
            let column = follow(bytes, fields.checked_add(4 + 4 * index)?)?;
            let kind = field(bytes, column, 2).and_then(|at| bytes.get(at));
            if kind != Some(&DURATION) {
                continue;
            }
            let name = follow(bytes, field(bytes, column, 0)?)?;
            let length = u32_at(bytes, name)?;
            let name = bytes.get(name + 4..(name + 4).checked_add(length)?)?;
            let of = follow(bytes, field(bytes, column, 3)?)?;
            // Milliseconds are the default.
            let unit =
                field(bytes, of, 0).map_or(Some(1), |at| number(bytes, at).map(u16::from_le_bytes));
            let unit = match unit? {
                0 => TimeUnit::S,
                1 => TimeUnit::Ms,
                2 => TimeUnit::Us,
                _ => TimeUnit::Ns,
            };
            found.push((String::from_utf8_lossy(name).into_owned(), unit));
        }
        Some(found)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_parquet_have_their_meaning() {
        for (bits, number) in [
            (0x3c00_u16, 1.0),
            (0xc000, -2.0),
            (0x3555, 0.333_251_953_125),
            (0x0001, 2f64.powi(-24)),
        ] {
            assert!(
                (half(&bits.to_le_bytes()) - number).abs() < 1e-12,
                "{bits:x}"
            );
        }
        assert!(half(&[0, 0x7e]).is_nan() && half(&[0]).is_nan());
        assert!((of_two_complement(&[0xff, 0x38]) + 200.0).abs() < 1e-12);
        assert!((of_two_complement(&[0, 0, 1, 0]) - 256.0).abs() < 1e-12);
        let mut stamp = Int96::new();
        // Half a second past noon of 1970-01-02.
        let nanoseconds = 43_200_500_000_000_u64;
        stamp.set_data(
            u32::try_from(nanoseconds & 0xffff_ffff).unwrap(),
            u32::try_from(nanoseconds >> 32).unwrap(),
            2_440_589,
        );
        assert!((seconds_of_int96(&stamp) - 129_600.5).abs() < 1e-9);
    }

    #[test]
    fn a_schema_of_arrow_that_is_none_says_nothing() {
        for text in [
            "",
            "!",
            "/////+gAAAAQAAAAAAAKAAwABgAFAAgACgAAAAABBAAMAAAA",
            "AAAA",
        ] {
            assert!(arrow::durations(text).is_empty(), "{text}");
        }
    }
}
