//! A terminal as a picture that moves: what a command printed, line by line, as SVG.
//!
//! Nothing is made up: lines and their order are those of the run. Only waiting is shortened.

use std::{fmt::Write as _, time::Duration};

/// Columns and rows of the terminal.
const COLUMNS: usize = 100;
const ROWS: usize = 26;
/// Width of a letter and height of a line (px).
const LETTER: f64 = 7.23;
const LINE: f64 = 17.0;
const MARGIN: f64 = 16.0;
/// The longest and the shortest pause between two lines (s): a reader waits for no diagnosis, and
/// sees lines come one after the other.
const PAUSES: (f64, f64) = (1.2, 0.06);
/// How long the last lines stay before everything begins again (s).
const END: f64 = 8.0;

/// What was printed, each line with the time since the start.
pub type Printed = Vec<(Duration, String)>;

/// Draws a run of a command.
pub fn draw(command: &str, printed: &Printed) -> String {
    let mut rows: Vec<(f64, String)> = vec![(0.0, format!("$ {command}"))];
    let (mut shown, mut before) = (0.8, Duration::ZERO);
    for (at, line) in printed {
        let pause = at.saturating_sub(before).as_secs_f64();
        shown += pause.clamp(PAUSES.1, PAUSES.0);
        before = *at;
        rows.extend(wrapped(line).into_iter().map(|part| (shown, part)));
    }
    let total = shown + END;
    let width = (COLUMNS as f64).mul_add(LETTER, 2.0 * MARGIN);
    let height = (ROWS as f64).mul_add(LINE, 2.0 * MARGIN);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" \
         width=\"{width:.0}\" height=\"{height:.0}\" \
         font-family=\"Menlo, Consolas, 'DejaVu Sans Mono', monospace\" font-size=\"12\">\n\
         <title>{}</title>\n<desc>The output of a real run. Waiting is shortened.</desc>\n\
         <style>\n\
         text {{ fill: #d6dde1; white-space: pre }}\n\
         .c {{ fill: #fff; font-weight: bold }}\n\
         .s {{ fill: #56b4e9; font-weight: bold }}\n\
         .r {{ animation: {total:.2}s step-end infinite }}\n",
        escaped(command)
    );
    for (number, (at, _)) in rows.iter().enumerate() {
        let share = 100.0 * at / total;
        let _ = writeln!(
            svg,
            "@keyframes l{number} {{ 0% {{ opacity: 0 }} {share:.2}% {{ opacity: 1 }} }}"
        );
    }
    // The lines move up as they reach the bottom.
    svg.push_str("@keyframes up { 0% { transform: none }");
    let up = |number: usize| (number + 1).saturating_sub(ROWS) as f64 * -LINE;
    for (number, (at, _)) in rows.iter().enumerate().skip(ROWS) {
        let share = 100.0 * at / total;
        let _ = write!(
            svg,
            " {share:.2}% {{ transform: translateY({}px) }}",
            up(number)
        );
    }
    let last = up(rows.len() - 1);
    let _ = write!(
        svg,
        " }}\n.up {{ transform: translateY({last}px); animation-name: up }}\n\
         @media (prefers-reduced-motion) {{ .r {{ animation: none }} }}\n</style>\n\
         <rect width=\"100%\" height=\"100%\" rx=\"8\" fill=\"#1c2529\"/>\n\
         <svg x=\"{MARGIN}\" y=\"{MARGIN}\" width=\"{:.0}\" height=\"{:.0}\">\n<g class=\"r up\">\n",
        2.0f64.mul_add(-MARGIN, width),
        2.0f64.mul_add(-MARGIN, height) + 4.0,
    );
    for (number, (_, line)) in rows.iter().enumerate() {
        let class = match line.as_bytes() {
            [b'$', ..] => "r c",
            [b'[', ..] => "r s",
            _ => "r",
        };
        let y = (number as f64 + 0.75) * LINE;
        let _ = writeln!(
            svg,
            "<text class=\"{class}\" style=\"animation-name: l{number}\" y=\"{y:.1}\" \
             xml:space=\"preserve\">{}</text>",
            escaped(line)
        );
    }
    svg.push_str("</g>\n</svg>\n</svg>\n");
    svg
}

/// A line as a terminal breaks it.
fn wrapped(line: &str) -> Vec<String> {
    let letters: Vec<char> = line.trim_end().chars().collect();
    if letters.is_empty() {
        return vec![String::new()];
    }
    letters
        .chunks(COLUMNS)
        .map(|part| part.iter().collect())
        .collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_line_is_there_in_its_order_and_long_waits_are_short() {
        let second = Duration::from_secs;
        let printed: Printed = (0..40)
            .map(|number| (second(60 * number), format!("line {number} < & >")))
            .chain([(second(2400), "x".repeat(COLUMNS + 1))])
            .collect();
        let svg = draw("cargo xtask demo", &printed);
        let texts: Vec<&str> = svg
            .lines()
            .filter(|line| line.starts_with("<text"))
            .collect();
        // The command, the lines, and the rest of the long one.
        assert_eq!(texts.len(), 1 + 40 + 2);
        assert!(texts[0].contains("$ cargo xtask demo"));
        for (number, text) in texts[1..41].iter().enumerate() {
            let line = format!(">line {number} &lt; &amp; &gt;<");
            assert!(text.contains(&line), "{text}");
        }
        let total: f64 = svg
            .split_once("animation: ")
            .and_then(|(_, rest)| rest.split_once("s step-end"))
            .and_then(|(total, _)| total.parse().ok())
            .unwrap();
        assert!(total < 41.0 * PAUSES.0 + END + 1.0, "{total} s");
        // Without animation the end is seen.
        assert!(svg.contains(&format!(
            ".up {{ transform: translateY({}px)",
            -LINE * (43 - ROWS) as f64
        )));
    }
}
