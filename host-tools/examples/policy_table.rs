//! Writes the table of the decision's constants into the page on the diagnosis.
//!
//! `cargo run -p host-tools --example policy_table -- docs/diagnosis.md` replaces what
//! stands between the table's head and the next text; a test holds the two together.

use std::fmt::Write as _;

use host_tools::diagnose::policy::Policy;

/// The head of the table in the page.
const HEAD: &str = "   |---|---:|---|---|---|\n";

fn main() -> std::io::Result<()> {
    if let Some(path) = std::env::args().nth(1) {
        let page = std::fs::read_to_string(&path)?;
        std::fs::write(&path, with_table(&page))?;
    } else {
        print!("{}", table());
    }
    Ok(())
}

/// The rows of the table, indented as a part of a list.
fn table() -> String {
    let mut text = String::new();
    for (name, value, unit, meaning, origin) in Policy::ROWS {
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

/// Three decimals at most.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// The page with its table as the code has it.
fn with_table(page: &str) -> String {
    let Some((before, rest)) = page.split_once(HEAD) else {
        return page.to_owned();
    };
    let after = rest
        .lines()
        .skip_while(|line| line.trim_start().starts_with('|') || line.starts_with("<!--"))
        .fold(String::new(), |text, line| text + line + "\n");
    format!(
        "{before}{HEAD}{}\n{}",
        table(),
        after.trim_start_matches('\n')
    )
}

#[cfg(test)]
mod tests {
    #[test]
    fn page_has_the_constants_of_the_code() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/diagnosis.md");
        let written = std::fs::read_to_string(path).unwrap_or_default();
        assert!(
            written.contains(&super::table()),
            "docs/diagnosis.md is out of date: \
             cargo run -p host-tools --example policy_table -- docs/diagnosis.md"
        );
    }
}
