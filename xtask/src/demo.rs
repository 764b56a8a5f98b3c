//! The whole loop on simulated data, for someone who has no rig yet.

use std::{
    fs, io,
    path::{Path, PathBuf},
    process::Command,
};

use crate::shell::{Outcome, Steps, cargo, root, run, target_dir};

/// Where the demo leaves everything, in the workspace's root; git ignores it.
const FOLDER: &str = "demo";

/// Simulates a rig with a hidden effect, diagnoses it and repairs the model.
pub fn demo() -> Outcome {
    let rig = target_dir().join("release/rig");
    let mut steps = Steps::new(3);
    steps.step("build the rig command", || {
        run(cargo()
            .args(["build", "-q", "--release", "--locked", "-p", "host-tools"])
            .args(["--bin", "rig"]))
    })?;
    steps.step("record a simulated actuator that hides an effect", || {
        // Recordings of an earlier demo would be diagnosed along with the new.
        remove(&root().join(FOLDER).join("recordings"))?;
        run(command(&rig).args(["example", "-o", FOLDER]))
    })?;
    steps.step("find out what the model is missing, and repair it", || {
        run(command(&rig)
            .args(["diagnose", "--model", "demo/model.toml"])
            .args(recordings()?)
            .args(["--json", "demo/verdict.json", "--plot", "demo/gap.svg"])
            .args(["-o", "demo/repaired.toml"]))
    })?;
    steps.finish("cargo xtask demo");
    println!(
        "\n\
         All of this is simulated, no rig was involved. What was hidden: {}\n\
         The picture of the gap, before and after:  demo/gap.svg  (any browser opens it)\n\
         The verdict, for programs:                 demo/verdict.json\n\
         The repaired model:                        demo/repaired.toml\n\
         With your own recordings:  cargo rig diagnose --model MODEL.toml RECORDING.csv …",
        hidden()
    );
    Ok(())
}

/// What the simulated actuator hides, from the model that it was simulated with.
fn hidden() -> String {
    let truth = fs::read_to_string(root().join(FOLDER).join("truth.toml")).unwrap_or_default();
    let kinds: Vec<&str> = truth
        .lines()
        .filter_map(|line| line.strip_prefix("kind = \"")?.strip_suffix('"'))
        .collect();
    if kinds.is_empty() {
        "see demo/truth.toml".into()
    } else {
        format!("{} (demo/truth.toml)", kinds.join(" and "))
    }
}

/// The command from the workspace's root, so that the paths it prints are short.
fn command(rig: &Path) -> Command {
    let mut command = Command::new(rig);
    command.current_dir(root());
    command
}

/// The simulated recordings, by name.
fn recordings() -> Outcome<Vec<PathBuf>> {
    let folder = Path::new(FOLDER).join("recordings");
    let unreadable = |error: io::Error| format!("cannot list {}: {error}", folder.display());
    let mut found = Vec::new();
    for entry in fs::read_dir(root().join(&folder)).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        let path = folder.join(name);
        if path.extension().is_some_and(|extension| extension == "csv") {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(format!("no recordings in {}", folder.display()).into());
    }
    Ok(found)
}

fn remove(folder: &Path) -> Outcome {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(format!("cannot clear {}: {error}", folder.display()).into())
        }
        _ => Ok(()),
    }
}
