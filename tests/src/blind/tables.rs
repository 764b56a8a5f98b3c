//! The score for people (terminal, Markdown, a picture) and for programs (CSV).

use std::collections::BTreeMap;
use std::fmt::Write;

use super::cases::Hidden;
use super::experiments::Set;
use super::score::{Class, Figures, Rate, Scored};
use super::truth::kinds;

/// "92 % (85–96), 74 of 80".
pub(super) fn shown(rate: Rate) -> String {
    match (rate.share(), rate.wilson()) {
        (Some(share), Some((low, high))) => format!(
            "{:.0} % ({:.0}–{:.0}), {} of {}",
            100.0 * share,
            100.0 * low,
            100.0 * high,
            rate.hits,
            rate.of
        ),
        _ => "–".to_owned(),
    }
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{:.1} %", 100.0 * value))
}

/// The rows of the main table: label, what is asked for, and the figure.
fn rows(figures: &Figures) -> Vec<(&'static str, &'static str, String)> {
    let asked = |rich: &'static str, paper: &'static str| {
        if figures.set == Set::Rich {
            rich
        } else {
            paper
        }
    };
    vec![
        (
            "one effect: named, lenient",
            asked("≥ 92 %", "≥ 70 %"),
            shown(figures.lenient),
        ),
        ("one effect: named, strict", "", shown(figures.strict)),
        (
            "… by the catalogue's formula, lenient",
            "",
            shown(figures.same_formula),
        ),
        (
            "… by another formula, lenient",
            "",
            shown(figures.other_formula),
        ),
        ("one effect: something else named", "", shown(figures.wrong)),
        (
            "one effect: in the answer set",
            asked("≥ 97 %", "≥ 95 %"),
            shown(figures.in_set),
        ),
        (
            "nothing or parameters only: a name",
            "≤ 3 %",
            shown(figures.false_names),
        ),
        ("… nothing hidden", "", shown(figures.false_on_nothing)),
        ("… parameters only", "", shown(figures.false_on_parameters)),
        (
            "outside the catalogue: a name at full strength",
            asked("≤ 15 %", "≤ 25 %"),
            shown(figures.outside),
        ),
        (
            "two effects: exact pair",
            asked("≥ 70 %", "–"),
            shown(figures.pair),
        ),
        (
            "two effects: all that is named is hidden",
            "",
            shown(figures.part_of_pair),
        ),
        (
            "held-out RMSE over the oracle's, median",
            asked("≤ 1.05", "≤ 1.10"),
            number(figures.held_out, 3),
        ),
        (
            "… against a perfect sensor",
            "",
            number(figures.held_out_clean, 2),
        ),
        (
            "effect parameters: 95 % intervals cover",
            "90–98 %",
            shown(figures.effect_coverage),
        ),
        (
            "base ratios: 95 % intervals cover",
            "90–98 %",
            shown(figures.base_coverage),
        ),
        (
            "effect parameters: median relative error",
            "",
            percent(figures.effect_error),
        ),
        (
            "base ratios: median relative error",
            "",
            percent(figures.base_error),
        ),
        (
            "wall time a case, median (s)",
            "≤ 15",
            number(figures.seconds_median, 1),
        ),
        (
            "wall time a case, worst (s)",
            "",
            number(figures.seconds_worst, 1),
        ),
    ]
}

/// What a case counts as in the rows of the confusion matrix.
pub fn row_label(case: &Scored) -> String {
    match case.answer.hidden {
        Hidden::Nothing => "(nothing)".to_owned(),
        Hidden::Parameters => "(parameters)".to_owned(),
        Hidden::Outside => "(outside)".to_owned(),
        Hidden::Two => "(two)".to_owned(),
        Hidden::One => case.answer.kinds.concat(),
    }
}

/// What the verdict counts as in the columns of the confusion matrix.
pub fn column_label(case: &Scored) -> String {
    match case.said.named.as_slice() {
        [] => format!("({})", case.said.verdict),
        [one] => one.clone(),
        several if several == case.answer.kinds => "(the pair)".to_owned(),
        _ => "(several)".to_owned(),
    }
}

/// Rows of the matrix in their order.
fn row_order() -> Vec<String> {
    let special = ["(two)", "(nothing)", "(parameters)", "(outside)"];
    kinds()
        .into_iter()
        .chain(special)
        .map(str::to_owned)
        .collect()
}

/// Columns of the matrix in their order.
fn column_order() -> Vec<String> {
    let special = [
        "(the pair)",
        "(several)",
        "(cannot_tell)",
        "(unexplained)",
        "(parameters_only)",
        "(no_discrepancy)",
        "(refused)",
    ];
    kinds()
        .into_iter()
        .chain(special)
        .map(str::to_owned)
        .collect()
}

