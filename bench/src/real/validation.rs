//! A validation run of real data, as the pictures show it.
//!
//! The curves come from `softrig simulate -o`, whose column `predicted_deg` stands beside
//! the measured angle.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use softrig_formats::recording::Recording;

/// One validation run, or an excerpt of it; of several runs the one on which the refit misses most.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct Validation {
    /// Name of the recording.
    pub run: String,
    /// Whether this is an excerpt.
    pub is_excerpt: bool,
    /// Times of the samples (s).
    pub time_s: Vec<f64>,
    /// What the column `angle_deg` holds.
    pub measured: Vec<f64>,
    /// As the refitted model simulates it.
    pub refit: Vec<f64>,
    /// As the repaired model does, where there is a repair.
    pub repaired: Option<Vec<f64>>,
}

/// Oscillations that can be told apart at the picture's width.
const MOST_PERIODS: f64 = 15.0;

impl Validation {
    /// Of runs as the refitted model simulates them, and the same runs by the repaired model; of that there may be none.
    ///
    /// # Errors
    ///
    /// Which run cannot be read, or that there is none.
    pub fn of(refit: &[PathBuf], repaired: &[PathBuf]) -> Result<Self, String> {
        let refit = read_all(refit)?;
        let repaired = read_all(repaired)?;
        let worst = (0..refit.len())
            .max_by(|&a, &b| refit[a].rms().total_cmp(&refit[b].rms()))
            .ok_or("there is no run to draw")?;
        let (refit, repaired) = (&refit[worst], repaired.get(worst));
        let shown = refit.excerpt();
        Ok(Self {
            run: refit.name.clone(),
            is_excerpt: shown.len() < refit.time.len(),
            time_s: refit.time[shown.clone()].to_vec(),
            measured: refit.measured_deg[shown.clone()].to_vec(),
            refit: refit.predicted_deg[shown.clone()].to_vec(),
            repaired: repaired.map(|run| run.predicted_deg[shown].to_vec()),
        })
    }
}

/// A run with what one model says to it.
struct Simulated {
    name: String,
    time: Vec<f64>,
    measured_deg: Vec<f64>,
    predicted_deg: Vec<f64>,
}

fn read_all(paths: &[PathBuf]) -> Result<Vec<Simulated>, String> {
    paths.iter().map(|path| Simulated::read(path)).collect()
}

impl Simulated {
    fn read(path: &Path) -> Result<Self, String> {
        let (recording, _) = Recording::read(path).map_err(|error| error.to_string())?;
        let predicted_deg = recording.column("predicted_deg").ok_or_else(|| {
            format!(
                "{}: no column predicted_deg, which `softrig simulate --recording` writes",
                path.display()
            )
        })?;
        Ok(Self {
            name: recording.name,
            time: recording.time,
            measured_deg: recording.angle.iter().map(|a| a.to_degrees()).collect(),
            predicted_deg,
        })
    }

    fn error(&self) -> Vec<f64> {
        let pairs = self.predicted_deg.iter().zip(&self.measured_deg);
        pairs
            .map(|(predicted, measured)| predicted - measured)
            .collect()
    }

    fn rms(&self) -> f64 {
        softrig::statistics::rms(&self.error())
    }

    /// The samples to draw: all, or those few periods in which the model misses most.
    fn excerpt(&self) -> Range<usize> {
        let all = 0..self.time.len();
        let mean = self.measured_deg.iter().sum::<f64>() / self.measured_deg.len().max(1) as f64;
        let crossings = self
            .measured_deg
            .windows(2)
            .filter(|pair| (pair[0] - mean) * (pair[1] - mean) < 0.0)
            .count();
        let periods = crossings as f64 / 2.0;
        if periods <= 2.0 * MOST_PERIODS {
            return all;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let length = (self.time.len() as f64 * MOST_PERIODS / periods) as usize;
        let squares: Vec<f64> = self.error().iter().map(|error| error * error).collect();
        (0..self.time.len() / length.max(1))
            .map(|place| place * length..(place + 1) * length)
            .max_by(|a, b| {
                let sum = |range: &Range<usize>| squares[range.clone()].iter().sum::<f64>();
                sum(a).total_cmp(&sum(b))
            })
            .unwrap_or(all)
    }
}
