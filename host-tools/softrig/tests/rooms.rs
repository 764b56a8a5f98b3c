//! The rooms of the diagnosis stand in one line: each knows only those before it.

use std::fs;
use std::path::{Path, PathBuf};

/// As the module page of `diagnose` lists them.
const LINE: [&str; 9] = [
    "work",
    "recordings",
    "score",
    "fit",
    "evidence",
    "decide",
    "search",
    "experiment",
    "explain",
];

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// The rooms that a source text names, outside of its tests and comments.
fn named(text: &str) -> impl Iterator<Item = &str> {
    let code = text.split("\n#[cfg(test)]\n").next().unwrap_or_default();
    code.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_' && c != ':'))
        .filter_map(|path| {
            let from = path.find("diagnose::").map(|at| at + "diagnose::".len());
            let own = path.strip_prefix("super::").map(|_| "super::".len());
            path.get(from.or(own)?..)?.split("::").next()
        })
}

#[test]
fn no_room_of_the_diagnosis_knows_one_after_it() {
    let house = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/diagnose");
    let page = fs::read_to_string(house.join("mod.rs")).unwrap();
    let mut said = page.lines().filter(|line| line.starts_with("//! | [`"));
    let mut seen = 0;
    for (place, room) in LINE.iter().enumerate() {
        let row = said.next().unwrap();
        assert!(row.contains(room), "row {} is not {room}: {row}", place + 1);
        for file in files(&house.join(room)) {
            let text = fs::read_to_string(&file).unwrap();
            for other in named(&text) {
                let Some(at) = LINE.iter().position(|it| *it == other) else {
                    continue;
                };
                seen += 1;
                assert!(at <= place, "{}: knows {other}", file.display());
            }
        }
    }
    assert_eq!(said.next(), None);
    assert_eq!(
        files(&house).len(),
        LINE.len() + 1,
        "a file beside the rooms"
    );
    assert!(seen > 50, "{seen} rooms are named");
}
