//! Second mode: ξ̈ + 2ζ₂ω₂ξ̇ + ω₂²ξ = −b θ̈, y = θ + ξ.
//!
//! A second way of swinging, ξ (rad), that the bending drives by its
//! acceleration and that the sensor sees on top of the angle: the tip wags, the
//! sensor strip flutters. f₂ = ω₂/2π (Hz) is its frequency, ζ₂ its damping ratio,
//! b the share of the acceleration that drives it. It does not act back on θ: its
//! mass is small. A run starts with ξ at rest, which a piece that was cut out
//! right after an edge does not; that is where this is weak.

use super::{
    Family, Hidden, Info, Mechanism, Parameter, Place, State, Unit, full_turn, parameters,
};
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;
use core::f32::consts::TAU;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "second_mode",
    title: "second mode of vibration",
    place: Place::Sensor,
    equation: "ξ̈ + 2ζ₂ω₂ξ̇ + ω₂²ξ = −b θ̈, y = θ + ξ, ω₂ = 2πf₂",
    text: "Something vibrates that the model has no coordinate for: the tip wags, the sensor strip \
           flutters. After each edge of the pressure the angle carries a faster ripple of \
           always the same frequency, which dies away and leaves rest angles as they are.",
    signature: "a narrow line in the spectrum after each edge",
    look_alikes: &["periodic_disturbance"],
    family: Family::SecondMode,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[
        State {
            key: "deflection_rad",
            text: "ξ, deflection (rad)",
        },
        State {
            key: "deflection_rad_per_s",
            text: "dξ/dt, its rate (rad/s)",
        },
    ],
};

parameters! {
    /// Second mode of vibration.
    SecondMode {
        /// Frequency f₂ = ω₂/2π (Hz).
        frequency: Parameter {
            key: "frequency_hz",
            symbol: "f₂",
            unit: Unit::Hertz,
            lower: 0.125,
            upper: 64.0,
            held: None,
            default: None,
            starts: &[2.0, 5.0, 12.0],
        },
        /// Damping ratio ζ₂. Beyond ½ nothing is seen to swing: such a pair of lags
        /// imitates any curve.
        damping_ratio: Parameter {
            key: "damping_ratio",
            symbol: "ζ₂",
            unit: Unit::One,
            lower: 0.0,
            upper: 0.5,
            held: None,
            default: None,
            starts: &[0.08],
        },
        /// Coupling b.
        coupling: Parameter {
            key: "coupling",
            symbol: "b",
            unit: Unit::One,
            lower: -8.0,
            upper: 8.0,
            held: None,
            default: None,
            starts: &[-0.3, 0.3],
        },
    }
}

impl<R: Real> SecondMode<R> {
    fn angular_frequency(&self) -> R {
        full_turn::<R>() * self.frequency
    }
}

impl<R: Real> Mechanism<R> for SecondMode<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn respond(&self, acceleration: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) {
        let frequency = self.angular_frequency();
        let [deflection, rate] = *hidden;
        let damping = (self.damping_ratio + self.damping_ratio) * rate;
        rates[0] = rate;
        rates[1] = -(self.coupling * acceleration) - frequency * (damping + frequency * deflection);
    }

    fn sensor(&self, angle: R, _time: R, hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        angle + hidden[0]
    }

    fn swings_beside(&self) -> bool {
        true
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        let frequency = self.angular_frequency();
        Rates {
            stiffness: frequency * frequency,
            relaxation: (self.damping_ratio + self.damping_ratio) * frequency,
        }
    }
}

impl Preparation for SecondMode<f32> {
    const CYCLES: u16 = 2_400;
    type Part = Mode;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[3.0, 0.1, 0.15]);

    fn prepare(&self, base: &Base) -> Self::Part {
        Mode::of(self, base.flow.dt)
    }

    fn set_moving(&self, rate: f32, memory: &mut Hidden<f32>) {
        memory[1] = self.coupling * rate / (TAU * self.frequency);
    }
}

