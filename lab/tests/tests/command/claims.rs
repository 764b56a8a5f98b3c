//! What README and book promise, and the commands that show it: `data/claims.toml`.
//!
//! That the words are still on their pages is asserted always, and that the commands show them with
//! `cargo xtask test --all`.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use super::common;
use softrig_tests::all_tests;
use softrig_tests::process::root;

/// A promise, and the script that shows it.
#[derive(serde::Deserialize)]
struct Claim {
    page: String,
    /// Words of the page.
    says: String,
    /// A script for `sh -e` in an empty folder.
    run: String,
    #[serde(default)]
    exit: i32,
    /// What it prints, in this order.
    #[serde(default)]
    shows: Vec<String>,
}

/// A promise that no script here shows.
#[derive(serde::Deserialize)]
struct NotRun {
    page: String,
    says: String,
    why: String,
}

#[derive(serde::Deserialize)]
struct Claims {
    claim: Vec<Claim>,
    #[serde(default)]
    not_run: Vec<NotRun>,
}

fn claims() -> Claims {
    toml::from_str(include_str!("../../data/claims.toml")).unwrap()
}

/// Lines of a page are one text.
fn joined(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Claim {
    /// What the script does otherwise.
    fn fault(&self, path: &std::ffi::OsStr) -> Option<String> {
        let folder = tempfile::tempdir().unwrap();
        let output = Command::new("sh")
            .args(["-e", "-c", &self.run])
            .current_dir(folder.path())
            .env("PATH", path)
            .output()
            .unwrap();
        let printed = [&output.stdout, &output.stderr].map(|it| String::from_utf8_lossy(it));
        let printed = printed.concat();
        if output.status.code() != Some(self.exit) {
            return Some(format!("{}\n{printed}", output.status));
        }
        let mut rest = printed.as_str();
        for part in &self.shows {
            match rest.split_once(part.as_str()) {
                Some((_, after)) => rest = after,
                None => return Some(format!("does not show {part:?}\n{printed}")),
            }
        }
        None
    }
}

#[test]
fn the_words_of_each_claim_are_on_its_page() {
    let Claims { claim, not_run } = claims();
    let with_words = claim.iter().map(|it| (&it.page, &it.says));
    let without = not_run.iter().map(|it| {
        assert!(!it.why.is_empty(), "{}: {}", it.page, it.says);
        (&it.page, &it.says)
    });
    for (page, says) in with_words.chain(without) {
        let text = std::fs::read_to_string(root().join(page)).unwrap();
        assert!(joined(&text).contains(&joined(says)), "{page}: {says:?}");
    }
    assert!(claim.len() > 60, "{}", claim.len());
}

#[test]
fn each_claim_is_shown() {
    if !all_tests() {
        return;
    }
    let program = common::program();
    let beside = program.parent().map(Path::to_owned).unwrap_or_default();
    let others = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(beside).chain(std::env::split_paths(&others));
    let path = std::env::join_paths(folders).unwrap();
    let mut faults = Vec::new();
    for claim in claims().claim {
        let clock = Instant::now();
        let fault = claim.fault(&path);
        let seconds = clock.elapsed().as_secs_f64();
        println!("{seconds:5.1} s  {}: {}", claim.page, claim.says);
        faults
            .extend(fault.map(|it| format!("{}: {}\n{}\n{it}", claim.page, claim.says, claim.run)));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}
