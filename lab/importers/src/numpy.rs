//! NumPy: `.npz` of `numpy.savez` and `savez_compressed`, and `.npy` of `numpy.save`.
//!
//! Each array of one dimension is a column by its name. The columns of an array with two are
//! called `name[0]`, `name[1]`, …; those of an `.npy`, which has no name, `#1`, `#2`, ….

use std::io::{Cursor, Read};
use std::path::Path;

use npyz::{DType, NpyFile, Order, TimeUnits, TypeChar, TypeStr};
use zip::ZipArchive;

use crate::guard::guarded;
use softrig_formats::bounded::{self, Limits};
use softrig_formats::columns::{Layout, Quantity, TimeUnit};
use softrig_formats::error::InputError;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged, read_whole};

/// Reads a packed file: arrays of numpy, and nothing else.
///
/// # Errors
///
/// Names the file and what it is instead.
pub fn read_npz(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let fail = |error: &dyn std::fmt::Display| damaged(path, "packed", error);
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(|error| fail(&error))?;
    #[cfg(feature = "native")]
    if is_spreadsheet(&archive) {
        return crate::excel::read(archive.into_inner().into_inner(), path, layout, limits);
    }
    let mut sheet = Sheet::default();
    let mut left = limits.bytes;
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|error| fail(&error))?;
        let Some(name) = entry.name().strip_suffix(".npy").map(str::to_owned) else {
            continue;
        };
        let mut bytes = Vec::new();
        entry
            .take(left + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| fail(&error))?;
        left = left
            .checked_sub(bytes.len() as u64)
            .ok_or_else(|| bounded::too_large(limits.bytes).in_file(path))?;
        let called = |number, count| match count {
            1 => name.clone(),
            _ => format!("{name}[{number}]"),
        };
        match array(&bytes, path, &called)? {
            Array::Read {
                columns,
                in_seconds,
            } => {
                let time = layout.names.of(Quantity::Time);
                if in_seconds && columns.iter().any(|(name, _)| name == time) {
                    sheet.columns_say.time = Some(TimeUnit::S);
                }
                sheet.columns.extend(columns);
            }
            Array::Unread(is) => sheet.unread.push((name, is)),
        }
    }
    if sheet.columns.is_empty() && sheet.unread.is_empty() {
        let (found, advice) = if is_spreadsheet(&archive) {
            ("is a spreadsheet of Excel", "export the sheet as CSV")
        } else {
            (
                "is a packed file without arrays of numpy in it",
                "unpack it, or export a sheet as CSV",
            )
        };
        return Err(InputError::new(found, advice).in_file(path));
    }
    sheet.samples(path, layout, limits, "array")
}

/// Whether a packed file is one of Excel's.
fn is_spreadsheet(archive: &ZipArchive<Cursor<Vec<u8>>>) -> bool {
    let mut names = archive.file_names();
    names.any(|name| name.starts_with("xl/"))
}

/// Reads a single array.
///
/// # Errors
///
/// Names the file.
pub fn read_npy(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let columns = match array(&bytes, path, &|number, _| format!("#{}", number + 1))? {
        Array::Read { columns, .. } => columns,
        Array::Unread(is) => {
            return Err(InputError::new(
                format!("is {is}, which is not read"),
                "save numbers: numpy.save(\"run.npy\", array.astype(float))",
            )
            .in_file(path));
        }
    };
    let sheet = Sheet {
        columns,
        ..Sheet::default()
    };
    sheet.samples(path, layout, limits, "column")
}

/// [`columns`] of a file that may be damaged.
fn array(
    bytes: &[u8],
    path: &Path,
    called: &dyn Fn(usize, usize) -> String,
) -> Result<Array, InputError> {
    guarded(|| columns(bytes, called))
        .map_err(|said| damaged(path, "NumPy", &said))?
        .map_err(|error| damaged(path, "NumPy", &error))
}

/// An array of a file.
enum Array {
    /// Its columns, and whether they are times in seconds by their type.
    Read {
        columns: Vec<(String, Values)>,
        in_seconds: bool,
    },
    /// What it is that is not read.
    Unread(String),
}

