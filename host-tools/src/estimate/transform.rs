//! Parameter transforms: an unbounded solver coordinate for a bounded parameter.
//!
//! Parameters have bounds (a damping is not negative), and the solver has none. So each
//! parameter is a smooth function of an unbounded coordinate, and folds back at its
//! bounds.
//!
//! Base parameters may be orders of magnitude from the initial guess, so their coordinates
//! are linear near it and logarithmic beyond. Their bounds come from the recordings
//! ([`Limits`]), never from the numbers of the model file.

use model_core::actuator::{Model, ParameterId};

use super::Dataset;
use crate::io::model_file::KnownRange;

/// The map from the solver's unbounded coordinate u to a parameter p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterTransform {
    /// No bounds: p = s·u.
    Linear {
        /// s.
        scale: f64,
    },
    /// A lower bound: p = l + s(√(u² + 1) − 1).
    Above {
        /// l.
        lower: f64,
        /// s.
        scale: f64,
    },
    /// Two bounds: p = l + (h − l)(1 + sin u)/2.
    Between {
        /// l.
        lower: f64,
        /// h.
        upper: f64,
    },
    /// Two positive bounds, orders of magnitude apart: as for two bounds, in ln p.
    Logarithmic {
        /// l.
        lower: f64,
        /// h.
        upper: f64,
    },
    /// From zero to an upper bound far away: p = s(cosh(w sin u) − 1).
    Wide {
        /// s.
        scale: f64,
        /// w.
        reach: f64,
    },
    /// Either sign up to a bound far away: p = s sinh(w sin u).
    Signed {
        /// s.
        scale: f64,
        /// w.
        reach: f64,
    },
}

/// What recordings can show of the base parameters at most.
///
/// A motion faster than the sampling, or slower than ten times the recording, is none that
/// a fit could find. So with the sampling interval h, the largest angle a and the largest
/// pressure P
///
/// ```text
/// C ≤ 10 M/h       the inertia's time constant M/C is a tenth of an interval or more
/// K ≤ 50 M/(h² n aⁿ⁻¹)     as is, at that damping, a fifth of an interval the spring's C/K
/// |g| ≤ 10 K aⁿ/P    of the largest K
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Limits {
    /// Shortest interval between samples (s).
    interval: f64,
    /// Longest session (s).
    duration: f64,
    /// Largest angle (rad).
    angle: f64,
    /// Largest pressure (Pa).
    pressure: f64,
    /// What is known beside the recordings.
    known: Vec<KnownRange>,
}

/// Intervals between samples that the inertia's time constant M/C may be short of one.
pub(super) const FASTEST_INERTIA: f64 = 10.0;

/// The same of the spring's time constant C/K.
const FASTEST_SPRING: f64 = 5.0;

/// Largest gain, in multiples of the one that balances the stiffest spring.
const LARGEST_GAIN: f64 = 10.0;

/// How far an inertia may move from its value, as a factor: only its ratio to the others
/// moves anything.
const INERTIA_RANGE: f64 = 1e3;

impl Limits {
    /// Takes them from the sessions.
    pub fn of(data: &Dataset) -> Self {
        let sessions = || data.sessions().iter();
        Self {
            interval: sessions()
                .map(|session| session.sampled_every())
                .fold(f64::INFINITY, f64::min),
            duration: sessions()
                .map(|session| session.recording().duration())
                .fold(0.0, f64::max),
            angle: data.largest_angle().max(1e-6),
            pressure: sessions()
                .map(|session| session.largest_pressure())
                .fold(0.0, f64::max),
            known: data.known_ranges().to_vec(),
        }
    }

    /// The largest damping that the recordings show beside an inertia.
    pub(super) fn damping(&self, inertia: f64) -> f64 {
        FASTEST_INERTIA * inertia / self.interval
    }

    /// The stiffness K whose slope at the largest angle is `slope` (N/rad).
    pub(super) fn stiffness_of(&self, slope: f64, exponent: f64) -> f64 {
        slope / (exponent * self.angle.powf(exponent - 1.0))
    }

    /// The size that is taken for a parameter that is zero, and its largest magnitude.
    fn size(&self, model: &Model<f64>, id: ParameterId) -> (f64, f64) {
        let dynamics = model.dynamics();
        let (inertia, exponent) = (dynamics.inertia, dynamics.exponent);
        let damping = self.damping(inertia);
        let stiffest = self.stiffness_of(damping * FASTEST_SPRING / self.interval, exponent);
        let slow = std::f64::consts::TAU / self.duration;
        let stiffness = self.stiffness_of(inertia * slow * slow, exponent);
        let gain = |stiffness: f64| stiffness * self.angle.powf(exponent) / self.pressure;
        match id {
            ParameterId::Damping => (inertia * slow, damping),
            ParameterId::Stiffness => (stiffness, stiffest),
            _ => (gain(stiffness), LARGEST_GAIN * gain(stiffest)),
        }
    }

    /// Scale and reach of a base parameter whose value is orders of magnitude from its bound.
    fn reach(&self, model: &Model<f64>, id: ParameterId) -> Option<(f64, f64)> {
        /// A value nearer to its bound moves the bound.
        const ROOM: f64 = 10.0;
        let (size, largest) = self.size(model, id);
        let value = model.value(id)?.abs();
        let scale = if value > 1e-9 * size { value } else { size };
        let largest = largest.max(ROOM * scale);
        let ratio = largest / scale;
        (ratio.is_finite() && scale > 0.0).then(|| (scale, ratio.asinh()))
    }
}

