//! The whole loop, for someone who has no rig yet: build the firmware, flash it,
//! record, diagnose, repair, upload, record again.
//!
//! Nothing here is staged: avrdude writes the image that a board would get, the
//! simulator executes it, and every number comes over the serial port.

use std::{
    path::{Path, PathBuf},
    process::Stdio,
    time::Duration,
};

use crate::{
    avr, flash,
    rig_loop::{
        self, Board, Drawn, Folder, Programs, Verdict, diagnose, in_words, record, upload_model,
        upload_repaired,
    },
    setup::{self, Mode, Purpose},
    shell::{Outcome, Steps, read, run, run_quietly},
};

/// Where the demo leaves everything, in the workspace's root; git ignores it.
const FOLDER: &str = "demo";

/// Which actuator is drawn unless one asks for another: the first, whatever comes
/// out.
const SEED: u64 = 1;

/// How long avrdude may take to write.
const FLASH_LIMIT: Duration = Duration::from_secs(120);

/// Reads the options of the demo.
///
/// # Errors
///
/// Says what makes no sense.
pub fn parse(words: &[&str]) -> Result<Drawn, String> {
    let mut drawn = Drawn {
        seed: SEED,
        effect: None,
    };
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        let value = words
            .next()
            .ok_or_else(|| format!("demo: {word} needs a value, or is not known"))?;
        match word {
            "--seed" => {
                drawn.seed = value
                    .parse()
                    .map_err(|_| format!("demo: {value:?} is no seed; give a whole number"))?;
            }
            "--effect" => drawn.effect = Some((*value).into()),
            _ => return Err(format!("demo: there is no option {word}")),
        }
    }
    Ok(drawn)
}

/// Closes the loop on the virtual rig.
pub fn demo(drawn: &Drawn) -> Outcome {
    let mut programs = None;
    let mut steps = Steps::new(8);
    steps.step("set-up", || setup::setup(Purpose::Demo, Mode::Install))?;
    steps.step(
        "build the rig command, the simulator and the firmware",
        || {
            let built = Programs::build()?;
            avr::gates(&built.image)?;
            avr::print_size(&built.image)?;
            programs = Some(built);
            Ok(())
        },
    )?;
    let programs = programs.ok_or("nothing was built")?;
    let folder = Folder::clear(PathBuf::from(FOLDER))?;
    let mut board = None;
    steps.step(
        "flash the firmware into the virtual rig, with avrdude",
        || {
            let empty = None;
            let complaints = Stdio::inherit();
            let started = Board::start(&programs.simulator, drawn, &folder, empty, complaints)?;
            run_quietly(
                &mut flash::avrdude(&programs.image, &started.port),
                FLASH_LIMIT,
            )?;
            println!(
                "  written and verified: {} on {}",
                image_name(&programs.image),
                started.port
            );
            board = Some(started);
            Ok(())
        },
    )?;
    let board = board.ok_or("the virtual rig is gone")?;
    steps.step("upload the nominal model, and record", || {
        run(&mut upload_model(&programs, &board, &folder))?;
        run(&mut record(&programs, &board, &folder, "before"))
    })?;
    steps.step("find out what the model is missing", || {
        run(diagnose(&programs, &folder)
            .arg("--report")
            .arg(folder.file("report.html"))
            .arg("--plot")
            .arg(folder.file("diagnosis.svg")))
    })?;
    let verdict = folder.verdict()?;
    let name = if verdict.upload {
        "upload the repaired model, and record again"
    } else {
        "record again with the same model: the diagnosis has none that predicts better"
    };
    steps.step(name, || {
        if verdict.upload {
            run(&mut upload_repaired(&programs, &board, &folder))?;
        }
        record_after(&programs, &board, &folder)
    })?;
    let mut gap = String::new();
    steps.step(
        "compare what the board predicted with what it measured",
        || {
            gap = read(
                rig_loop::gap(&programs, &folder)
                    .arg("--plot")
                    .arg(folder.file("gap.svg")),
            )?;
            println!("{gap}");
            Ok(())
        },
    )?;
    steps.step("stop the virtual rig", || board.stop())?;
    steps.finish("cargo xtask demo");
    println!("\n{}", summary(&folder.hidden()?, &verdict, &gap));
    Ok(())
}

fn record_after(programs: &Programs, board: &Board, folder: &Folder) -> Outcome {
    run(&mut record(programs, board, folder, "after"))
}

/// Five lines for someone who has never seen a verdict.
fn summary(hidden: &[String], verdict: &Verdict, gap: &str) -> String {
    let hidden = if hidden.is_empty() {
        "nothing but wrong parameters".into()
    } else {
        in_words(hidden)
    };
    let model = if verdict.upload {
        "the repaired model demo/repaired.toml"
    } else {
        "the model that the board kept demo/model.toml"
    };
    format!(
        "The simulated actuator hid: {hidden}.   (demo/truth.toml)\n\
         The diagnosis says: {}\n\
         {}\n\
         The whole report is demo/report.html: open it in any browser. The gap before and after is demo/gap.svg, {model}.\n\
         With your own recordings: cargo rig diagnose --model MODEL.toml RECORDING.csv …",
        verdict.sentence(),
        gap.lines()
            .find(|line| line.starts_with("The gap"))
            .unwrap_or("The gap is in the table above."),
    )
}

fn image_name(image: &Path) -> String {
    image
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_choose_the_actuator() {
        let drawn = parse(&[]).unwrap();
        assert_eq!((drawn.seed, drawn.effect), (1, None));
        let drawn = parse(&["--effect", "gravity", "--seed", "7"]).unwrap();
        assert_eq!((drawn.seed, drawn.effect.as_deref()), (7, Some("gravity")));
        for words in [&["--seed"][..], &["--seed", "x"], &["--sed", "1"]] {
            assert!(parse(words).is_err(), "{words:?}");
        }
    }

    #[test]
    fn a_verdict_without_a_name_is_summed_up_in_plain_words() {
        let verdict = Verdict::parse(
            r#"{"verdict": "unexplained", "effects": [], "upload": false, "seconds": 1}"#,
        )
        .unwrap();
        let text = summary(
            &["gravity".into()],
            &verdict,
            "all\n\nThe gap stayed at 2.00° RMS.",
        );
        for part in [
            "hid: gravity.",
            "no name is given",
            "stayed at 2.00°",
            "demo/model.toml",
        ] {
            assert!(text.contains(part), "{text}");
        }
        assert!(summary(&[], &verdict, "").contains("nothing but wrong parameters"));
    }
}
