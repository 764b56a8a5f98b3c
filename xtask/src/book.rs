//! The book: the documents in `docs/` as pages for a browser.

use std::{path::PathBuf, process::Command};

use crate::{
    setup,
    shell::{Outcome, root, run, target_dir},
};

/// Builds the book and returns its first page. `docs/book/book.toml` says what is in it; links are
/// checked by `cargo test`, which needs no mdBook.
pub fn book() -> Outcome<PathBuf> {
    let mdbook = setup::mdbook().ok_or("mdBook is not here: run `cargo xtask setup`")?;
    let folder = target_dir().join("book");
    run(Command::new(mdbook)
        .current_dir(root())
        .args(["build", "docs/book", "--dest-dir"])
        .arg(&folder))?;
    Ok(folder.join("index.html"))
}
