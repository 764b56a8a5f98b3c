//! What an effect does in a step of the board.
//!
//! An effect is prepared once for steps of one length ([`Preparation`], in the effect's file).
//! What comes of it, a [`Part`], has its constants and acts in the phases of a step, which
//! [`crate::prepared`] puts in order.
//!
//! Where nothing can be prepared, the effect's own [`Mechanism`] acts: [`Mapped`], [`Stiffened`],
//! [`Forced`], [`Shown`]. A law of the rate alone has no part: [`crate::glide`] takes its losses
//! ([`RateLaw`]).

use crate::actuator::Model;
use crate::dynamics::Dynamics;
use crate::effects::{Hidden, Instant, Mechanism};
use crate::glide::Flow;
use crate::leapfrog::Leapfrog;

/// The steps that parts are prepared for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Base {
    /// The model that is stepped.
    pub model: Model<f32>,
    /// Its base equation.
    pub leapfrog: Leapfrog<f32>,
    /// The drift, with the length of a step (s).
    pub flow: Flow,
    /// Length of a period (s), after which the sensors are read.
    pub interval: f32,
}

impl Base {
    /// An inertia that nothing acts on.
    #[inline(always)]
    pub(crate) fn empty() -> Self {
        Self {
            model: Model::inert(),
            leapfrog: Leapfrog::empty(),
            flow: Flow {
                decay: 0.0,
                dt: 0.0,
                reach: 0.0,
                keep: 0.0,
            },
            interval: 0.0,
        }
    }
}

/// The step at hand. In memory, because a small processor hands few numbers to a function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Bending angle (rad): before the drift at its start, after it at its end.
    pub angle: f32,
    /// Way of the drift (rad).
    pub moved: f32,
    /// Pressure at the end of the step (Pa), as far as the input path has carried it.
    pub chamber: f32,
    /// Time at its end (s).
    pub time: f32,
    /// Pull of the spring at its end (rad of way).
    pub pull: f32,
    /// What the angle sensor shows (rad).
    pub reading: f32,
}

impl Step {
    /// What an effect sees after the drift. Laws of the rate have no part: its rate is zero.
    #[inline]
    pub(crate) fn instant(&self) -> Instant<f32> {
        Instant {
            time: self.time,
            angle: self.angle,
            rate: 0.0,
            pressure: self.chamber,
        }
    }
}

/// When a part acts: a step leaves out a phase in which none does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Phases {
    /// Before the drift.
    pub before: bool,
    /// After it.
    pub after: bool,
    /// On the reading.
    pub reading: bool,
}

impl Phases {
    /// In none.
    pub const NONE: Self = Self {
        before: false,
        after: false,
        reading: false,
    };
    /// Before the drift.
    pub const BEFORE: Self = Self {
        before: true,
        ..Self::NONE
    };
    /// After the drift.
    pub const AFTER: Self = Self {
        after: true,
        ..Self::NONE
    };
    /// On the reading.
    pub const READING: Self = Self {
        reading: true,
        ..Self::NONE
    };

    /// The phases of either.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            before: self.before | other.before,
            after: self.after | other.after,
            reading: self.reading | other.reading,
        }
    }
}

/// A law of the rate alone, as the glide tabulates it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateLaw {
    /// The rate (rad/s), either way, beyond which the force is a straight line.
    pub farthest: f32,
    /// Whether the directions differ.
    pub sided: bool,
}

impl RateLaw {
    /// That of a friction with a smoothed sign.
    pub(crate) fn of_sign(friction: &impl Mechanism<f32>, model: &Model<f32>) -> Option<Self> {
        friction.sign(model.dynamics()).map(|sign| Self {
            farthest: sign.saturated,
            sided: false,
        })
    }
}

/// How an effect is prepared for steps.
pub trait Preparation {
    /// Cycles that it adds to a step on the board, with what several effects share.
    ///
    /// Measured on the simulated board, which the tests compare, and rounded up. Rare steps cost
    /// more: one in which a hysteresis loop turns round, or that is long for its exponential.
    const CYCLES: u16;

    /// What acts in a step.
    type Part: Part;

    /// How it is tested: see [`Trial`].
    #[cfg(test)]
    const TRIAL: Trial;

    /// Computes the constants.
    fn prepare(&self, base: &Base) -> Self::Part;

    /// The law of the rate that it is in this model; none if it is another effect.
    fn rate_law(&self, _model: &Model<f32>) -> Option<RateLaw> {
        None
    }

    /// The fastest rate (1/s) that it adds to the damping of a drift, for angles up to `farthest`
    /// (rad), if its part takes from the drift: a step must not outlast it.
    fn brakes(&self, _dynamics: &Dynamics<f32>, _farthest: f32) -> Option<f32> {
        None
    }

