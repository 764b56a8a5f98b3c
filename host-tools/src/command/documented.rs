//! Every command line of `softrig` in the documents is one that it accepts.
//!
//! Those that can run without a bench are run by `lab/tests/tests/command/documents.rs`.

use std::fs;

use clap::Parser;
use clap::error::ErrorKind;

use super::Cli;

#[path = "../../tests/common/pages.rs"]
mod pages;

use pages::{blocks, command_lines, words};

#[test]
fn documented_command_lines_are_accepted() {
    let mut count = 0;
    let mut faults = Vec::new();
    for page in pages::pages() {
        let text = fs::read_to_string(&page).expect("documents are text");
        let lines = blocks(&text)
            .into_iter()
            .flat_map(|block| command_lines(block.text, "softrig"));
        for line in lines {
            count += 1;
            let place = page.file_name().unwrap_or_default().display();
            match Cli::try_parse_from(words(&line.command)) {
                Ok(_) => {}
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion
                    ) => {}
                Err(error) => faults.push(format!("{place}: {}\n{error}", line.command)),
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(count > 80, "only {count} command lines were found");
}

#[test]
fn command_lines_are_found_as_a_shell_reads_them() {
    let text = "Not here: softrig none\n```\nsoftrig fit --model \"a b.toml\" \\\n    x.csv   # remark\n\
                not shown\n$ softrig schema > file\nrigid\n$ cc\nno\ncargo rig ports && softrig example -o 'd#1'\n\
                softrig fit --share $SLURM_ARRAY_TASK_ID/2\n```\nsoftrig none\n```text\nsoftrig?\n```\n";
    let blocks = blocks(text);
    assert_eq!(blocks[1].info, "text");
    let lines = command_lines(blocks[0].text, "softrig");
    let read: Vec<String> = lines
        .iter()
        .map(|line| words(&line.command).join("|"))
        .collect();
    assert_eq!(
        read,
        [
            "softrig|fit|--model|a b.toml|x.csv",
            "softrig|schema",
            "softrig|ports",
            "softrig|example|-o|d#1",
            "softrig|fit|--share|0/2"
        ]
    );
    let shown: Vec<&str> = lines.iter().map(|line| line.shown.as_str()).collect();
    assert_eq!(shown, ["", "rigid\n", "", "", ""]);
    assert!(command_lines(blocks[1].text, "softrig").is_empty());
}
