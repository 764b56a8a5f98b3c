//! The loop once, for someone who has no rig yet; `cargo xtask demo` builds and runs it.
//!
//! Nothing here is staged: `softrig flash` writes the image that a board would get, the simulator
//! executes it, and every number comes over the serial port.

use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use clap::Parser;
use softrig_tests::process::succeed;
use softrig_tests::rig_loop::{
    Board, Drawn, Folder, Programs, diagnose, follow, gap, record, tracking, upload_model,
    upload_repaired,
};
use softrig_tests::verdict::{Kinds, Verdict, in_words};

/// Records, diagnoses, uploads and records again, on a drawn actuator.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask demo")]
struct Args {
    /// Which actuator
    #[arg(long, default_value_t = SEED)]
    seed: u64,
    /// The kind of effect that it hides
    #[arg(long, value_name = "KIND")]
    effect: Option<String>,
    #[command(flatten)]
    programs: Programs,
}

/// Where the demo leaves everything, in the workspace's root; git ignores it.
const FOLDER: &str = "demo";

/// Which actuator is drawn unless one asks for another: the first, whatever comes
/// out.
const SEED: u64 = 1;

/// How long it may take to write the image.
const FLASH_LIMIT: Duration = Duration::from_secs(120);

/// The steps that `cargo xtask demo` does before: set-up and build.
const DONE: usize = 2;
/// All steps.
const STEPS: usize = 8;

fn main() -> ExitCode {
    match demo(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("demo: {problem}");
            ExitCode::FAILURE
        }
    }
}

/// Numbered steps, each with its time; a failure names its step.
struct Steps(usize);

impl Steps {
    fn step<T>(
        &mut self,
        name: &str,
        work: impl FnOnce() -> Result<T, String>,
    ) -> Result<T, String> {
        self.0 += 1;
        let label = format!("[{}/{STEPS}] {name}", self.0);
        println!("\n{label}");
        let clock = Instant::now();
        let done = work().map_err(|problem| format!("{label}: {problem}"))?;
        println!("{label}: ok, {:.1} s", clock.elapsed().as_secs_f64());
        Ok(done)
    }
}

/// Runs a command with its output shown; its failure is ours.
fn run(command: &mut Command) -> Result<(), String> {
    let name = command.get_program().to_owned();
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{} failed ({status})", name.display())),
        Err(error) => Err(format!("cannot start {}: {error}", name.display())),
    }
}

fn demo(args: &Args) -> Result<(), String> {
    let programs = &args.programs;
    let drawn = Drawn {
        seed: args.seed,
        effect: args.effect.clone(),
    };
    let clock = Instant::now();
    let mut steps = Steps(DONE);
    let folder = Folder::clear(PathBuf::from(FOLDER))?;
    let flash = "flash the firmware into the virtual rig";
    let board = steps.step(flash, || {
        let complaints = Stdio::inherit();
        let board = Board::start(&programs.simulator, &drawn, &folder, None, complaints)?;
        // The image in Intel's format stands beside the other.
        let mut flash = programs.rig();
        flash.args(["flash", "--port", &board.port]);
        flash.arg(programs.image.with_extension("hex"));
        succeed(&mut flash, FLASH_LIMIT, &folder.path("flash.txt"))?;
        let name = programs.image.file_name().unwrap_or_default();
        println!(
            "  written and verified: {} on {}",
            name.display(),
            board.port
        );
        Ok(board)
    })?;
    let name = "upload the nominal model, record, and follow set-points";
    let followed = steps.step(name, || {
        run(&mut upload_model(programs, &board, &folder))?;
        run(&mut record(programs, &board, &folder, "before"))?;
        // A board stops a loop whose model and sensor disagree.
        Ok(run(&mut follow(programs, &board, &folder, "before")).is_ok())
    })?;
    let verdict = steps.step("find out what the model is missing", || {
        run(diagnose(programs, &folder)
            .arg("--report")
            .arg(folder.file("report.html"))
            .arg("--plot")
            .arg(folder.file("diagnosis.svg")))?;
        folder.verdict()
    })?;
    let name = if verdict.is_for_the_board() {
        "upload the repaired model, record and follow again"
    } else {
        "record and follow again with the same model: the diagnosis has none that predicts better"
    };
    let followed_again = steps.step(name, || {
        if verdict.is_for_the_board() {
            run(&mut upload_repaired(programs, &board, &folder))?;
        }
        run(&mut record(programs, &board, &folder, "after"))?;
        Ok(run(&mut follow(programs, &board, &folder, "after")).is_ok())
    })?;
    let name = "compare what the board predicted with what it measured";
    let gap = steps.step(name, || {
        run(gap(programs, &folder)
            .arg("--plot")
            .arg(folder.file("gap.svg")))?;
        run(tracking(programs, &folder)
            .arg("--plot")
            .arg(folder.file("follow.svg")))?;
        folder.gap()
    })?;
    steps.step("stop the virtual rig", || board.stop())?;
    println!("\nthe loop took {:.1} s", clock.elapsed().as_secs_f64());
    let hidden = folder.hidden();
    let hidden = hidden.ok_or("the virtual rig did not write down what it hid")?;
    let stopped = |model: &str| {
        format!(
            "In closed loop the board stopped with the {model} model: sensor and prediction disagreed."
        )
    };
    let tracking = match (followed, followed_again) {
        (true, true) => folder.tracking()?,
        (_, false) => stopped("present"),
        (false, true) => stopped("nominal"),
    };
    println!("\n{}", summary(&hidden, &verdict, &gap.sentence, &tracking));
    Ok(())
}

/// Six lines for someone who has never seen a verdict.
fn summary(hidden: &Kinds, verdict: &Verdict, gap: &str, tracking: &str) -> String {
    let hidden = if hidden.is_empty() {
        "nothing but wrong parameters".into()
    } else {
        in_words(hidden)
    };
    let model = if verdict.is_for_the_board() {
        "the repaired model demo/repaired.toml"
    } else {
        "the model that the board kept demo/model.toml"
    };
    format!(
        "The simulated actuator hid: {hidden}.   (demo/truth.toml)\n\
         The diagnosis says: {}\n\
         {gap}\n\
         {tracking}\n\
         The whole report is demo/report.html: open it in any browser. The gap before and after is demo/gap.svg, {model}.\n\
         With your own recordings: cargo rig diagnose --model MODEL.toml RECORDING.csv …",
        verdict.sentence(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_verdict_without_a_name_is_summed_up_in_plain_words() {
        let verdict = Verdict::parse(
            r#"{"verdict": "unexplained", "effects": [], "upload": false, "seconds": 1}"#,
        )
        .unwrap();
        let gravity = Kinds::from(["gravity".into()]);
        let text = summary(&gravity, &verdict, "The gap stayed at 2.00° RMS.", "");
        for part in [
            "hid: gravity.",
            "no name is given",
            "stayed at 2.00°",
            "demo/model.toml",
        ] {
            assert!(text.contains(part), "{text}");
        }
        let text = summary(&Kinds::new(), &verdict, "", "");
        assert!(text.contains("nothing but wrong parameters"));
    }
}
