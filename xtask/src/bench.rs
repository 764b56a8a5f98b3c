//! Benchmarks: our solver and SciPy's, our firmware and plain C, and the time of a
//! diagnosis.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Instant,
};

use crate::{
    avr, bench_real,
    shell::{Outcome, cargo, has_program, read, root, run, seconds, target_dir, text},
    simulator::virtual_rig,
    venv,
};

/// The rival's versions, so that figures can be had again.
const PYTHON_PACKAGES: [&str; 3] = ["numpy", "scipy", "numba"];

/// Runs the host's simulation beside SciPy's and Numba's on the same problems.
pub fn host() -> Outcome {
    let folder = target_dir().join("bench");
    fs::create_dir_all(&folder)
        .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
    let python = python(&folder)?;

    println!("bench: our solver");
    run(cargo()
        .args(["build", "-q", "--release", "-p", "host-tools"])
        .args(["--example", "bench_simulate"]))?;
    let problems = folder.join("problems.json");
    let file = fs::File::create(&problems)
        .map_err(|error| format!("cannot write {}: {error}", problems.display()))?;
    run(pinned(&target_dir().join("release/examples/bench_simulate")).stdout(file))?;

    println!("bench: SciPy and Numba\n");
    run(pinned(&python)
        .arg(root().join("xtask/bench/scipy_simulate.py"))
        .arg(&problems))
}

/// Times a whole diagnosis: of the real pendulum where its recordings are at
/// hand, else of a simulated example.
pub fn diagnosis() -> Outcome {
    const RUNS: usize = 5;
    run(cargo().args([
        "build",
        "-q",
        "--release",
        "-p",
        "host-tools",
        "--bin",
        "rig",
    ]))?;
    let rig = target_dir().join("release/rig");
    let pendulum = bench_real::shared().join("pendulum");
    let (folder, name) = if pendulum.is_dir() {
        (pendulum, "real pendulum")
    } else {
        let folder = target_dir().join("bench/example");
        run(Command::new(&rig).args(["example", "-o"]).arg(&folder))?;
        (folder, "simulated example")
    };
    let mut fitted = Vec::new();
    let mut held_out = Vec::new();
    let recordings = folder.join("recordings");
    let entries = fs::read_dir(&recordings)
        .map_err(|error| format!("cannot list {}: {error}", recordings.display()))?;
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        if file.starts_with("vad_") {
            held_out.push(path);
        } else if file.ends_with(".csv") {
            fitted.push(path);
        }
    }
    fitted.sort();
    held_out.sort();
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let mut command = Command::new(&rig);
        command
            .arg("diagnose")
            .arg("--model")
            .arg(folder.join("model.toml"));
        command.args(&fitted);
        if !held_out.is_empty() {
            command.arg("--holdout").args(&held_out);
        }
        let clock = Instant::now();
        read(&mut command)?;
        times.push(clock.elapsed());
    }
    times.sort();
    println!(
        "bench: rig diagnose, {name}, {} recordings: median of {RUNS} runs {} ({} to {})",
        fitted.len() + held_out.len(),
        seconds(times[RUNS / 2]),
        seconds(times[0]),
        seconds(times[RUNS - 1])
    );
    Ok(())
}

/// Hides effects in simulated recordings, diagnoses them, and counts. The
/// options are those of the program in the tests crate.
pub fn blind(options: &[&str]) -> Outcome {
    run(cargo().args([
        "build",
        "-q",
        "--release",
        "-p",
        "softrig-tests",
        "--bin",
        "blind",
    ]))?;
    run(Command::new(target_dir().join("release/blind"))
        .arg("--folder")
        .arg(target_dir().join("blind"))
        .args(options))
}

/// Asks folders of cases: `invariance`, or `calibration`. The options are those of the
/// program in the tests crate; `--rig` takes another `rig` than the one of this source.
pub fn asked(program: &str, options: &[&str]) -> Outcome {
    let mut build = cargo();
    build.args(["build", "-q", "--release", "--locked"]);
    build.args(["-p", "softrig-tests", "--bin", program]);
    if !options.iter().any(|option| option.starts_with("--rig")) {
        build.args(["-p", "host-tools", "--bin", "rig"]);
    }
    run(&mut build)?;
    run(Command::new(target_dir().join("release").join(program))
        .arg("--rig")
        .arg(target_dir().join("release/rig"))
        .arg("--keep")
        .arg(target_dir().join("invariance"))
        .arg("--loops")
        .arg(target_dir().join("loop"))
        .args(options))
}