/// The mode over one step, with the rate of the actuator constant in it. Its state is z and
/// (ż + b·ω)/ω₂.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// What a step makes of the state.
    step: [[f32; 2]; 2],
    /// What a way of one does (1/rad).
    per_way: [f32; 2],
}

impl Part for Mode {
    fn phases(&self) -> Phases {
        Phases {
            after: true,
            ..Phases::READING
        }
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        let [z, u] = *memory;
        let [[a, b], [c, d]] = self.step;
        *memory = [
            a * z + b * u + self.per_way[0] * step.moved,
            c * z + d * u + self.per_way[1] * step.moved,
        ];
        0.0
    }

    fn read(&self, step: &mut Step, memory: &mut Hidden<f32>) {
        step.reading += memory[0];
    }
}

impl Mode {
    /// z̈ = −b·ω̇ − ω₂(2ζż + ω₂z) over `dt` seconds.
    #[inline(never)]
    fn of(effect: &SecondMode<f32>, dt: f32) -> Self {
        let turn = TAU * effect.frequency * dt;
        let damping = 2.0 * effect.damping_ratio;
        // e^(turn·[[0, 1], [−1, −2ζ]]): halved until its series converges fast, then squared.
        let mut size = turn * (1.0 + damping);
        let mut halvings = 0;
        let mut part = turn;
        while size > 0.25 {
            size *= 0.5;
            part *= 0.5;
            halvings += 1;
        }
        let generator = [[0.0, part], [-part, -damping * part]];
        let mut step = [[1.0, 0.0], [0.0, 1.0]];
        for order in (1..=5_u8).rev() {
            let mut next = product(&generator, &step);
            let share = 1.0 / f32::from(order);
            for entry in next.as_flattened_mut() {
                *entry *= share;
            }
            next[0][0] += 1.0;
            next[1][1] += 1.0;
            step = next;
        }
        for _ in 0..halvings {
            step = product(&step, &step);
        }
        // A rate ω adds −b·ω to ż and 2ζ·b·ω to the other: over a step F⁻¹(Φ − 1) of that.
        let drive = [-effect.coupling, damping * effect.coupling];
        let [[a, b], [c, d]] = step;
        let over = (a - 1.0) * drive[0] + b * drive[1];
        let under = c * drive[0] + (d - 1.0) * drive[1];
        Self {
            step,
            per_way: [(-damping * over - under) / turn, over / turn],
        }
    }
}

#[inline(never)]
fn product(a: &[[f32; 2]; 2], b: &[[f32; 2]; 2]) -> [[f32; 2]; 2] {
    let mut product = [[0.0; 2]; 2];
    for (row, [left, right]) in product.iter_mut().zip(a) {
        for (entry, (over, under)) in row.iter_mut().zip(b[0].iter().zip(&b[1])) {
            *entry = left * over + right * under;
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// A free mass under a held force accelerates evenly, and the mode answers
    /// with the step response of a damped oscillator to −b F/M.
    #[test]
    fn even_acceleration_gives_the_step_response_of_an_oscillator() {
        let (frequency, ratio, coupling) = (1.7, 0.1, 0.4);
        let mode = Kind::SecondMode
            .build(&[frequency, ratio, coupling])
            .unwrap();
        let model = spring(0.5, 0.0, 0.0, &[mode]);
        let natural = core::f64::consts::TAU * frequency;
        let damped = natural * f64::sqrt(1.0 - ratio * ratio);
        for time in [0.1, 0.9, 2.5] {
            let end = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), time, 4_000);
            let envelope = f64::exp(-ratio * natural * time);
            let phase = damped * time;
            let swing = phase.cos() + ratio * natural / damped * phase.sin();
            let settled = -coupling * 2.0 / (natural * natural);
            let expected = settled * (1.0 - envelope * swing);
            assert!((end.hidden[0][0] - expected).abs() < 1e-11, "{time} s");
            let reading = model.reading(&end);
            assert!((reading - time * time - expected).abs() < 1e-10, "{time} s");
        }
    }
}