impl ParameterTransform {
    /// The transform of a free parameter.
    pub fn of(limits: &Limits, model: &Model<f64>, id: ParameterId) -> Self {
        if let Some(&KnownRange { lower, upper, .. }) =
            limits.known.iter().find(|known| known.id == id)
        {
            return Self::Between { lower, upper };
        }
        let reach = limits.reach(model, id);
        match (id, reach) {
            (ParameterId::Damping | ParameterId::Stiffness, Some((scale, reach))) => {
                return Self::Wide { scale, reach };
            }
            (ParameterId::InputGain, Some((scale, reach))) => {
                return Self::Signed { scale, reach };
            }
            _ => {}
        }
        let value = model.value(id).unwrap_or(1.0);
        let scale = if value.abs() > 1e-12 {
            value.abs()
        } else {
            1.0
        };
        let (lower, upper) = match id {
            ParameterId::Inertia => (value / INERTIA_RANGE, value * INERTIA_RANGE),
            _ => bounds(model, id),
        };
        match (lower.is_finite(), upper.is_finite()) {
            (true, true) if lower > 0.0 && upper / lower > 50.0 => {
                Self::Logarithmic { lower, upper }
            }
            (true, true) => Self::Between { lower, upper },
            (true, false) => Self::Above { lower, scale },
            _ => Self::Linear { scale },
        }
    }

    /// The value at `u`.
    pub fn to_value(self, u: f64) -> f64 {
        match self {
            Self::Linear { scale } => scale * u,
            Self::Above { lower, scale } => lower + scale * ((u * u + 1.0).sqrt() - 1.0),
            Self::Between { lower, upper } => lower + (upper - lower) * 0.5 * (1.0 + u.sin()),
            Self::Logarithmic { lower, upper } => {
                lower * ((upper / lower).ln() * 0.5 * (1.0 + u.sin())).exp()
            }
            // 2 sinh²(x/2) = cosh x − 1 without its loss of digits.
            Self::Wide { scale, reach } => 2.0 * scale * (0.5 * reach * u.sin()).sinh().powi(2),
            Self::Signed { scale, reach } => scale * (reach * u.sin()).sinh(),
        }
    }

    /// dp/du at `u`.
    pub fn slope(self, u: f64) -> f64 {
        match self {
            Self::Linear { scale } => scale,
            Self::Above { scale, .. } => scale * u / (u * u + 1.0).sqrt(),
            Self::Between { lower, upper } => (upper - lower) * 0.5 * u.cos(),
            Self::Logarithmic { lower, upper } => {
                self.to_value(u) * (upper / lower).ln() * 0.5 * u.cos()
            }
            Self::Wide { scale, reach } => scale * (reach * u.sin()).sinh() * reach * u.cos(),
            Self::Signed { scale, reach } => scale * (reach * u.sin()).cosh() * reach * u.cos(),
        }
    }

    /// The size of a typical value.
    pub fn scale(self) -> f64 {
        match self {
            Self::Linear { scale }
            | Self::Above { scale, .. }
            | Self::Wide { scale, .. }
            | Self::Signed { scale, .. } => scale,
            Self::Between { lower, upper } | Self::Logarithmic { lower, upper } => upper - lower,
        }
    }

    /// Whether a position is within a thousandth of the range of a bound.
    pub fn is_at_edge(self, u: f64) -> bool {
        match self {
            Self::Linear { .. } => false,
            Self::Above { .. } => u.abs() < 0.045,
            Self::Between { .. } | Self::Logarithmic { .. } | Self::Signed { .. } => {
                u.sin().abs() > 0.998
            }
            Self::Wide { reach, .. } => u.sin().abs() > 0.998 || (reach * u.sin()).abs() < 0.045,
        }
    }

    /// The coordinate of a value. On a bound the slope is zero and the solver could
    /// never leave it, so initial guesses keep a small distance.
    pub fn position(self, value: f64) -> f64 {
        const MARGIN: f64 = 2e-5;
        match self {
            Self::Linear { scale } => value / scale,
            Self::Above { lower, scale } => {
                let ratio = ((value - lower) / scale).max(MARGIN) + 1.0;
                (ratio * ratio - 1.0).sqrt()
            }
            Self::Between { lower, upper } => {
                let share = ((value - lower) / (upper - lower)).clamp(MARGIN, 1.0 - MARGIN);
                (2.0 * share - 1.0).asin()
            }
            Self::Logarithmic { lower, upper } => {
                let share =
                    ((value / lower).ln() / (upper / lower).ln()).clamp(MARGIN, 1.0 - MARGIN);
                (2.0 * share - 1.0).asin()
            }
            Self::Wide { scale, reach } => {
                let ratio = (value / scale).max(MARGIN);
                (2.0 * (0.5 * ratio).sqrt().asinh() / reach)
                    .min(1.0 - MARGIN)
                    .asin()
            }
            Self::Signed { scale, reach } => ((value / scale).asinh() / reach)
                .clamp(MARGIN - 1.0, 1.0 - MARGIN)
                .asin(),
        }
    }
}

/// The bounds of a parameter in SI units.
pub fn bounds(model: &Model<f64>, id: ParameterId) -> (f64, f64) {
    match id {
        ParameterId::Inertia => (1e-9, f64::INFINITY),
        ParameterId::Damping | ParameterId::Stiffness => (0.0, f64::INFINITY),
        ParameterId::Exponent => (0.25, 8.0),
        ParameterId::InputGain => (f64::NEG_INFINITY, f64::INFINITY),
        ParameterId::Effect { slot, parameter } => model
            .effects()
            .nth(slot)
            .and_then(|effect| effect.parameters().get(parameter))
            .map_or((f64::NEG_INFINITY, f64::INFINITY), |row| {
                (f64::from(row.lower), f64::from(row.upper))
            }),
    }
}
