//! A sample as `softrig monitor` hands it on: printed, sent to other programs, or logged.

use serde_json::{Number, Value};

use softrig_link::record::{COLUMNS, LoggedSample, line};
use softrig_link::{Clock, Event};

/// A sample at its place in time, as a row of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Row {
    /// Time since the first sample (ms), by the board's clock.
    pub time_ms: i64,
    /// The row, with the end of its line.
    pub text: String,
}

impl Row {
    /// The row of a sample; none of other events, and of a sample that is no later than the one
    /// before.
    pub(super) fn of(event: &Event, clock: &mut Clock) -> Option<Self> {
        let Event::Sample(received) = event else {
            return None;
        };
        let time_ms = clock.place(received)?.time_ms;
        let row = LoggedSample {
            time_ms,
            sample: received.sample,
        };
        Some(Self {
            time_ms,
            text: line(&row, None),
        })
    }

    /// Its columns with their values. What is not known is left out.
    pub(super) fn fields(&self) -> impl Iterator<Item = (&'static str, Value)> {
        let cells = COLUMNS.split(',').zip(self.text.trim_end().split(','));
        let known = cells.filter(|(_, cell)| !cell.is_empty());
        known.map(|(name, cell)| {
            let number = cell.parse().ok().and_then(Number::from_f64);
            (
                name,
                number.map_or_else(|| Value::from(cell), Value::Number),
            )
        })
    }
}
