//! The page of the documentation (`docs/blind.md`): its sections are written by
//! two commands, of runs and of sessions, and each leaves those of the other as they
//! are.

use std::fmt::Write;

use super::answer::Collection;
use super::counts::Group;
use super::score::Scored;
use super::tables::{faint, kind_rows, refusals, rows, sets};

/// The heading of the bench set.
pub const HEADING: &str = "## The bench set";

/// What the bench set is.
pub const DESCRIPTION: &str = "\
Cases that look like a bench rather than like a simulator. A case is a whole session of
80 to 130 s with its metadata, in a third of the cases cut into files without any: steps,
a staircase, triangles, small reversals, a multisine and a hold in a drawn order, without
rest in between, half of them without a return to zero. Hysteresis, creep, drift and the
largest angle so far belong to the session. The zeros of both sensors are off (pressure
0.3 kPa rms and at most 0.7 kPa, angle up to 1.5°), the clock jitters by 3 to 15 % of an
interval, 50 to 200 Hz, and in three of ten cases the top hundredth of the angle's range is
cut off. A coloured force that nothing explains acts on every rig: an Ornstein–Uhlenbeck
process of 1 to 2 % of the elastic force at 60°, with a correlation time of 0.3 to 5 s.

Of twelve cases seven hide one effect, one hides two, two are quiet (nothing, or only
parameters) and two hide what is outside the catalogue: stiction that grows with the time
at rest, a stiffness that pulsates, a random force of 10 to 20 %. Two of the seven are of
other rigs: a near-integrator with dry friction, free swings without pressure (a file a
release), Bouc–Wen's hysteresis with a drawn shape under a random multisine. The size of an
effect is drawn so that the refitted model misses by 1.5 to 8 times what it misses by
without the effect: the noise of the sensor, and what the coloured force leaves.

Right is the exact name, a member of the same family (or `cannot_tell` with that family),
or an answer set of at most three that holds the truth. Wrong is a name of another family,
at full strength or for a part of the gap. What each row counts is in
`bench/src/blind/grade.rs`.
";

/// The page `before` with what was scored now in place of its sections of the same
/// sets.
pub fn page(before: &str, scored: &[Scored], command: &str, tool: &str) -> String {
    let (runs, bench) = parts(before);
    let of_bench = |case: &Scored| case.answer.collection() == Collection::Bench;
    if scored.iter().all(of_bench) {
        let section = bench_section(scored, command, tool);
        match runs.trim_end() {
            "" => section,
            runs => format!("{runs}\n\n{section}"),
        }
    } else {
        let runs = runs_sections(scored, command, tool);
        match bench {
            "" => runs,
            bench => format!("{}\n\n{bench}", runs.trim_end()),
        }
    }
}

/// What of a page is of runs, and its section of the bench set.
pub fn parts(page: &str) -> (&str, &str) {
    page.split_at(page.find(HEADING).unwrap_or(page.len()))
}

fn runs_sections(scored: &[Scored], command: &str, tool: &str) -> String {
    let mut text = format!(
        "# Blind benchmark\n\nWritten by the command below; do not edit. What each figure counts is in\n`bench/src/blind/said.rs` and `score.rs`, how truths are drawn in `cases.rs` and\n`sizes.rs`, their equations in `law.rs`.\n\n```\n{command}\n```\n\nSources of the tool: {tool}. Rates are followed by their 95 % interval (Wilson).\n"
    );
    for (collection, cases) in sets(scored) {
        let name = collection.name();
        let _ = write!(
            text,
            "\n## The {name} set\n\n| | asked for | |\n|---|---|---|\n"
        );
        for (label, asked, figure) in rows(collection, &cases) {
            let _ = writeln!(text, "| {label} | {asked} | {figure} |");
        }
        let _ = write!(
            text,
            "\n![Confusion matrix](images/blind_{name}.svg)\n\n{}",
            markdown_table(&kind_rows(collection, &cases))
        );
    }
    let _ = writeln!(text, "\n{}.", faint(scored));
    text
}

fn bench_section(scored: &[Scored], command: &str, tool: &str) -> String {
    let cases = Group::of(Collection::Bench, scored);
    let mut text = format!(
        "{HEADING}\n\n{DESCRIPTION}\n```\n{command}\n```\n\nSources of the tool: {tool}.\n\n| | |\n|---|---|\n"
    );
    for (label, _, figure) in rows(Collection::Bench, &cases) {
        let _ = writeln!(text, "| {label} | {figure} |");
    }
    text.push('\n');
    text += &markdown_table(&kind_rows(Collection::Bench, &cases));
    let _ = writeln!(text, "\n{}.", faint(scored));
    for line in refusals(scored) {
        let _ = writeln!(text, "\n{line}.");
    }
    text
}

/// Rows under a head as a table in Markdown.
fn markdown_table(rows: &[Vec<String>]) -> String {
    let mut text = String::new();
    for (number, row) in rows.iter().enumerate() {
        let _ = writeln!(text, "| {} |", row.join(" | "));
        if number == 0 {
            let _ = writeln!(text, "|{}", "---|".repeat(row.len()));
        }
    }
    text
}
