//! The self-test: model steps, printed to the last bit.
//!
//! Board and desktop must compute the same. This is checked on the flashed image: the board
//! steps fixed models from a fixed state, one with each power function and one with each
//! effect of the catalogue, and prints the bits; the desktop does the same and compares.

use core::hint::black_box;

use model_core::{
    actuator::Model,
    catalogue::Kind,
    power::{GuardedMicromath, Minimax, Power},
    predictor::Predictor,
};
use ufmt::{uWrite, uwrite};
use wire::{
    line::Sealed,
    self_test::{
        ANGLE_RAD, DEAREST_THREE, DONE, DYNAMICS, FARTHEST_RAD, MICROMATH, MINIMAX, TABLE,
        accurate_step, one_step, with_dearest, with_effect,
    },
    step_report::StepReport,
    stretch::{self, Probe},
};

/// A power function with the name and the marks that the self-test gives it.
trait Tested: Power<f32> {
    const NAME: &'static str;
    const STEP: u8;
    const POWER: u8;
}

impl Tested for Minimax {
    const NAME: &'static str = MINIMAX;
    const STEP: u8 = stretch::STEP_MINIMAX;
    const POWER: u8 = stretch::POWER_MINIMAX;
}

impl Tested for GuardedMicromath {
    const NAME: &'static str = MICROMATH;
    const STEP: u8 = stretch::STEP_MICROMATH;
    const POWER: u8 = stretch::POWER_MICROMATH;
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
    use model_core::{
        input::Held,
        integrate::{Scheme, step},
        predictor::STEP_S,
    };
    use std::vec::Vec;
    use wire::{
        self_test::{PRESSURE_PA, RATE_RAD_PER_S},
        stretch::NoProbe,
        text::Text,
    };

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