/// How often each truth got each answer.
pub fn confusion<'a>(cases: impl Iterator<Item = &'a Scored>) -> BTreeMap<(String, String), u32> {
    let mut counts = BTreeMap::new();
    for case in cases {
        *counts
            .entry((row_label(case), column_label(case)))
            .or_default() += 1;
    }
    counts
}

/// One line for each kind: counts of what was answered.
fn kind_rows(set: Set, scored: &[Scored]) -> Vec<[String; 6]> {
    row_order()
        .into_iter()
        .filter_map(|label| {
            let cases: Vec<&Scored> = scored
                .iter()
                .filter(|case| case.answer.set == set && row_label(case) == label)
                .collect();
            let first = cases.first()?;
            let truth_counts = matches!(first.class, Class::One | Class::Two);
            let strict = Rate::count(
                cases
                    .iter()
                    .map(|case| case.said.names_exactly(&case.answer.kinds)),
            );
            let lenient = Rate::count(
                cases
                    .iter()
                    .map(|case| case.said.names_group(&case.answer.kinds)),
            );
            let holds = Rate::count(cases.iter().map(|case| case.said.holds(&case.answer.kinds)));
            let is_right =
                |case: &Scored| truth_counts && case.said.names_exactly(&case.answer.kinds);
            let others = cases.iter().filter(|case| !is_right(case));
            let rate = |rate: Rate| {
                if truth_counts {
                    shown(rate)
                } else {
                    String::new()
                }
            };
            Some([
                label,
                cases.len().to_string(),
                rate(strict),
                rate(lenient),
                rate(holds),
                counted(others.map(|case| column_label(case))),
            ])
        })
        .collect()
}

const KIND_HEAD: [&str; 6] = [
    "hidden",
    "cases",
    "strict",
    "lenient",
    "in the answer set",
    "other answers",
];

fn sets(scored: &[Scored]) -> Vec<Figures> {
    [Set::Rich, Set::Paper]
        .into_iter()
        .filter_map(|set| Figures::of(set, scored))
        .collect()
}

/// How many effects could not be drawn as large as is asked for. They count
/// like all others.
fn faint(scored: &[Scored]) -> String {
    let cases = scored.iter().map(|case| &case.answer);
    too_faint(cases.map(|answer| (answer.case.as_str(), answer.visible)))
}

/// The cases, by name, that are not as visible as is asked for.
pub(super) fn too_faint<'a>(cases: impl Iterator<Item = (&'a str, bool)>) -> String {
    let cases: Vec<(&str, bool)> = cases.collect();
    let faint = cases.iter().filter(|(_, visible)| !visible);
    let faint: Vec<&str> = faint.map(|(case, _)| *case).collect();
    format!(
        "effects that are fainter or coarser than the range that is asked for: {} of {} cases {}",
        faint.len(),
        cases.len(),
        faint.join(" ")
    )
    .trim_end()
    .to_owned()
}

/// What was answered how often.
pub(super) fn counted(answers: impl Iterator<Item = String>) -> String {
    let mut counts: BTreeMap<String, u32> = BTreeMap::new();
    for answer in answers {
        *counts.entry(answer).or_default() += 1;
    }
    let counts = counts.iter().map(|(what, count)| format!("{what} {count}"));
    counts.collect::<Vec<_>>().join(", ")
}

/// A table in Markdown.
pub(super) fn markdown_table<const N: usize>(head: [&str; N], rows: &[[String; N]]) -> String {
    let mut text = format!("| {} |\n|{}\n", head.join(" | "), "---|".repeat(N));
    for row in rows {
        let _ = writeln!(text, "| {} |", row.join(" | "));
    }
    text
}

/// Columns padded to their widest entry.
pub(super) fn aligned(rows: &[Vec<String>]) -> String {
    let mut text = String::new();
    let columns = rows.first().map_or(0, Vec::len);
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    for row in rows {
        let mut line = String::from(" ");
        for (entry, width) in row.iter().zip(&widths) {
            let _ = write!(line, " {entry:<width$} ");
        }
        let _ = writeln!(text, "{}", line.trim_end());
    }
    text
}

/// The tables for a terminal.
pub fn terminal(scored: &[Scored]) -> String {
    let mut text = String::new();
    for figures in sets(scored) {
        let _ = writeln!(text, "\n{} set\n", figures.set.name());
        let table: Vec<Vec<String>> = rows(&figures)
            .into_iter()
            .map(|(label, asked, figure)| vec![label.to_owned(), asked.to_owned(), figure])
            .collect();
        text += &aligned(&table);
        let mut table = vec![KIND_HEAD.map(str::to_owned).to_vec()];
        table.extend(kind_rows(figures.set, scored).into_iter().map(Vec::from));
        let _ = writeln!(text);
        text += &aligned(&table);
    }
    let _ = writeln!(text, "\n  {}", faint(scored));
    text
}

