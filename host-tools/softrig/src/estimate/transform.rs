//! Parameter transforms: the solver's coordinate of a parameter.
//!
//! Each parameter is an increasing function of its coordinate, in which a step of a tenth is
//! a noticeable one wherever it begins. Bounds (a damping is not negative) are bounds of the
//! coordinate, which the solver keeps ([`super::descent`]).
//!
//! Base parameters may be orders of magnitude from the initial guess, so their coordinates
//! are linear near it and logarithmic beyond. Their bounds come from the recordings
//! ([`Limits`]), never from the numbers of the model file.

use model_core::actuator::{Model, ParameterId};
use model_core::effects::Unit;

use super::Dataset;
use softrig_formats::model_file::KnownRange;

/// The map from the solver's coordinate u to a parameter p.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterTransform {
    /// No bounds: p = s·u.
    Linear {
        /// s.
        scale: f64,
    },
    /// A lower bound: p = l + s·u.
    Above {
        /// l.
        lower: f64,
        /// s.
        scale: f64,
    },
    /// Two bounds: p = l + (h − l)·u.
    Between {
        /// l.
        lower: f64,
        /// h.
        upper: f64,
    },
    /// Two positive bounds, orders of magnitude apart: p = l (h/l)ᵘ.
    Logarithmic {
        /// l.
        lower: f64,
        /// h.
        upper: f64,
    },
    /// From zero to an upper bound far away: p = s sinh u, u ≤ w.
    Wide {
        /// s.
        scale: f64,
        /// w.
        reach: f64,
    },
    /// Either sign up to a bound far away: p = s sinh u, |u| ≤ w.
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
    /// Interval between the samples that are compared (s), the longest.
    compared: f64,
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

/// Intervals between compared samples that a time constant of an effect has at least.
const SHORTEST_LAG: f64 = 0.25;

/// Part of the largest angle that a rate crosses in the longest session at least: slower is rest.
const SLOWEST_RATE: f64 = 0.1;

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
            compared: sessions()
                .map(|session| session.interval())
                .fold(0.0, f64::max),
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
        slope / (exponent * libm::pow(self.angle, exponent - 1.0))
    }

    /// The size that is taken for a parameter that is zero, and its largest magnitude.
    fn size(&self, model: &Model<f64>, id: ParameterId) -> (f64, f64) {
        let dynamics = model.dynamics();
        let (inertia, exponent) = (dynamics.inertia, dynamics.exponent);
        let damping = self.damping(inertia);
        let stiffest = self.stiffness_of(damping * FASTEST_SPRING / self.interval, exponent);
        let slow = std::f64::consts::TAU / self.duration;
        let stiffness = self.stiffness_of(inertia * slow * slow, exponent);
        let gain = |stiffness: f64| stiffness * libm::pow(self.angle, exponent) / self.pressure;
        match id {
            ParameterId::Damping => (inertia * slow, damping),
            ParameterId::Stiffness => (stiffness, stiffest),
            _ => (gain(stiffness), LARGEST_GAIN * gain(stiffest)),
        }
    }

    /// Bounds of a parameter of an effect. A time constant far below the interval between samples
    /// does not show, nor does what a friction does at rates that are rest; both only make a
    /// simulation long. A start beyond moves the bound.
    fn bounds(&self, model: &Model<f64>, id: ParameterId) -> (f64, f64) {
        let (lower, upper) = bounds(model, id);
        let least = match model.row(id).map(|row| row.unit) {
            Some(Unit::Second) => SHORTEST_LAG * self.compared,
            Some(Unit::RadianPerSecond) => SLOWEST_RATE * self.angle / self.duration,
            _ => return (lower, upper),
        };
        let start = model.value(id).unwrap_or(upper);
        if lower > 0.0 && least.is_finite() {
            (lower.max(least.min(start)), upper)
        } else {
            (lower, upper)
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
        (ratio.is_finite() && scale > 0.0).then(|| (scale, libm::asinh(ratio)))
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
            _ => limits.bounds(model, id),
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

    /// The least and the largest u.
    pub const fn bounds(self) -> [f64; 2] {
        match self {
            Self::Linear { .. } => [f64::NEG_INFINITY, f64::INFINITY],
            Self::Above { .. } => [0.0, f64::INFINITY],
            Self::Between { .. } | Self::Logarithmic { .. } => [0.0, 1.0],
            Self::Wide { reach, .. } => [0.0, reach],
            Self::Signed { reach, .. } => [-reach, reach],
        }
    }

    /// The value at `u`, or at the bound that `u` is beyond.
    pub fn to_value(self, u: f64) -> f64 {
        let [least, most] = self.bounds();
        let u = u.max(least).min(most);
        match self {
            Self::Linear { scale } => scale * u,
            Self::Above { lower, scale } => lower + scale * u,
            Self::Between { lower, upper } => lower + (upper - lower) * u,
            Self::Logarithmic { lower, upper } => lower * libm::pow(upper / lower, u),
            Self::Wide { scale, .. } | Self::Signed { scale, .. } => scale * libm::sinh(u),
        }
    }

    /// dp/du at `u`.
    pub fn slope(self, u: f64) -> f64 {
        match self {
            Self::Linear { scale } | Self::Above { scale, .. } => scale,
            Self::Between { lower, upper } => upper - lower,
            Self::Logarithmic { lower, upper } => self.to_value(u) * libm::log(upper / lower),
            Self::Wide { scale, .. } | Self::Signed { scale, .. } => scale * libm::cosh(u),
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
        const NEAR: f64 = 1e-3;
        let [least, most] = self.bounds();
        let range = (most - least).min(1.0);
        u < least + NEAR * range || u > most - NEAR * range
    }

    /// The coordinate of a value.
    pub fn position(self, value: f64) -> f64 {
        let u = match self {
            Self::Linear { scale } => value / scale,
            Self::Above { lower, scale } => (value - lower) / scale,
            Self::Between { lower, upper } => (value - lower) / (upper - lower),
            Self::Logarithmic { lower, upper } => {
                libm::log(value.max(lower) / lower) / libm::log(upper / lower)
            }
            Self::Wide { scale, .. } | Self::Signed { scale, .. } => libm::asinh(value / scale),
        };
        let [least, most] = self.bounds();
        u.max(least).min(most)
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
