//! Parameter transforms: an unbounded solver coordinate for a bounded parameter.
//!
//! Parameters have bounds (a damping is not negative), and the solver has none. So each
//! parameter is a smooth function of an unbounded coordinate, and folds back at its
//! bounds.

use model_core::actuator::{Model, ParameterId};

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
}

impl ParameterTransform {
    /// The transform of a free parameter.
    pub fn of(nominal: &Model<f64>, model: &Model<f64>, id: ParameterId) -> Self {
        let value = model.value(id).unwrap_or(1.0);
        let scale = if value.abs() > 1e-12 {
            value.abs()
        } else {
            1.0
        };
        let (lower, upper) = search_range(nominal, model, id);
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
        }
    }

    /// Whether a position is within a thousandth of the range of a bound.
    pub fn is_at_edge(self, u: f64) -> bool {
        match self {
            Self::Linear { .. } => false,
            Self::Above { .. } => u.abs() < 0.045,
            Self::Between { .. } | Self::Logarithmic { .. } => u.sin().abs() > 0.998,
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
        }
    }
}

/// How far a fit may move a base parameter from its nominal value, as a factor.
///
/// Data sheets are right to a third. A factor of ten allows for a mistaken unit, and
/// stops a fit of a wrong structure from running to infinity along an unidentifiable
/// direction (inertia without influence, everything else scaled up).
const SEARCH_FACTOR: f64 = 10.0;

/// The range in which a fit searches a parameter (SI units), given the nominal model.
fn search_range(nominal: &Model<f64>, model: &Model<f64>, id: ParameterId) -> (f64, f64) {
    let (lower, upper) = bounds(model, id);
    let value = nominal.value(id).unwrap_or(0.0);
    match id {
        ParameterId::Effect { .. } | ParameterId::Exponent => (lower, upper),
        _ if value == 0.0 => (lower, upper),
        ParameterId::InputGain if value < 0.0 => (SEARCH_FACTOR * value, 0.0),
        ParameterId::Damping | ParameterId::Stiffness | ParameterId::InputGain => {
            (0.0, SEARCH_FACTOR * value)
        }
        ParameterId::Inertia => (value / SEARCH_FACTOR, value * SEARCH_FACTOR),
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
