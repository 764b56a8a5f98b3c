//! Estimates the width of a text.
//!
//! The layout does not know the reader's font, so widths are estimated from the letters
//! alone. That also keeps the layout the same on every machine.

pub(super) const TITLE_PX: f64 = 16.0;
pub(super) const SUBTITLE_PX: f64 = 12.0;
pub(super) const PANEL_TITLE_PX: f64 = 13.0;
pub(super) const LABEL_PX: f64 = 12.0;
pub(super) const TICK_PX: f64 = 11.0;
pub(super) const LEGEND_PX: f64 = 12.0;
pub(super) const LEADING: f64 = 1.35;

/// How heavy a text is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weight {
    Regular,
    Bold,
}

/// Advance width of a text in the widest face that a viewer falls back to.
///
/// The faces that are asked for are narrower. A viewer without them takes its own
/// sans-serif, often DejaVu Sans, and a heading that was measured in Helvetica then
/// ends beyond the edge. Widths are those of DejaVu Sans, rounded up by kind of letter.
pub(super) fn text_width(text: &str, size_px: f64, weight: Weight) -> f64 {
    let em: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | '\'' => 0.28,
            '|' | ' ' | '.' | ',' | ':' | ';' | '!' | '/' | '·' => 0.34,
            'f' | 't' | 'r' | '(' | ')' | '[' | ']' | '-' => 0.41,
            'm' | 'M' | 'W' | '%' | '—' | '…' => 0.98,
            'w' | '→' | '−' | '+' | '=' | '<' | '>' => 0.84,
            c if c.is_uppercase() => 0.73,
            _ => 0.64,
        })
        .sum();
    let heavier = match weight {
        Weight::Regular => 1.0,
        Weight::Bold => 1.12,
    };
    em * size_px * heavier
}

/// Breaks a text into lines at spaces, and a word that is longer than a line, such
/// as the name of a file, where the line ends.
pub(super) fn wrap(text: &str, size_px: f64, weight: Weight, width: f64) -> Vec<String> {
    let fits = |line: &str| text_width(line, size_px, weight) <= width;
    let mut lines: Vec<String> = Vec::new();
    // What a no-break space joins stays together.
    let ends = |letter: char| letter.is_whitespace() && letter != '\u{a0}';
    for word in text.split(ends).filter(|word| !word.is_empty()) {
        match lines.last_mut() {
            Some(line) if fits(&format!("{line} {word}")) => {
                line.push(' ');
                line.push_str(word);
            }
            _ if fits(word) => lines.push(word.to_owned()),
            _ => {
                let mut piece = String::new();
                for letter in word.chars() {
                    if !piece.is_empty() && !fits(&format!("{piece}{letter}")) {
                        lines.push(std::mem::take(&mut piece));
                    }
                    piece.push(letter);
                }
                lines.push(piece);
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_line_is_wider_than_its_room() {
        let title = "Torque-limited pendulum: family dry friction + stiffness shape: coulomb \
                     friction and gravity / coulomb friction and cubic stiffness";
        let name = "a_recording_whose_name_is_much_longer_than_a_line_of_its_panel.csv";
        for weight in [Weight::Regular, Weight::Bold] {
            for text in [title, name] {
                for room in [200.0, 400.0, 728.0] {
                    let lines = wrap(text, TITLE_PX, weight, room);
                    assert!(
                        lines
                            .iter()
                            .all(|line| text_width(line, TITLE_PX, weight) <= room),
                        "{lines:?}"
                    );
                }
            }
        }
        let letters = |text: &str| text.replace(' ', "");
        let lines = wrap(name, TITLE_PX, Weight::Bold, 200.0);
        assert_eq!(letters(&lines.concat()), letters(name));
    }

    #[test]
    fn widths_are_no_less_than_in_dejavu() {
        // As a browser measures them in DejaVu Sans at 16 px.
        for (text, weight, measured) in [
            (
                "family dry friction + stiffness shape: coulomb friction and",
                Weight::Bold,
                521.7,
            ),
            (
                "Hanging load on a hydraulic cylinder: coulomb friction (part)",
                Weight::Bold,
                548.7,
            ),
            (
                "RMS error on all runs that were not fitted: 16.4 refitted, 0.710 repaired",
                Weight::Regular,
                566.3,
            ),
            ("simulated − measured (°)", Weight::Regular, 208.1),
        ] {
            let width = text_width(text, TITLE_PX, weight);
            assert!((1.0..1.1).contains(&(width / measured)), "{text}: {width}");
        }
    }
}
