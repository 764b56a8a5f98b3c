//! Families of structures: the answer where their members cannot be distinguished.
//!
//! Real friction follows neither Coulomb's nor Dahl's formula, and "dry friction" is enough
//! to know what to look at. So effects that act alike on an actuator share a
//! [family name](Family).

use model_core::catalogue::Kind;
pub use model_core::effects::Family;

/// The families of a structure, sorted.
pub fn of_all(kinds: &[Kind]) -> Vec<Family> {
    let mut families: Vec<Family> = kinds.iter().map(|kind| kind.info().family).collect();
    families.sort_unstable();
    families
}

/// The names of effects, as in files.
pub fn names(kinds: &[Kind]) -> Vec<String> {
    kinds.iter().map(|kind| kind.name().to_owned()).collect()
}

/// The joint name of several families: "dry friction + stiffness shape".
pub fn title(families: &[Family]) -> String {
    let names: Vec<String> = families.iter().map(ToString::to_string).collect();
    names.join(" + ")
}
