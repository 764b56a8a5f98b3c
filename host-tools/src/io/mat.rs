//! MATLAB files as `save(…, '-v7')` and `-v6` write them: version 5 of the format.
//!
//! A file is a list of elements, each with a type and a length, most of them packed. Read
//! are arrays of numbers, alone or as fields of structures: `t`, `run.pressure`, and
//! `data(:,2)` for a column of a matrix. Everything else (texts, cells, tables, objects) is
//! passed over. The reader is here because those that exist refuse whole numbers that
//! MATLAB stores small, know no structures, or unpack without a limit.

use std::io::Read;
use std::path::Path;

use super::{Decimals, Samples, Sheet, Values, damaged, read_whole};
use crate::bounded::Limits;
use crate::columns::Layout;
use crate::error::InputError;

/// Bytes before the first element.
const HEADER: usize = 128;
/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Classes of arrays: a structure, and from double to 64-bit integers.
const STRUCTURE: u8 = 2;
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
        values: limits.fields,
    };
    if bytes.len() < HEADER {
        return Err(damaged(path, "MATLAB", &"it ends in its header"));
    }
    file.elements(&bytes[HEADER..])
        .map_err(|fault| match fault {
            Fault::Damaged(what) => damaged(path, "MATLAB", &what),
            Fault::TooLarge => crate::bounded::too_large(limits.bytes).in_file(path),
        })?;
    let sheet = Sheet {
        columns: file.columns,
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

/// What was found so far.
struct File {
    is_big_endian: bool,
    /// Bytes that may still be unpacked.
    left: u64,
    /// Numbers that may still be kept.
    values: u64,
    columns: Vec<(String, Values)>,
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
        let class = self.u32(flags.data).ok_or(ENDS_EARLY)? & 0xff;
        let sizes = self.element(flags.rest)?;
        let name = self.element(sizes.rest)?;
        let sizes: Vec<usize> = sizes
            .data
            .chunks_exact(4)
            .filter_map(|size| self.u32(size))
            .map(|size| size as usize)
            .collect();
        let name_of_its_own = String::from_utf8_lossy(name.data);
        let full = match known_as {
            "" => name_of_its_own.into_owned(),
            known_as => known_as.to_owned(),
        };
        #[allow(clippy::cast_possible_truncation)] // Eight bits are left.
        match class as u8 {
            STRUCTURE if depth < DEEPEST && sizes.iter().all(|&size| size == 1) => {
                self.fields(name.rest, &full, depth)
            }
            class if NUMBERS.contains(&class) => {
                let values = self.element(name.rest)?;
                let numbers = self.numbers(values.kind, values.data)?;
                self.keep(&full, &sizes, numbers)
            }
            _ => Ok(()),
        }
    }

    fn fields(&mut self, bytes: &[u8], of: &str, depth: usize) -> Result<(), Fault> {
        let length = self.element(bytes)?;
        let names = self.element(length.rest)?;
        let length = self.u32(length.data).ok_or(ENDS_EARLY)? as usize;
        let mut rest = names.rest;
        for name in names.data.chunks_exact(length.max(1)) {
            let end = name.iter().position(|&byte| byte == 0);
            let name = String::from_utf8_lossy(&name[..end.unwrap_or(name.len())]);
            let field = self.element(rest)?;
            if field.kind == MATRIX {
                self.matrix(field.data, &format!("{of}.{name}"), depth + 1)?;
            }
            rest = field.rest;
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
        match *sizes {
            [1, _] | [_, 1] => self.columns.push((name.to_owned(), values(numbers))),
            // One column after the other.
            [rows, columns] if rows > 0 && columns <= WIDEST => {
                for (number, column) in (1..).zip(numbers.chunks_exact(rows)) {
                    let name = format!("{name}(:,{number})");
                    self.columns.push((name, values(column.to_vec())));
                }
            }
            _ => {}
        }
        Ok(())
    }
}

fn values(numbers: Vec<f64>) -> Values {
    Values::Numbers(numbers, Decimals::Various)
}
