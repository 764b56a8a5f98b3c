//! Materials: Ludwick's exponent before an actuator is moulded.
//!
//! `rig materials` has three sources: the paper's table, a tensile test ([`fit`]), and
//! a data sheet ([`predictor`]). Several choices (stress and strain measure, range,
//! residual, rows of the table) change the exponent by more than its standard error, so
//! each of them is an argument and is printed with the result.

pub mod curve;
pub mod fit;
pub(crate) mod pictures;
pub(crate) mod predictor;

use model_core::material::{Material, TABLE_I};

use curve::TensileCurve;

/// Letters and digits of a name in lower case: spaces and hyphens are written differently
/// everywhere.
fn plain(name: &str) -> String {
    name.chars()
        .filter(|c| c.is_alphanumeric())
        .flat_map(char::to_lowercase)
        .collect()
}

/// The row of Table I with a name, whatever its case, spaces and hyphens.
pub fn named(name: &str) -> Option<&'static Material> {
    TABLE_I
        .iter()
        .find(|material| plain(material.name) == plain(name))
}

/// The rows of Table I whose names are most like one that is in none of them, best first.
pub fn like(name: &str) -> Vec<&'static Material> {
    /// Names that are less alike than this are others.
    const ALIKE: f64 = 0.75;
    /// More are no help.
    const MOST: usize = 3;
    let wanted = plain(name);
    let mut rows: Vec<(f64, &Material)> = TABLE_I
        .iter()
        .map(|material| {
            (
                strsim::jaro_winkler(&plain(material.name), &wanted),
                material,
            )
        })
        .filter(|(alike, _)| *alike > ALIKE)
        .collect();
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    rows.into_iter()
        .take(MOST)
        .map(|(_, material)| material)
        .collect()
}

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
    fn slips_of_the_keyboard_find_their_row() {
        assert_eq!(
            named("ecoflex 0030").map(|it| it.name),
            Some("Ecoflex 00-30")
        );
        assert_eq!(named("Ecoflex"), None);
        let names = |name: &str| like(name).iter().map(|it| it.name).collect::<Vec<_>>();
        assert_eq!(names("dragonskin 2O").first(), Some(&"Dragon Skin 20"));
        assert!(names("Ecoflex 0031").contains(&"Ecoflex 00-30"));
        assert!(names("PLA").is_empty() && names("").is_empty());
    }

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
