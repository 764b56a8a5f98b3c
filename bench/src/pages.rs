//! Figures as text: for a terminal, and between the marks of pages in `docs/`.
//!
//! A benchmark's template (`bench/pages/`) takes its JSON. A page has marks, `<!-- NAME -->` and
//! `<!-- end of NAME -->`, and only what the template has between the same marks is written there.

use std::path::Path;

use minijinja::syntax::SyntaxConfig;
use minijinja::value::Serde;
use minijinja::{Environment, UndefinedBehavior};
use serde_json::Value;
use softrig_tests::verdict::significant;
use softrig_tests::{text_of, write};

/// Name of a benchmark, the pages in `docs/` that have sections of it, and its template.
type Page = (&'static str, &'static [&'static str], &'static str);

macro_rules! template {
    ($name:literal) => {
        include_str!(concat!("../pages/", $name))
    };
}

const PAGES: [Page; 14] = [
    ("blind", &["blind.md", "formulas.md"], template!("blind.md")),
    (
        "calibration",
        &["diagnosis.md"],
        template!("calibration.md"),
    ),
    (
        "catalogue",
        &["effects.md", "diagnosis.md", "diagnosis-details.md"],
        template!("catalogue.md"),
    ),
    ("commands", &["benchmarks.md"], template!("commands.md")),
    ("control", &[], template!("control.md")),
    ("decide", &["decide.md"], template!("decide.md")),
    ("diagnosis", &[], template!("diagnosis.md")),
    ("dirt", &[], template!("invariance.md")),
    ("invariance", &[], template!("invariance.md")),
    ("loop", &["loop.md"], template!("loop.md")),
    ("many", &[], template!("many.md")),
    ("public", &["public.md"], template!("public.md")),
    ("real", &["real.md"], template!("real.md")),
    ("search", &["search.md"], template!("search.md")),
];

/// What most templates use.
const MACROS: &str = template!("macros.md");

/// The benchmark that wrote these figures.
///
/// # Errors
///
/// If none did.
pub fn name_of(figures: &Value) -> Result<&str, String> {
    let name = figures["benchmark"].as_str();
    name.ok_or_else(|| "these are no figures of a benchmark: give a file that --json wrote".into())
}

fn page(figures: &Value) -> Result<Option<&'static Page>, String> {
    let name = name_of(figures)?;
    Ok(PAGES.iter().find(|(known, ..)| *known == name))
}

/// The text of a benchmark's figures, with the marks of its sections; empty where only a program reads them.
///
/// # Errors
///
/// If the template misses a figure.
pub fn render(figures: &Value) -> Result<String, String> {
    let Some((name, _, template)) = page(figures)? else {
        return Ok(String::new());
    };
    fill(
        &format!("{name}.md"),
        &format!("{MACROS}{template}"),
        figures,
    )
}

/// Fills a template.
///
/// # Errors
///
/// If it misses a figure.
pub(crate) fn fill(name: &str, template: &str, figures: &Value) -> Result<String, String> {
    let syntax = SyntaxConfig::builder()
        .trim_blocks(true)
        .lstrip_blocks(true)
        .keep_trailing_newline(true)
        .build()
        .map_err(|error| error.to_string())?;
    let mut templates = Environment::new();
    templates.set_syntax(syntax);
    templates.set_undefined_behavior(UndefinedBehavior::SemiStrict);
    let or_dash =
        |value: Option<f64>, shown: &dyn Fn(f64) -> String| value.map_or("–".into(), shown);
    templates.add_filter("fixed", move |value: Option<f64>, digits: usize| {
        or_dash(value, &|value| format!("{value:.digits$}"))
    });
    templates.add_filter("significant", move |value: Option<f64>| {
        or_dash(value, &significant)
    });
    templates.add_filter("seconds", move |value: Option<f64>| {
        or_dash(value, &seconds)
    });
    templates.add_filter("cell", |text: &str| cell(text));
    templates.add_filter("anchor", |title: &str| anchor(title));
    let filled = templates.render_named_str(name, template, Serde(figures));
    filled.map_err(|error| format!("{error:#}"))
}

/// Seconds with the digits that mean something on a busy machine.
fn seconds(seconds: f64) -> String {
    match seconds {
        0.0..0.1 => format!("{seconds:.3}"),
        0.1..10.0 => format!("{seconds:.2}"),
        _ => format!("{seconds:.1}"),
    }
}

/// One line, and nothing that ends a cell of a table.
fn cell(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    text.replace('|', "/").chars().take(160).collect()
}

