//! The open-loop prediction beside the rig, and the mismatch flag.
//!
//! The recurrence itself is [`model_core::predictor`], which a computer can repeat from
//! the log. This module decides when it restarts, and when an error of the prediction is
//! a mismatch.
//!
//! It starts from a single line of telemetry with its noise: 0.1° and 0.08 kPa rms after
//! sixteen conversions, a fiftieth of the shipped band, and the model relaxes from it. A
//! mean of the last second would be quieter, but then a log that begins at a run, or that
//! lost a line before it, could not be reproduced bit by bit.

use model_core::predictor::{Prediction, Predictor};
use wire::{
    decimal::Hundredths,
    settings::{Key, Settings},
};

use crate::{design::PERIOD_S, units::DEG_PER_RAD};

/// The readings of a telemetry line, as they are sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    /// Gauge pressure (kPa).
    pub pressure: Option<Hundredths>,
    /// Bending angle (°).
    pub angle: Option<Hundredths>,
}

/// The prediction and the mismatch flag.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Monitor {
    prediction: Option<Prediction>,
    predicted: Option<Hundredths>,
    /// Time for which the error has been outside the band (s).
    outside: f32,
    mismatch: bool,
}

impl Monitor {
    /// Starts from rest at the next readings.
    pub fn restart(&mut self) {
        self.prediction = None;
        self.predicted = None;
        self.outside = 0.0;
    }

    /// Clears the flag.
    pub fn clear(&mut self) {
        self.outside = 0.0;
        self.mismatch = false;
    }

    /// Whether prediction and measurement disagreed for too long.
    pub fn mismatch(&self) -> bool {
        self.mismatch
    }

    /// The predicted reading of the angle sensor (°); none before the first readings,
    /// and after the model diverged.
    pub fn predicted(&self) -> Option<Hundredths> {
        self.predicted
    }

    /// The predictor's state.
    pub fn prediction(&self) -> Option<&Prediction> {
        self.prediction.as_ref()
    }

    /// Advances to the next telemetry line: starts from it if there is no prediction and
    /// both readings are valid, otherwise makes a step. The error only counts while
    /// `judge`: at rest an actuator may be bent by hand.
    pub fn step(&mut self, predictor: &Predictor, settings: &Settings, seen: &Seen, judge: bool) {
        match (&mut self.prediction, seen) {
            (Some(prediction), _) => {
                predictor.step(prediction, seen.pressure.map(|pressure| pressure.0));
            }
            (
                none,
                Seen {
                    pressure: Some(pressure),
                    angle: Some(angle),
                },
            ) => *none = Some(predictor.start(angle.0, pressure.0)),
            _ => return,
        }
        let Some(prediction) = &self.prediction else {
            return;
        };
        let degrees = prediction.reading() * DEG_PER_RAD;
        self.predicted = degrees.is_finite().then(|| Hundredths::round(degrees));
        if !judge {
            self.outside = 0.0;
            return;
        }
        let Some(angle) = seen.angle else { return };
        let inside = self.predicted.is_some_and(|predicted| {
            let gap = angle.0.saturating_sub(predicted.0).saturating_abs();
            gap <= Hundredths::round(settings.number(Key::MismatchBand)).0
        });
        self.outside = if inside { 0.0 } else { self.outside + PERIOD_S };
        if self.outside > settings.number(Key::MismatchTime) {
            self.mismatch = true;
        }
    }
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation)]
mod tests {
    extern crate std;
    use super::*;
    use crate::plant::dynamics;
    use model_core::actuator::Model;

    fn predictor() -> Predictor {
        let dynamics = dynamics(&Settings::DEFAULT).map(|value| value as f32);
        Predictor::new(&Model::new(dynamics, &[]).unwrap(), 2.3).unwrap()
    }

    fn seen(pressure: i32, angle: i32) -> Seen {
        Seen {
            pressure: Some(Hundredths(pressure)),
            angle: Some(Hundredths(angle)),
        }
    }

    #[test]
    fn the_flag_needs_the_band_the_time_and_a_judge() {
        let (predictor, settings) = (predictor(), Settings::DEFAULT);
        let mut monitor = Monitor::default();
        let pass = |monitor: &mut Monitor, angle, judge, periods| {
            for _ in 0..periods {
                monitor.step(&predictor, &settings, &seen(0, angle), judge);
            }
        };
        pass(&mut monitor, 0, true, 500);
        assert_eq!(monitor.predicted(), Some(Hundredths(0)));
        pass(&mut monitor, 499, true, 500);
        pass(&mut monitor, 600, false, 500);
        pass(&mut monitor, 600, true, 49);
        pass(&mut monitor, 0, true, 1);
        pass(&mut monitor, 600, true, 49);
        assert!(!monitor.mismatch());
        pass(&mut monitor, 600, true, 3);
        assert!(monitor.mismatch());
        pass(&mut monitor, 0, true, 100);
        assert!(monitor.mismatch(), "it is latched");
        monitor.clear();
        assert!(!monitor.mismatch());
    }

    #[test]
    fn waits_for_readings_and_starts_from_them() {
        let predictor = predictor();
        let mut monitor = Monitor::default();
        let blind = Seen {
            angle: None,
            ..seen(100, 0)
        };
        monitor.step(&predictor, &Settings::DEFAULT, &blind, true);
        assert_eq!(monitor.predicted(), None);
        monitor.step(&predictor, &Settings::DEFAULT, &seen(100, 321), true);
        assert_eq!(monitor.predicted(), Some(Hundredths(321)));
        assert_eq!(monitor.prediction().unwrap().steps(), 0);
        monitor.step(&predictor, &Settings::DEFAULT, &blind, true);
        assert_eq!(monitor.prediction().unwrap().steps(), 1);
    }
}
