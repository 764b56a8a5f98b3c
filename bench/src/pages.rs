//! Sections of pages that benchmarks write.

use softrig_tests::process::root;
use softrig_tests::{text_of, write};

/// Puts a section into a page of `docs/`, between `<!-- NAME -->` and `<!-- end of NAME -->`.
///
/// # Errors
///
/// The page cannot be read or written, or has no such lines.
pub fn put_section(page: &str, name: &str, section: &str) -> Result<(), String> {
    let path = root().join("docs").join(page);
    let text = with_section(&text_of(&path)?, name, section)
        .map_err(|what| format!("docs/{page} {what}"))?;
    write(&path, &text)
}

fn with_section(page: &str, name: &str, section: &str) -> Result<String, String> {
    let marks = [
        format!("<!-- {name} -->\n"),
        format!("<!-- end of {name} -->"),
    ];
    let missing = |mark: &str| format!("has no line {:?}", mark.trim());
    let (before, rest) = page
        .split_once(&marks[0])
        .ok_or_else(|| missing(&marks[0]))?;
    let (_, after) = rest
        .split_once(&marks[1])
        .ok_or_else(|| missing(&marks[1]))?;
    let section = section.trim_end();
    Ok(format!(
        "{before}{}{section}\n{}{after}",
        marks[0], marks[1]
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_is_replaced_and_the_rest_stays() {
        let page = "a\n<!-- x -->\nold\n<!-- end of x -->\nb\n";
        let new = with_section(page, "x", "new\n\n").unwrap();
        assert_eq!(new, "a\n<!-- x -->\nnew\n<!-- end of x -->\nb\n");
        assert_eq!(with_section(&new, "x", "new").unwrap(), new);
        let missing = with_section("a\n", "x", "new").unwrap_err();
        assert_eq!(missing, "has no line \"<!-- x -->\"");
    }
}