/// Times diagnoses of up to a thousand recordings; `--docs` draws the picture.
pub fn many(docs: bool) -> Outcome {
    run(cargo()
        .args(["build", "-q", "--release"])
        .args(["-p", "host-tools", "--bin", "rig"])
        .args(["-p", "softrig-tests", "--bin", "many_recordings"]))?;
    let mut command = Command::new(target_dir().join("release/many_recordings"));
    command
        .arg("--rig")
        .arg(target_dir().join("release/rig"))
        .arg("--folder")
        .arg(target_dir().join("bench/many"));
    if docs {
        command
            .arg("--picture")
            .arg(root().join("docs/images/many_recordings.svg"));
    }
    run(&mut command)
}

/// Lets the real image step to angles in closed loop; `--docs` draws the picture.
pub fn control(docs: bool) -> Outcome {
    let image = avr::build()?;
    let mut command = cargo();
    command
        .args(["run", "-q", "--locked", "-p", "virtual-rig"])
        .args(["--example", "closed_loop_steps", "--"])
        .env("SOFTRIG_FIRMWARE", image);
    if docs {
        command
            .arg("--picture")
            .arg(root().join("docs/images/closed_loop_steps.svg"));
    }
    run(&mut command)
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

/// Counts the cycles of the firmware's inner loops, beside plain C.
pub fn board() -> Outcome {
    let image = avr::build()?;
    let rig = virtual_rig()?;
    let sketch = sketch()?;

    let ours = simulate(&rig, &image, Some("self-test: done"))?;
    let plain = simulate(&rig, &sketch, None)?;
    let of = |run: &Run, name: &str| run.cycles.iter().find(|(n, _)| n == name).map(|&(_, c)| c);
    let (Some(pow), Some(step)) = (of(&plain, "power_minimax"), of(&plain, "step_minimax")) else {
        return Err("the C sketch left no cycle marks".into());
    };

    println!("\ncycles on the ATmega2560 (16 000 are a millisecond)\n");
    println!("  {:<34}{:>10}{:>14}", "", "cycles", "of plain C");
    let row = |name: &str, cycles: u64, rival: u64| {
        println!(
            "  {name:<34}{cycles:>10}{:>13.0}%",
            100.0 * cycles as f64 / rival as f64
        );
    };
    let ours_of = |name: &str| {
        of(&ours, name).ok_or_else(|| format!("the firmware left no cycle mark for {name}"))
    };
    for (label, name, rival) in [
        ("one power, minimax", "power_minimax", pow),
        ("one power, micromath", "power_micromath", pow),
        ("one step, power by micromath", "step_micromath", step),
        ("one step, power by minimax", "step_minimax", step),
        ("one step, power by table", "step_table", step),
    ] {
        row(label, ours_of(name)?, rival);
    }
    let mut effects: Vec<_> = ours
        .cycles
        .iter()
        .filter_map(|(name, cycles)| Some((name.strip_prefix("step_table+")?, *cycles)))
        .collect();
    effects.sort_by_key(|&(_, cycles)| cycles);
    for (effect, cycles) in effects {
        row(&format!("  with {effect}"), cycles, step);
    }
    row(
        "  with the three most expensive",
        ours_of("step_dearest")?,
        step,
    );
    row("plain C: one power", pow, pow);
    row("plain C: one RK4 step", step, step);
    // What a model at 1 kHz takes of a processor of 16 MHz.
    let at_1_khz = |cycles: u64| cycles as f64 / 160.0;
    println!(
        "\n  at 1 kHz the base model takes {:.1} % of the processor, in plain C {:.0} %",
        at_1_khz(ours_of("step_table")?),
        at_1_khz(step)
    );
    println!("\nwhat they computed");
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
    let avr::Size { flash, static_ram } = avr::size(&sketch)?;
    println!(
        "  plain C: {flash} bytes of flash, {static_ram} bytes of RAM, stack {} bytes deep",
        plain.stack
    );
    Ok(())
}

/// The results of one run of an image.
struct Run {
    said: String,
    cycles: Vec<(String, u64)>,
    stack: String,
}

/// Runs an image until it has sent a text, or until it halts.
fn simulate(rig: &Path, image: &Path, until: Option<&str>) -> Outcome<Run> {
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
    Ok(Run {
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
        .arg(root().join("xtask/bench/rk4_sketch.c"))
        .arg("-lm"))?;
    Ok(out)
}
