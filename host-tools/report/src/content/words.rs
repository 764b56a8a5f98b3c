//! Lists, names and probabilities as people write them.

use model_core::catalogue::Kind;

use softrig_formats::family::Family;

pub(super) fn titles(kinds: &[Kind]) -> String {
    let titles: Vec<&str> = kinds.iter().map(|kind| kind.info().title).collect();
    listed(&titles)
}

/// Families in a sentence: "a kind of dry friction and a kind of creep".
pub(super) fn in_words(families: &[Family]) -> String {
    let kinds: Vec<String> = families
        .iter()
        .map(|family| format!("a kind of {family}"))
        .collect();
    kinds.join(" and ")
}

/// The effects of one rival among several: "creep with gravity".
pub(super) fn combined(kinds: &[Kind]) -> String {
    let titles: Vec<&str> = kinds.iter().map(|kind| kind.info().title).collect();
    titles.join(" with ")
}

/// "a, b and c".
pub(super) fn listed(items: &[impl AsRef<str>]) -> String {
    let items: Vec<&str> = items.iter().map(AsRef::as_ref).collect();
    match items.as_slice() {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [head @ .., last] => format!("{} and {last}", head.join(", ")),
    }
}

/// "a, b or c".
pub(super) fn either(items: &[impl AsRef<str>]) -> String {
    let items: Vec<&str> = items.iter().map(AsRef::as_ref).collect();
    match items.as_slice() {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [head @ .., last] => format!("{} or {last}", head.join(", ")),
    }
}

pub(super) fn with_capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

pub(super) fn probability(value: f64) -> String {
    if value > 0.995 {
        "> 0.99".into()
    } else if value < 0.005 {
        "< 0.01".into()
    } else {
        format!("{value:.2}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers_for_people() {
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
        assert_eq!(probability(0.999), "> 0.99");
    }
}