/// The columns of an array, called by their numbers from 0 and how many there are.
fn columns(bytes: &[u8], called: &dyn Fn(usize, usize) -> String) -> std::io::Result<Array> {
    let file = NpyFile::new(bytes)?;
    let shape: Vec<usize> = file
        .shape()
        .iter()
        .map(|&length| usize::try_from(length).unwrap_or(usize::MAX))
        .collect();
    let order = file.order();
    let (rows, count) = match *shape.as_slice() {
        // A row of MATLAB's kind is one too.
        [rows] | [1, rows] => (rows, 1),
        [rows, count] => (rows, count),
        ref shape => {
            return Ok(Array::Unread(format!(
                "an array of {} dimensions",
                shape.len()
            )));
        }
    };
    // The header may say anything; eight bits are the least that a number has.
    if rows.saturating_mul(count) > bytes.len() {
        return Err(std::io::Error::other("it is shorter than its header says"));
    }
    let kind = match file.dtype() {
        DType::Plain(kind) => Some(kind),
        _ => None,
    };
    let Some(numbers) = numbers(file)? else {
        return Ok(Array::Unread(named(kind.as_ref())));
    };
    let in_seconds = kind.is_some_and(|kind| kind.time_units().is_some());
    let columns = (0..count).map(|column| {
        let values = (0..rows).map(|row| match order {
            Order::C => numbers[row * count + column],
            Order::Fortran => numbers[column * rows + row],
        });
        let values = Values::Numbers(values.collect(), Decimals::Various);
        (called(column, count), values)
    });
    Ok(Array::Read {
        columns: columns.collect(),
        in_seconds,
    })
}

/// What an array is that holds no numbers.
fn named(kind: Option<&TypeStr>) -> String {
    let Some(kind) = kind else {
        return "a structured array, with several fields in each element".to_owned();
    };
    match kind.type_char() {
        TypeChar::Object => "an array of objects of Python, which are pickled".to_owned(),
        TypeChar::Complex => "complex".to_owned(),
        TypeChar::UnicodeStr | TypeChar::ByteStr => "text".to_owned(),
        TypeChar::TimeDelta | TypeChar::DateTime => {
            format!("times of the type {kind}, whose unit has no fixed length")
        }
        _ => format!("of the type {kind}"),
    }
}

/// Seconds in a unit of numpy's times; none in months and years.
fn seconds(units: TimeUnits) -> Option<f64> {
    let written = units.to_string();
    let digits = written.len()
        - written
            .trim_start_matches(|it: char| it.is_ascii_digit())
            .len();
    let (count, unit) = written.split_at(digits);
    let count: f64 = if count.is_empty() {
        1.0
    } else {
        count.parse().ok()?
    };
    let unit = match unit {
        "W" => 604_800.0,
        "D" => 86_400.0,
        "h" => 3_600.0,
        "m" => 60.0,
        "s" => 1.0,
        "ms" => 1e-3,
        "us" | "\u{3bc}s" | "\u{b5}s" => 1e-6,
        "ns" => 1e-9,
        "ps" => 1e-12,
        _ => return None,
    };
    Some(count * unit)
}

/// The numbers of an array in its own order; none if it holds something else.
#[allow(clippy::cast_precision_loss)] // Counters and time stamps: f64 is what all else is in.
fn numbers(file: NpyFile<&[u8]>) -> std::io::Result<Option<Vec<f64>>> {
    let DType::Plain(kind) = file.dtype() else {
        return Ok(None);
    };
    macro_rules! read {
        ($of:ty, $convert:expr) => {
            file.into_vec::<$of>()?.into_iter().map($convert).collect()
        };
    }
    if let Some(units) = kind.time_units() {
        let Some(unit) = seconds(units) else {
            return Ok(None);
        };
        // No time is the smallest number.
        let all = file.into_vec::<i64>()?.into_iter();
        let all: Vec<i64> = all.collect();
        // From the first on, which keeps all digits.
        let first = all.iter().copied().find(|it| *it != i64::MIN).unwrap_or(0);
        let time = |it: i64| match it {
            i64::MIN => f64::NAN,
            it => it.wrapping_sub(first) as f64 * unit,
        };
        return Ok(Some(all.into_iter().map(time).collect()));
    }
    Ok(Some(match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 8) => read!(f64, |it| it),
        (TypeChar::Float, 4) => read!(f32, f64::from),
        (TypeChar::Int, 8) => read!(i64, |it| it as f64),
        (TypeChar::Int, 4) => read!(i32, f64::from),
        (TypeChar::Int, 2) => read!(i16, f64::from),
        (TypeChar::Int, 1) => read!(i8, f64::from),
        (TypeChar::Uint, 8) => read!(u64, |it| it as f64),
        (TypeChar::Uint, 4) => read!(u32, f64::from),
        (TypeChar::Uint, 2) => read!(u16, f64::from),
        (TypeChar::Uint, 1) => read!(u8, f64::from),
        (TypeChar::Bool, 1) => read!(bool, |it| f64::from(u8::from(it))),
        _ => return Ok(None),
    }))
}
