//! What is hidden in a case of any set: the half of its answer that is scored.

use serde::{Deserialize, Serialize};

use super::law::Law;
use super::world::{Base, World};

/// What is hidden in a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hidden {
    /// Nothing: the nominal model is the truth.
    Nothing,
    /// The parameters are off.
    Parameters,
    /// One effect of the catalogue.
    One,
    /// Two effects of the catalogue.
    Two,
    /// An effect outside the catalogue.
    Outside,
}

impl Hidden {
    /// Nothing, or parameters only.
    pub const fn is_quiet(self) -> bool {
        matches!(self, Self::Nothing | Self::Parameters)
    }

    /// One or two effects of the catalogue.
    pub const fn has_a_name(self) -> bool {
        matches!(self, Self::One | Self::Two)
    }
}

/// What a case hides, and how much of it shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Secret {
    /// Name of the case's folder.
    pub case: String,
    /// What is hidden.
    pub hidden: Hidden,
    /// Kinds of the catalogue, in alphabetical order.
    pub kinds: Vec<String>,
    /// Names of the laws, in the order of the truth's effects.
    pub laws: Vec<String>,
    /// Whether the catalogue's own laws were used throughout.
    pub same_laws: bool,
    /// The truth, in SI units.
    pub truth: World,
    /// The nominal parameters.
    pub nominal: Base,
    /// What the refitted base leaves with what is there without the effect (the
    /// sensor's noise; on a bench also what it leaves of the coloured force), over
    /// that.
    pub misfit_over_noise: f64,
    /// Of a pair: the least that leaving out one of the two, the rest
    /// refitted, leaves likewise.
    pub partner_over_noise: Option<f64>,
    /// Whether both are in the range that is asked for.
    pub visible: bool,
}

/// The kinds of the catalogue that laws are cases of, in alphabetical order.
pub fn kinds_of(laws: &[Law]) -> Vec<String> {
    let kinds = laws.iter().filter_map(|law| law.row().kind);
    let mut kinds: Vec<String> = kinds.map(str::to_owned).collect();
    kinds.sort_unstable();
    kinds
}

/// The names of laws.
pub fn names_of(laws: &[Law]) -> Vec<String> {
    laws.iter().map(|law| law.row().name.to_owned()).collect()
}
