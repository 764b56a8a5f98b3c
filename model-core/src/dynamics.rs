//! The parameters of the base equation, and its rates.
//!
//! They are separate from effects and from the model: effects change the parameters and add to
//! the rates, and a model consists of both.

use crate::effects::{Parameter, Unit, parameters};

parameters! {
    @table
    /// Parameters of the base equation, in SI units and radians. Fits start where the
    /// recordings say, and a file has to give all of them.
    Dynamics {
        /// Effective inertia M (kg·m), positive.
        inertia: Parameter {
            key: "inertia_kg_m",
            symbol: "M",
            unit: Unit::KilogramMetre,
            lower: f32::MIN_POSITIVE,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[],
        },
        /// Viscous damping C (N·s/rad), not negative.
        damping: Parameter {
            key: "damping_n_s_per_rad",
            symbol: "C",
            unit: Unit::NewtonSecondPerRad,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[],
        },
        /// Stiffness K (N/radⁿ), not negative.
        stiffness: Parameter {
            key: "stiffness_n_per_rad_n",
            symbol: "K",
            unit: Unit::NewtonPerRadToTheN,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[],
        },
        /// Exponent n of Ludwick's law, positive; 1 is Hooke's law.
        exponent: Parameter {
            key: "exponent",
            symbol: "n",
            unit: Unit::One,
            lower: f32::MIN_POSITIVE,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[],
        },
        /// Input gain g (N/Pa).
        input_gain: Parameter {
            key: "input_gain_n_per_kpa",
            symbol: "g",
            unit: Unit::NewtonPerKiloPascal,
            lower: f32::NEG_INFINITY,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[],
        },
    }
}

/// How fast the equations move: what a step length has to resolve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates<R> {
    /// Stiffness over inertia, the square of an angular frequency (1/s²).
    pub stiffness: R,
    /// Damping over inertia or 1/τ (1/s).
    pub relaxation: R,
}
