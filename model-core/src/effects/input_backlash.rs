//! Backlash of the input: a play of half-width b on the pressure.
//!
//! A valve with a dead band, a regulator with hysteresis, a piston seal that sticks before it
//! slides: the chamber pressure p_c (Pa) stays where it is until the line pressure p has moved
//! away from it by b (Pa), and then follows at that distance. It does not depend on time or
//! angle. p_c has corners where p turns and where the play is taken up.

use super::{
    Family, Hidden, Info, Mechanism, Need, Parameter, Place, Rest, State, Unit, parameters,
};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Mapped, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "input_backlash",
    title: "backlash of the input",
    place: Place::Input,
    equation: "p_c = p_c clamped into p ± b",
    text: "After each reversal of the pressure nothing happens until it has gone back by a fixed \
           amount: a valve with a dead band, a regulator with hysteresis, a seal that sticks. The \
           dead band has the same width in pressure at every angle and at every speed.",
    signature: "pressure since the last reversal of the command",
    look_alikes: &["coulomb_friction", "bouc_wen_hysteresis"],
    family: Family::Play,
    needs: &[Need::Reversal],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: false,
    states: &[State {
        key: "play_pa",
        text: "p_c, pressure (Pa)",
    }],
};

parameters! {
    /// Backlash of the input.
    ///
    /// The play operator: p_c = min(max(p_c before, p − b), p + b).
    ///
    /// The memory is the play's output at the end of the last step. Within a step it is clamped into
    /// p ± b, which is exact as long as p turns round at most once a step and at its end.
    InputBacklash {
        /// Half-width b of the play (Pa).
        half_width: Parameter {
            key: "half_width_kpa",
            symbol: "b",
            unit: Unit::KiloPascal,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.03, 0.1],
        },
    }
}

impl<R: Real> Mechanism<R> for InputBacklash<R> {
    /// A run starts in the middle of the play, p_c = p. A piece that was cut out of a longer run
    /// starts so too, although its play was most likely taken up on one side. That costs up to b.
    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.pressure, R::zero()]
    }

    fn input(&self, pressure: R, hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        let (low, high) = (pressure - self.half_width, pressure + self.half_width);
        if hidden[0] < low {
            low
        } else if hidden[0] > high {
            high
        } else {
            hidden[0]
        }
    }

    fn pressure_towards(&self, pressure: R, hidden: &Hidden<R>) -> R {
        if pressure > hidden[0] {
            pressure + self.half_width
        } else {
            pressure - self.half_width
        }
    }

    fn has_memory(&self) -> bool {
        true
    }

    fn note(&self, _angle: R, pressure: R, hidden: &mut Hidden<R>) {
        hidden[0] = self.input(pressure, hidden, &mut [R::zero(); 2]);
    }
}

impl Preparation for InputBacklash<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Mapped<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[6_000.0], 0.05);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Mapped(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::spring;
    use crate::input::FromFn;
    use crate::integrate::{Scheme, step};

    /// Up to 1, down to −1, up to 0 with b = 0.3: 0.7 at the top, stays there
    /// down to 0.4, −0.7 at the bottom, stays there up to −0.4, ends at −0.3.
    #[test]
    fn output_follows_at_half_the_width_and_waits_after_each_reversal() {
        let play = Kind::InputBacklash.build(&[0.3]).unwrap();
        let model = spring(1.0, 1.0, 1.0, &[play]);
        let mut state = model.at_rest(0.0, 0.0);
        let pressure = |time: f64| {
            if time < 1.0 {
                time
            } else if time < 3.0 {
                2.0 - time
            } else {
                time - 4.0
            }
        };
        for count in 0..400 {
            let start = f64::from(count) * 0.01;
            let input = FromFn(|offset: f64| pressure(start + offset));
            step(Scheme::Rk4, &model, &mut state, &input, 0.01);
            let expected = match count + 1 {
                ..=30 => 0.0,
                up @ 31..=100 => f64::from(up) * 0.01 - 0.3,
                101..=160 => 0.7,
                down @ 161..=300 => 2.0 - f64::from(down) * 0.01 + 0.3,
                301..=360 => -0.7,
                up => f64::from(up) * 0.01 - 4.0 - 0.3,
            };
            let output = state.hidden[0][0];
            assert!((output - expected).abs() < 1e-12, "{count}: {output}");
        }
    }

    /// Within a step the chamber moves as soon as the play is taken up, not only
    /// after the step.
    #[test]
    fn play_is_taken_up_within_the_step() {
        let play = Kind::InputBacklash.build(&[0.3]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[play]);
        let state = model.at_rest(0.0, 0.0);
        let at = |pressure| {
            let input = FromFn(move |_| pressure);
            model.derivative(&state, &input, 0.0).acceleration
        };
        assert!(at(0.2).abs() < 1e-15);
        assert!((at(1.0) - 0.7).abs() < 1e-15);
        assert!((at(-1.0) + 0.7).abs() < 1e-15);
    }
}
