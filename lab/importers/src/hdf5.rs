//! HDF5: what h5py writes, and MATLAB from version 7.3 on.
//!
//! Each data set of numbers is a column by its path, `rig/pressure`. The columns of one with two
//! dimensions are called `name[0]`, `name[1]`, …, along the shorter one: MATLAB stores its matrices
//! turned over. A single row or column is one column.

use std::io::Read;
use std::path::Path;

use hdf5_pure::{Error, File, Group};

use crate::guard::guarded;
use softrig_formats::bounded::Limits;
use softrig_formats::columns::Layout;
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
    let columns = guarded(|| {
        let file = File::from_bytes(bytes)?;
        let mut found = Found {
            columns: Vec::new(),
            left: limits.fields,
        };
        found.group(&file.root(), "", 0)?;
        Ok(found.columns)
    });
    let columns = columns
        .map_err(|said| damaged(path, "HDF5", &said))?
        .map_err(|error: Error| damaged(path, "HDF5", &error))?;
    let sheet = Sheet {
        columns,
        ..Sheet::default()
    };
    sheet.samples(path, layout, limits, "data set")
}

struct Found {
    columns: Vec<(String, Values)>,
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
            if dimensions.is_empty() || dimensions.len() > 2 || size > self.left {
                continue;
            }
            // Texts, references and records hold no numbers.
            let Ok(numbers) = data.read_f64() else {
                continue;
            };
            self.left -= size;
            let called = format!("{prefix}{name}");
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
}
