//! A virtual rig behind a pseudo-terminal, in a folder of its own, switched off when dropped.
//!
//! `cargo xtask test` builds the image and the simulator and says where they are. Without them
//! there is nothing to test, and the tests say so.

use std::env;
use std::io::{BufRead, BufReader, Lines, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::common::program;

const IMAGE: &str = "SOFTRIG_FIRMWARE";
const SIMULATOR: &str = "SOFTRIG_VIRTUAL_RIG";

/// Its port, in its folder.
pub const PORT: &str = "port";

/// How long the simulator may take to offer its port.
const PORT_LIMIT: Duration = Duration::from_secs(60);

/// Image and simulator; none where they were not built.
pub fn programs() -> Option<(PathBuf, PathBuf)> {
    let found = env::var_os(IMAGE).zip(env::var_os(SIMULATOR));
    if found.is_none() {
        println!(
            "skipped: {IMAGE} and {SIMULATOR} are not set; `cargo xtask test` builds both and sets them"
        );
    }
    found.map(|(image, simulator)| (image.into(), simulator.into()))
}

/// `softrig` in a folder, to its end.
pub fn rig(folder: &TempDir, arguments: &[&str]) -> Output {
    Command::new(program())
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .expect("softrig starts")
}

/// A running simulator.
pub struct VirtualRig {
    pub folder: TempDir,
    child: Child,
    controls: ChildStdin,
    answers: Lines<BufReader<ChildStdout>>,
}

impl VirtualRig {
    /// With the image, in real time unless the arguments say otherwise; none where nothing was built.
    pub fn start(arguments: &[&str]) -> Option<Self> {
        let (image, simulator) = programs()?;
        Some(Self::serve(&simulator, Some(&image), arguments))
    }

    /// A board without a program; none where nothing was built.
    pub fn erased(arguments: &[&str]) -> Option<Self> {
        let (_, simulator) = programs()?;
        Some(Self::serve(&simulator, None, arguments))
    }

    fn serve(simulator: &Path, image: Option<&Path>, arguments: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new(simulator);
        command.args(["serve", "--control", "--link", PORT]);
        if let Some(image) = image {
            command.arg("--image").arg(image);
        }
        let mut child = command
            .args(arguments)
            .current_dir(&folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the simulator starts");
        let until = Instant::now() + PORT_LIMIT;
        wait_until(until, || folder.path().join(PORT).exists());
        let controls = child.stdin.take().unwrap();
        let mut answers = BufReader::new(child.stdout.take().unwrap()).lines();
        let said = answers.next().unwrap().unwrap();
        assert!(said.starts_with("port "), "{said}");
        Self {
            folder,
            child,
            controls,
            answers,
        }
    }

    /// What it answers to a line of its control.
    pub fn obey(&mut self, line: &str) -> String {
        writeln!(self.controls, "{line}").unwrap();
        self.answers.next().unwrap().unwrap()
    }

    /// Ends it; what it wrote stays in its folder.
    pub fn switch_off(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// `softrig` in its folder, to its end.
    pub fn rig(&self, arguments: &[&str]) -> Output {
        rig(&self.folder, arguments)
    }
}

impl Drop for VirtualRig {
    fn drop(&mut self) {
        self.switch_off();
    }
}

/// Waits until it holds.
pub fn wait_until(until: Instant, mut holds: impl FnMut() -> bool) {
    while !holds() {
        assert!(Instant::now() < until, "it did not come to that");
        std::thread::sleep(Duration::from_millis(20));
    }
}
