//! Numbers of a table whose decimal sign is not known beforehand.
//!
//! `1,234` is 1.234 in one country and 1234 in another. The numbers of a file tell together
//! which it is; where they do not, the file is refused.

use crate::error::InputError;

/// The decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sign {
    Point,
    Comma,
}

/// How the numbers of a file are written, as far as those tell that were read.
#[derive(Clone, Debug, Default)]
pub struct Numbers {
    sign: Option<Sign>,
    /// The first number with a comma that may be one before decimals or between thousands:
    /// its line, its column and itself.
    doubt: Option<(u64, String, String)>,
}

impl Numbers {
    /// Reads a number as it is written, infinities and `NaN` too. One with a comma is only sure
    /// once [`check`](Self::check) has passed.
    ///
    /// # Errors
    ///
    /// Names the line and the column of what is not a number, or is written otherwise than those
    /// before; of an earlier number, if this one shows that it is ambiguous.
    pub fn read(&mut self, field: &str, line: u64, column: &str) -> Result<f64, InputError> {
        self.number(field, line, column)
            .map_err(|error| match error.line {
                Some(_) => error,
                None => error.at_line(line).in_column(column),
            })
    }

    /// Whether the numbers have decimal commas, as far as those tell that were read.
    pub fn have_commas(&self) -> bool {
        self.sign == Some(Sign::Comma)
    }

    fn number(&mut self, field: &str, line: u64, column: &str) -> Result<f64, InputError> {
        let points = field.matches('.').count();
        let commas = field.matches(',').count();
        let sign = match (points, commas) {
            (0, 0) => None,
            (1, 0) => Some(Sign::Point),
            (0, 1) if is_with_comma(field) => {
                if is_ambiguous(field) {
                    if self.sign.is_none() && self.doubt.is_none() {
                        self.doubt = Some((line, column.to_owned(), field.to_owned()));
                    }
                    None
                } else {
                    Some(Sign::Comma)
                }
            }
            (_, 0) => return number(field),
            _ => {
                return Err(InputError::new(
                    format!(
                        "\"{field}\" is not a number that is sure: thousands may be separated in it"
                    ),
                    "write numbers without separators between thousands",
                ));
            }
        };
        if let Some(sign) = sign {
            if *self.sign.get_or_insert(sign) != sign {
                return Err(Self::mixed(field));
            }
            if sign == Sign::Point && self.doubt.is_some() {
                return self.check().map(|()| f64::NAN);
            }
        }
        if commas == 1 {
            if self.sign == Some(Sign::Point) {
                return Err(Self::mixed(field));
            }
            return number(&field.replace(',', "."));
        }
        number(field)
    }

    fn mixed(field: &str) -> InputError {
        let (this, other) = if field.contains(',') {
            ("comma", "points")
        } else {
            ("point", "commas")
        };
        InputError::new(
            format!("\"{field}\" has a {this}, and numbers above have decimal {other}"),
            "write all numbers in one way, without separators between thousands",
        )
    }

    /// Refuses a file in which nothing showed what a comma means, once all its numbers are read.
    ///
    /// # Errors
    ///
    /// Names the line and the column of the first ambiguous number.
    pub fn check(&self) -> Result<(), InputError> {
        match &self.doubt {
            Some((line, column, field)) if self.sign != Some(Sign::Comma) => Err(InputError::new(
                format!(
                    "\"{field}\" may be {} or {}: nothing in the file tells which",
                    field.replace(',', "."),
                    field.replace(',', "")
                ),
                "write numbers with a decimal point, and without separators between thousands",
            )
            .at_line(*line)
            .in_column(column.clone())),
            _ => Ok(()),
        }
    }
}

/// Whether a text is a number with one comma in place of a decimal point.
pub(crate) fn is_with_comma(field: &str) -> bool {
    field.matches(',').count() == 1
        && !field.contains('.')
        && field.bytes().any(|byte| byte.is_ascii_digit())
        && field.replace(',', ".").parse::<f64>().is_ok()
}

/// Whether the comma in a number may be one between thousands: three digits behind it and up to
/// three before it, the first of them not zero.
fn is_ambiguous(field: &str) -> bool {
    let Some((before, behind)) = field.split_once(',') else {
        return false;
    };
    let before = before.trim_start_matches(['+', '-']);
    (1..=3).contains(&before.len())
        && !before.starts_with('0')
        && behind.len() == 3
        && behind.bytes().all(|byte| byte.is_ascii_digit())
}

fn number(field: &str) -> Result<f64, InputError> {
    field.parse().map_err(|_| {
        InputError::new(
            if field.is_empty() {
                "is empty".to_owned()
            } else {
                format!("\"{field}\" is not a number")
            },
            "write numbers with a decimal point and no unit, or delete the row",
        )
    })
}

/// Whether a field would be a number in one country or another.
pub fn seems_number(field: &str) -> bool {
    field.replace(',', ".").parse::<f64>().is_ok()
}
