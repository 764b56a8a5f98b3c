//! What a diagnosis found, as a type.
//!
//! [`decide`](mod@crate::diagnose::decide) makes it. A [`Finding`] has only what goes with each answer: a name has a
//! strength, a family has rivals, a quiet rig has neither. Terminal, page, Python and JSON are renderings of it.

use model_core::catalogue::Kind;
use model_core::effects::table::Variable;

use crate::diagnose::decide::verdict::{Alternative, Answer, Strength};
use crate::diagnose::score::grammar::is_term;
use softrig_formats::family::{Family, names};

/// A structure that explains the recordings, or part of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Explanation {
    /// The effects that it adds.
    pub kinds: Vec<Kind>,
    /// Probability among the explanations of the same size.
    pub probability: f64,
    /// Twice the logarithm of how much less likely the held-out segments are than under the
    /// best of its size.
    pub delta_bic: f64,
}

impl Explanation {
    /// The same for JSON.
    pub fn written(&self) -> Alternative {
        Alternative {
            kinds: names(&self.kinds),
            formulas: self
                .kinds
                .iter()
                .filter(|kind| is_term(**kind))
                .map(|kind| kind.info().equation.to_owned())
                .collect(),
            probability: self.probability,
            delta_bic: self.delta_bic,
        }
    }
}

/// Whether two structures add the same effects, in any order.
pub fn are_the_same(a: &[Kind], b: &[Kind]) -> bool {
    a.len() == b.len() && a.iter().all(|kind| b.contains(kind))
}

/// An effect that is named.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NamedKind {
    /// The effect.
    pub kind: Kind,
    /// Probability that a structure with it, or with an effect that it is a special case of, is the
    /// right one of its size.
    pub probability: f64,
}

/// The answer to "what is missing?".
#[derive(Clone, Debug, PartialEq)]
pub enum Finding {
    /// No effect is missing.
    Quiet {
        /// Whether the parameters of the supplied model were off.
        refitted: bool,
        /// Whether more than noise is left, and less than the tolerance.
        immaterial: bool,
    },
    /// Only noise is left, but so much that an effect may hide below it.
    Noisy,
    /// Effects are named.
    Named {
        /// They, in the order of the repaired model.
        effects: Vec<NamedKind>,
        /// How much of the error they explain.
        strength: Strength,
        /// The nearest explanations of the same size, best first.
        rivals: Vec<Explanation>,
    },
    /// Explanations that these recordings do not tell apart.
    Rivals {
        /// Two or more, best first.
        rivals: Vec<Explanation>,
        /// The families that all of them share; empty if they differ.
        families: Vec<Family>,
        /// How much of the error the best one explains.
        strength: Strength,
    },
    /// A family whose variable is right, while no formula of it is: a table over that variable
    /// follows the missing force.
    Shape {
        /// The variable.
        of: Variable,
        /// The best formula.
        formula: Explanation,
        /// Its families.
        families: Vec<Family>,
        /// How much of the error it explains.
        strength: Strength,
    },
    /// One explanation that these recordings do not determine.
    Trace {
        /// It.
        explanation: Explanation,
        /// Its families.
        families: Vec<Family>,
        /// How much of the error it explains.
        strength: Strength,
    },
    /// The budget was spent before an answer could be given.
    OutOfTime {
        /// What came closest until then.
        closest: Option<Explanation>,
    },
    /// Something is missing that no known effect explains.
    Unexplained {
        /// What comes closest, best first.
        closest: Vec<Explanation>,
    },
}

impl Finding {
    /// The answer of the JSON.
    pub const fn answer(&self) -> Answer {
        match self {
            Self::Quiet { refitted: true, .. } => Answer::ParametersOnly,
            Self::Quiet { .. } => Answer::NoDiscrepancy,
            Self::Named { .. } => Answer::EffectFound,
            Self::Rivals { .. }
            | Self::Shape { .. }
            | Self::Trace { .. }
            | Self::OutOfTime { .. }
            | Self::Noisy => Answer::CannotTell,
            Self::Unexplained { .. } => Answer::Unexplained,
        }
    }

    /// Whether nothing is missing, or nothing that matters.
    pub const fn is_quiet(&self) -> bool {
        matches!(self, Self::Quiet { .. })
    }

    /// The effects that are named.
    pub fn named(&self) -> Vec<Kind> {
        self.inclusions().iter().map(|it| it.kind).collect()
    }

    /// The effects that are named, with their probabilities.
    pub fn inclusions(&self) -> &[NamedKind] {
        match self {
            Self::Named { effects, .. } => effects,
            _ => &[],
        }
    }

    /// The probability of an effect, if it is named.
    pub fn probability_of(&self, kind: Kind) -> Option<f64> {
        let all = self.inclusions();
        all.iter()
            .find(|it| it.kind == kind)
            .map(|it| it.probability)
    }

    /// The explanations beside a name, or in its place, best first.
    pub fn explanations(&self) -> &[Explanation] {
        match self {
            Self::Quiet { .. } | Self::Noisy => &[],
            Self::Named { rivals, .. } | Self::Rivals { rivals, .. } => rivals,
            Self::Shape { formula: only, .. }
            | Self::Trace {
                explanation: only, ..
            } => std::slice::from_ref(only),
            Self::OutOfTime { closest } => closest.as_slice(),
            Self::Unexplained { closest } => closest,
        }
    }

    /// How much of the error the name or the best rival explains.
    pub const fn strength(&self) -> Option<Strength> {
        match self {
            Self::Named { strength, .. }
            | Self::Rivals { strength, .. }
            | Self::Shape { strength, .. }
            | Self::Trace { strength, .. } => Some(*strength),
            Self::Quiet { .. }
            | Self::Noisy
            | Self::OutOfTime { .. }
            | Self::Unexplained { .. } => None,
        }
    }

    /// The families that are the answer, where no effect is.
    pub fn families(&self) -> &[Family] {
        match self {
            Self::Rivals { families, .. }
            | Self::Shape { families, .. }
            | Self::Trace { families, .. } => families,
            Self::Quiet { .. }
            | Self::Noisy
            | Self::Named { .. }
            | Self::OutOfTime { .. }
            | Self::Unexplained { .. } => &[],
        }
    }
}
