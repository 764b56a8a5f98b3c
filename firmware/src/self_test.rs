//! Model steps at start-up, shown to the bit.
//!
//! The claim that the board and the desktop compute the same is checked where it
//! matters: on the image that is flashed. The board steps fixed models from a
//! fixed state, one with each power function and one with each effect of the
//! catalogue, and prints the bits; the desktop does the same and compares.

use core::hint::black_box;

use model_core::{
    actuator::{Dynamics, InvalidModel, Model, State},
    catalogue::{Effect, Kind},
    effects::table::{InModel, Table, Variable},
    input::Held,
    integrate::{Scheme, step},
    power::{GuardedMicromath, Minimax, Power},
};
use ufmt::{uWrite, uwrite};
use wire::{line::Sealed, step_report::StepReport, stretch};

use crate::probe::Probe;

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
/// Length of the step in seconds: the control period.
pub const STEP_S: f32 = 0.005;

/// The text that ends the self-test.
pub const DONE: &str = "self-test done";

/// A power function with the name and the marks that the self-test gives it.
trait Tested: Power<f32> {
    const NAME: &'static str;
    const STEP: u8;
    const POWER: u8;
}

impl Tested for Minimax {
    const NAME: &'static str = "minimax";
    const STEP: u8 = stretch::STEP_MINIMAX;
    const POWER: u8 = stretch::POWER_MINIMAX;
}

impl Tested for GuardedMicromath {
    const NAME: &'static str = "micromath";
    const STEP: u8 = stretch::STEP_MICROMATH;
    const POWER: u8 = stretch::POWER_MICROMATH;
}

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
    let mut values = [0.0; MOST_PARAMETERS];
    for (index, value) in values.iter_mut().enumerate() {
        if let Some((lower, upper)) = kind.bounds(index) {
            // Not `clamp`, which panics if the bounds are the wrong way round.
            *value = 0.05_f32.max(lower).min(upper);
        }
    }
    let effect = values
        .get(..kind.parameter_count())
        .and_then(|values| kind.build_slot(values))
        .ok_or(InvalidModel::TooManyEffects)?;
    Model::of_slots(DYNAMICS, [Some(effect), None, None], None)
}

/// Prints what the firmware is and one step with each power function and effect.
///
/// # Errors
///
/// Those of the output.
pub fn run<W: uWrite + ?Sized>(out: &mut W, probe: &mut impl Probe) -> Result<(), W::Error> {
    let mut line = Sealed::new(out);
    uwrite!(
        line,
        "softrig {} on an ATmega2560",
        env!("CARGO_PKG_VERSION")
    )?;
    line.finish()?;

    probe.open(stretch::NOTHING);
    probe.close();
    for_power::<Minimax, W>(out, probe)?;
    for_power::<GuardedMicromath, W>(out, probe)?;
    for (index, &kind) in (0..).zip(Kind::ALL) {
        let state = with_effect(kind)
            .map(|model| one_step(&model, stretch::effect(usize::from(index)), probe));
        report(out, Minimax::NAME, Some(index), state)?;
    }

    let mut line = Sealed::new(out);
    line.write_str(DONE)?;
    line.finish()
}

fn for_power<P: Tested, W: uWrite + ?Sized>(
    out: &mut W,
    probe: &mut impl Probe,
) -> Result<(), W::Error> {
    let (base, exponent) = black_box((ANGLE_RAD, DYNAMICS.exponent));
    probe.open(P::POWER);
    black_box(P::pow(base, exponent));
    probe.close();

    let state = Model::<f32, P>::new(DYNAMICS, &[]).map(|model| one_step(&model, P::STEP, probe));
    report(out, P::NAME, None, state)
}

/// Steps the model once from the fixed state.
fn one_step<P: Power<f32>>(
    model: &Model<f32, P>,
    stretch: u8,
    probe: &mut impl Probe,
) -> State<f32> {
    // What the compiler knows it would compute itself, and nothing would be
    // tested or measured.
    let model = black_box(model);
    let mut state = black_box(model.moving(ANGLE_RAD, RATE_RAD_PER_S, PRESSURE_PA));
    let input = black_box(Held(PRESSURE_PA));
    let dt = black_box(STEP_S);

    probe.open(stretch);
    step(Scheme::Rk4, model, &mut state, &input, dt);
    black_box(&state);
    probe.close();
    state
}

fn report<W: uWrite + ?Sized>(
    out: &mut W,
    power: &str,
    effect: Option<u8>,
    state: Result<State<f32>, InvalidModel>,
) -> Result<(), W::Error> {
    let Ok(state) = state else {
        // Only a change of the constants above can bring this about.
        let mut line = Sealed::new(out);
        uwrite!(line, "step {}: the model is not valid", power)?;
        return line.finish();
    };
    StepReport {
        power,
        effect,
        angle_rad: state.angle,
        rate_rad_per_s: state.rate,
    }
    .write(out)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::probe::NoProbe;
    use std::{string::String, vec::Vec};

    struct Text(String);

    impl uWrite for Text {
        type Error = core::convert::Infallible;

        fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
            self.0.push_str(text);
            Ok(())
        }
    }

    #[derive(Default)]
    struct Recorder(Vec<Option<u8>>);

    impl Probe for Recorder {
        fn open(&mut self, stretch: u8) {
            self.0.push(Some(stretch));
        }
        fn close(&mut self) {
            self.0.push(None);
        }
    }

    #[test]
    fn every_line_is_sealed_and_the_last_one_says_so() {
        let mut out = Text(String::new());
        run(&mut out, &mut NoProbe).unwrap();
        let texts: Vec<_> = out
            .0
            .lines()
            .map(|line| wire::line::open(line).unwrap())
            .collect();
        assert_eq!(texts.len(), 4 + Kind::ALL.len());
        assert!(texts.iter().all(|text| !text.contains("not valid")));
        assert_eq!(texts.last(), Some(&DONE));
    }

    #[test]
    fn the_step_follows_the_equation_of_motion() {
        let mut exact = Model::<f64>::new(DYNAMICS.map(f64::from), &[])
            .unwrap()
            .moving(f64::from(ANGLE_RAD), f64::from(RATE_RAD_PER_S), 0.0);
        step(
            Scheme::Rk4,
            &Model::<f64>::new(DYNAMICS.map(f64::from), &[]).unwrap(),
            &mut exact,
            &Held(f64::from(PRESSURE_PA)),
            f64::from(STEP_S),
        );
        let minimax = Model::<f32, Minimax>::new(DYNAMICS, &[]).unwrap();
        let micromath = Model::<f32, GuardedMicromath>::new(DYNAMICS, &[]).unwrap();
        for state in [
            one_step(&minimax, 0, &mut NoProbe),
            one_step(&micromath, 0, &mut NoProbe),
        ] {
            assert!((f64::from(state.angle) - exact.angle).abs() < 1e-6);
            assert!((f64::from(state.rate) - exact.rate).abs() < 1e-5);
        }
        assert!((exact.rate - f64::from(RATE_RAD_PER_S)).abs() > 1e-4);
    }

    #[test]
    fn stretches_do_not_overlap() {
        let mut recorder = Recorder::default();
        run(&mut Text(String::new()), &mut recorder).unwrap();
        assert!(recorder.0.len() >= 10);
        for pair in recorder.0.chunks(2) {
            assert!(matches!(pair, [Some(_), None]), "{:?}", recorder.0);
        }
    }
}
