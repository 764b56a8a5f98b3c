//! Names of materials as people write them, for the paper's Table I.

use model_core::material::{Material, TABLE_I};

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

#[cfg(test)]
mod tests {
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
}
