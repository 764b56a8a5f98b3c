//! The whole loop, for someone who has no rig yet: build the firmware, flash it,
//! record, diagnose, repair, upload, record again.
//!
//! Nothing here is staged: avrdude writes the image that a board would get, the
//! simulator executes it, and every number comes over the serial port.

use std::{
    fs,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::mpsc,
    thread,
    time::Duration,
};

use crate::{
    avr, flash,
    setup::{self, Mode},
    shell::{Outcome, Steps, cargo, read, root, run, run_quietly, target_dir},
    test,
};

/// Where the demo leaves everything, in the workspace's root; git ignores it.
const FOLDER: &str = "demo";

/// Which of the actuators is drawn that hide something.
const SEED: &str = "14";

/// What is recorded, by the name that the board knows.
const PROTOCOL: &str = "steps";

/// How long the simulator may take to offer its port, and avrdude to write.
const LIMIT: Duration = Duration::from_secs(120);

/// Closes the loop on the virtual rig.
pub fn demo() -> Outcome {
    let rig = target_dir().join("release/rig");
    let mut image = PathBuf::new();
    let mut simulator = PathBuf::new();
    let mut steps = Steps::new(8);
    steps.step("set-up", || setup::setup(Mode::Install))?;
    steps.step(
        "build the rig command, the simulator and the firmware",
        || {
            run(cargo()
                .args(["build", "-q", "--release", "--locked", "-p", "host-tools"])
                .args(["--bin", "rig"]))?;
            simulator = test::virtual_rig()?;
            image = avr::build()?;
            avr::gates(&image)?;
            avr::print_size(&image)
        },
    )?;
    clear(&root().join(FOLDER))?;
    let mut board = None;
    steps.step(
        "flash the firmware into the virtual rig, with avrdude",
        || {
            let started = VirtualRig::start(&simulator)?;
            run_quietly(&mut flash::avrdude(&image, &started.port), LIMIT)?;
            println!(
                "  written and verified: {} on {}",
                image_name(&image),
                started.port
            );
            board = Some(started);
            Ok(())
        },
    )?;
    let Some(board) = board else {
        return Err("the virtual rig is gone".into());
    };
    let record = |folder: &str| {
        create(&root().join(FOLDER).join(folder))?;
        run(command(&rig)
            .args(["record", "--port", &board.port, "--protocol", PROTOCOL])
            .arg("-o")
            .arg(format!("{FOLDER}/{folder}/run.csv")))
    };
    steps.step(
        "upload the model that the owner believes in, and record",
        || {
            run(command(&rig).args([
                "upload",
                "--port",
                &board.port,
                "--model",
                "demo/model.toml",
            ]))?;
            record("before")
        },
    )?;
    steps.step("find out what the model is missing", || {
        run(command(&rig)
            .args(["diagnose", "--model", "demo/model.toml"])
            .args(recordings("before")?)
            .args([
                "--json",
                "demo/verdict.json",
                "--report",
                "demo/report.html",
                "--plot",
                "demo/diagnosis.svg",
            ])
            .args(["-o", "demo/repaired.toml"]))
    })?;
    steps.step("upload the repaired model, and record again", || {
        run(command(&rig).args([
            "upload",
            "--port",
            &board.port,
            "--model",
            "demo/repaired.toml",
        ]))?;
        record("after")
    })?;
    let mut gap = String::new();
    steps.step(
        "compare what the board predicted with what it measured",
        || {
            gap = read(
                command(&rig)
                    .arg("gap")
                    .args(recordings("before")?)
                    .arg("--after")
                    .args(recordings("after")?)
                    .args(["--plot", "demo/gap.svg"]),
            )?;
            println!("{gap}");
            Ok(())
        },
    )?;
    steps.step("stop the virtual rig", || board.stop())?;
    steps.finish("cargo xtask demo");
    summary(&gap);
    Ok(())
}

/// Five lines for someone who has never seen a verdict.
fn summary(gap: &str) {
    println!(
        "\n\
         The simulated actuator hid: {}.   (demo/truth.toml)\n\
         The diagnosis says: {}\n\
         {}\n\
         The whole report is demo/report.html: open it in any browser. The gap before and after is demo/gap.svg, the repaired model demo/repaired.toml.\n\
         With your own recordings: cargo rig diagnose --model MODEL.toml RECORDING.csv …",
        hidden(),
        verdict(),
        gap.lines()
            .find(|line| line.starts_with("The gap"))
            .unwrap_or("The gap is in the table above."),
    );
}