/// The link to a heading, as GitHub makes it.
fn anchor(title: &str) -> String {
    let kept = title
        .chars()
        .filter(|c| c.is_alphanumeric() || " -".contains(*c));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

/// A rendered text without marks and pictures, the columns of its tables below each other.
pub fn for_terminal(text: &str) -> String {
    let mut shown = String::new();
    let mut table: Vec<Vec<&str>> = Vec::new();
    let lines = text.trim_end().lines();
    for line in lines.filter(|line| !line.starts_with("<!--") && !line.starts_with("![")) {
        if let Some(cells) = line.strip_prefix('|') {
            table.push(
                cells
                    .trim_end_matches('|')
                    .split('|')
                    .map(str::trim)
                    .collect(),
            );
            continue;
        }
        shown += &aligned(&std::mem::take(&mut table));
        shown += line;
        shown.push('\n');
    }
    shown + &aligned(&table)
}

/// A table of Markdown whose columns stand below each other; its second row says which ones are right-aligned.
fn aligned(table: &[Vec<&str>]) -> String {
    let Some([head, rule]) = table.first_chunk() else {
        return String::new();
    };
    let width = |column: usize| {
        let rows = table.iter().filter(|row| *row != rule);
        let cells = rows.filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut text = String::new();
    for (number, row) in table.iter().enumerate() {
        for ((cell, alignment), &width) in row.iter().zip(rule).zip(&widths) {
            text += &match (number == 1, alignment.ends_with(':')) {
                (true, true) => format!("|{}:", "-".repeat(width + 1)),
                (true, false) => format!("|{}", "-".repeat(width + 2)),
                (false, true) => format!("| {cell:>width$} "),
                (false, false) => format!("| {cell:<width$} "),
            };
        }
        text += "|\n";
    }
    text
}

/// Writes the sections of a rendered text into the benchmark's pages.
///
/// # Errors
///
/// A page cannot be read or written, or none has the marks of a section.
pub fn write_into(docs: &Path, figures: &Value, text: &str) -> Result<(), String> {
    let pages = page(figures)?.map_or(&[] as &[&str], |&(_, pages, _)| pages);
    let mut missing = names(text).collect::<Vec<_>>();
    for name in pages {
        let path = docs.join(name);
        let before = text_of(&path)?;
        missing.retain(|section| between(&before, section).is_none());
        write(&path, &with_sections(&before, text))?;
    }
    match missing.first() {
        Some(section) if !pages.is_empty() => Err(format!(
            "docs/{} has no lines <!-- {section} --> and <!-- end of {section} -->",
            pages.join(", docs/")
        )),
        _ => Ok(()),
    }
}

/// Whether a page in `docs/` has what a rendered text says.
///
/// # Errors
///
/// The page cannot be read.
pub fn is_written(docs: &Path, page: &str, text: &str) -> Result<bool, String> {
    let page = text_of(&docs.join(page))?;
    Ok(with_sections(&page, text) == page)
}

/// The names of a text's sections.
fn names(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .filter_map(|line| line.strip_prefix("<!-- end of ")?.strip_suffix(" -->"))
}

/// What stands before, between and behind the marks of a section.
fn between<'a>(text: &'a str, name: &str) -> Option<[&'a str; 3]> {
    let mark = format!("<!-- {name} -->\n");
    let start = text.find(&mark)? + mark.len();
    let end = start + text[start..].find(&format!("<!-- end of {name} -->"))?;
    Some([&text[..start], &text[start..end], &text[end..]])
}

/// The page with what a text has between marks in place of what it has itself there.
fn with_sections(page: &str, text: &str) -> String {
    let mut page = page.to_owned();
    for name in names(text) {
        if let (Some([before, _, after]), Some([_, section, _])) =
            (between(&page, name), between(text, name))
        {
            page = format!("{before}{}\n{after}", section.trim_end());
        }
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_replaced_and_the_rest_stays() {
        let page = "a\n<!-- x -->\nold\n<!-- end of x -->\nb\n<!-- y -->\n<!-- end of y -->\n";
        let text = "<!-- x -->\nnew\n\n<!-- end of x -->\nfor a terminal\n";
        let new = with_sections(page, text);
        assert_eq!(new, page.replace("old", "new"));
        assert_eq!(with_sections(&new, text), new);
        assert_eq!(with_sections("a\n", text), "a\n");
    }

    #[test]
    fn a_page_without_marks_is_named() {
        let docs = tempfile::tempdir().unwrap();
        write(&docs.path().join("loop.md"), "a\n").unwrap();
        let missing = write_into(
            docs.path(),
            &serde_json::json!({ "benchmark": "loop" }),
            "<!-- loop -->\nnew\n<!-- end of loop -->\n",
        );
        assert_eq!(
            missing.unwrap_err(),
            "docs/loop.md has no lines <!-- loop --> and <!-- end of loop -->"
        );
    }

    #[test]
    fn every_section_has_one_place() {
        for (name, pages, template) in PAGES {
            let texts: Vec<String> = pages
                .iter()
                .map(|page| {
                    text_of(&softrig_tests::process::root().join("docs").join(page)).unwrap()
                })
                .collect();
            assert_eq!(names(template).count() > 0, !pages.is_empty(), "{name}");
            for section in names(template) {
                let places = texts.iter().filter(|text| between(text, section).is_some());
                assert_eq!(places.count(), 1, "{name}: {section}");
            }
        }
    }

    #[test]
    fn a_terminal_shows_columns_below_each_other() {
        let text = "<!-- x -->\n| a | b |\n|---|---:|\n| long |  |\n| ü | 12 |\n![p](q)\n\nend\n<!-- end of x -->\n";
        assert_eq!(
            for_terminal(text),
            "| a    |  b |\n|------|---:|\n| long |    |\n| ü    | 12 |\n\nend\n"
        );
    }

    #[test]
    fn headings_are_linked_as_github_does() {
        assert_eq!(anchor("Torque-limited pendulum"), "torque-limited-pendulum");
    }
}
