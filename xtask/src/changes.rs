//! Whether something changed since a step last passed: by a key over the contents of its files.

use std::{
    collections::hash_map::DefaultHasher,
    fs,
    hash::{Hash, Hasher},
    path::PathBuf,
    process::Command,
};

use crate::shell::{read, root, target_dir};

/// Whether the step passed with these files as they are.
pub fn is_as_it_passed(step: &str, inputs: &[&str]) -> bool {
    let before = fs::read_to_string(place(step)).ok();
    before.is_some() && before == key(inputs)
}

/// Keeps that the step passed with these files. Where git does not say which they are, nothing is
/// kept, and the step runs each time.
pub fn passed(step: &str, inputs: &[&str]) {
    let place = place(step);
    let Some(key) = key(inputs) else { return };
    if let Some(folder) = place.parent() {
        let _ = fs::create_dir_all(folder);
    }
    let _ = fs::write(place, key);
}

fn place(step: &str) -> PathBuf {
    target_dir().join("passed").join(step.replace(' ', "-"))
}

/// A key over the files and the compiler; none without git.
fn key(inputs: &[&str]) -> Option<String> {
    let listed = read(
        Command::new("git")
            .args([
                "ls-files",
                "--cached",
                "--others",
                "--exclude-standard",
                "--",
            ])
            .args(inputs)
            .current_dir(root()),
    )
    .ok()?;
    let mut hasher = DefaultHasher::new();
    read(Command::new("rustc").arg("-vV").current_dir(root()))
        .ok()?
        .hash(&mut hasher);
    for file in listed.lines() {
        file.hash(&mut hasher);
        fs::read(root().join(file)).ok().hash(&mut hasher);
    }
    Some(format!("{:016x}\n", hasher.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_of_the_contents() {
        let Some(one) = key(&["xtask/src"]) else {
            return;
        };
        assert_eq!(key(&["xtask/src"]), Some(one.clone()));
        assert_ne!(key(&["xtask/src/main.rs"]), Some(one));
    }
}