/// The simulator behind its serial port.
struct VirtualRig {
    process: Child,
    port: String,
}

impl VirtualRig {
    /// Starts it with an empty board and an actuator that hides something.
    fn start(simulator: &Path) -> Outcome<Self> {
        let mut process = command(simulator)
            .args(["serve", "--hide", SEED, "--seed", SEED, "--speed", "max"])
            .args(["--model-out", "demo/model.toml"])
            .args(["--truth-out", "demo/truth.toml"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|error| format!("cannot start the virtual rig: {error}"))?;
        let stdout = process.stdout.take();
        let (send, receive) = mpsc::channel();
        thread::spawn(move || {
            for line in stdout
                .into_iter()
                .flat_map(|pipe| BufReader::new(pipe).lines())
            {
                let Ok(line) = line else { break };
                if let Some(port) = line.strip_prefix("port ") {
                    let _ = send.send(port.to_owned());
                }
            }
        });
        let mut started = Self {
            process,
            port: String::new(),
        };
        started.port = receive
            .recv_timeout(LIMIT)
            .map_err(|_| "the virtual rig did not offer a serial port")?;
        Ok(started)
    }

    fn stop(mut self) -> Outcome {
        self.process
            .kill()
            .map_err(|error| format!("cannot stop the virtual rig: {error}").into())
    }
}

impl Drop for VirtualRig {
    fn drop(&mut self) {
        // A failed step must not leave it running.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn image_name(image: &Path) -> String {
    image
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// What the simulated actuator hides, from the model that it was simulated with.
fn hidden() -> String {
    let truth = fs::read_to_string(root().join(FOLDER).join("truth.toml")).unwrap_or_default();
    let kinds: Vec<String> = truth
        .lines()
        .filter_map(|line| line.strip_prefix("kind = \"")?.strip_suffix('"'))
        .map(|kind| kind.replace('_', " "))
        .collect();
    if kinds.is_empty() {
        "nothing but wrong parameters".into()
    } else {
        kinds.join(" and ")
    }
}

/// The verdict's kinds in words, from its JSON, read as text: this crate has no
/// dependencies.
fn verdict() -> String {
    let json = fs::read_to_string(root().join(FOLDER).join("verdict.json")).unwrap_or_default();
    let field = |name: &str| -> Option<String> {
        let rest = json.split_once(&format!("\"{name}\""))?.1;
        let value = rest.split_once('"')?.1.split_once('"')?.0;
        Some(value.replace('_', " "))
    };
    match field("verdict").as_deref() {
        Some("effect found") => format!("{} is missing.", field("kind").unwrap_or_default()),
        Some(other) => format!("{other}."),
        None => "see demo/verdict.json.".into(),
    }
}

/// The command from the workspace's root, so that the paths it prints are short.
fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root());
    command
}

/// The recordings of a folder, by name.
fn recordings(folder: &str) -> Outcome<Vec<PathBuf>> {
    let folder = Path::new(FOLDER).join(folder);
    let unreadable = |error: io::Error| format!("cannot list {}: {error}", folder.display());
    let mut found = Vec::new();
    for entry in fs::read_dir(root().join(&folder)).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        let path = folder.join(name);
        // One file a step; run.csv is all of them in one.
        let is_step = path
            .file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with("run_"));
        if is_step && path.extension().is_some_and(|extension| extension == "csv") {
            found.push(path);
        }
    }
    found.sort();
    if found.is_empty() {
        return Err(format!("no recordings in {}", folder.display()).into());
    }
    Ok(found)
}

/// Empties the demo's folder: recordings of an earlier one would be diagnosed
/// along with the new.
fn clear(folder: &Path) -> Outcome {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(format!("cannot clear {}: {error}", folder.display()).into())
        }
        _ => create(folder),
    }
}

fn create(folder: &Path) -> Outcome {
    fs::create_dir_all(folder)
        .map_err(|error| format!("cannot create {}: {error}", folder.display()).into())
}
