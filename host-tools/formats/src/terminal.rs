//! Safe output to a terminal.
//!
//! A file name, a column header, a name in a model or a line from a board can contain control
//! characters: they move the cursor, change the title, hide earlier output, or reverse the
//! direction of a line. So all output of `softrig` goes through [`print()`] or [`remark`], which
//! print such characters as text. Lints of the library forbid other ways.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::Write as _;

/// Whether a terminal obeys a character instead of showing it: the control characters, and
/// those that turn the direction of a line or end it unseen.
fn is_obeyed(character: char) -> bool {
    character.is_control()
        || matches!(
            character,
            '\u{061c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'
                ..='\u{202e}' | '\u{2066}'..='\u{2069}'
        )
}

/// The text with every character that a terminal obeys shown as `\n`, `\t`, `\r` or
/// `\u001b`, as JSON and TOML escape them. Ends of lines stay where `keep_lines`.
fn shown(text: &str, keep_lines: bool) -> Cow<'_, str> {
    let hidden = |c: char| is_obeyed(c) && !(keep_lines && c == '\n');
    if !text.chars().any(hidden) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        match character {
            c if !hidden(c) => out.push(c),
            '\n' => out.push_str("\\n"),
            '\t' => out.push_str("\\t"),
            '\r' => out.push_str("\\r"),
            // Writing to a string cannot fail.
            c => drop(write!(out, "\\u{:04x}", u32::from(c))),
        }
    }
    Cow::Owned(out)
}

/// A text of ours, of several lines, with what others wrote in it made harmless.
pub fn printable(text: &str) -> Cow<'_, str> {
    shown(text, true)
}

/// Foreign text on one line: a line end in it would look like the end of our sentence.
pub fn printable_line(text: &str) -> Cow<'_, str> {
    shown(text, false)
}

/// Prints results.
///
/// # Errors
///
/// Passes on that the reader has seen enough (`softrig schema | head -1`), at which
/// `println!` would panic; `main` takes it for success.
pub fn print(text: &str) -> std::io::Result<()> {
    print_own(&printable(text))
}

/// Prints what is ours to the last character, such as a script for a shell.
///
/// # Errors
///
/// Like [`print()`].
pub fn print_own(text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

/// Says something where it does not mix with results.
pub fn remark(text: &str) {
    // A closed standard error leaves nowhere to report that it is closed.
    let _ = writeln!(std::io::stderr().lock(), "{}", printable(text));
}

/// A word quoted for a shell.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_a_terminal_obeys_is_shown() {
        for (text, expected) in [
            ("60° – Δθ, 日本", "60° – Δθ, 日本"),
            ("\u{1b}[2Jgone", "\\u001b[2Jgone"),
            ("a\rb\tc\u{7f}", "a\\rb\\tc\\u007f"),
            ("\u{9b}31m\u{85}", "\\u009b31m\\u0085"),
            ("gpj.\u{202e}exe\u{2066}", "gpj.\\u202eexe\\u2066"),
            ("two\nlines", "two\nlines"),
        ] {
            assert_eq!(printable(text), expected);
        }
        assert_eq!(printable_line("two\nlines"), "two\\nlines");
    }

    proptest! {
        #[test]
        fn nothing_is_left_for_a_terminal_to_obey(text in "\\PC*|[\u{0}-\u{9f}\u{2000}-\u{2070}]*") {
            prop_assert!(!printable_line(&text).chars().any(is_obeyed));
            prop_assert!(printable(&text).chars().all(|c| c == '\n' || !is_obeyed(c)));
        }
    }

    #[test]
    fn a_command_can_be_typed_as_it_stands() {
        assert_eq!(quoted("runs/a-1.csv"), "runs/a-1.csv");
        assert_eq!(quoted("my run's.csv"), "'my run'\\''s.csv'");
        assert_eq!(quoted("<b>"), "'<b>'");
        assert_eq!(quoted(""), "''");
    }
}
