//! Periodic disturbance: Q = A sin(2πft + φ).
//!
//! A pump's stroke, a fan, a table that shakes. The phase counts from the start of the session
//! (t in s), so that only a disturbance that starts with it has the same phase in several
//! sessions; for any other this is wrong.

use super::table::Variable;
use super::{
    Doubtful, Family, Hidden, Info, Instant, Mechanism, Parameter, Place, State, Unit, full_turn,
    parameters,
};
use crate::dynamics::{Dynamics, Rates};
use crate::elementary::sin_near;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;
use core::f32::consts::{PI, TAU};

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "periodic_disturbance",
    title: "periodic disturbance",
    place: Place::Force,
    equation: "Q = A sin(2πft + φ)",
    text: "Something shakes the actuator at a frequency of its own: the strokes of a pump, a fan, \
           the table. The angle carries a ripple that goes on at rest, is not tied to the edges of \
           the command, and moves when the pump runs at another speed.",
    signature: "a line in the spectrum, not tied to edges",
    look_alikes: &["second_mode"],
    family: Family::Periodic,
    needs: &[],
    own_variable: Some(Variable::Time),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[Doubtful::FewPeriods],
    has_slope: true,
    states: &[State {
        key: "turns",
        text: "turns of the disturbance",
    }],
};

parameters! {
    /// Periodic disturbance.
    PeriodicDisturbance {
        /// Amplitude A (N).
        force: Parameter {
            key: "force_n",
            symbol: "A",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.05],
        },
        /// Frequency f (Hz).
        frequency: Parameter {
            key: "frequency_hz",
            symbol: "f",
            unit: Unit::Hertz,
            lower: 0.031_25,
            upper: 64.0,
            held: None,
            default: None,
            starts: &[0.5, 2.0, 8.0],
        },
        /// Phase φ at the start of the session (rad).
        phase: Parameter {
            key: "phase_rad",
            symbol: "φ",
            unit: Unit::Radian,
            lower: -6.5,
            upper: 6.5,
            held: None,
            default: None,
            starts: &[-1.5, 1.5],
        },
    }
}

impl<R: Real> Mechanism<R> for PeriodicDisturbance<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn force(&self, _at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        rates[0] = self.frequency;
        self.force * (full_turn::<R>() * hidden[0] + self.phase).sin()
    }

    fn has_memory(&self) -> bool {
        true
    }

    /// The turns f·t are integrated as a hidden state. Whole turns are taken off after each step, so
    /// that the sine keeps its resolution in `f32` however long the run lasts.
    fn note(&self, _angle: R, _pressure: R, hidden: &mut Hidden<R>) {
        if hidden[0] >= R::one() {
            hidden[0] -= R::one();
        }
    }

    fn swings_beside(&self) -> bool {
        true
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        let frequency = full_turn::<R>() * self.frequency;
        Rates {
            stiffness: frequency * frequency,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for PeriodicDisturbance<f32> {
    const CYCLES: u16 = 2_400;
    type Part = Turning;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.1, 0.8, 0.3]);

    fn prepare(&self, base: &Base) -> Self::Part {
        let angle = TAU * self.frequency * base.flow.dt;
        // Within a turn and a little by its bounds.
        let phase = if self.phase > PI {
            self.phase - TAU
        } else {
            self.phase
        };
        Turning {
            force: self.force * base.leapfrog.per_newton(),
            angle,
            start: phase - angle,
        }
    }

    fn recall(&self, base: &Base, _step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        let mut turned = self.phase + TAU * hidden[0];
        while turned > PI {
            turned -= TAU;
        }
        // Before the step that the first kick takes it along, as at rest.
        memory[0] = turned - TAU * self.frequency * base.flow.dt;
    }
}

/// A sine; it remembers its phase (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Its amplitude, γ·a (rad).
    force: f32,
    /// By how much the phase advances in a step (rad).
    angle: f32,
    /// The phase before the step that the first kick takes it along (rad).
    start: f32,
}

impl Part for Turning {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    fn at_rest(&self, _step: &mut Step) -> Hidden<f32> {
        [self.start, 0.0]
    }

    fn follows_clock(&self) -> bool {
        true
    }

    #[inline(always)]
    fn force(&self, _base: &Base, _step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        memory[0] += self.angle;
        if memory[0] > PI {
            memory[0] -= TAU;
        }
        self.force * sin_near(memory[0])
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// A free mass: M θ̈ = −A sin(νt + φ) gives
    /// θ = (A/Mν²)[sin(νt + φ) − sin φ − νt cos φ].
    #[test]
    fn free_mass_integrates_the_sine_twice() {
        let (inertia, force, frequency, phase) = (0.5, 0.7, 1.3, 0.6f64);
        let effect = Kind::PeriodicDisturbance
            .build(&[force, frequency, phase])
            .unwrap();
        let model = spring(inertia, 0.0, 0.0, &[effect]);
        let end = run(&model, model.at_rest(0.0, 0.0), &Held(0.0), 5.0, 10_000);
        let nu = core::f64::consts::TAU * frequency;
        let turned = nu * 5.0 + phase;
        let expected =
            force / (inertia * nu * nu) * (turned.sin() - phase.sin() - nu * 5.0 * phase.cos());
        assert!((end.angle - expected).abs() < 1e-9, "{}", end.angle);
        // Whole turns are taken off.
        assert!((end.hidden[0][0] - 0.5).abs() < 1e-9);
    }
}
