//! Whether something changed since a step last passed: by a key over the contents of its files.
//!
//! Keys are kept for the user, not in the target folder, so that another clone of the same sources
//! finds them, with what the step made.

use std::{
    collections::hash_map::DefaultHasher,
    env, fs,
    hash::{Hash, Hasher},
    path::{Path, PathBuf},
    process::Command,
};

use crate::shell::{read, root};

/// A step that passed, or did not yet, with its files as they are.
#[derive(Clone, Debug)]
pub struct Passed {
    /// Where it is kept; none without git or a home.
    mark: Option<PathBuf>,
}

impl Passed {
    /// The step with these files and what else decides how it goes.
    pub fn of(step: &str, inputs: &[&str]) -> Self {
        let mark = folder()
            .zip(key(inputs))
            .map(|(folder, key)| folder.join(format!("{}-{key:016x}", step.replace(' ', "-"))));
        Self { mark }
    }

    /// Whether it passed. What it made is put back where it is missing.
    pub fn is_known(&self, made: Option<&Path>) -> bool {
        let Some(mark) = self.mark.as_ref().filter(|mark| mark.is_file()) else {
            return false;
        };
        let Some(made) = made else { return true };
        made.parent()
            .is_some_and(|it| fs::create_dir_all(it).is_ok())
            && fs::copy(mark, made).is_ok()
    }

    /// Keeps that it passed, with what it made.
    pub fn keep(&self, made: Option<&Path>) {
        let Some(mark) = &self.mark else { return };
        if let Some(folder) = mark.parent() {
            let _ = fs::create_dir_all(folder);
        }
        let _ = match made {
            Some(made) => fs::copy(made, mark).map(drop),
            None => fs::write(mark, ""),
        };
    }
}

/// Where caches of this user's programs are.
fn folder() -> Option<PathBuf> {
    let caches = env::var_os("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .or_else(|| Some(PathBuf::from(env::var_os("HOME")?).join(".cache")))?;
    Some(caches.join("softrig/passed"))
}

/// A key over the files, the compiler and Python; none without git.
fn key(inputs: &[&str]) -> Option<u64> {
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
    for tool in [["rustc", "-vV"], ["python3", "--version"]] {
        let said = read(Command::new(tool[0]).arg(tool[1]).current_dir(root()));
        said.unwrap_or_default().hash(&mut hasher);
    }
    for file in listed.lines() {
        file.hash(&mut hasher);
        fs::read(root().join(file)).ok().hash(&mut hasher);
    }
    Some(hasher.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_is_of_the_contents() {
        let Some(one) = key(&["xtask/src"]) else {
            return;
        };
        assert_eq!(key(&["xtask/src"]), Some(one));
        assert_ne!(key(&["xtask/src/main.rs"]), Some(one));
    }

    #[test]
    fn what_a_step_made_is_put_back() {
        let folder = env::temp_dir().join(format!("softrig-passed-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let made = folder.join("dist/page.html");
        let passed = Passed {
            mark: Some(folder.join("mark")),
        };
        assert!(!passed.is_known(Some(&made)));
        fs::create_dir_all(folder.join("dist")).unwrap();
        fs::write(&made, "a page").unwrap();
        passed.keep(Some(&made));
        fs::remove_file(&made).unwrap();
        assert!(passed.is_known(Some(&made)));
        assert_eq!(fs::read_to_string(&made).unwrap(), "a page");
        fs::remove_dir_all(folder).unwrap();
    }
}
