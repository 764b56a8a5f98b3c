//! Materials: Ludwick's exponent before an actuator is moulded.
//!
//! `softrig materials` has three sources: the paper's table, a tensile test ([`fit`]), and
//! a data sheet ([`predictor`]). Several choices (stress and strain measure, range,
//! residual, rows of the table) change the exponent by more than its standard error, so
//! each of them is an argument and is printed with the result.
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod curve;
pub mod fit;
pub mod predictor;

use model_core::material::Material;

use curve::TensileCurve;
use softrig_formats::material_name::named;

/// Returns the row of Table I that a tensile curve belongs to, judged by the
/// material that the file names, else by the file's own name. Case, spaces and
/// hyphens do not matter: the database and the table write them differently.
pub fn table_row(curve: &TensileCurve) -> Option<&'static Material> {
    let stem = curve.path.file_stem().unwrap_or_default().to_string_lossy();
    [curve.material.as_str(), &stem].into_iter().find_map(named)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn curves_find_their_row_by_either_name() {
        let row = |file: &str, material: &str| {
            let text = format!(
                "PARAMETER;INFO;URL;;\nMaterial;{material};;;\nTime (s);strain;stress_mpa\n0;0.1;0.2\n"
            );
            let curve = TensileCurve::parse(Path::new(file), text.as_bytes()).unwrap();
            table_row(&curve).map(|material| material.name)
        };
        assert_eq!(
            row("data/Dragon Skin FX Pro.csv", "DSFX"),
            Some("Dragon Skin FX-Pro")
        );
        assert_eq!(
            row("a.csv", "dragon skin 10 MEDIUM"),
            Some("Dragon Skin 10 Medium")
        );
        assert_eq!(row("Dragon Skin FX Pro Slacker.csv", "slacker"), None);
    }
}

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
