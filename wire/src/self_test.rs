//! What the self-test steps: fixed models from a fixed state, one with each power function and
//! one with each effect of the catalogue.
//!
//! The board steps them and prints the bits ([`StepReport`](crate::step_report::StepReport));
//! the computer steps the same and compares. Both must compute the same.

use core::hint::black_box;

use model_core::{
    actuator::{InvalidModel, MAX_EFFECTS, Model, Slot},
    catalogue::{Effect, Kind},
    dynamics::Dynamics,
    effects::table::{InModel, Table, Variable},
    leapfrog::{Accurate, Leapfrog},
    power::{Minimax, Power},
    predictor::{Predictor, STEP_S},
    prepared::{DEAREST, Motion},
};

use crate::stretch::Probe;

/// Design 1 of the paper, as the default model file has it (SI units).
pub const DYNAMICS: Dynamics<f32> = Dynamics {
    inertia: 0.36,
    damping: 0.913,
    stiffness: 0.127,
    exponent: 2.365,
    input_gain: 2.17e-5,
};

/// Angle from which the step starts, in radians.
pub const ANGLE_RAD: f32 = 0.3;
/// Rate from which the step starts, in rad/s.
pub const RATE_RAD_PER_S: f32 = 0.1;
/// Pressure during the step, in pascal.
pub const PRESSURE_PA: f32 = 10_000.0;
/// The largest angle that the models are planned for, in radians.
pub const FARTHEST_RAD: f32 = 2.3;

/// The text that ends the self-test.
pub const DONE: &str = "self-test: done";

/// The name of a step with [`Minimax`].
pub const MINIMAX: &str = "minimax";

/// The name of a step with micromath's power function, guarded.
pub const MICROMATH: &str = "micromath";

/// The name of a step by the table of the power.
pub const TABLE: &str = "table";

/// The name of a step of [`with_dearest`].
pub const DEAREST_THREE: &str = "dearest three";

/// The most parameters that an effect has, but for a table.
const MOST_PARAMETERS: usize = 8;

/// Nodes (rad/s) of the table: the step begins on a slope.
const NODES: [f32; 3] = [-0.3, 0.05, 0.7];
/// Its forces (N).
const FORCES: [f32; 3] = [-0.01, 0.001, -0.03];

/// The model with one effect, its parameters small but within their bounds.
///
/// # Errors
///
/// [`InvalidModel`] if the effect has no such parameters, which the tests rule out.
pub fn with_effect(kind: Kind) -> Result<Model<f32, Minimax>, InvalidModel> {
    if kind == Kind::Table {
        let table =
            Table::new(Variable::Rate, &NODES, &FORCES).map_err(|_| InvalidModel::NotOneTable)?;
        return Model::of_slots(
            DYNAMICS,
            [Some(Effect::Table(InModel)), None, None],
            Some(table),
        );
    }
    let effect = effect(kind).ok_or(InvalidModel::TooManyEffects)?;
    Model::of_slots(DYNAMICS, [Some(effect), None, None], None)
}

/// An effect with small parameters within their bounds.
fn effect(kind: Kind) -> Option<Slot<f32>> {
    let mut values = [0.0; MOST_PARAMETERS];
    for (index, value) in values.iter_mut().enumerate() {
        if let Some((lower, upper)) = kind.bounds(index) {
            // Not `clamp`, which panics if the bounds are the wrong way round.
            *value = 0.05_f32.max(lower).min(upper);
        }
    }
    let values = values.get(..kind.parameter_count())?;
    kind.build_slot(values)
}

/// The model with the three most expensive effects.
///
/// # Errors
///
/// The same as [`with_effect`].
pub fn with_dearest() -> Result<Model<f32, Minimax>, InvalidModel> {
    let mut slots = [None; MAX_EFFECTS];
    for (slot, kind) in slots.iter_mut().zip(DEAREST) {
        *slot = effect(kind);
    }
    Model::of_slots(DYNAMICS, slots, None)
}

/// One step of the predictor from the fixed state, under the fixed pressure, and what the
/// sensor makes of it.
#[inline(never)]
pub fn one_step(predictor: &Predictor, stretch: u8, probe: &mut impl Probe) -> Motion {
    let prepared = predictor.prepared();
    let mut motion = black_box(prepared.moving(ANGLE_RAD, RATE_RAD_PER_S, PRESSURE_PA));
    // What the compiler knows it would compute itself, and nothing would be
    // tested or measured.
    let (pressure, time) = black_box((PRESSURE_PA, STEP_S));
    probe.open(stretch);
    prepared.step(&mut motion, pressure, time);
    prepared.read(&mut motion, time);
    black_box(&motion);
    probe.close();
    motion
}

/// The step that is computed without a table, by a power function of any exponent.
pub fn accurate_step<P: Power<f32>>(stretch: u8, probe: &mut impl Probe) -> (f32, f32) {
    let leapfrog = Leapfrog::new(&DYNAMICS, STEP_S);
    let (scale, exponent) = black_box((leapfrog.pull_scale(), DYNAMICS.exponent));
    let spring = Accurate::<f32, P>::new(scale, exponent);
    let pressure = black_box(PRESSURE_PA);
    let mut drift = black_box(leapfrog.at(&spring, ANGLE_RAD, RATE_RAD_PER_S, pressure));
    probe.open(stretch);
    leapfrog.step(&spring, &mut drift, pressure);
    black_box(&drift);
    probe.close();
    (drift.angle, leapfrog.rate(&spring, &drift, pressure))
}

#[cfg(feature = "std")]
pub use on_the_computer::expected;

#[cfg(feature = "std")]
mod on_the_computer {
    extern crate std;
    use std::vec::Vec;

    use model_core::power::GuardedMicromath;

    use super::{
        DEAREST_THREE, DYNAMICS, FARTHEST_RAD, InvalidModel, Kind, MICROMATH, MINIMAX, Minimax,
        Model, Predictor, TABLE, accurate_step, one_step, with_dearest, with_effect,
    };
    use crate::{step_report::StepReport, stretch::NoProbe};

    /// Every step of the self-test in its order, as this computer computes it.
    ///
    /// # Errors
    ///
    /// [`InvalidModel`] if a constant of this module makes no model, which the tests rule out.
    pub fn expected() -> Result<Vec<StepReport<'static>>, InvalidModel> {
        let report = |power, effect, (angle_rad, rate_rad_per_s)| StepReport {
            power,
            effect,
            angle_rad,
            rate_rad_per_s,
        };
        let predicted = |model: &Model<f32>| {
            let predictor =
                Predictor::new(model, FARTHEST_RAD).map_err(|_| InvalidModel::TooManyEffects)?;
            let motion = one_step(&predictor, 0, &mut NoProbe);
            Ok((motion.angle(), predictor.prepared().rate(&motion)))
        };
        let mut steps = Vec::from([
            report(MINIMAX, None, accurate_step::<Minimax>(0, &mut NoProbe)),
            report(
                MICROMATH,
                None,
                accurate_step::<GuardedMicromath>(0, &mut NoProbe),
            ),
            report(TABLE, None, predicted(&Model::new(DYNAMICS, &[])?)?),
        ]);
        for (index, &kind) in (0..).zip(Kind::ALL) {
            steps.push(report(TABLE, Some(index), predicted(&with_effect(kind)?)?));
        }
        steps.push(report(DEAREST_THREE, None, predicted(&with_dearest()?)?));
        Ok(steps)
    }
}
