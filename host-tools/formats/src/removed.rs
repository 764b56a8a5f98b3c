//! Samples of a channel that are not believed.
//!
//! They keep their place in a recording, so that its rows stay those of its file: the recorded
//! value is kept here, and a straight line between the neighbours replaces it. An angle that was
//! removed is not fitted; a pressure is bridged.

use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::left_out::What;

/// A measured channel of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// The pressure.
    Pressure,
    /// The bending angle.
    Angle,
}

impl fmt::Display for Channel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pressure => "pressure",
            Self::Angle => "angle",
        })
    }
}

/// Why samples are not believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Why {
    /// They lie far from their neighbours on both sides, which agree.
    Isolated,
    /// They lie far beyond all others.
    OutOfReach,
    /// One value, entered and left in a step that no motion makes.
    Repeated,
    /// The channel has noise and stays at one value to the last digit.
    Frozen,
    /// The channel is slower than the rows, and they repeat its last value.
    Held,
}

impl Why {
    /// Whether it is a fault of the sensor, not a way of sampling.
    pub fn is_fault(self) -> bool {
        self != Self::Held
    }
}

/// Successive samples of a channel that are not believed, for one reason.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Removed {
    /// The channel.
    pub channel: Channel,
    /// The samples.
    pub samples: Range<usize>,
    /// What the file has there, in the unit of the channel.
    pub values: Vec<f64>,
    /// The reason.
    pub why: Why,
}

impl Removed {
    /// What is said of them.
    pub fn what(&self) -> What {
        match (self.why, self.channel) {
            (Why::Frozen, Channel::Pressure) => What::FrozenPressure,
            (Why::Frozen, Channel::Angle) => What::FrozenAngle,
            (Why::Held, Channel::Pressure) => What::HeldPressure,
            (Why::Held, Channel::Angle) => What::HeldAngle,
            (_, Channel::Pressure) => What::ImpossiblePressure,
            (_, Channel::Angle) => What::ImpossibleAngle,
        }
    }

    /// The part within a range of samples, counted from its start.
    pub(crate) fn within(&self, range: &Range<usize>) -> Option<Self> {
        let from = self.samples.start.max(range.start);
        let to = self.samples.end.min(range.end);
        (from < to).then(|| Self {
            samples: from - range.start..to - range.start,
            values: self.values[from - self.samples.start..to - self.samples.start].to_vec(),
            ..self.clone()
        })
    }
}

/// Draws a straight line over time through the removed samples of a channel, between those
/// that are left; beyond the first and the last of them it is level.
pub(crate) fn bridge(time: &[f64], values: &mut [f64], removed: &[bool]) {
    let kept: Vec<usize> = (0..values.len()).filter(|&k| !removed[k]).collect();
    for k in (0..values.len()).filter(|&k| removed[k]) {
        let after = kept.partition_point(|&it| it < k);
        let value = |place: usize| kept.get(place).map(|&it| (time[it], values[it]));
        let before = after.checked_sub(1).and_then(value);
        values[k] = match (before, value(after)) {
            (Some((from, a)), Some((to, b))) => a + (b - a) * (time[k] - from) / (to - from),
            (Some((_, level)), None) | (None, Some((_, level))) => level,
            (None, None) => return,
        };
    }
}
