//! Licences, duplicates and sources of dependencies: cargo-deny, with its exceptions in deny.toml.

use std::process::Command;

use crate::shell::{Outcome, cargo, has_program, root, run};

/// The version that was tried.
const VERSION: &str = "^0.20";

/// What is checked. Advisories take a data base from the network, and are a step of the workflow.
const CHECKS: [&str; 3] = ["licenses", "bans", "sources"];

/// Checks the dependencies, where cargo-deny is there: to compile it takes longer than all that
/// it does.
pub fn check() -> Outcome {
    if !has_program("cargo-deny") {
        println!("cargo-deny is not here: cargo install cargo-deny --locked --version '{VERSION}'");
        return Ok(());
    }
    run(Command::new("cargo-deny")
        .args(["--all-features", "--locked", "check"])
        .args(CHECKS)
        .current_dir(root())
        .env("CARGO", cargo().get_program()))
}