/// The page of the documentation.
pub fn markdown(scored: &[Scored], command: &str, tool: &str) -> String {
    let mut text = format!(
        "# Blind benchmark\n\nWritten by the command below; do not edit. What each figure counts is in\n`tests/src/blind/score.rs`, how truths are drawn in `cases.rs`, their equations in\n`truth.rs`.\n\n```\n{command}\n```\n\nSources of the tool: {tool}. Rates are followed by their 95 % interval (Wilson).\n"
    );
    for figures in sets(scored) {
        let name = figures.set.name();
        let _ = write!(
            text,
            "\n## The {name} set\n\n| | asked for | |\n|---|---|---|\n"
        );
        for (label, asked, figure) in rows(&figures) {
            let _ = writeln!(text, "| {label} | {asked} | {figure} |");
        }
        let _ = write!(
            text,
            "\n![Confusion matrix](images/blind_{name}.svg)\n\n{}",
            markdown_table(KIND_HEAD, &kind_rows(figures.set, scored))
        );
    }
    let _ = writeln!(text, "\n{}.", faint(scored));
    text
}

/// A line for each case.
pub fn csv(scored: &[Scored]) -> String {
    let mut text = String::from(
        "case,set,hidden,kinds,formulas,misfit_over_noise,partner_over_noise,visible,noise_deg,verdict,named,answer_set,held_out_over_oracle,held_out_over_oracle_clean,seconds\n",
    );
    for case in scored {
        let open: Vec<String> = case
            .said
            .answer_set
            .iter()
            .map(|set| set.join("+"))
            .collect();
        let _ = writeln!(
            text,
            "{},{},{},{},{},{:.3},{},{},{:.3},{},{},{},{},{},{:.2}",
            case.answer.case,
            case.answer.set.name(),
            format!("{:?}", case.answer.hidden).to_lowercase(),
            case.answer.kinds.join("+"),
            case.answer.formulas.join("+"),
            case.answer.misfit_over_noise,
            number(case.answer.partner_over_noise, 3),
            case.answer.visible,
            case.answer.sensors.angle_noise.to_degrees(),
            case.said.verdict,
            case.said.named.join("+"),
            open.join(" "),
            number(case.ratios().map(|(noisy, _)| noisy), 4),
            number(case.ratios().map(|(_, clean)| clean), 4),
            case.seconds
        );
    }
    text
}

/// The confusion matrix as a picture: the share of each row in its columns.
pub fn picture(set: Set, scored: &[Scored]) -> String {
    const CELL: usize = 20;
    const LEFT: usize = 190;
    const TOP: usize = 175;
    let counts = confusion(scored.iter().filter(|case| case.answer.set == set));
    let rows: Vec<String> = row_order()
        .into_iter()
        .filter(|row| counts.keys().any(|(truth, _)| truth == row))
        .collect();
    let columns: Vec<String> = column_order()
        .into_iter()
        .filter(|column| rows.contains(column) || counts.keys().any(|(_, answer)| answer == column))
        .collect();
    let (width, height) = (
        // Slanted labels of the last columns lean over the edge.
        LEFT + CELL * columns.len() + 100,
        TOP + CELL * rows.len() + 40,
    );
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"8\" y=\"18\" font-size=\"14\">Hidden (rows) and answered (columns), {} set: cases</text>\n",
        set.name()
    );
    for (k, column) in columns.iter().enumerate() {
        let x = LEFT + CELL * k + CELL / 2 + 4;
        let _ = writeln!(
            svg,
            "<text transform=\"translate({x},{}) rotate(-60)\">{column}</text>",
            TOP - 6
        );
    }
    for (r, row) in rows.iter().enumerate() {
        let y = TOP + CELL * r;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{row}</text>",
            LEFT - 6,
            y + 14
        );
        let all: u32 = counts
            .iter()
            .filter(|((truth, _), _)| truth == row)
            .map(|(_, count)| count)
            .sum();
        for (k, column) in columns.iter().enumerate() {
            let count = counts
                .get(&(row.clone(), column.clone()))
                .copied()
                .unwrap_or(0);
            let x = LEFT + CELL * k;
            let share = f64::from(count) / f64::from(all.max(1));
            // Right names are green, wrong ones vermilion, the rest blue.
            let colour = if column == row || column == "(the pair)" {
                "#009E73"
            } else if column.starts_with('(') && column != "(several)" {
                "#0072B2"
            } else {
                "#D55E00"
            };
            let _ = writeln!(
                svg,
                "<rect x=\"{x}\" y=\"{y}\" width=\"{CELL}\" height=\"{CELL}\" fill=\"{colour}\" fill-opacity=\"{:.3}\" stroke=\"#ddd\"/>",
                if count == 0 { 0.0 } else { 0.15 + 0.85 * share }
            );
            if count > 0 {
                let ink = if share > 0.5 { "#fff" } else { "#000" };
                let _ = writeln!(
                    svg,
                    "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" fill=\"{ink}\">{count}</text>",
                    x + CELL / 2,
                    y + 14
                );
            }
        }
    }
    svg += "</svg>\n";
    svg
}