    /// Changes the memory of its part at rest to that of a start in motion (rad/s).
    fn set_moving(&self, _rate: f32, _memory: &mut Hidden<f32>) {}

    /// Sets the memory of its part to that of a state with these hidden values. `step` has the
    /// angle of the state, and the reading that enters the effect.
    fn recall(&self, _base: &Base, _step: &Step, _hidden: Hidden<f32>, _memory: &mut Hidden<f32>) {}
}

/// What an effect does in a step. Every method but one defaults to doing nothing.
///
/// [`Part::before`] and [`Part::force`] are inlined into one function of all effects: a call of
/// its own costs the board 90 cycles a step.
///
/// | phase | method | example |
/// |---|---|---|
/// | before the drift | [`Part::before`] | a tube changes the pressure, a drag takes from the rate |
/// | after the drift | [`Part::force`] | gravity pulls, a Maxwell branch relaxes |
/// | end of a period | [`Part::read`] | a slow sensor |
pub trait Part {
    /// When it acts: only the methods of these phases are called.
    fn phases(&self) -> Phases;

    /// What it remembers after a long rest, at an angle and under the pressure that enters it,
    /// which becomes the one that leaves it.
    fn at_rest(&self, _step: &mut Step) -> Hidden<f32> {
        [0.0; 2]
    }

    /// Maps the pressure, or returns the share of the rate that it takes and takes its part of
    /// the way.
    fn before(&self, _step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        0.0
    }

    /// Carries its memory along the drift and returns its force (rad of way), or changes the
    /// pull of the spring.
    #[inline(always)]
    fn force(&self, _base: &Base, _step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        0.0
    }

    /// Whether its memory goes on with the clock alone, also in the kick of a start.
    fn follows_clock(&self) -> bool {
        false
    }

    /// Maps the reading, a period after the last one.
    fn read(&self, _step: &mut Step, _memory: &mut Hidden<f32>) {}
}

/// The part of an effect that is in the exponent, in the memory of pressures, in the glide or
/// beside another damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nothing;

impl Part for Nothing {
    fn phases(&self) -> Phases {
        Phases::NONE
    }
}

/// Maps the pressure as the effect says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapped<E>(pub E);

impl<E: Mechanism<f32>> Part for Mapped<E> {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        let entering = step.chamber;
        step.chamber = self.0.input(entering, &[entering, 0.0], &mut [0.0; 2]);
        [entering, 0.0]
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        step.chamber = self.0.input(step.chamber, memory, &mut [0.0; 2]);
        // A play rests where it was pushed to; effects without a memory ignore this.
        memory[0] = step.chamber;
        0.0
    }
}

/// Multiplies the stiffness as the effect says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffened<E>(pub E);

impl<E: Mechanism<f32>> Part for Stiffened<E> {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        let mut of_ones = Dynamics {
            inertia: 1.0,
            damping: 1.0,
            stiffness: 1.0,
            exponent: 1.0,
            input_gain: 1.0,
        };
        self.0.modulate(&step.instant(), &[0.0; 2], &mut of_ones);
        step.pull *= of_ones.stiffness;
        0.0
    }
}

/// A force of angle, pressure or time as the effect says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forced<E>(pub E);

impl<E: Mechanism<f32>> Part for Forced<E> {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    #[inline(always)]
    fn force(&self, base: &Base, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        self.0.force(&step.instant(), &[0.0; 2], &mut [0.0; 2]) * base.leapfrog.per_newton()
    }
}

/// Maps the reading as the effect says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown<E>(pub E);

impl<E: Mechanism<f32>> Part for Shown<E> {
    fn phases(&self) -> Phases {
        Phases::READING
    }

    #[inline]
    fn read(&self, step: &mut Step, memory: &mut Hidden<f32>) {
        step.reading = self
            .0
            .sensor(step.reading, step.time, memory, &mut [0.0; 2]);
    }
}

/// How the steps of an effect are tested beside its physics in `f64`, in [`crate::prepared`].
#[cfg(test)]
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// Values at which it is plain to see; empty for what is tested in its own way.
    pub values: &'static [f32],
    /// Largest gap of the reading (°): where no corner is in the way, what the base equation is
    /// within.
    pub within_deg: f64,
    /// Whether it is smooth, so that steps half as long have a quarter of the error.
    pub smooth: bool,
}

#[cfg(test)]
impl Trial {
    /// Of a smooth effect.
    pub const fn smooth(values: &'static [f32]) -> Self {
        Self {
            values,
            within_deg: 0.02,
            smooth: true,
        }
    }

    /// Of an effect with a corner.
    pub const fn with_corner(values: &'static [f32], within_deg: f64) -> Self {
        Self {
            values,
            within_deg,
            smooth: false,
        }
    }
}
