//! HDF5: what h5py writes, and MATLAB from version 7.3 on.
//!
//! Each data set of numbers is a column by its path, `rig/pressure`. The columns of one with two
//! dimensions are called `name[0]`, `name[1]`, …, along the shorter one: MATLAB stores its matrices
//! turned over. A single row or column is one column, a field of a table of records `table.field`.
//! `scale_factor`, `add_offset` and `units` of a data set are applied, as netCDF and CF have them.

use std::io::Read;
use std::path::Path;

use hdf5_pure::{AttrValue, Dataset, Datatype, DatatypeByteOrder, Error, File, Group};

use crate::guard::guarded;
use crate::half;
use softrig_formats::bounded::Limits;
use softrig_formats::columns::{Columns, Layout, Quantity, Unit};
use softrig_formats::error::InputError;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged, read_whole};

/// Most columns of a data set: beyond that it is a picture.
const MOST_COLUMNS: usize = 256;

/// How deep groups may stand in each other: links can go round.
const DEEPEST: usize = 8;

/// Reads a file of HDF5.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the data sets that it has.
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let found = guarded(|| {
        let file = File::from_bytes(bytes)?;
        let mut found = Found {
            columns: Vec::new(),
            unread: Vec::new(),
            units: Vec::new(),
            scaled: Vec::new(),
            left: limits.fields,
        };
        found.group(&file.root(), "", 0)?;
        Ok(found)
    });
    let found = found
        .map_err(|said| damaged(path, "HDF5", &said))?
        .map_err(|error: Error| damaged(path, "HDF5", &error))?;
    let mut columns_say = Columns::default();
    let mut warnings = Vec::new();
    for quantity in Quantity::ALL {
        let wanted = layout.names.of(quantity);
        let said = found.units.iter().find(|(name, _)| name == wanted);
        if let Some((_, written)) = said.filter(|_| layout.columns.unit(quantity).is_none()) {
            // netCDF: seconds since a date.
            let unit = written.split(" since ").next().unwrap_or(written);
            let unit = Unit::of(quantity, unit).ok_or_else(|| no_unit(quantity, written));
            columns_say.set(unit.map_err(|error| error.in_file(path).in_column(wanted))?);
        }
        if let Some((_, how)) = found.scaled.iter().find(|(name, _)| name == wanted) {
            warnings.push(format!(
                "{}: {wanted} is stored packed; {how}",
                path.display()
            ));
        }
    }
    let sheet = Sheet {
        columns: found.columns,
        unread: found.unread,
        columns_say,
        warnings,
        ..Sheet::default()
    };
    sheet.samples(path, layout, limits, "data set")
}

/// A unit that a data set says, and that is none of what it holds.
fn no_unit(quantity: Quantity, written: &str) -> InputError {
    let key = quantity.key();
    InputError::new(
        format!(
            "is in \"{written}\", which is no unit of {key} that is known: {}",
            quantity.units()
        ),
        format!("say in which unit it is with --units {key}=UNIT, or convert the data set"),
    )
}

struct Found {
    columns: Vec<(String, Values)>,
    /// What is not read, and what it is.
    unread: Vec<(String, String)>,
    /// The units that data sets say.
    units: Vec<(String, String)>,
    /// How packed data sets are unpacked.
    scaled: Vec<(String, String)>,
    /// Numbers that may still be read.
    left: u64,
}

