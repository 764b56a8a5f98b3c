//! Writes the tables of the constants into the pages on the diagnosis.
//!
//! `cargo run -p softrig --example policy_table -- docs/diagnosis.md docs/diagnosis-details.md`
//! replaces what stands between a table's head and the next text; a test holds them together.

use std::fmt::Write as _;
use std::io::Error;
use std::path::PathBuf;

use softrig::diagnose::policy::{Constant, Policy, Search};

/// The head of a table in a page.
const HEAD: &str = "|---|---:|---|---|---|\n";

/// The pages in `docs/`, each with its table.
const TABLES: [(&str, &[Constant]); 2] = [
    ("diagnosis.md", Policy::ROWS),
    ("diagnosis-details.md", Search::ROWS),
];

fn main() -> std::io::Result<()> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    if paths.is_empty() {
        for (_, rows) in TABLES {
            println!("{}", table(rows));
        }
    }
    for path in paths {
        let is_this = |(page, _): &(&str, &[Constant])| path.ends_with(page);
        let Some((_, rows)) = TABLES.into_iter().find(is_this) else {
            return Err(Error::other(format!(
                "{}: no page with a table",
                path.display()
            )));
        };
        let page = std::fs::read_to_string(&path)?;
        std::fs::write(&path, with_table(&page, rows))?;
    }
    Ok(())
}

/// The rows of a table.
fn table(rows: &[Constant]) -> String {
    let mut text = String::new();
    for (name, value, unit, meaning, origin) in rows {
        let meaning = meaning.trim();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "| `{name}` | {} | {unit} | {meaning} | {origin} |",
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

/// A page with its table as the code has it.
fn with_table(page: &str, rows: &[Constant]) -> String {
    let Some((before, rest)) = page.split_once(HEAD) else {
        return page.to_owned();
    };
    let after: String = rest
        .split_inclusive('\n')
        .skip_while(|line| line.starts_with('|'))
        .collect();
    format!("{before}{HEAD}{}{after}", table(rows))
}

#[cfg(test)]
mod tests {
    #[test]
    fn pages_have_the_constants_of_the_code() {
        for (page, rows) in super::TABLES {
            let path = format!("{}/../../docs/{page}", env!("CARGO_MANIFEST_DIR"));
            let written = std::fs::read_to_string(path).unwrap_or_default();
            assert!(
                written.contains(&super::table(rows))
                    && super::with_table(&written, rows) == written,
                "docs/{page} is out of date: \
                 cargo run -p softrig --example policy_table -- docs/{page}"
            );
        }
    }
}
