//! What is known about an effect besides its equation: all that files, fits, the diagnosis, exports
//! and reports have to know of it. There are no defaults, so that a new effect cannot leave one
//! out.

use core::fmt;

use super::table::Variable;
use crate::catalogue::Kind;

/// What the catalogue knows about an effect besides its equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Info {
    /// Name in model files and verdicts.
    pub name: &'static str,
    /// Name in sentences.
    pub title: &'static str,
    /// Where it acts.
    pub place: Place,
    /// Its equation.
    pub equation: &'static str,
    /// What it is and how it shows, in two or three sentences for a report.
    pub text: &'static str,
    /// Where in the data the gap lives that it leaves.
    pub signature: &'static str,
    /// Names of effects that leave a similar gap.
    pub look_alikes: &'static [&'static str],
    /// The effects that act alike by other formulas.
    pub family: Family,
    /// What recordings have to show before it can be known, beside a pressure that changes where
    /// it acts on that.
    pub needs: &'static [Need],
    /// The one variable that its force depends on; none for an effect with a memory, or of several
    /// variables.
    pub own_variable: Option<Variable>,
    /// The effect that it becomes at an end of its parameters: with no extra force at rest, with
    /// equal time constants, with a yield angle or a relaxation that vanishes.
    pub special_case: Option<Kind>,
    /// Effects that it can follow better than their own formulas here, where the actuator has them
    /// by another: many small lags in a row make a dead time, and bristles that bend before they
    /// slip (LuGre) a hysteresis with a small yield angle.
    pub imitates: &'static [Kind],
    /// How the rig is changed to tell it from others.
    pub told_by: &'static [Change],
    /// When a fit of it must not be named, however good it is.
    pub doubtful: &'static [Doubtful],
    /// Whether it has a slope at rest, so that a linear model can contain it: friction and play
    /// have none.
    pub has_slope: bool,
    /// Its hidden states, in their order.
    pub states: &'static [State],
}

/// The place where an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Between the pressure sensor and the chamber.
    Input,
    /// On the forces or the parameters of the equation of motion.
    Force,
    /// Between the angle and what the sensor shows.
    Sensor,
}

/// What recordings have to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// A pressure that changes.
    Drive,
    /// A pressure that turns back.
    Reversal,
    /// An angle that goes and comes back.
    Return,
}

/// A change of the rig, in which an effect shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Turned, so that weight pulls otherwise.
    Turned,
    /// With a longer tube between pump and actuator.
    LongerTube,
    /// After a long rest.
    Rested,
}

/// When a fit must not be named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubtful {
    /// No session loads the actuator a second time: a softening by the largest stretch so far is
    /// then a difference between loading and unloading, which friction, creep and lag make as well.
    LoadedOnce,
    /// The recordings hold a few periods only: then it is a curve in time.
    FewPeriods,
    /// The spring has grown fivefold, and the effect takes that back: what is left of two curves of the
    /// angle that nearly cancel is the curve of another effect.
    TakesBack,
    /// Beside this effect, which makes the same of another cause.
    Beside(Kind),
}

/// A hidden state, as exported code names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct State {
    /// Its name, with a unit.
    pub key: &'static str,
    /// Symbol, meaning and unit.
    pub text: &'static str,
}

/// Effects that act alike on an actuator, by different formulas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Family {
    /// A force by the direction of motion.
    DryFriction,
    /// A dead band of the drive.
    Play,
    /// A slow yielding under a constant load.
    Creep,
    /// A change with time alone.
    Drift,
    /// A softening by the largest angle so far.
    FirstStretch,
    /// A damping that is not one constant.
    RateDamping,
    /// A static curve of force over angle or pressure.
    StiffnessShape,
    /// A shift of a zero.
    Offset,
    /// The tube's effect on the pressure.
    InputPath,
    /// The sensor's effect on the angle.
    SensorPath,
    /// A force of a frequency of its own.
    Periodic,
    /// A second oscillation beside the first.
    SecondMode,
    /// An effect with a user's formula and no family: by its name.
    Own(&'static str),
    /// No family.
    Other,
}

impl Family {
    /// The families of the catalogue's effects, which a user's formula can also name.
    pub const NAMED: [Self; 12] = [
        Self::DryFriction,
        Self::Play,
        Self::Creep,
        Self::Drift,
        Self::FirstStretch,
        Self::RateDamping,
        Self::StiffnessShape,
        Self::Offset,
        Self::InputPath,
        Self::SensorPath,
        Self::Periodic,
        Self::SecondMode,
    ];

    /// Looks a family up by its name.
    pub fn named(title: &str) -> Option<Self> {
        Self::NAMED
            .into_iter()
            .find(|family| family.title() == title)
    }

    /// Its name.
    pub const fn title(self) -> &'static str {
        match self {
            Self::DryFriction => "dry friction",
            Self::Play => "play",
            Self::Creep => "creep",
            Self::Drift => "drift",
            Self::FirstStretch => "first stretch",
            Self::RateDamping => "rate damping",
            Self::StiffnessShape => "stiffness shape",
            Self::Offset => "offset",
            Self::InputPath => "input path",
            Self::SensorPath => "sensor path",
            Self::Periodic => "periodic",
            Self::SecondMode => "second mode",
            Self::Own(name) => name,
            Self::Other => "other",
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.title())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_that_may_be_named_has_a_family() {
        for &kind in Kind::NAMES {
            assert!(Family::NAMED.contains(&kind.info().family), "{kind:?}");
        }
    }

    #[test]
    fn families_are_found_by_their_names() {
        for family in Family::NAMED {
            assert_eq!(Family::named(family.title()), Some(family));
        }
        assert_eq!(Family::named("other"), None);
    }
}
