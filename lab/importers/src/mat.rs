//! MATLAB files as `save(…, '-v7')` and `-v6` write them: version 5 of the format.
//!
//! A file is a list of elements, each with a type and a length, most of them compressed.
//! Arrays of numbers are read, alone or as fields of structures and in cells: `t`,
//! `run.pressure`, `signals(2).values`, `c{1}`, and `data(:,2)` for a column of a matrix, or
//! `data(2,:)` for a row where the samples lie in rows, `y(1,2,:)` for an array with a layer a
//! sample, `log.t` for a structure a sample. Dimensions of one do not count. What else
//! there is (texts, tables, objects) is named with its type. This reader exists because existing ones refuse integers that MATLAB stores in
//! few bytes, do not read structures, or unpack without a limit.

use std::io::Read;
use std::path::Path;

use softrig_formats::bounded::Limits;
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged, read_whole};

/// Bytes before the first element.
const HEADER: usize = 128;
/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Classes of arrays: cells, structures, and from double to 64-bit integers.
const CELL: u8 = 1;
const STRUCTURE: u8 = 2;
const OPAQUE: u8 = 17;
/// The flag of arrays with an imaginary part, and the largest share of the real part that is
/// rounding.
const COMPLEX: u32 = 0x0800;
const ROUNDING: f64 = 1e-9;
const NUMBERS: std::ops::RangeInclusive<u8> = 6..=15;
/// Structures within structures that are looked into.
const DEEPEST: usize = 4;
/// Columns of a matrix that have names; one that is wider is no table of samples.
const WIDEST: usize = 64;

/// Reads a MATLAB file.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the variables that it has.
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let mut file = File {
        is_big_endian: bytes.get(126..128) == Some(b"MI"),
        left: limits.bytes,
        columns: Vec::new(),
        unread: Vec::new(),
        warnings: Vec::new(),
        values: limits.fields,
    };
    if bytes.len() < HEADER {
        return Err(damaged(path, "MATLAB", &"it ends in its header"));
    }
    file.elements(&bytes[HEADER..])
        .map_err(|fault| match fault {
            Fault::Damaged(what) => damaged(path, "MATLAB", &what),
            Fault::TooLarge => softrig_formats::bounded::too_large(limits.bytes).in_file(path),
        })?;
    let sheet = Sheet {
        columns: file.columns,
        unread: file.unread,
        warnings: file
            .warnings
            .into_iter()
            .map(|warning| format!("{}: {warning}", path.display()))
            .collect(),
        ..Sheet::default()
    };
    sheet.samples(path, layout, limits, "variable")
}

/// Why a file is not read.
enum Fault {
    Damaged(&'static str),
    TooLarge,
}

const ENDS_EARLY: Fault = Fault::Damaged("it ends in the middle of a variable");

/// The state of the reader.
struct File {
    is_big_endian: bool,
    /// Bytes that may still be unpacked.
    left: u64,
    /// Numbers that may still be kept.
    values: u64,
    columns: Vec<(String, Values)>,
    /// What is not read, and what it is.
    unread: Vec<(String, String)>,
    warnings: Vec<String>,
}

/// An element: its type, its bytes, and what follows it.
struct Element<'a> {
    kind: u32,
    data: &'a [u8],
    rest: &'a [u8],
}

impl File {
    fn array<const N: usize>(&self, bytes: &[u8]) -> Option<[u8; N]> {
        let mut array: [u8; N] = bytes.get(..N)?.try_into().ok()?;
        if self.is_big_endian {
            array.reverse();
        }
        Some(array)
    }

    fn u32(&self, bytes: &[u8]) -> Option<u32> {
        self.array(bytes).map(u32::from_le_bytes)
    }

