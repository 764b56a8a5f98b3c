//! Benchmarks: our solver and SciPy's, our firmware and plain C. What reads results of `softrig`
//! is one program, bench/, which is built and started here; it also draws and writes the pages.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use crate::{
    avr,
    machines::{self, Soak},
    shell::{Outcome, cargo, has_program, read, release_build, root, run, target_dir, text},
    simulator::virtual_rig,
    size, venv,
};

/// The rival's versions, so that figures can be had again.
const PYTHON_PACKAGES: [&str; 3] = ["numpy", "scipy", "numba"];

/// The program.
const PROGRAM: &str = "softrig-bench";

/// Its benchmarks, and `catalogue` and `pages`, which write pages from the code and from figures of earlier runs.
const NAMES: [&str; 14] = [
    "blind",
    "calibration",
    "catalogue",
    "commands",
    "decide",
    "diagnosis",
    "dirt",
    "invariance",
    "loop",
    "many",
    "pages",
    "public",
    "real",
    "search",
];

/// Runs the host's simulation beside SciPy's and Numba's on the same problems.
pub fn host() -> Outcome {
    let folder = target_dir().join("bench");
    fs::create_dir_all(&folder)
        .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    let python = python(&folder)?;

    println!("bench: our solver");
    run(release_build().args(["-q", "-p", PROGRAM]))?;
    let problems = folder.join("problems.json");
    run(pinned(&target_dir().join("release").join(PROGRAM))
        .args(["simulate", "--json"])
        .arg(&problems))?;

    println!("bench: SciPy and Numba\n");
    run(pinned(&python)
        .arg(root().join("bench/peers/scipy_simulate.py"))
        .arg(&problems))
}

/// Runs the gate of the blind benchmark with the program that was built for the tests, which
/// computes the same: a build for users would compile everything once more.
pub fn gate() -> Outcome {
    run(command("debug", "blind").arg("--fast"))
}

/// Runs the benchmarks that have a limit: the same answers to the same questions, asked otherwise,
/// and an hour of misfortunes on the simulated rig.
pub fn gates() -> Outcome {
    const LIMITS: &[&str] = &[
        "--sets",
        "bench",
        "--limit",
        "6",
        "--ways",
        "seed,order,units",
        "--at-least",
        "same=0.9,contradicting=0.02",
    ];
    start("invariance", LIMITS)?;
    machines::soak(&Soak {
        hours: 1.0,
        seed: 1,
    })
}

/// Whether the program has a benchmark of this name.
pub fn is_known(name: &str) -> bool {
    NAMES.contains(&name)
}

/// Builds the program and starts a benchmark with these options; `--softrig` takes another `softrig` than the
/// one of this source.
pub fn start(name: &str, options: &[&str]) -> Outcome {
    let asks = !["blind", "catalogue", "pages", "search"].contains(&name);
    let plays = ["decide", "loop"].contains(&name);
    let mut build = release_build();
    build.args(["-q", "-p", PROGRAM]);
    if asks && !options.iter().any(|option| option.starts_with("--softrig")) {
        build.args(["-p", "softrig-cli", "--bin", "softrig"]);
        build.args(["--features", "softrig-cli/lab"]);
    }
    if plays {
        build.args(["-p", "virtual-rig", "--bin", "virtual-rig"]);
    }
    run(&mut build)?;
    let mut command = command("release", name);
    let built = target_dir().join("release");
    if asks {
        command.arg("--softrig").arg(built.join("softrig"));
    }
    let asks_for_help = options.iter().any(|word| ["-h", "--help"].contains(word));
    if plays && !asks_for_help {
        command.arg("--simulator").arg(built.join("virtual-rig"));
        command.arg("--image").arg(avr::build()?);
    }
    if name == "real" && !asks_for_help {
        command.arg("--python").arg(black_boxes()?);
    }
    run(command.args(options))
}

/// The program as it was built with a profile.
fn command(profile: &str, name: &str) -> Command {
    let mut command = Command::new(target_dir().join(profile).join(PROGRAM));
    command.arg(name).arg("--target").arg(target_dir());
    command
}

/// A Python that fits black boxes, after they have found known systems again.
fn black_boxes() -> Outcome<PathBuf> {
    let scripts = root().join("bench/black_box");
    let requirements = scripts.join("requirements.txt");
    // An environment of older versions is not the pinned one.
    let imports = format!(
        "import numpy; assert f'numpy=={{numpy.__version__}} ' in open({:?}).read()",
        requirements.display().to_string()
    );
    let python = venv::virtual_environment(
        &target_dir().join("real/python"),
        &imports,
        &[
            "--require-hashes".into(),
            "-r".into(),
            requirements.into_os_string(),
        ],
    )?;
    println!("bench: black boxes find known systems again");
    run(Command::new(&python)
        .arg(scripts.join("black_box.py"))
        .arg("--self-check"))?;
    Ok(python)
}