impl Found {
    fn group(&mut self, group: &Group, prefix: &str, depth: usize) -> Result<(), Error> {
        for name in group.datasets()? {
            let data = group.dataset(&name)?;
            let shape = data.shape()?;
            let size = shape
                .iter()
                .fold(1, |size: u64, it| size.saturating_mul(*it));
            let dimensions: Vec<u64> = shape.into_iter().filter(|&it| it != 1).collect();
            // Nobody's recording: pictures, and what is larger than any.
            let called = format!("{prefix}{name}");
            if dimensions.is_empty() {
                continue;
            }
            if dimensions.len() > 2 || size > self.left {
                self.unread.push((
                    called,
                    format!("an array of {} dimensions", dimensions.len()),
                ));
                continue;
            }
            let attributes = data.attrs().unwrap_or_default();
            let class = attributes.get("MATLAB_class").and_then(text);
            if attributes.contains_key("MATLAB_object_decode") {
                let class = class.unwrap_or_default();
                self.unread
                    .push((called, format!("an object of MATLAB's class {class}")));
                continue;
            }
            if let Ok(Datatype::Compound { .. }) = data.datatype() {
                self.records(&data, &called, size);
                continue;
            }
            let Some(mut numbers) = numbers_of(&data, size) else {
                let is = match (class.as_deref(), data.dtype()) {
                    (Some("cell"), _) => "a cell array".to_owned(),
                    (_, Ok(kind)) => format!("of the type {kind}"),
                    (_, Err(_)) => "of a type that is not known".to_owned(),
                };
                self.unread.push((called, is));
                continue;
            };
            self.left -= size;
            let value = |name: &str| attributes.get(name).and_then(number);
            let (scale, offset) = (value("scale_factor"), value("add_offset"));
            let missing = value("_FillValue").or_else(|| value("missing_value"));
            for number in numbers.iter_mut().filter(|it| Some(**it) == missing) {
                *number = f64::NAN;
            }
            if scale.is_some() || offset.is_some() {
                let (scale, offset) = (scale.unwrap_or(1.0), offset.unwrap_or(0.0));
                for number in &mut numbers {
                    *number = scale * *number + offset;
                }
                let how = format!("its scale_factor {scale} and add_offset {offset} are applied");
                self.scaled.push((called.clone(), how));
            }
            let units = ["units", "unit", "Units", "Unit"].iter();
            let units = units.filter_map(|name| attributes.get(*name).and_then(text));
            if let Some(units) = units.into_iter().find(|it| !it.is_empty()) {
                self.units.push((called.clone(), units));
            }
            let as_column = |numbers| Values::Numbers(numbers, Decimals::Various);
            match dimensions.as_slice() {
                &[rows, columns] => {
                    let count = usize::try_from(rows.min(columns)).unwrap_or(usize::MAX);
                    let is_turned = rows < columns;
                    for column in 0..count.min(MOST_COLUMNS) {
                        let values: Vec<f64> = if is_turned {
                            let length = numbers.len() / count;
                            numbers[column * length..(column + 1) * length].to_vec()
                        } else {
                            numbers
                                .iter()
                                .skip(column)
                                .step_by(count)
                                .copied()
                                .collect()
                        };
                        let name = format!("{called}[{column}]");
                        self.columns.push((name, as_column(values)));
                    }
                }
                _ => self.columns.push((called, as_column(numbers))),
            }
        }
        for name in group.groups()? {
            // What MATLAB's cells and structures refer to.
            if !name.starts_with('#') && depth < DEEPEST {
                self.group(&group.group(&name)?, &format!("{prefix}{name}/"), depth + 1)?;
            }
        }
        Ok(())
    }

    /// The fields of a table of records, as `PyTables` and pandas write them.
    fn records(&mut self, data: &Dataset, called: &str, count: u64) {
        let Ok(Datatype::Compound { size, members }) = data.datatype() else {
            return;
        };
        let size = size as usize;
        let bytes = count.saturating_mul(size as u64);
        if bytes > self.left.saturating_mul(8) || size == 0 {
            self.unread.push((
                called.to_owned(),
                "a table of more records than are read".to_owned(),
            ));
            return;
        }
        let Ok(raw) = data.read_raw() else {
            self.unread
                .push((called.to_owned(), "a table of records".to_owned()));
            return;
        };
        let mut names = Vec::new();
        for member in &members {
            let name = format!("{called}.{}", member.name);
            names.push(member.name.clone());
            let at = usize::try_from(member.byte_offset).unwrap_or(usize::MAX);
            let numbers: Option<Vec<f64>> = raw
                .chunks_exact(size)
                .map(|record| number_in(record.get(at..)?, &member.datatype))
                .collect();
            match numbers {
                Some(numbers) => {
                    self.left = self.left.saturating_sub(numbers.len() as u64);
                    self.columns
                        .push((name, Values::Numbers(numbers, Decimals::Various)));
                }
                None => self.unread.push((name, "no number".to_owned())),
            }
        }
        let is = format!("a table of records with the fields {}", names.join(", "));
        self.unread.push((called.to_owned(), is));
    }
}