    fn element<'a>(&self, bytes: &'a [u8]) -> Result<Element<'a>, Fault> {
        let tag = self.u32(bytes).ok_or(ENDS_EARLY)?;
        // Up to four bytes may stand in the tag itself.
        let small = tag >> 16;
        if small != 0 {
            return Ok(Element {
                kind: tag & 0xffff,
                data: bytes.get(4..4 + small as usize).ok_or(ENDS_EARLY)?,
                rest: bytes.get(8..).unwrap_or_default(),
            });
        }
        let length = self.u32(&bytes[4..]).ok_or(ENDS_EARLY)? as usize;
        let end = length.checked_add(8).ok_or(ENDS_EARLY)?;
        let padded = if tag == COMPRESSED {
            end
        } else {
            end.next_multiple_of(8)
        };
        Ok(Element {
            kind: tag,
            data: bytes.get(8..end).ok_or(ENDS_EARLY)?,
            rest: bytes.get(padded..).unwrap_or_default(),
        })
    }

    fn elements(&mut self, mut bytes: &[u8]) -> Result<(), Fault> {
        while !bytes.is_empty() {
            let element = self.element(bytes)?;
            match element.kind {
                MATRIX => self.matrix(element.data, "", 0)?,
                COMPRESSED => {
                    let unpacked = self.unpack(element.data)?;
                    let inner = self.element(&unpacked)?;
                    if inner.kind == MATRIX {
                        self.matrix(inner.data, "", 0)?;
                    }
                }
                _ => {}
            }
            bytes = element.rest;
        }
        Ok(())
    }

    fn unpack(&mut self, packed: &[u8]) -> Result<Vec<u8>, Fault> {
        let mut unpacked = Vec::new();
        flate2::read::ZlibDecoder::new(packed)
            .take(self.left + 1)
            .read_to_end(&mut unpacked)
            .map_err(|_| Fault::Damaged("a variable cannot be unpacked"))?;
        self.left = self
            .left
            .checked_sub(unpacked.len() as u64)
            .ok_or(Fault::TooLarge)?;
        Ok(unpacked)
    }

    /// Keeps the columns of an array, or the fields of a structure under their names.
    fn matrix(&mut self, bytes: &[u8], known_as: &str, depth: usize) -> Result<(), Fault> {
        if bytes.is_empty() {
            // A field without a value.
            return Ok(());
        }
        let flags = self.element(bytes)?;
        let said = self.u32(flags.data).ok_or(ENDS_EARLY)?;
        #[allow(clippy::cast_possible_truncation)] // Eight bits are left.
        let class = (said & 0xff) as u8;
        let called = |name: &[u8]| match known_as {
            "" => String::from_utf8_lossy(name).into_owned(),
            known_as => known_as.to_owned(),
        };
        let sizes = self.element(flags.rest)?;
        if class == OPAQUE {
            // It has no sizes: its name, the system, and its class.
            let full = called(sizes.data);
            let of = self
                .element(sizes.rest)
                .and_then(|it| self.element(it.rest));
            let of = of.map_or_else(
                |_| String::new(),
                |it| String::from_utf8_lossy(it.data).into(),
            );
            self.unread.push((full, object(&of)));
            return Ok(());
        }
        let name = self.element(sizes.rest)?;
        let sizes: Vec<usize> = sizes
            .data
            .chunks_exact(4)
            .filter_map(|size| self.u32(size))
            .map(|size| size as usize)
            .collect();
        let full = called(name.data);
        let count = sizes
            .iter()
            .try_fold(1_usize, |count, &size| count.checked_mul(size))
            .filter(|count| *count <= bytes.len());
        match class {
            STRUCTURE if depth < DEEPEST => match count {
                Some(count) => self.fields(name.rest, &full, depth, count),
                None => Err(Fault::Damaged("a structure is larger than the file")),
            },
            CELL if depth < DEEPEST => {
                self.unread.push((full.clone(), "a cell array".to_owned()));
                let mut rest = name.rest;
                for number in 1..=count.unwrap_or(0).min(WIDEST) {
                    let cell = self.element(rest)?;
                    if cell.kind == MATRIX {
                        self.matrix(cell.data, &format!("{full}{{{number}}}"), depth + 1)?;
                    }
                    rest = cell.rest;
                }
                Ok(())
            }
            class if NUMBERS.contains(&class) => {
                let values = self.element(name.rest)?;
                let numbers = self.numbers(values.kind, values.data)?;
                if said & COMPLEX != 0 {
                    let imaginary = self.element(values.rest)?;
                    let imaginary = self.numbers(imaginary.kind, imaginary.data)?;
                    let largest =
                        |of: &[f64]| of.iter().fold(0.0, |most: f64, it| most.max(it.abs()));
                    let (real, imaginary) = (largest(&numbers), largest(&imaginary));
                    if imaginary > ROUNDING * real {
                        self.unread.push((full, "complex".to_owned()));
                        return Ok(());
                    }
                    self.warnings.push(format!(
                        "{full} is complex; its imaginary part is {imaginary:.0e} at most, and left out"
                    ));
                }
                self.keep(&full, &sizes, numbers)
            }
            class => {
                let is = match class {
                    3 => object(""),
                    4 => "text".to_owned(),
                    5 => "a sparse matrix".to_owned(),
                    16 => "a function".to_owned(),
                    STRUCTURE | CELL => "nested too deep".to_owned(),
                    _ => "of a type that is not known".to_owned(),
                };
                self.unread.push((full, is));
                Ok(())
            }
        }
    }

    /// The fields of a structure, or of each of an array of them.
    fn fields(&mut self, bytes: &[u8], of: &str, depth: usize, count: usize) -> Result<(), Fault> {
        let length = self.element(bytes)?;
        let names = self.element(length.rest)?;
        let length = self.u32(length.data).ok_or(ENDS_EARLY)? as usize;
        let all: Vec<String> = names
            .data
            .chunks_exact(length.max(1))
            .map(|name| {
                let end = name.iter().position(|&byte| byte == 0);
                String::from_utf8_lossy(&name[..end.unwrap_or(name.len())]).into_owned()
            })
            .collect();
        if all.iter().any(|name| name == "_ObjectMetadata") {
            self.unread.push((of.to_owned(), object("")));
            return Ok(());
        }
        let mut rest = names.rest;
        let begin = self.columns.len();
        // Of one structure a sample each field is a number.
        let is_number = |(_, values): &(String, Values)| values.len() == 1;
        for number in 1..=count {
            if number > WIDEST && !self.columns[begin..].iter().all(is_number) {
                break;
            }
            for name in &all {
                let field = self.element(rest)?;
                if field.kind == MATRIX {
                    let which = match count {
                        1 => String::new(),
                        _ => format!("({number})"),
                    };
                    self.matrix(field.data, &format!("{of}{which}.{name}"), depth + 1)?;
                }
                rest = field.rest;
            }
        }
        let found = &self.columns[begin..];
        if count > 1 && found.len() == count * all.len() && found.iter().all(is_number) {
            let mut fields: Vec<Vec<f64>> = vec![Vec::with_capacity(count); all.len()];
            for (place, (_, number)) in self.columns.drain(begin..).enumerate() {
                if let Values::Numbers(number, _) = number {
                    fields[place % all.len()].extend(number);
                }
            }
            let fields = all.iter().zip(fields);
            let fields = fields.map(|(name, numbers)| (format!("{of}.{name}"), values(numbers)));
            self.columns.extend(fields);
        }
        Ok(())
    }

    /// MATLAB stores numbers as small as they fit, whatever their class.
    fn numbers(&self, kind: u32, bytes: &[u8]) -> Result<Vec<f64>, Fault> {
        macro_rules! all {
            ($type:ty) => {
                bytes
                    .chunks_exact(size_of::<$type>())
                    .filter_map(|bytes| self.array(bytes))
                    .map(|bytes| <$type>::from_le_bytes(bytes) as f64)
                    .collect()
            };
        }
        #[allow(clippy::cast_lossless)] // Not all of them are lossless.
        Ok(match kind {
            1 => all!(i8),
            2 => all!(u8),
            3 => all!(i16),
            4 => all!(u16),
            5 => all!(i32),
            6 => all!(u32),
            7 => all!(f32),
            9 => all!(f64),
            12 => all!(i64),
            13 => all!(u64),
            _ => return Err(Fault::Damaged("a variable has numbers of no known type")),
        })
    }

    fn keep(&mut self, name: &str, sizes: &[usize], numbers: Vec<f64>) -> Result<(), Fault> {
        let count = sizes
            .iter()
            .try_fold(1_usize, |count, &size| count.checked_mul(size));
        if count != Some(numbers.len()) {
            return Err(Fault::Damaged("a variable has another size than it says"));
        }
        self.values = self
            .values
            .checked_sub(numbers.len() as u64)
            .ok_or(Fault::TooLarge)?;
        let column = |numbers: Vec<f64>| values(numbers);
        let dimensions: Vec<usize> = sizes.iter().copied().filter(|&size| size != 1).collect();
        match *dimensions {
            [] | [_] => self.columns.push((name.to_owned(), column(numbers))),
            // As Simulink logs a vector: the samples lie along the longer dimension, mostly the last.
            [rows, layers] if sizes.len() > 2 && (1..=WIDEST).contains(&rows.min(layers)) => {
                let is_last = layers >= rows;
                let (count, other) = (rows.min(layers), rows.max(layers));
                let far = sizes.iter().position(|&size| size == rows).unwrap_or(0);
                let along = if is_last { sizes.len() - 1 } else { far };
                for number in 0..count {
                    let subscript = |(at, &size): (usize, &usize)| match size {
                        _ if at == along => ":".to_owned(),
                        1 => "1".to_owned(),
                        _ => (number + 1).to_string(),
                    };
                    let subscripts: Vec<String> = sizes.iter().enumerate().map(subscript).collect();
                    let part: Vec<f64> = if is_last {
                        numbers.iter().skip(number).step_by(rows).copied().collect()
                    } else {
                        numbers[number * other..(number + 1) * other].to_vec()
                    };
                    let name = format!("{name}({})", subscripts.join(","));
                    self.columns.push((name, column(part)));
                }
            }
            // One column after the other.
            [rows, columns] if rows > 0 && columns <= WIDEST => {
                for (number, part) in (1..).zip(numbers.chunks_exact(rows)) {
                    let name = format!("{name}(:,{number})");
                    self.columns.push((name, column(part.to_vec())));
                }
            }
            // A channel in each row.
            [rows, columns] if columns > 0 && (1..=WIDEST).contains(&rows) => {
                for row in 0..rows {
                    let part = numbers.iter().skip(row).step_by(rows).copied().collect();
                    let name = format!("{name}({},:)", row + 1);
                    self.columns.push((name, column(part)));
                }
            }
            _ => {
                let shown: Vec<String> = sizes.iter().map(ToString::to_string).collect();
                let is = format!("an array of {} numbers", shown.join(" × "));
                self.unread.push((name.to_owned(), is));
            }
        }
        Ok(())
    }
}

