//! Lines of JSON: what loggers and data bases write, one object a sample.
//!
//! Fields of objects in objects are called `imu.angle`, those of arrays `position[0]`. An array of
//! objects over the whole file is read the same way.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use serde_json::Value;

use super::{Decimals, Samples, Sheet, Values, read_whole};
use crate::bounded::{self, Limits};
use crate::columns::Layout;
use crate::error::InputError;

/// Reads lines of JSON.
///
/// # Errors
///
/// Names the file and the line, or the columns that there are.
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let text = std::str::from_utf8(&bytes).map_err(|_| bounded::not_text(path))?;
    let place = |error: InputError, line: u64| error.in_file(path).at_line(line);
    let mut table = Table::default();
    if text.trim_start().starts_with('[') {
        let rows: Vec<Value> = serde_json::from_str(text)
            .map_err(|error| place(no_object(&error), error.line() as u64))?;
        for row in &rows {
            table
                .add(row, limits)
                .map_err(|error| error.in_file(path))?;
        }
    } else {
        for (line, row) in (1..).zip(text.lines()) {
            if row.trim().is_empty() {
                continue;
            }
            let row: Value =
                serde_json::from_str(row).map_err(|error| place(no_object(&error), line))?;
            table
                .add(&row, limits)
                .map_err(|error| place(error, line))?;
        }
    }
    table.sheet().samples(path, layout, limits, "field")
}

fn no_object(error: &serde_json::Error) -> InputError {
    InputError::new(
        format!("is no object of JSON: {error}"),
        "write one object a line, {\"time_s\": 0.01, \"pressure_kpa\": 30.2, \"angle_deg\": 12.5}",
    )
}

/// A value in a row.
#[derive(Clone, Debug)]
enum Cell {
    Nothing,
    Number(f64),
    Text(String),
}

/// Columns in the order in which they appear.
#[derive(Debug, Default)]
struct Table {
    names: Vec<String>,
    places: HashMap<String, usize>,
    columns: Vec<Vec<Cell>>,
    rows: usize,
}

impl Table {
    fn add(&mut self, row: &Value, limits: Limits) -> Result<(), InputError> {
        if !row.is_object() {
            return Err(InputError::new(
                "is JSON, and no object with the values of a sample",
                "write one object a line, {\"time_s\": 0.01, \"pressure_kpa\": 30.2, \"angle_deg\": 12.5}",
            ));
        }
        self.rows += 1;
        self.take(String::new(), row);
        limits.check(self.rows as u64, self.columns.len())?;
        for column in &mut self.columns {
            column.resize(self.rows, Cell::Nothing);
        }
        Ok(())
    }

    fn take(&mut self, name: String, value: &Value) {
        let cell = match value {
            Value::Null => return,
            Value::Object(fields) => {
                for (key, value) in fields {
                    let name = if name.is_empty() {
                        key.clone()
                    } else {
                        format!("{name}.{key}")
                    };
                    self.take(name, value);
                }
                return;
            }
            Value::Array(values) => {
                for (index, value) in values.iter().enumerate() {
                    self.take(format!("{name}[{index}]"), value);
                }
                return;
            }
            Value::Number(number) => Cell::Number(number.as_f64().unwrap_or(f64::NAN)),
            Value::Bool(flag) => Cell::Number(f64::from(u8::from(*flag))),
            Value::String(text) => Cell::Text(text.clone()),
        };
        let place = *self.places.entry(name.clone()).or_insert_with(|| {
            self.names.push(name);
            self.columns.push(Vec::new());
            self.columns.len() - 1
        });
        let column = &mut self.columns[place];
        column.resize(self.rows - 1, Cell::Nothing);
        column.push(cell);
    }

    fn sheet(self) -> Sheet {
        let columns = self.columns.into_iter().map(|cells| {
            if cells.iter().any(|cell| matches!(cell, Cell::Text(_))) {
                let texts = cells.into_iter().map(|cell| match cell {
                    Cell::Nothing => String::new(),
                    Cell::Number(number) => Decimals::Various.show(number),
                    Cell::Text(text) => text,
                });
                return Values::Texts(texts.collect());
            }
            let numbers = cells.iter().map(|cell| match cell {
                Cell::Number(number) => *number,
                Cell::Nothing | Cell::Text(_) => f64::NAN,
            });
            Values::Numbers(numbers.collect(), Decimals::Various)
        });
        Sheet {
            columns: self.names.into_iter().zip(columns).collect(),
            ..Sheet::default()
        }
    }
}
