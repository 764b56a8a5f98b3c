//! What the pages say to type: command lines in the code blocks of `README.md`, `CONTRIBUTING.md`
//! and the book.

use std::path::{Path, PathBuf};

/// Values of the variables that a scheduler sets, for a command line that names them.
pub const VARIABLES: [(&str, &str); 2] = [
    ("$SLURM_ARRAY_TASK_ID", "0"),
    ("$SLURM_ARRAY_TASK_COUNT", "2"),
];

/// `README.md`, `CONTRIBUTING.md` and all Markdown files in `docs/`, in the order of their names.
pub fn pages() -> Vec<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = here
        .ancestors()
        .find(|folder| folder.join("Cargo.lock").is_file())
        .expect("the folder of the workspace");
    let mut found = vec![root.join("README.md"), root.join("CONTRIBUTING.md")];
    let mut folders = vec![root.join("docs")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("docs/ can be read") {
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

/// A code block: what stands after its first fence, and its text.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    pub info: &'a str,
    pub text: &'a str,
}

/// The code blocks of a page, but for those in C, where a line may begin with a type's name.
pub fn blocks(page: &str) -> Vec<Block<'_>> {
    page.split("```")
        .skip(1)
        .step_by(2)
        .map(|block| {
            let (info, text) = block.split_once('\n').unwrap_or((block, ""));
            Block {
                info: info.trim(),
                text,
            }
        })
        .filter(|block| block.info != "c")
        .collect()
}

/// A command line, without a shell's prompt, and what the block shows below it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// As a shell reads it: with quotes, patterns and remarks.
    pub command: String,
    /// Where commands have a prompt: the lines below it, up to the next prompt.
    pub shown: String,
}

/// The alias of a checkout for the command `softrig`.
const ALIAS: (&str, &str) = ("cargo rig", "softrig");

/// The command lines of a program in a code block, also those with `cargo` before its name.
pub fn command_lines(text: &str, program: &str) -> Vec<Line> {
    let mut found: Vec<Line> = Vec::new();
    let mut shows = false;
    for line in text.replace("\\\n", " ").lines() {
        let (typed, prompt) = match line.trim_start().strip_prefix("$ ") {
            Some(typed) => (typed, true),
            None => (line, false),
        };
        let ours = typed.split("&&").filter_map(|command| {
            let command = command.trim();
            let command = match command.strip_prefix(ALIAS.0) {
                Some(rest) => format!("{}{rest}", ALIAS.1),
                None => command.strip_prefix("cargo ").unwrap_or(command).to_owned(),
            };
            (command.split(' ').next() == Some(program)).then_some(command)
        });
        let before = found.len();
        found.extend(ours.map(|command| Line {
            command,
            shown: String::new(),
        }));
        if found.len() > before || prompt {
            shows = prompt && found.len() > before;
        } else if let (true, Some(last)) = (shows, found.last_mut()) {
            last.shown.push_str(line);
            last.shown.push('\n');
        }
    }
    found
}

/// The words of a shell's command, up to a remark, a pipe or a redirection.
pub fn words(command: &str) -> Vec<String> {
    let command = VARIABLES
        .iter()
        .fold(command.to_owned(), |it, (name, value)| {
            it.replace(name, value)
        });
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
