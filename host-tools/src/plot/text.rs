//! How much room a text takes.
//!
//! The picture is laid out before any reader's font is known, so widths are
//! estimated from the letters alone. That also keeps the layout the same on
//! every machine.

pub(super) const TITLE_PX: f64 = 16.0;
pub(super) const SUBTITLE_PX: f64 = 12.0;
pub(super) const PANEL_TITLE_PX: f64 = 13.0;
pub(super) const LABEL_PX: f64 = 12.0;
pub(super) const TICK_PX: f64 = 11.0;
pub(super) const LEGEND_PX: f64 = 12.0;
pub(super) const LEADING: f64 = 1.35;

/// Advance width of a text in a Helvetica-like face, a little on the wide side
/// because the reader's face is unknown.
pub(super) fn text_width(text: &str, size_px: f64) -> f64 {
    let em: f64 = text
        .chars()
        .map(|c| match c {
            'i' | 'j' | 'l' | '\'' | '|' => 0.24,
            'f' | 't' | 'r' | ' ' | '.' | ',' | ':' | ';' | '!' | '(' | ')' | '[' | ']' | '/'
            | '·' | '-' => 0.32,
            'm' | 'M' | 'W' | '%' | '—' => 0.88,
            'w' => 0.74,
            c if c.is_uppercase() => 0.70,
            _ => 0.57,
        })
        .sum();
    em * size_px * 1.03
}

/// Breaks a text into lines at spaces; a word longer than the line stays whole.
pub(super) fn wrap(text: &str, size_px: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if text_width(&format!("{line} {word}"), size_px) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
