//! Samples from arrays in memory.
//!
//! They are checked like those of a file. An error names the array and the index, from 0 as in
//! the languages that use them.

use std::path::Path;

use super::{Samples, unusable};
use crate::bounded::Limits;
use crate::columns::{Columns, Layout, Quantity};
use crate::error::InputError;

impl Samples {
    /// Takes time, pressure and angle in the units that `columns` says, which are s, kPa and
    /// ° if it says nothing. `name` is only used in messages.
    ///
    /// # Errors
    ///
    /// Names the array, the place in it, and the remedy.
    pub fn of_arrays(
        name: &str,
        arrays: [&[f64]; 3],
        columns: &Columns,
    ) -> Result<Self, InputError> {
        let rows = same_length(arrays)?;
        Limits::RECORDING.check(rows as u64, arrays.len())?;
        let layout = Layout::from(*columns);
        let mut samples = Self {
            columns: *columns,
            ..Self::default()
        };
        for row in 0..rows {
            let values = arrays.map(|array| array[row]);
            if let Some((quantity, error)) = unusable(values) {
                return Err(at(quantity, row, error));
            }
            if let Some((quantity, question)) = samples.push(values) {
                let array = quantity.column();
                samples
                    .warnings
                    .push(format!("{name}, {array}[{row}]: {question}"));
            }
        }
        let place = |error: InputError, number: u64| {
            let row = usize::try_from(number).unwrap_or(usize::MAX);
            at(Quantity::Time, row.saturating_sub(1), error)
        };
        samples.finish(Path::new(name), &layout, place)?;
        Ok(samples)
    }
}

/// The number of samples in three arrays.
fn same_length(arrays: [&[f64]; 3]) -> Result<usize, InputError> {
    let lengths = arrays.map(<[f64]>::len);
    if lengths.iter().any(|&length| length != lengths[0]) {
        let each: Vec<String> = Quantity::ALL
            .into_iter()
            .zip(lengths)
            .map(|(quantity, length)| format!("{length} in {}", quantity.column()))
            .collect();
        return Err(InputError::new(
            format!("the arrays have different lengths: {}", each.join(", ")),
            "give one value a sample in each of them",
        ));
    }
    Ok(lengths[0])
}

/// Names the place of a fault in an array.
fn at(quantity: Quantity, row: usize, error: InputError) -> InputError {
    let array = quantity.column();
    InputError::new(format!("{array}[{row}]: {}", error.found), error.advice)
}
