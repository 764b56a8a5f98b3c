//! Lines that are not rows, and are left out as long as they are few.

use std::path::Path;

use super::Samples;
use crate::columns::Layout;
use crate::error::InputError;
use crate::left_out::{LeftOut, What};

/// Largest share of the lines that are not rows.
const BAD_SHARE: f64 = 0.05;

/// Lines that are not rows: torn, cut off, or written by a board while it starts; rows of another
/// format in which a number is missing.
#[derive(Default)]
pub(super) struct BadLines {
    lines: Vec<u64>,
    /// Lines that repeat the header.
    pub(super) headers: Vec<u64>,
    first: Option<InputError>,
    /// What is wrong with the last line, if it was cut off.
    pub(super) at_end: Option<InputError>,
}

impl BadLines {
    pub(super) fn take(&mut self, line: u64, error: InputError) {
        self.lines.push(line);
        self.first.get_or_insert(error);
    }

    /// Says what was left out, or refuses it if it is too much.
    pub(super) fn finish(
        self,
        samples: &mut Samples,
        path: &Path,
        layout: &Layout,
    ) -> Result<(), InputError> {
        let share = self.lines.len() as f64 / (samples.len() + self.lines.len()) as f64;
        if let Some(first) = self.first {
            let is_only = self.lines.len() == 1;
            let first = self.at_end.filter(|_| is_only).unwrap_or(first);
            if layout.strict || share > BAD_SHARE {
                let more = self.lines.len() - 1;
                return Err(match more {
                    0 => first,
                    _ => InputError {
                        found: format!("{} ({more} more lines are no rows either)", first.found),
                        ..first
                    },
                });
            }
            let what = if samples.lines.is_text() {
                "line"
            } else {
                "sample"
            };
            let places = self.lines.iter().map(|line| format!("{what} {line}"));
            let text = format!("left out; the first of them {}", first.found);
            let said = LeftOut::new(What::BadLine, path, places, text);
            samples.left_out.push(said);
        }
        if !self.headers.is_empty() {
            let places = self.headers.iter().map(|line| format!("line {line}"));
            let text = "left out, as after a reset of the board";
            let said = LeftOut::new(What::RepeatedHeader, path, places, text);
            samples.left_out.push(said);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounded::Limits;
    use crate::formats::{Decimals, Sheet, Values};

    /// Forty rows, of which the first have no pressure.
    fn without(missing: usize, layout: &Layout) -> Result<Samples, InputError> {
        let numbers = |of: &dyn Fn(usize) -> f64| {
            Values::Numbers((0..40).map(of).collect(), Decimals::Various)
        };
        let pressure = |k| if k < missing { f64::NAN } else { 5.0 };
        let sheet = Sheet {
            columns: vec![
                ("time_s".into(), numbers(&|k| k as f64)),
                ("pressure_kpa".into(), numbers(&pressure)),
                ("angle_deg".into(), numbers(&|k| k as f64)),
                ("seq".into(), numbers(&|k| k as f64)),
            ],
            ..Sheet::default()
        };
        sheet.samples(Path::new("a.npz"), layout, Limits::RECORDING, "array")
    }

    #[test]
    fn rows_without_a_number_are_left_out_while_they_are_few() {
        let plain = Layout::default();
        let samples = without(2, &plain).unwrap();
        assert!((samples.time_s[0] - 2.0).abs() < 1e-12);
        assert_eq!(samples.extra[0].fields[0], "2");
        assert_eq!(samples.lines.place(0), "sample 3");
        assert_eq!(samples.left_out[0].places, ["sample 1", "sample 2"]);
        assert!(without(0, &plain).unwrap().left_out.is_empty());
        for refused in [
            without(3, &plain),
            without(
                1,
                &Layout {
                    strict: true,
                    ..plain.clone()
                },
            ),
        ] {
            let said = refused.unwrap_err().to_string();
            assert!(
                said.contains("column pressure_kpa: row 1: NaN is not"),
                "{said}"
            );
        }
    }
}