/// The numbers of a data set; none of a type that is not of numbers.
fn numbers_of(data: &Dataset, size: u64) -> Option<Vec<f64>> {
    let numbers = match data.datatype() {
        Ok(Datatype::FloatingPoint {
            size: 2,
            byte_order,
            ..
        }) => {
            let raw = data.read_raw().ok()?;
            let is_big = byte_order == DatatypeByteOrder::BigEndian;
            let number = |it: &[u8]| match *it {
                [high, low] if is_big => half(&[low, high]),
                _ => half(it),
            };
            raw.chunks_exact(2).map(number).collect()
        }
        _ => data.read_f64().ok()?,
    };
    // Of a type that the library does not know it reads nothing.
    (numbers.len() as u64 == size).then_some(numbers)
}

/// The number at the start of some bytes; none of a type that is not of numbers.
#[allow(clippy::cast_precision_loss)] // Counters and time stamps: f64 is what all else is in.
fn number_in(bytes: &[u8], kind: &Datatype) -> Option<f64> {
    let (size, is_big, is_float, is_signed) = match kind {
        Datatype::FixedPoint {
            size,
            byte_order,
            layout,
        } => (*size, byte_order, false, layout.signed),
        Datatype::FloatingPoint {
            size, byte_order, ..
        } => (*size, byte_order, true, true),
        _ => return None,
    };
    let mut field = bytes.get(..size as usize)?.to_vec();
    if *is_big == DatatypeByteOrder::BigEndian {
        field.reverse();
    }
    let mut wide = [0; 8];
    wide.get_mut(..field.len())?.copy_from_slice(&field);
    let raw = u64::from_le_bytes(wide);
    Some(match (is_float, size) {
        (true, 8) => f64::from_bits(raw),
        (true, 4) => f64::from(f32::from_bits(u32::try_from(raw).ok()?)),
        (true, _) => return None,
        (false, _) if is_signed => {
            let unused = 64 - 8 * size;
            ((raw << unused).cast_signed() >> unused) as f64
        }
        (false, _) => raw as f64,
    })
}

/// The text of an attribute.
fn text(of: &AttrValue) -> Option<String> {
    match of {
        AttrValue::String(text) => Some(text.trim().to_owned()),
        other => {
            let shown = format!("{other:?}");
            // Fixed-width and ASCII texts: what stands between the first quotes.
            shown.split('"').nth(1).map(|it| it.trim().to_owned())
        }
    }
}

/// The number of an attribute, alone or in an array of one.
#[allow(clippy::cast_precision_loss)] // Scales have few digits.
fn number(of: &AttrValue) -> Option<f64> {
    Some(match of {
        AttrValue::F64(it) => *it,
        AttrValue::F32(it) => f64::from(*it),
        AttrValue::I64(it) => *it as f64,
        AttrValue::I32(it) => f64::from(*it),
        AttrValue::I16(it) => f64::from(*it),
        AttrValue::I8(it) => f64::from(*it),
        AttrValue::U64(it) => *it as f64,
        AttrValue::U32(it) => f64::from(*it),
        AttrValue::U16(it) => f64::from(*it),
        AttrValue::U8(it) => f64::from(*it),
        AttrValue::F64Array(all) => *all.first()?,
        AttrValue::F32Array(all) => f64::from(*all.first()?),
        AttrValue::I64Array(all) => *all.first()? as f64,
        AttrValue::I32Array(all) => f64::from(*all.first()?),
        AttrValue::I16Array(all) => f64::from(*all.first()?),
        _ => return None,
    })
}
