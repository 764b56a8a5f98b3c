//! The self-test: model steps, printed to the last bit.
//!
//! Board and desktop must compute the same. This is checked on the flashed image: the board
//! steps fixed models from a fixed state, one with each power function and one with each
//! effect of the catalogue, and prints the bits; the desktop does the same and compares.

use core::hint::black_box;

use model_core::{
    actuator::{InvalidModel, MAX_EFFECTS, Model, Slot},
    catalogue::{Effect, Kind},
    dynamics::Dynamics,
    effects::table::{InModel, Table, Variable},
    leapfrog::{Accurate, Leapfrog},
    power::{GuardedMicromath, Minimax, Power},
    predictor::{Predictor, STEP_S},
    prepared::{DEAREST, Motion},
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
/// The largest angle that the models are planned for, in radians.
pub const FARTHEST_RAD: f32 = 2.3;

/// The text that ends the self-test.
pub const DONE: &str = "self-test: done";

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

/// How far the self-test is. Its models are stepped where otherwise the model of the
/// settings is, since there is no room for another; their tables take a while.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SelfTest {
    /// The next line.
    line: u8,
    /// Whether its model is in the predictor.
    has_model: bool,
}

/// Lines before those of the models.
const HEAD: u8 = 3;

impl SelfTest {
    /// Goes on, and writes at most one line; whether there is more to come.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    #[inline(never)]
    pub fn advance<W: uWrite + ?Sized>(
        &mut self,
        predictor: &mut Predictor,
        out: &mut W,
        probe: &mut impl Probe,
    ) -> Result<bool, W::Error> {
        match self.line {
            0 => {
                probe.open(stretch::NOTHING);
                probe.close();
                let mut line = Sealed::new(out);
                uwrite!(
                    line,
                    "softrig: {} on an ATmega2560",
                    env!("CARGO_PKG_VERSION")
                )?;
                line.finish()?;
            }
            1 => report(out, Minimax::NAME, None, for_power::<Minimax>(probe))?,
            2 => {
                let state = for_power::<GuardedMicromath>(probe);
                report(out, GuardedMicromath::NAME, None, state)?;
            }
            _ => return self.model(predictor, out, probe),
        }
        self.line += 1;
        Ok(true)
    }

    /// Steps the next model: the base equation, each effect, the dearest three.
    fn model<W: uWrite + ?Sized>(
        &mut self,
        predictor: &mut Predictor,
        out: &mut W,
        probe: &mut impl Probe,
    ) -> Result<bool, W::Error> {
        if self.has_model && !predictor.prepare() {
            return Ok(true);
        }
        let place = self.line - HEAD;
        let effect = usize::from(place).checked_sub(1);
        let kind = effect.and_then(|index| Kind::ALL.get(index));
        let (power, stretch, model) = match (effect, kind) {
            (None, _) => (
                TABLE,
                stretch::STEP_TABLE,
                Model::of_slots(DYNAMICS, [None; 3], None),
            ),
            (Some(index), Some(&kind)) => (TABLE, stretch::effect(index), with_effect(kind)),
            (Some(index), None) if index == Kind::ALL.len() => {
                (DEAREST_THREE, stretch::STEP_DEAREST, with_dearest())
            }
            _ => {
                let mut line = Sealed::new(out);
                line.write_str(DONE)?;
                line.finish()?;
                return Ok(false);
            }
        };
        if self.has_model {
            let motion = one_step(predictor, stretch, probe);
            let state = (motion.angle(), predictor.prepared().rate(&motion));
            report(out, power, kind.and(place.checked_sub(1)), state)?;
        } else {
            self.has_model =
                model.is_ok_and(|model| predictor.restart(&model, FARTHEST_RAD).is_ok());
            if self.has_model {
                return Ok(true);
            }
            // Only a change of the constants above can bring this about.
            let mut line = Sealed::new(out);
            line.write_str("model: not valid")?;
            line.finish()?;
        }
        self.has_model = false;
        self.line += 1;
        Ok(true)
    }
}

/// The name of a step by the table of the power.
pub const TABLE: &str = "table";

/// The name of a step of [`with_dearest`].
pub const DEAREST_THREE: &str = "dearest three";

#[inline(never)]
fn for_power<P: Tested>(probe: &mut impl Probe) -> (f32, f32) {
    let (base, exponent) = black_box((ANGLE_RAD, DYNAMICS.exponent));
    probe.open(P::POWER);
    black_box(P::pow(base, exponent));
    probe.close();
    accurate_step::<P>(P::STEP, probe)
}

#[inline(never)]
fn report<W: uWrite + ?Sized>(
    out: &mut W,
    power: &str,
    effect: Option<u8>,
    (angle_rad, rate_rad_per_s): (f32, f32),
) -> Result<(), W::Error> {
    StepReport {
        power,
        effect,
        angle_rad,
        rate_rad_per_s,
    }
    .write(out)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::probe::NoProbe;
    use model_core::{
        input::Held,
        integrate::{Scheme, step},
    };
    use std::vec::Vec;
    use wire::text::Text;

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

    /// The whole test, as the application runs it.
    fn run(out: &mut Text, probe: &mut impl Probe) {
        let mut predictor = Predictor::empty();
        let mut test = SelfTest::default();
        while test.advance(&mut predictor, out, probe).unwrap() {}
    }

    #[test]
    fn every_line_is_sealed_and_the_last_one_says_so() {
        let mut out = Text::default();
        run(&mut out, &mut NoProbe);
        let texts: Vec<_> = out
            .0
            .lines()
            .map(|line| wire::line::open(line).unwrap())
            .collect();
        assert_eq!(texts.len(), 6 + Kind::ALL.len());
        assert!(
            texts.iter().all(|text| !text.contains("not valid")),
            "{texts:#?}"
        );
        assert_eq!(texts.last(), Some(&DONE));
    }

    #[test]
    fn the_step_follows_the_equation_of_motion() {
        let model = Model::<f64>::new(DYNAMICS.map(f64::from), &[]).unwrap();
        let mut exact = model.moving(f64::from(ANGLE_RAD), f64::from(RATE_RAD_PER_S), 0.0);
        let input = Held(f64::from(PRESSURE_PA));
        step(Scheme::Rk4, &model, &mut exact, &input, f64::from(STEP_S));
        let base = Model::<f32>::new(DYNAMICS, &[]).unwrap();
        let predictor = Predictor::new(&base, FARTHEST_RAD).unwrap();
        let motion = one_step(&predictor, 0, &mut NoProbe);
        for (angle, rate) in [
            accurate_step::<Minimax>(0, &mut NoProbe),
            accurate_step::<GuardedMicromath>(0, &mut NoProbe),
            (motion.angle(), predictor.prepared().rate(&motion)),
        ] {
            assert!((f64::from(angle) - exact.angle).abs() < 1e-6);
            assert!((f64::from(rate) - exact.rate).abs() < 1e-5);
        }
        assert!((exact.rate - f64::from(RATE_RAD_PER_S)).abs() > 1e-4);
    }

    #[test]
    fn stretches_do_not_overlap() {
        let mut recorder = Recorder::default();
        run(&mut Text::default(), &mut recorder);
        assert!(recorder.0.len() >= 10);
        for pair in recorder.0.chunks(2) {
            assert!(matches!(pair, [Some(_), None]), "{:?}", recorder.0);
        }
    }
}
