//! Every command line of `rig` in the documents is one that it accepts.

use std::{
    fs,
    path::{Path, PathBuf},
};

use clap::Parser;
use clap::error::ErrorKind;

use super::Cli;

/// Commands and flags that are announced and not here yet: the words that a command line of
/// theirs has. Whoever brings one takes it off this list.
const NOT_YET: &[&[&str]] = &[];

/// `README.md` and all Markdown files in `docs/`.
fn documents() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut found = vec![root.join("README.md")];
    let mut folders = vec![root.join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("docs/ can be read") {
            let path = entry.expect("docs/ can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The command lines of `rig` in the code blocks of a document, without a shell's prompt, its
/// remarks and its redirections.
fn command_lines(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for block in text.split("```").skip(1).step_by(2) {
        for line in block.replace("\\\n", " ").lines() {
            for command in line.trim_start().trim_start_matches("$ ").split("&&") {
                let words = words(command);
                let words = match words.first().map(String::as_str) {
                    Some("cargo") if words.get(1).is_some_and(|word| word == "rig") => &words[1..],
                    Some("rig") => &words[..],
                    _ => continue,
                };
                // What a shell would put in the place of a variable is not known here.
                if !words.iter().any(|word| word.contains('$')) {
                    found.push(words.to_vec());
                }
            }
        }
    }
    found
}

/// The words of a shell's command, up to a remark, a pipe or a redirection.
fn words(command: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for letter in command.trim().chars() {
        match (quote, letter) {
            (Some(open), close) if open == close => quote = None,
            (None, '"' | '\'') => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            (None, ' ') => found.extend(word.take()),
            (None, '#') if word.is_none() => break,
            (None, '|' | '>' | '<' | '&') => break,
            (_, letter) => word.get_or_insert_default().push(letter),
        }
    }
    found.extend(word);
    found
}

/// Whether a command line needs something that is announced.
fn announced(words: &[String]) -> Option<&'static [&'static str]> {
    let has = |part: &&str| words.iter().any(|word| word == part);
    NOT_YET.iter().copied().find(|entry| entry.iter().all(has))
}

#[test]
fn documented_command_lines_are_accepted() {
    let mut count = 0;
    let mut faults = Vec::new();
    for document in documents() {
        let text = fs::read_to_string(&document).expect("documents are text");
        for words in command_lines(&text) {
            count += 1;
            let line = words.join(" ");
            let place = document.file_name().unwrap_or_default().display();
            match (Cli::try_parse_from(&words), announced(&words)) {
                (Ok(_), Some(entry)) => {
                    faults.push(format!("{line}: take {entry:?} off the list NOT_YET"));
                }
                (Ok(_), None) | (Err(_), Some(_)) => {}
                (Err(error), None)
                    if matches!(
                        error.kind(),
                        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
                    ) => {}
                (Err(error), None) => faults.push(format!("{place}: {line}\n{error}")),
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(count > 40, "only {count} command lines were found");
}

#[test]
fn command_lines_are_found_as_a_shell_reads_them() {
    let text = "Not here: rig none\n```\n$ rig fit --model \"a b.toml\" \\\n    x.csv   # remark\n\
                rig schema > file\nrigid\ncargo rig ports && rig example -o 'd#1'\n\
                rig fit --model $M x.csv\n```\nrig none\n";
    let lines: Vec<String> = command_lines(text)
        .iter()
        .map(|words| words.join("|"))
        .collect();
    assert_eq!(
        lines,
        [
            "rig|fit|--model|a b.toml|x.csv",
            "rig|schema",
            "rig|ports",
            "rig|example|-o|d#1"
        ]
    );
}