/// Lets the real image step to angles in closed loop; `--docs` draws the picture.
pub fn control(docs: bool) -> Outcome {
    let figures = target_dir().join("bench/control.json");
    let json = read(
        cargo()
            .args(["run", "-q", "--locked", "-p", "softrig-bench-board"])
            .args(["--bin", "closed_loop_steps"])
            .env("SOFTRIG_FIRMWARE", avr::build()?),
    )?;
    fs::create_dir_all(target_dir().join("bench"))
        .and_then(|()| fs::write(&figures, json))
        .map_err(|error| format!("cannot write {}: {error}", figures.display()))?;
    let figures = figures.display().to_string();
    let mut options = vec![figures.as_str()];
    options.extend(docs.then_some("--docs"));
    start("pages", &options)
}

/// A command on one core: both sides compute on a single thread.
fn pinned(program: &Path) -> Command {
    let mut command = if has_program("taskset") {
        let mut command = Command::new("taskset");
        command.args(["-c", "0"]).arg(program);
        command
    } else {
        Command::new(program)
    };
    for variable in [
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "RAYON_NUM_THREADS",
    ] {
        command.env(variable, "1");
    }
    command
}

/// A Python with SciPy, in a folder of its own.
fn python(folder: &Path) -> Outcome<PathBuf> {
    venv::virtual_environment(
        &folder.join("python"),
        "import numba, numpy, scipy.integrate",
        &PYTHON_PACKAGES.map(Into::into),
    )
}

/// Shows the cycles of the firmware's inner loops, beside plain C, and that both computed the same.
pub fn board() -> Outcome {
    let image = avr::build()?;
    let Sections {
        figures,
        ours,
        plain,
    } = sections(&image, &virtual_rig()?)?;
    println!(
        "\n16 000 cycles are a millisecond\n\n{}",
        size::cycles_table(&figures)
    );
    println!("what they computed");
    for line in ours
        .said
        .lines()
        .filter(|line| line.starts_with("step ") && !line.contains(" with "))
    {
        println!("  {line}");
    }
    println!("  plain C: bits {}", plain.said.trim());
    avr::print_size(&image)?;
    println!("  image: stack {} bytes deep", ours.stack);
    let avr::Size { flash, static_ram } = avr::size(&sketch()?)?;
    println!(
        "  plain C: {flash} bytes of flash, {static_ram} bytes of RAM, stack {} bytes deep",
        plain.stack
    );
    Ok(())
}

/// The self-test of an image and the sketch in C, on the simulated processor.
pub struct Sections {
    /// Cycles of every measured section, by the names of the golden file.
    pub figures: Vec<(String, f64)>,
    ours: SketchRun,
    plain: SketchRun,
}

/// Counts the cycles of the measured sections.
pub fn sections(image: &Path, rig: &Path) -> Outcome<Sections> {
    let ours = simulate(rig, image, Some("self-test: done"))?;
    let plain = simulate(rig, &sketch()?, None)?;
    let named = |run: &SketchRun, prefix: &str| -> Vec<(String, f64)> {
        run.cycles
            .iter()
            // Sleep is what is left.
            .filter(|(name, _)| name != "idle")
            .map(|(name, cycles)| (format!("{prefix}{name}"), *cycles as f64))
            .collect()
    };
    let figures = [named(&ours, size::CYCLES), named(&plain, size::C_CYCLES)].concat();
    Ok(Sections {
        figures,
        ours,
        plain,
    })
}

/// The results of one run of an image.
struct SketchRun {
    said: String,
    cycles: Vec<(String, u64)>,
    stack: String,
}

/// Runs an image until it has sent a text, or until it halts.
fn simulate(rig: &Path, image: &Path, until: Option<&str>) -> Outcome<SketchRun> {
    let mut command = Command::new(rig);
    command
        .arg("run")
        .arg(image)
        .args(["--cycles", "800000000", "--send", "selftest"])
        .stdin(Stdio::null());
    if let Some(text) = until {
        command.args(["--until", text]);
    }
    let output = command
        .output()
        .map_err(|error| format!("cannot start {}: {error}", text(&command)))?;
    let marks = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() {
        return Err(format!("{} failed: {marks}", text(&command)).into());
    }
    let cycles = marks
        .lines()
        .filter_map(|line| {
            let mut words = line.strip_prefix("cycles ")?.split(' ');
            Some((words.next()?.to_owned(), words.next()?.parse().ok()?))
        })
        .collect();
    let stack = marks
        .lines()
        .find_map(|line| line.strip_prefix("stack ")?.strip_suffix(" bytes"))
        .unwrap_or("an unknown number of")
        .into();
    Ok(SketchRun {
        stack,
        said: String::from_utf8_lossy(&output.stdout).into_owned(),
        cycles,
    })
}

/// Compiles the C sketch.
fn sketch() -> Outcome<PathBuf> {
    let folder = target_dir().join("bench");
    fs::create_dir_all(&folder)
        .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    let out = folder.join("rk4_sketch.elf");
    run(Command::new("avr-gcc")
        .args(["-O2", "-mmcu=atmega2560", "-o"])
        .arg(&out)
        .arg(root().join("bench/peers/rk4_sketch.c"))
        .arg("-lm"))?;
    Ok(out)
}
