//! The table of a recording, one line per sample.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use wire::decimal::Hundredths;
use wire::telemetry::Setpoint;

use super::{LoggedSample, seconds};
use softrig_formats::error::{InputError, Pending};

/// The columns, in their order.
pub const COLUMNS: &str = "time_s,pressure_kpa,angle_deg,setpoint_deg,setpoint_kpa,pump_ul,predicted_deg,state,fault,seq,mismatch";

/// A power cut costs at most this much.
const SYNC_EVERY: Duration = Duration::from_secs(1);

/// A table that is being written.
#[derive(Debug)]
pub struct Sheet {
    path: PathBuf,
    file: File,
    /// Seconds in one of the board's, if that was measured.
    clock_factor: Option<f64>,
    /// Bytes of whole lines.
    length: u64,
    synced: Instant,
}

/// The first line of a table.
pub(super) fn header() -> String {
    format!("{COLUMNS}\n")
}

impl Sheet {
    /// Creates the file, with its header.
    ///
    /// # Errors
    ///
    /// Names the file.
    pub fn create(path: &Path, clock_factor: Option<f64>) -> Result<Self, InputError> {
        let file = Pending::new(path, header().as_bytes())?.commit()?;
        Ok(Self::after_header(path, file, clock_factor))
    }

    /// Goes on after the header, which was written to the file.
    pub(super) fn after_header(path: &Path, file: File, clock_factor: Option<f64>) -> Self {
        Self {
            path: path.to_owned(),
            file,
            clock_factor,
            length: header().len() as u64,
            synced: Instant::now(),
        }
    }

    /// Appends a row.
    ///
    /// # Errors
    ///
    /// Names the file.
    pub fn write(&mut self, row: &LoggedSample) -> Result<(), InputError> {
        self.append(&line(row, self.clock_factor))?;
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
        match self.file.sync_data() {
            // Pipes and devices have no disk.
            Err(error) if error.kind() != std::io::ErrorKind::InvalidInput => {
                Err(not_written(&self.path, &error))
            }
            _ => Ok(()),
        }
    }

    /// One call, unbuffered: a program that is killed leaves whole lines.
    fn append(&mut self, text: &str) -> Result<(), InputError> {
        match self.file.write_all(text.as_bytes()) {
            Ok(()) => {
                self.length += text.len() as u64;
                Ok(())
            }
            Err(error) => {
                // A full disk takes a part of a line, which would be read as a wrong number.
                // Taking back needs no room; pipes and devices keep what they got.
                let _ = self.file.set_len(self.length);
                let _ = self.file.seek(SeekFrom::Start(self.length));
                Err(not_written(&self.path, &error))
            }
        }
    }
}

fn not_written(path: &Path, error: &std::io::Error) -> InputError {
    InputError::new(
        format!("cannot be written: {error}"),
        "check the folder and make space on the disk; the rows that were written are kept",
    )
    .in_file(path)
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