/// What an object of a class is called.
fn object(class: &str) -> String {
    match class {
        "" => "an object of MATLAB (a timetable, a table, a datetime or a class of its own)"
            .to_owned(),
        class => format!("an object of MATLAB's class {class}"),
    }
}

fn values(numbers: Vec<f64>) -> Values {
    Values::Numbers(numbers, Decimals::Various)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use softrig_formats::columns::Names;
    use std::io::Write;

    /// Elements as MATLAB writes them, in the order of bytes of most computers.
    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let length = u32::try_from(data.len()).unwrap();
        if (1..=4).contains(&data.len()) {
            bytes.extend((kind | length << 16).to_le_bytes());
            bytes.extend(data);
            bytes.resize(8, 0);
            return bytes;
        }
        bytes.extend(kind.to_le_bytes());
        bytes.extend(length.to_le_bytes());
        bytes.extend(data);
        if kind != COMPRESSED {
            bytes.resize(bytes.len().next_multiple_of(8), 0);
        }
        bytes
    }

    fn array(class: u32, name: &str, sizes: [i32; 2], inside: &[u8]) -> Vec<u8> {
        let flags = [class.to_le_bytes(), 0_u32.to_le_bytes()].concat();
        let sizes = sizes.map(i32::to_le_bytes).concat();
        let parts = [
            element(6, &flags),
            element(5, &sizes),
            element(1, name.as_bytes()),
            inside.to_vec(),
        ];
        element(MATRIX, &parts.concat())
    }

    fn doubles(name: &str, sizes: [i32; 2], values: &[f64]) -> Vec<u8> {
        let bytes: Vec<u8> = values.iter().flat_map(|it| it.to_le_bytes()).collect();
        array(6, name, sizes, &element(9, &bytes))
    }

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut packer =
            flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        packer.write_all(bytes).unwrap();
        element(COMPRESSED, &packer.finish().unwrap())
    }

    fn file(elements: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file, made by a test".to_vec();
        bytes.resize(124, b' ');
        bytes.extend([0, 1, b'I', b'M']);
        bytes.extend(elements.concat());
        bytes
    }

    fn read_as(bytes: &[u8], columns: &str) -> Result<Samples, InputError> {
        let layout = Layout {
            names: Names::parse(columns).unwrap(),
            ..Layout::default()
        };
        let path = Path::new("lab.mat");
        crate::read_bytes(bytes, path, &layout)
    }

    fn good() -> Vec<u8> {
        // Doubles that are whole are stored as bytes.
        let small = array(6, "time_s", [1, 3], &element(2, &[0, 1, 2]));
        file(&[
            packed(&small),
            packed(&doubles("pressure_kpa", [3, 1], &[1.5, 2.5, -3.5])),
            doubles("angle_deg", [3, 1], &[10.25, 20.0, 30.0]),
            array(4, "note", [1, 5], &element(16, b"hello")),
            doubles("gain", [1, 1], &[4.0]),
            doubles("setpoint_deg", [3, 1], &[60.0, f64::NAN, 0.1]),
        ])
    }

    #[test]
    fn variables_are_columns() {
        let samples = read_as(&good(), "time=time_s").unwrap();
        assert_eq!(samples.time_s, [0.0, 1.0, 2.0]);
        assert_eq!(samples.pressure_kpa, [1.5, 2.5, -3.5]);
        assert_eq!(samples.angle_deg, [10.25, 20.0, 30.0]);
        assert_eq!(samples.extra.len(), 1, "one has as many values");
        assert_eq!(samples.extra[0].fields, ["60", "", "0.1"]);
    }

    #[test]
    fn fields_of_structures_and_columns_of_matrices_have_names() {
        let time = doubles("", [2, 1], &[0.0, 0.5]);
        let pressure = array(7, "", [2, 1], &element(7, &[0, 0, 128, 63, 0, 0, 0, 64]));
        let inside = [
            element(5, &8_i32.to_le_bytes()),
            element(1, b"t\0\0\0\0\0\0\0press\0\0\0"),
            time,
            pressure,
        ];
        let bytes = file(&[
            array(u32::from(STRUCTURE), "run", [1, 1], &inside.concat()),
            packed(&doubles("data", [2, 2], &[1.0, 2.0, 30.0, 40.0])),
        ]);
        let columns = "time=run.t,pressure=run.press,angle=data(:,2)";
        let samples = read_as(&bytes, columns).unwrap();
        assert_eq!(samples.time_s, [0.0, 0.5]);
        assert_eq!(samples.pressure_kpa, [1.0, 2.0]);
        assert_eq!(samples.angle_deg, [30.0, 40.0]);
        let said = read_as(&bytes, "time=t").unwrap_err().to_string();
        assert!(
            said.contains("lab.mat, column t: has no variable t")
                && said.contains("run.t, run.press, data(:,1), data(:,2)"),
            "{said}"
        );
    }

    /// Cells, arrays of structures, rows of a matrix, dimensions of one, and what cannot be read.
    #[test]
    fn every_shape_of_numbers_is_read_and_the_rest_named() {
        let cell = |inside: &[Vec<u8>]| array(u32::from(CELL), "c", [1, 2], &inside.concat());
        let names = b"values\0\0";
        let signals = [
            element(5, &8_i32.to_le_bytes()),
            element(1, names),
            doubles("", [3, 1], &[1.0, 2.0, 3.0]),
            doubles("", [3, 1], &[4.0, 5.0, 6.0]),
        ];
        let object = [
            element(6, &[u32::from(OPAQUE).to_le_bytes(), [0; 4]].concat()),
            element(1, b"tt"),
            element(1, b"MCOS"),
            element(1, b"timetable"),
        ];
        let complex = |imaginary: f64| {
            let flags = [(6 | COMPLEX).to_le_bytes(), 0_u32.to_le_bytes()].concat();
            let pair = |a: f64, b: f64| [a.to_le_bytes(), b.to_le_bytes()].concat();
            let parts = [
                element(6, &flags),
                element(5, &[2_i32.to_le_bytes(), 1_i32.to_le_bytes()].concat()),
                element(1, b"z"),
                element(9, &pair(1.0, 2.0)),
                element(9, &pair(imaginary, 0.0)),
            ];
            element(MATRIX, &parts.concat())
        };
        let samples = [0, 1, 2].map(|k| {
            let field = |number| doubles("", [1, 1], &[f64::from(k) + number]);
            [field(0.0), field(5.0)].concat()
        });
        let log = [
            element(5, &2_i32.to_le_bytes()),
            element(1, b"t\0p\0"),
            samples.concat(),
        ];
        let layers = |name: &str, sizes: [i32; 3], values: &[f64]| {
            let flags = [6_u32.to_le_bytes(), [0; 4]].concat();
            let values: Vec<u8> = values.iter().flat_map(|it| it.to_le_bytes()).collect();
            let parts = [
                element(6, &flags),
                element(5, &sizes.map(i32::to_le_bytes).concat()),
                element(1, name.as_bytes()),
                element(9, &values),
            ];
            element(MATRIX, &parts.concat())
        };
        let wide: Vec<f64> = (0..130).flat_map(|k| [f64::from(k), 1.0, 2.0]).collect();
        let bytes = file(&[
            cell(&[
                doubles("", [3, 1], &[0.0, 1.0, 2.0]),
                doubles("", [1, 3], &[7.0, 8.0, 9.0]),
            ]),
            array(u32::from(STRUCTURE), "signals", [1, 2], &signals.concat()),
            element(MATRIX, &object.concat()),
            complex(1e-17),
            doubles("data", [3, 130], &wide),
            array(u32::from(STRUCTURE), "log", [1, 3], &log.concat()),
            layers("y", [1, 2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            layers("z3", [1, 3, 2], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
        ]);
        let columns = "time=c{1},pressure=signals(1).values,angle=signals(2).values";
        let samples = read_as(&bytes, columns).unwrap();
        assert_eq!(samples.angle_deg, [4.0, 5.0, 6.0]);
        assert!(samples.warnings[0].contains("z is complex"));
        let columns = "time=log.t,pressure=log.p,angle=y(1,2,:)";
        let samples = read_as(&bytes, columns).unwrap();
        assert_eq!(samples.time_s, [0.0, 1.0, 2.0]);
        assert_eq!(samples.pressure_kpa, [5.0, 6.0, 7.0]);
        assert_eq!(samples.angle_deg, [2.0, 4.0, 6.0]);
        let samples = read_as(&bytes, "time=log.t,pressure=z3(1,:,1),angle=z3(1,:,2)").unwrap();
        assert_eq!(samples.angle_deg, [4.0, 5.0, 6.0]);
        let rows = read_as(&bytes, "time=data(1,:),pressure=data(2,:),angle=data(3,:)").unwrap();
        assert_eq!(rows.len(), 130);
        let said = read_as(&bytes, "time=tt.Time").unwrap_err().to_string();
        assert!(
            said.contains("tt is an object of MATLAB's class timetable"),
            "{said}"
        );
        let said = read_as(&file(&[complex(0.5)]), "time=z")
            .unwrap_err()
            .to_string();
        assert!(said.contains("z is complex"), "{said}");
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (bytes, columns, part) in [
            (
                file(&[
                    doubles("time_s", [2, 1], &[0.0, 1.0]),
                    doubles("pressure_kpa", [3, 1], &[0.0, 1.0, 2.0]),
                    doubles("angle_deg", [2, 1], &[0.0, 1.0]),
                ]),
                "time=time_s",
                "pressure_kpa has 3 values, and time_s has 2",
            ),
            (good(), "angle=setpoint_deg", "row 2: NaN is not a number"),
            (
                good(),
                "angle=time_s,time=angle_deg,pressure=pressure_kpa",
                "",
            ),
            (good()[..100].to_vec(), "time=t", "ends in its header"),
            (
                file(&[doubles("x", [9, 9], &[1.0])]),
                "time=t",
                "another size",
            ),
            (
                // A head without the HDF5 file that follows it.
                b"MATLAB 7.3 MAT-file, Platform: GLNXA64".to_vec(),
                "time=t",
                "damaged HDF5 file",
            ),
        ] {
            match read_as(&bytes, columns) {
                Ok(_) => assert!(part.is_empty()),
                Err(error) => assert!(error.to_string().contains(part), "{error}"),
            }
        }
    }

    #[test]
    fn a_bomb_is_refused_before_it_goes_off() {
        let zeros = vec![0; 64 << 20];
        let bomb = file(&[packed(&zeros), packed(&zeros)]);
        let limits = Limits {
            bytes: 100 << 20,
            ..Limits::RECORDING
        };
        let error = read(&bomb[..], Path::new("lab.mat"), &Layout::default(), limits);
        let said = error.unwrap_err().to_string();
        assert!(said.contains("more than 100 MiB"), "{said}");
    }

    proptest! {
        /// A damaged file is an error with its name, or still a recording.
        #[test]
        fn damage_is_an_error(
            edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            end in any::<prop::sample::Index>(),
            cut in any::<bool>(),
        ) {
            let mut bytes = good();
            for (place, byte) in edits {
                let place = place.index(bytes.len());
                bytes[place] = byte;
            }
            if cut {
                bytes.truncate(end.index(bytes.len()));
            }
            match read_as(&bytes, "time=time_s") {
                Ok(samples) => prop_assert!(samples.len() >= 2),
                Err(error) => prop_assert_eq!(error.file.as_deref(), Some(Path::new("lab.mat"))),
            }
        }
    }
}
