//! `softrig virtual`: finding the simulator, starting and ending it.

use std::path::Path;
use std::process::Stdio;

use super::Said;

#[test]
fn a_simulator_that_is_not_built_says_how_to_build_it() {
    let folder = tempfile::tempdir().unwrap();
    // As deep as cargo builds it: it looks around in three folders above itself.
    let built = folder.path().join("target/release");
    std::fs::create_dir_all(&built).unwrap();
    let rig = built.join("softrig");
    std::fs::copy(env!("CARGO_BIN_EXE_softrig"), &rig).unwrap();
    let run = |args: &[&str], simulator: Option<&Path>| {
        let mut command = std::process::Command::new(&rig);
        command.current_dir(folder.path()).arg("virtual").args(args);
        command
            .env_remove("SOFTRIG_VIRTUAL_RIG")
            .env_remove("SOFTRIG_FIRMWARE");
        if let Some(path) = simulator {
            command.env("SOFTRIG_VIRTUAL_RIG", path);
        }
        Said::new("virtual", command.output().unwrap())
    };
    run(&[], None).failed(2, &["virtual-rig is not built", "cargo xtask setup"]);
    let simulator = built.join("virtual-rig");
    executable(&simulator, "echo \"port $6 of $*\"\nexit 0\n");
    run(&[], None).failed(2, &["firmware is not built", "cargo xtask firmware"]);
    let image = folder.path().join("image.elf");
    std::fs::write(&image, "").unwrap();
    let image = image.to_str().unwrap();
    let said = run(&["--image", image, "--hide", "7", "--link", "here"], None).ok();
    said.says("serve --control --image");
    said.says("--link here --hide 7 --speed realtime");
    said.says("softrig monitor --port");
    executable(&simulator, "echo broken >&2\nexit 3\n");
    run(&["--image", image], Some(&simulator)).failed(1, &["broken", "exit status: 3"]);
}

/// What it says against its arguments stands above; the code is that of wrong input.
#[test]
fn arguments_that_the_simulator_refuses_are_wrong_input() {
    for (its, ours) in [(2, 2), (3, 1)] {
        let folder = tempfile::tempdir().unwrap();
        let simulator = folder.path().join("virtual-rig");
        executable(&simulator, &format!("exit {its}\n"));
        let status = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"))
            .current_dir(folder.path())
            .args(["virtual", "--image", "virtual-rig", "--clock-error", "5"])
            .env("SOFTRIG_VIRTUAL_RIG", &simulator)
            .stderr(Stdio::null())
            .status()
            .unwrap();
        assert_eq!(status.code(), Some(ours), "{its}");
    }
}

#[test]
fn the_simulator_is_told_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let simulator = folder.path().join("virtual-rig");
    executable(
        &simulator,
        "trap 'echo ended > ended; exit 0' TERM\necho port somewhere\nwhile :; do sleep 0.05; done\n",
    );
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_softrig"))
        .current_dir(folder.path())
        .args(["virtual", "--image", "virtual-rig"])
        .env("SOFTRIG_VIRTUAL_RIG", &simulator)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut stdout = std::io::BufReader::new(child.stdout.take().unwrap());
    std::io::BufRead::read_line(&mut stdout, &mut line).unwrap();
    assert!(line.contains("somewhere"), "{line}");
    let id = rustix::process::Pid::from_child(&child);
    rustix::process::kill_process(id, rustix::process::Signal::TERM).unwrap();
    assert!(child.wait().unwrap().success());
    assert!(folder.path().join("ended").exists());
}

fn executable(path: &Path, script: &str) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::write(path, format!("#!/bin/sh\n{script}")).unwrap();
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}
