//! Equations as they are printed, from the plain text of the catalogue.
//!
//! In `Q = T tanh(ω/ω_s)` letters are variables and stand in italics; names of functions,
//! words, and what a subscript describes are upright (ISO 80000-2). The plain text stays the
//! one source: the terminal shows it as it is.

/// Functions, and words within equations. Other letters that follow each other are a product.
const WORDS: [&str; 14] = [
    "clamped",
    "else",
    "in",
    "into",
    "linear",
    "max",
    "of",
    "one",
    "piecewise",
    "share",
    "sign",
    "sin",
    "tanh",
    "where",
];

/// Sets an equation, or a symbol, in HTML.
pub fn html(plain: &str) -> String {
    let mut set = String::with_capacity(2 * plain.len());
    let mut rest = plain;
    while let Some(letter) = rest.chars().next() {
        let after = rest.trim_start_matches(|c: char| c.is_ascii_alphabetic());
        let word = &rest[..rest.len() - after.len()];
        if WORDS.contains(&word) {
            set += word;
            rest = after;
            continue;
        }
        rest = &rest[letter.len_utf8()..];
        let (element, inside) = match letter {
            '_' => (
                "sub",
                escaped(taken(&mut rest, |c| {
                    c.is_alphanumeric() && level(c).is_none()
                })),
            ),
            '^' => ("sup", html(group(&mut rest))),
            // The base of the exponential function and π are numbers, Δ is an operator.
            'e' if rest.starts_with('^') => ("", "e".into()),
            'Δ' | 'π' => ("", letter.into()),
            _ => match level(letter) {
                Some((element, letter)) => (element, letter.into()),
                // Dots belong to the letter that they stand above.
                None if letter.is_alphabetic() => {
                    ("i", format!("{letter}{}", taken(&mut rest, is_dot)))
                }
                None => ("", escaped(letter.encode_utf8(&mut [0; 4]))),
            },
        };
        if element.is_empty() {
            set += &inside;
        } else {
            set += &format!("<{element}>{inside}</{element}>");
        }
    }
    set
}

/// One or two dots above the letter before: its derivatives by the time.
fn is_dot(letter: char) -> bool {
    matches!(letter, '\u{307}' | '\u{308}')
}

/// The plain digit and HTML element of a superscript or subscript.
fn level(letter: char) -> Option<(&'static str, char)> {
    const RAISED: &str = "⁰¹²³⁴⁵⁶⁷⁸⁹";
    const LOWERED: &str = "₀₁₂₃₄₅₆₇₈₉";
    [("sup", RAISED), ("sub", LOWERED)]
        .into_iter()
        .find_map(|(element, digits)| {
            let (_, digit) = digits
                .chars()
                .zip('0'..='9')
                .find(|(it, _)| *it == letter)?;
            Some((element, digit))
        })
}

/// The leading letters for which `wanted` holds; `text` goes on behind them.
fn taken<'t>(text: &mut &'t str, wanted: impl Fn(char) -> bool) -> &'t str {
    let after = text.trim_start_matches(wanted);
    let head = &text[..text.len() - after.len()];
    *text = after;
    head
}

/// The text in braces, or else one letter; `text` advances past it.
fn group<'t>(text: &mut &'t str) -> &'t str {
    let braced = text.strip_prefix('{').and_then(|it| it.split_once('}'));
    let (inside, after) =
        braced.unwrap_or_else(|| text.split_at(text.chars().next().map_or(0, char::len_utf8)));
    *text = after;
    inside
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::catalogue::Kind;
    use model_core::effects::table::Variable;

    #[test]
    fn letters_lean_and_words_stand() {
        for (plain, set) in [
            (
                "Q = T tanh(ω/ω_s)",
                "<i>Q</i> = <i>T</i> tanh(<i>ω</i>/<i>ω</i><sub>s</sub>)",
            ),
            ("n → n + Δn", "<i>n</i> → <i>n</i> + Δ<i>n</i>"),
            (
                "A sin(2πft + φ)",
                "<i>A</i> sin(2π<i>f</i><i>t</i> + <i>φ</i>)",
            ),
            (
                "1 − e^{−θ_max/θ_m}",
                "1 − e<sup>−<i>θ</i><sub>max</sub>/<i>θ</i><sub>m</sub></sup>",
            ),
            (
                "τ ṗ_c = p where p > p_c",
                "<i>τ</i> <i>ṗ</i><sub>c</sub> = <i>p</i> where <i>p</i> &gt; <i>p</i><sub>c</sub>",
            ),
            (
                "ξ̈ + ω₂²ξ",
                "<i>ξ̈</i> + <i>ω</i><sub>2</sub><sup>2</sup><i>ξ</i>",
            ),
            ("θ³", "<i>θ</i><sup>3</sup>"),
            ("x^n", "<i>x</i><sup><i>n</i></sup>"),
            ("x^{n", "<i>x</i><sup>{</sup><i>n</i>"),
            ("", ""),
        ] {
            assert_eq!(html(plain), set);
        }
    }

    /// The text between the tags of an equation.
    fn read(set: &str) -> String {
        let mut text = String::new();
        let mut inside = false;
        for letter in set.chars() {
            match letter {
                '<' => inside = true,
                '>' => inside = false,
                _ if !inside => text.push(letter),
                _ => {}
            }
        }
        text.replace("&lt;", "<")
            .replace("&gt;", ">")
            .replace("&amp;", "&")
    }

    /// An equation without its typographic signs.
    fn bare(plain: &str) -> String {
        plain
            .chars()
            .filter(|letter| !"_^{}".contains(*letter))
            .map(|letter| level(letter).map_or(letter, |(_, digit)| digit))
            .collect()
    }

    #[test]
    fn every_equation_and_symbol_of_the_catalogue_is_set_whole() {
        let kinds = Kind::NAMES.iter().chain([&Kind::Table]);
        let texts = kinds.flat_map(|kind| {
            let symbols = kind.parameters().iter().map(|row| row.symbol);
            symbols.chain([kind.info().equation])
        });
        let variables = Variable::ALL.iter().map(|of| of.symbol());
        for plain in texts.chain(variables) {
            let set = html(plain);
            assert_eq!(read(&set), bare(plain), "{plain}");
            for element in ["i", "sub", "sup"] {
                let [opened, closed] = [format!("<{element}>"), format!("</{element}>")];
                assert_eq!(set.matches(&opened).count(), set.matches(&closed).count());
                assert!(
                    !set.contains(&format!("{opened}{closed}")),
                    "{plain}: {set}"
                );
            }
            // A word that nobody listed would be set as a product of its letters.
            let runs = plain.split(|c: char| !(c.is_ascii_alphabetic() || c == '_'));
            for word in runs.filter_map(|run| run.split('_').next()) {
                let known = word.len() < 2 || WORDS.contains(&word) || word == "ft";
                assert!(known, "{word} in {plain}");
            }
        }
    }
}
