//! Records a rig without losing received samples.
//!
//! Every sample is written as one line, in one call, as soon as it is read: however the
//! program ends, the file is a valid recording up to the last line. The metadata is
//! written at the beginning and completed at the end; until then it has no counts.

mod black_box;
mod limits;
mod meta;
mod outcome;
pub mod session;
mod sheet;
pub mod shelf;
mod split;

use std::path::{Path, PathBuf};

use wire::history::Moment;
use wire::state::State;
use wire::telemetry::Telemetry;

pub use black_box::black_box_path;
pub use limits::check_limits;
pub use meta::{About, Counts, Gap};
pub use outcome::RecordingOutcome;
pub use sheet::{COLUMNS, Sheet, line};
pub use shelf::{Disk, Shelf, Table};
pub use split::{Part, Step, parts, run_path, steps};

use crate::{Clock, Event, Received};
use softrig_formats::error::InputError;
use softrig_formats::recording::{FAULTY_ENDING, meta_beside};

/// A sample at its place on the time axis, which is the board's until it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoggedSample {
    /// Time since the first sample (ms).
    pub time_ms: i64,
    /// The sample.
    pub sample: Telemetry,
}

/// Writes what arrives.
#[derive(Debug)]
pub struct Recorder {
    shelf: Box<dyn Shelf>,
    path: PathBuf,
    /// The recording's metadata.
    pub about: About,
    /// Lines received and lost; part of the metadata at the end.
    pub counts: Counts,
    sheet: Sheet,
    /// Rows that are no recording because a sensor had no reading.
    faulty: Option<Sheet>,
    clock: Clock,
    kept: Option<Vec<LoggedSample>>,
    last: Option<LoggedSample>,
    failure: Option<InputError>,
}

/// Seconds of a time of the board's (ms), of whose seconds each takes `factor`; those of the board
/// itself where that is not known.
fn seconds(ms: i64, factor: Option<f64>) -> f64 {
    ms as f64 / 1000.0 * factor.unwrap_or(1.0)
}

/// Where what is known about a recording stands.
pub fn meta_path(path: &Path) -> PathBuf {
    meta_beside(path)
}

/// Where the rows without a reading of both sensors go.
pub fn faulty_path(path: &Path) -> PathBuf {
    path.with_extension(&FAULTY_ENDING[1..])
}

impl Recorder {
    /// Starts a recording; `keep` remembers its rows, so that runs can be found in
    /// them.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    pub fn create(
        shelf: Box<dyn Shelf>,
        path: &Path,
        about: About,
        keep: bool,
    ) -> Result<Self, InputError> {
        let table = shelf.begin(
            (path, sheet::header().as_bytes()),
            (&meta_path(path), about.to_text().as_bytes()),
        )?;
        // What that recording left would be taken for ours.
        shelf.remove(&faulty_path(path));
        shelf.remove(&black_box_path(path));
        Ok(Self {
            sheet: Sheet::after_header(table, about.clock_factor),
            shelf,
            path: path.to_owned(),
            clock: about
                .clock_factor
                .map_or_else(Clock::default, Clock::of_rate),
            about,
            counts: Counts::default(),
            faulty: None,
            kept: keep.then(Vec::new),
            last: None,
            failure: None,
        })
    }

    /// Takes what happened on the link.
    pub fn take(&mut self, event: &Event) {
        if let Event::Sample(received) = event
            && self.failure.is_none()
        {
            self.failure = self.note(received).err();
        }
    }

    /// The last sample and its time.
    pub fn last(&self) -> Option<&LoggedSample> {
        self.last.as_ref()
    }

    /// Time from the first sample to the last (ms).
    pub fn elapsed_ms(&self) -> i64 {
        self.last.map_or(0, |row| row.time_ms)
    }

    /// Whether everything could be written.
    ///
    /// # Errors
    ///
    /// The error of a write that failed.
    pub fn check(&self) -> Result<(), InputError> {
        // It stays: rows after those that are missing would look like one recording.
        self.failure.clone().map_or(Ok(()), Err)
    }

    fn note(&mut self, received: &Received) -> Result<(), InputError> {
        let Some(placed) = self.clock.place(received) else {
            return Ok(());
        };
        let row = LoggedSample {
            time_ms: placed.time_ms,
            sample: received.sample,
        };
        if self.last.is_none() {
            self.about.uptime_s = Some(f64::from(row.sample.time_ms) / 1000.0);
            self.write_meta()?;
        }
        self.last = Some(row);
        // At rest it is that of an earlier run.
        let disagrees = row.sample.mismatch && row.sample.state == State::Running;
        if disagrees && self.about.mismatch_from_s.is_none() {
            self.about.mismatch_from_s = Some(row.time_ms as f64 / 1000.0);
        }
        if let Some(gap) = placed.gap {
            self.about.gap.push(Gap::new(gap, self.about.clock_factor));
            self.write_meta()?;
        }
        if row.sample.pressure_kpa.is_some() && row.sample.angle_deg.is_some() {
            self.sheet.write(&row)?;
            self.counts.samples += 1;
            if let Some(kept) = &mut self.kept {
                kept.push(row);
            }
            return Ok(());
        }
        let faulty = match &mut self.faulty {
            Some(faulty) => faulty,
            none => {
                let path = faulty_path(&self.path);
                let table = self.shelf.table(&path, sheet::header().as_bytes())?;
                none.insert(Sheet::after_header(table, self.about.clock_factor))
            }
        };
        faulty.write(&row)?;
        self.counts.rows_without_reading += 1;
        Ok(())
    }

    /// Writes the second before a fault beside the recording, on its time axis.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    pub fn write_black_box(&mut self, past: &[Moment]) -> Result<PathBuf, InputError> {
        let path = black_box_path(&self.path);
        let text = black_box::text(past, self.last.as_ref(), self.about.clock_factor);
        self.shelf.put(&path, text.as_bytes())?;
        self.about.black_box = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        Ok(path)
    }

    /// Writes what is known so far.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written.
    pub fn write_meta(&self) -> Result<(), InputError> {
        self.shelf
            .put(&meta_path(&self.path), self.about.to_text().as_bytes())
    }

    /// Ends the recording. Writes the parts of its protocol that were played into
    /// its metadata, as segments, and with `cut` also each step to a file of its
    /// own. Returns the paths of these files.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be written. What is known is written all the same, if
    /// there is room for it.
    pub fn finish(mut self, parts: &[Part], cut: bool) -> Result<Vec<PathBuf>, InputError> {
        self.about.counts = Some(self.counts);
        if let Err(failure) = self.check().and_then(|()| self.sheet.sync()) {
            self.about.complete = false;
            let _ = self.write_meta();
            return Err(failure);
        }
        let rows = self.kept.take().unwrap_or_default();
        let runs = split::split(&rows, parts, self.about.complete);
        let mut written = Vec::new();
        for run in runs.iter().filter(|_| cut) {
            if let Some(step) = run.step {
                let path = run_path(&self.path, &step);
                split::write_run(self.shelf.as_ref(), &path, &step, run.rows, &self.about)?;
                written.push(path);
            }
        }
        self.about.segment = runs
            .iter()
            .filter_map(|run| run.segment(self.about.clock_factor))
            .collect();
        self.about.runs = written
            .iter()
            .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()))
            .collect();
        self.write_meta()?;
        Ok(written)
    }
}
