//! The confusion matrix of runs from rest as a picture.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::answer::Collection;
use super::counts::Group;
use super::experiments::Set;
use super::law::kinds;
use super::score::Scored;
use super::tables::{column_label, row_label, row_order};

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
fn confusion(cases: &Group<'_>) -> BTreeMap<(String, String), u32> {
    let mut counts = BTreeMap::new();
    for case in cases.iter() {
        *counts
            .entry((row_label(case), column_label(case)))
            .or_default() += 1;
    }
    counts
}

/// The confusion matrix as a picture: the share of each row in its columns.
pub fn picture(set: Set, scored: &[Scored]) -> String {
    const CELL: usize = 20;
    const LEFT: usize = 190;
    const TOP: usize = 175;
    let counts = confusion(&Group::of(Collection::Runs(set), scored));
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
