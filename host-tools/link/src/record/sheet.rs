//! The table of a recording, one line per sample.

use std::fmt::Write as _;
use std::time::Duration;

use softrig_formats::instant::Instant;
use wire::decimal::Hundredths;
use wire::telemetry::Setpoint;

use super::shelf::Table;
use super::{LoggedSample, seconds};
use softrig_formats::error::InputError;

/// The columns, in their order.
pub const COLUMNS: &str = "time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq,mismatch";

/// A power cut costs at most this much.
const SYNC_EVERY: Duration = Duration::from_secs(1);

/// A table that is being written.
#[derive(Debug)]
pub struct Sheet {
    table: Box<dyn Table>,
    /// Seconds in one of the board's, if that was measured.
    clock_factor: Option<f64>,
    synced: Instant,
}

/// The first line of a table.
pub(super) fn header() -> String {
    format!("{COLUMNS}\n")
}

impl Sheet {
    /// Goes on with a table that has its header.
    pub(super) fn after_header(table: Box<dyn Table>, clock_factor: Option<f64>) -> Self {
        Self {
            table,
            clock_factor,
            synced: Instant::now(),
        }
    }

    /// Appends a row, in one call.
    ///
    /// # Errors
    ///
    /// Names the file.
    pub fn write(&mut self, row: &LoggedSample) -> Result<(), InputError> {
        self.table.append(line(row, self.clock_factor).as_bytes())?;
        if self.synced.elapsed() >= SYNC_EVERY {
            self.sync()?;
        }
        Ok(())
    }

    /// Waits until what was written is on the disk.
    ///
    /// # Errors
    ///
    /// Names the file.
    pub fn sync(&mut self) -> Result<(), InputError> {
        self.synced = Instant::now();
        self.table.sync()
    }
}

/// A row with its end. What is not known stays empty.
pub fn line(row: &LoggedSample, clock_factor: Option<f64>) -> String {
    let sample = &row.sample;
    let (angle, pressure) = match sample.setpoint {
        Setpoint::None => (None, None),
        Setpoint::Angle(level) => (Some(level), None),
        Setpoint::Pressure(level) => (None, Some(level)),
    };
    let mut text = String::with_capacity(96);
    push_time(&mut text, row.time_ms, clock_factor);
    for value in [sample.pressure_kpa, sample.angle_deg, angle, pressure] {
        text.push(',');
        push(&mut text, value);
    }
    let _ = write!(text, ",{},", sample.volume_ul);
    push(&mut text, sample.predicted_deg);
    let _ = writeln!(
        text,
        ",{},{},{},{}",
        sample.state.name(),
        sample.fault,
        sample.sequence,
        u8::from(sample.mismatch)
    );
    text
}

/// A time in seconds. The board's milliseconds are kept as they are, and corrected ones have
/// microseconds, so that a sample is not moved by rounding.
pub(super) fn push_time(text: &mut String, ms: i64, clock_factor: Option<f64>) {
    if clock_factor.is_some() {
        let _ = write!(text, "{:.6}", seconds(ms, clock_factor));
        return;
    }
    let size = ms.unsigned_abs();
    let sign = if ms < 0 { "-" } else { "" };
    let _ = write!(text, "{sign}{}.{:03}", size / 1000, size % 1000);
}

/// Exactly the decimals that the board sent.
pub(super) fn push(text: &mut String, value: Option<Hundredths>) {
    if let Some(Hundredths(value)) = value {
        let size = value.unsigned_abs();
        let sign = if value < 0 { "-" } else { "" };
        let _ = write!(text, "{sign}{}.{:02}", size / 100, size % 100);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::state::State;
    use wire::telemetry::Telemetry;

    #[test]
    fn a_line_has_the_boards_decimals_and_no_number_where_there_is_no_reading() {
        let mut row = LoggedSample {
            time_ms: 12_345,
            sample: Telemetry {
                sequence: 7,
                time_ms: 99,
                pressure_kpa: Some(Hundredths(-5)),
                angle_deg: Some(Hundredths(5_981)),
                predicted_deg: None,
                setpoint: Setpoint::Angle(Hundredths(6_000)),
                volume_ul: -12,
                state: State::Running,
                fault: 0,
                mismatch: false,
            },
        };
        assert_eq!(
            line(&row, None),
            "12.345,-0.05,59.81,60.00,,-12,,running,0,7,0\n"
        );
        row.sample.angle_deg = None;
        row.sample.mismatch = true;
        row.sample.setpoint = Setpoint::Pressure(Hundredths(4_000));
        row.sample.predicted_deg = Some(Hundredths(100));
        assert_eq!(
            line(&row, Some(1.004)),
            "12.394380,-0.05,,,40.00,-12,1.00,running,0,7,1\n"
        );
        assert_eq!(
            line(&row, None).matches(',').count(),
            COLUMNS.matches(',').count()
        );
    }
}
