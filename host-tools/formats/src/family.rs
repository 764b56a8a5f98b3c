//! Families of effects: the answer where their members cannot be distinguished.
//!
//! Real friction follows neither Coulomb's nor Dahl's formula, and "dry friction" is enough
//! to know what to look at. So effects that act alike on an actuator share a family name.

use std::fmt;

use model_core::catalogue::Kind;

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

    /// The family of an effect.
    pub fn of(kind: Kind) -> Self {
        match kind {
            Kind::CoulombFriction | Kind::StribeckFriction | Kind::BoucWenHysteresis => {
                Self::DryFriction
            }
            Kind::InputBacklash => Self::Play,
            Kind::MaxwellBranch | Kind::Leak => Self::Creep,
            Kind::StiffnessDrift | Kind::SensorDrift => Self::Drift,
            Kind::MullinsSoftening => Self::FirstStretch,
            Kind::QuadraticDamping | Kind::AngleDependentDamping | Kind::AsymmetricDamping => {
                Self::RateDamping
            }
            Kind::ExponentShift
            | Kind::CubicStiffness
            | Kind::LinearStiffness
            | Kind::Gravity
            | Kind::EndStop
            | Kind::PressureStiffening
            | Kind::SensorNonlinearity => Self::StiffnessShape,
            Kind::PressureThreshold | Kind::SensorOffset => Self::Offset,
            Kind::PneumaticLag | Kind::DeadTime | Kind::VentAsymmetry => Self::InputPath,
            Kind::SensorLag => Self::SensorPath,
            Kind::PeriodicDisturbance => Self::Periodic,
            Kind::SecondMode => Self::SecondMode,
            Kind::Custom(formula) => formula
                .0
                .family
                .and_then(Self::named)
                .unwrap_or(Self::Own(formula.0.info.name)),
            _ => Self::Other,
        }
    }

    /// The families of a structure, sorted.
    pub fn of_all(kinds: &[Kind]) -> Vec<Self> {
        let mut families: Vec<Self> = kinds.iter().map(|&kind| Self::of(kind)).collect();
        families.sort_unstable();
        families
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.title())
    }
}

/// The joint name of several families: "dry friction + stiffness shape".
pub fn title(families: &[Family]) -> String {
    let names: Vec<String> = families.iter().map(ToString::to_string).collect();
    names.join(" + ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_effect_that_may_be_named_has_a_family() {
        for &kind in Kind::ALL {
            if kind.name() != "table" {
                assert_ne!(Family::of(kind), Family::Other, "{kind:?}");
                assert!(Family::NAMED.contains(&Family::of(kind)), "{kind:?}");
            }
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
