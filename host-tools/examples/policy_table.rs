//! Writes the tables of the decision's constants into the page on the diagnosis.
//!
//! `cargo run -p host-tools --example policy_table -- docs/diagnosis.md` replaces what
//! stands between each table's head and the next text; a test holds the two together.

use std::fmt::Write as _;

use host_tools::diagnose::policy::{Policy, Row, Search};

/// The head of a table in the page.
const HEAD: &str = "   |---|---:|---|---|---|\n";

/// The tables, in the order of the page.
const TABLES: [&[Row]; 2] = [Search::ROWS, Policy::ROWS];

fn main() -> std::io::Result<()> {
    if let Some(path) = std::env::args().nth(1) {
        let page = std::fs::read_to_string(&path)?;
        std::fs::write(&path, with_tables(&page))?;
    } else {
        for rows in TABLES {
            println!("{}", table(rows));
        }
    }
    Ok(())
}

/// The rows of a table, indented as a part of a list.
fn table(rows: &[Row]) -> String {
    let mut text = String::new();
    for (name, value, unit, meaning, origin) in rows {
        let meaning = meaning.trim();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "   | `{name}` | {} | {unit} | {meaning} | {origin} |",
            short(*value)
        );
    }
    text
}

/// Four decimals at most.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// The page with its tables as the code has them.
fn with_tables(page: &str) -> String {
    let mut parts = page.split(HEAD);
    let mut text = parts.next().unwrap_or_default().to_owned();
    for (rows, rest) in TABLES.into_iter().zip(parts) {
        let after: Vec<&str> = rest
            .lines()
            .skip_while(|line| line.trim_start().starts_with('|'))
            .collect();
        text += HEAD;
        text += &table(rows);
        text += &after.join("\n");
        text += "\n";
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn page_has_the_constants_of_the_code() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/diagnosis.md");
        let written = std::fs::read_to_string(path).unwrap_or_default();
        assert_eq!(
            super::with_tables(&written),
            written,
            "docs/diagnosis.md is out of date: \
             cargo run -p host-tools --example policy_table -- docs/diagnosis.md"
        );
        for rows in super::TABLES {
            assert!(written.contains(&super::table(rows)));
        }
    }
}
