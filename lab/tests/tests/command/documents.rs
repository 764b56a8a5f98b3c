//! The pages are followed as a reader would: every command line of `softrig` in them that needs no
//! bench is run, in the order of its page and in a folder of its own, and what a page shows of
//! the output has to be in the output.
//!
//! What differs from one computer or run to the next is a `…` in the page. That every line is
//! one that `softrig` accepts is asserted in `src/command/documented.rs`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::common::Bench;
use super::common::pages::{self, Line, blocks, command_lines, words};

/// Lines that are not run: how one begins, and why.
const NOT_RUN: &[(&str, &str)] = &[
    ("softrig monitor", "a screen, which needs a terminal"),
    ("softrig calibrate", "somebody bends the sensor"),
    (
        "softrig flash",
        "lab/tests/tests/virtual_rig/flash.rs runs it",
    ),
    ("softrig next", "somebody turns the base; minutes"),
    (
        "softrig commission --port",
        "somebody presses the switches; minutes",
    ),
    (
        "softrig commission --virtual",
        "minutes; lab/tests/tests/virtual_rig/commission.rs runs it",
    ),
    ("softrig init #", "it asks"),
    (
        "softrig compare --prediction",
        "a simulation of the reader's; host-tools/tests/cli/own_simulation.rs runs it",
    ),
    (
        "softrig compare --model m.toml --prediction",
        "a simulation of the reader's; host-tools/tests/cli/own_simulation.rs runs it",
    ),
    (
        "softrig residuals --prediction",
        "a simulation of the reader's; host-tools/tests/cli/own_simulation.rs runs it",
    ),
    (
        "softrig diagnose --model m.toml --prediction",
        "a simulation of the reader's; host-tools/tests/cli/own_simulation.rs runs it",
    ),
    (
        "softrig diagnose --model pendulum/",
        "recordings of another laboratory",
    ),
    (
        "softrig diagnose --model m.toml bag.mcap",
        "a log of another laboratory",
    ),
    (
        "softrig materials fit-curve",
        "tensile curves of another laboratory",
    ),
];

/// Where the pages name a board, a virtual one answers.
const BOARD: &str = "/dev/ttyACM0";
const LINK: &str = "rig-port";

/// The longest that a line may take (s).
const LIMIT_S: &str = "120";

/// Files that a line supposes in another form than that of [`stock`]: a part of the line, the
/// file, and what is done to its text.
type Form = fn(&str) -> String;
const FORMS: &[(&str, &str, Form)] = &[
    ("run.csv --columns time=t", "run.csv", psi),
    ("run.csv --units time=ms", "run.csv", absolute_in_ms),
    ("lab.csv --columns", "lab.csv", psi_and_radians),
];

/// A protocol of a reader's own.
const PROTOCOL: &str = "\
schema = 1
name = \"mine\"

[[segment]]
kind = \"ramp\"
track = \"angle_open_loop\"
level_deg = 40.0
duration_s = 2.0
";

/// The cases of the page on batches, with the files that are put there.
const MANIFEST: &str = "\
case,model,recordings,holdout
finger_01,models/finger.toml,data/01_steps.csv;data/01_sines.csv,data/01_check.csv
finger_02,models/finger.toml,data/02_steps.csv;data/02_sines.csv,
";

/// Rewrites each row of a recording with these columns first.
fn rewritten(text: &str, header: &str, row: impl Fn(f64, f64, f64) -> String) -> String {
    let rows = text.lines().skip(1).map(|line| {
        let mut numbers = line.split(',').map(|field| field.parse().unwrap());
        let mut next = || numbers.next().unwrap();
        row(next(), next(), next())
    });
    format!("{header}\n{}\n", rows.collect::<Vec<_>>().join("\n"))
}

fn psi(text: &str) -> String {
    rewritten(text, "t,p_psi,theta", |t, p, angle| {
        format!("{t},{:.5},{angle}", p / 6.894_757)
    })
}

fn psi_and_radians(text: &str) -> String {
    rewritten(text, "t,p_psi,theta", |t, p, angle| {
        format!("{t},{:.5},{:.6}", p / 6.894_757, angle.to_radians())
    })
}

fn absolute_in_ms(text: &str) -> String {
    rewritten(text, "time_s,pressure_kpa,angle_deg", |t, p, angle| {
        format!("{:.1},{:.4},{angle}", t * 1e3, p + 101.325)
    })
}

/// Puts the files that the pages suppose into a folder: an actuator with a nominal model, and
/// runs of it under the names of the pages.
fn stock(bench: &Bench) {
    for example in [
        "-o stock --hide 2 --effect maxwell_branch",
        "-o other --hide 3 --effect coulomb_friction",
    ] {
        bench.line(&format!("example {example}")).assert().success();
    }
    let copy = |from: &str, to: &str| {
        let to = bench.path(to);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(bench.path(from), to).unwrap();
    };
    for (theirs, ours) in [("nptdms.tdms", "run.tdms"), ("rosbags.db3", "bag.db3")] {
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("data");
        std::fs::copy(data.join(theirs), bench.path(ours)).unwrap();
    }
    for model in [
        "model.toml",
        "m.toml",
        "nominal.toml",
        "without.toml",
        "models/finger.toml",
    ] {
        copy("stock/model.toml", model);
    }
    for model in ["with.toml", "repaired.toml"] {
        copy("stock/truth.toml", model);
    }
    bench.put(
        "limits.toml",
        "max.kpa = 150.0\nset.kpa = 140.0\nmax.deg = 110.0\nset.deg = 100.0\n",
    );
    bench.put("mine.toml", PROTOCOL);
    bench.put("cases.csv", MANIFEST);
    let runs = [
        ("step30_1", "step step30 id_1 data/01_check"),
        (
            "step60_1",
            "run step60 monday id_2 upright lab data/02_steps",
        ),
        ("step90_1", "step90 tuesday steps aside"),
        ("triangle", "data/01_sines"),
        ("step60_2", "vad_1 triangle data/01_steps"),
        ("step90_2", "data/02_sines"),
    ];
    for (run, names) in runs {
        for name in names.split(' ') {
            for kind in ["csv", "meta.toml"] {
                let from = format!("stock/recordings/{run}.{kind}");
                copy(&from, &format!("{name}.{kind}"));
            }
        }
    }
}

/// A line of a page, and what the page shows of its output.
#[derive(Debug)]
struct Shown {
    line: Line,
    quoted: String,
}

/// The lines of a page, each with the text that follows it.
fn lines_of(page: &str) -> Vec<Shown> {
    let mut found: Vec<Shown> = Vec::new();
    // A block of text shows the output of the command before it.
    let mut open = false;
    for block in blocks(page) {
        if block.info == "text" {
            if let (true, Some(last)) = (open, found.last_mut()) {
                last.quoted.push_str(block.text);
            }
            open = false;
            continue;
        }
        let lines = command_lines(block.text, "softrig");
        open = !lines.is_empty();
        found.extend(lines.into_iter().map(|line| Shown {
            quoted: line.shown.clone(),
            line,
        }));
    }
    found
}

/// Files of code that a page names in the paragraph before: "… in `mine.toml`:".
fn named_files(page: &str) -> Vec<(String, String)> {
    let parts: Vec<&str> = page.split("```").collect();
    let named = |pair: &[&str]| {
        let paragraph = pair[0].trim_end().rsplit("\n\n").next()?;
        let named = paragraph.strip_suffix(':')?.rsplit_once("in `")?.1;
        let (name, _) = named.split_once('`')?;
        let (_, text) = pair[1].split_once('\n')?;
        let is_file = name.contains('.') && !name.contains('/');
        is_file.then(|| (name.to_owned(), text.to_owned()))
    };
    parts.windows(2).step_by(2).filter_map(named).collect()
}

/// The first quoted line that is not in the output, in order. Spaces count as one, and `…` stands
/// for anything.
fn missing<'q>(quoted: &'q str, output: &str) -> Option<&'q str> {
    let plain = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let mut printed = output.lines().map(plain);
    quoted
        .lines()
        .filter(|line| !matches!(line.trim(), "" | "…"))
        .find(|line| {
            let parts: Vec<String> = line.split('…').map(plain).collect();
            !printed.any(|there| is_made_of(&there, &parts))
        })
}

/// Whether a line begins with the first part, ends with the last and has the others between.
fn is_made_of(line: &str, parts: &[String]) -> bool {
    let [first, others @ ..] = parts else {
        return false;
    };
    let Some(mut rest) = line.strip_prefix(first.as_str()) else {
        return false;
    };
    let Some((last, between)) = others.split_last() else {
        return rest.is_empty();
    };
    for part in between {
        let Some((_, after)) = rest.split_once(part.as_str()) else {
            return false;
        };
        rest = after;
    }
    rest.ends_with(last.as_str())
}

/// What became of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fate {
    Run,
    /// The same line, with nothing shown, runs on another page.
    Elsewhere,
    /// No simulator is here: the test says that it is skipped.
    NoBoard,
    NotRun(&'static str),
}

/// A process that is interrupted when dropped, as by Ctrl-C.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let pid = self.0.id().to_string();
        let _ = Command::new("kill").args(["-INT", &pid]).status();
        let _ = self.0.wait();
    }
}

/// A reader with a terminal in a folder.
struct Reader {
    bench: Bench,
    rig: Option<Served>,
    made: BTreeSet<String>,
    /// Whether the page chose the virtual rig. Otherwise it goes on with a recording of
    /// [`stock`] after it has made one: a minute of steps takes a minute to diagnose.
    has_own_rig: bool,
}

impl Reader {
    fn shell(&self, line: &str) -> Command {
        let program = super::common::program();
        let folder = program.parent().unwrap().display();
        let path = std::env::var("PATH").unwrap_or_default();
        let mut command = Command::new("timeout");
        command
            .args([LIMIT_S, "sh", "-c", &format!("exec {line} 2>&1")])
            .current_dir(self.bench.folder())
            .env("PATH", format!("{folder}:{path}"))
            .envs(pages::VARIABLES.map(|(name, value)| (&name[1..], value)))
            .stdin(Stdio::null());
        command
    }

    /// Starts a virtual rig with this line, as fast as it goes.
    fn serve(&mut self, line: &str) {
        self.rig = None;
        let _ = std::fs::remove_file(self.bench.path(LINK));
        let mut command = Command::new(super::common::program());
        command
            .args(&words(line)[1..])
            .args(["--speed", "max"])
            .current_dir(self.bench.folder())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        self.rig = Some(Served(command.spawn().expect("softrig starts")));
        let clock = Instant::now();
        while !self.bench.path(LINK).exists() {
            assert!(
                clock.elapsed() < Duration::from_secs(60),
                "`{line}`: no port"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        let ports = self.bench.prints("ports");
        assert!(
            ports.contains(LINK) && ports.contains("virtual rig"),
            "{ports}"
        );
    }

    /// Runs a line.
    ///
    /// # Errors
    ///
    /// What is not as the page says.
    fn run(&mut self, shown: &Shown) -> Result<(), String> {
        let command = &shown.line.command;
        let line = command.replace(BOARD, LINK);
        if line.starts_with("softrig virtual") {
            self.serve(&line);
            self.has_own_rig = true;
            return Ok(());
        }
        if line.contains(LINK) && self.rig.is_none() {
            self.serve(&format!("softrig virtual --link {LINK}"));
        }
        let form = FORMS.iter().find(|(part, ..)| line.contains(part));
        let plain = form.map(|(_, name, form)| {
            let text = self.bench.text(name);
            self.bench.put(name, form(&text));
            (*name, text)
        });
        // What a line makes is not there before, unless the page made it.
        let words = words(&line);
        let mut kept = Vec::new();
        for pair in words.windows(2).filter(|pair| pair[0] == "-o") {
            if self.made.insert(pair[1].clone()) {
                let file = self.bench.path(&pair[1]);
                kept.extend(
                    (!self.has_own_rig && line.starts_with("softrig record"))
                        .then(|| (pair[1].clone(), std::fs::read(&file).unwrap_or_default())),
                );
                let _ = std::fs::remove_file(file.with_extension("meta.toml"));
                let _ = std::fs::remove_file(file);
            }
        }
        let output = self.shell(&line).output().expect("a shell");
        let text = String::from_utf8_lossy(&output.stdout).replace(LINK, BOARD);
        if let Some((name, text)) = plain {
            self.bench.put(name, text);
        }
        for (name, bytes) in kept {
            if !bytes.is_empty() {
                assert!(self.bench.path(&name).exists(), "`{line}` made no {name}");
                let _ = std::fs::remove_file(self.bench.path(&name).with_extension("meta.toml"));
                self.bench.put(&name, bytes);
            }
        }
        let is_error = shown.quoted.trim_start().starts_with("error:");
        if output.status.success() == is_error {
            return Err(format!("it ends with {}:\n{text}", output.status));
        }
        let quoted = shown.quoted.replace(LINK, BOARD);
        match missing(&quoted, &text) {
            Some(line) => Err(format!(
                "it does not print, in this order:\n{line}\nbut\n{text}"
            )),
            None => Ok(()),
        }
    }
}

/// Every line of every page with its fate, in the order of the pages.
fn plan() -> Vec<(String, Vec<(Shown, Fate)>)> {
    let has_board = ["SOFTRIG_VIRTUAL_RIG", "SOFTRIG_FIRMWARE"]
        .iter()
        .all(|name| std::env::var_os(name).is_some());
    let mut seen = BTreeSet::new();
    let root = softrig_tests::process::root();
    let mut plan = Vec::new();
    for path in pages::pages() {
        let text = std::fs::read_to_string(&path).unwrap();
        let name = path.strip_prefix(&root).unwrap().display().to_string();
        let lines = lines_of(&text);
        // A page with a rig of its own is followed from end to end.
        let has_own_rig = lines
            .iter()
            .any(|it| it.line.command.starts_with("softrig virtual"));
        let lines = lines.into_iter().map(|shown| {
            let line = shown.line.command.replace(BOARD, LINK);
            let typed = words(&line).join(" ");
            let not_run = NOT_RUN.iter().find(|(start, _)| {
                let start = start.replace(BOARD, LINK);
                let bare = start.strip_suffix(" #");
                bare.map_or(line.starts_with(&start), |bare| typed == bare)
            });
            let fate = if let Some((_, why)) = not_run {
                Fate::NotRun(why)
            } else if !has_own_rig && !seen.insert(typed) && shown.quoted.is_empty() {
                Fate::Elsewhere
            } else if line.contains(LINK) && !has_board {
                Fate::NoBoard
            } else {
                Fate::Run
            };
            (shown, fate)
        });
        let lines = lines.collect();
        plan.push((name, lines));
    }
    plan
}

/// Follows the pages on which a board is spoken to, or the others.
fn follow(with_a_board: bool) {
    // One after the other: diagnoses would take the simulator's processor from it.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    let mut faults = Vec::new();
    let plan = plan();
    let mut fates = plan.iter().flat_map(|(_, lines)| lines);
    if with_a_board && fates.any(|(_, fate)| *fate == Fate::NoBoard) {
        // What such a page goes on with would be missing.
        println!("skipped: `cargo xtask test` builds image and simulator");
        return;
    }
    for (page, lines) in plan {
        let has_board = |shown: &Shown| {
            let line = &shown.line.command;
            line.contains(LINK) || line.contains(BOARD)
        };
        if lines.iter().any(|(shown, _)| has_board(shown)) != with_a_board
            || !lines.iter().any(|(_, fate)| *fate == Fate::Run)
        {
            continue;
        }
        let mut reader = Reader {
            bench: Bench::empty(),
            rig: None,
            made: BTreeSet::new(),
            has_own_rig: false,
        };
        stock(&reader.bench);
        let path: PathBuf = softrig_tests::process::root().join(&page);
        for (name, text) in named_files(&std::fs::read_to_string(path).unwrap()) {
            reader.bench.put(&name, text);
        }
        for (shown, fate) in &lines {
            if *fate == Fate::Run {
                let clock = Instant::now();
                let outcome = reader.run(shown);
                let seconds = clock.elapsed().as_secs_f64();
                let line = format!("{page}: {}", shown.line.command);
                println!("{seconds:5.1} s  {line}");
                if let Err(fault) = outcome {
                    faults.push(format!("{line}\n{fault}"));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}

#[test]
fn pages_without_a_board_are_true() {
    follow(false);
}

#[test]
fn pages_with_a_board_are_true() {
    follow(true);
}

#[test]
fn every_line_is_run_or_has_a_reason() {
    let mut fates: BTreeMap<Fate, usize> = BTreeMap::new();
    let plan = plan();
    let all: Vec<&(Shown, Fate)> = plan.iter().flat_map(|(_, lines)| lines).collect();
    for (_, fate) in &all {
        *fates.entry(*fate).or_default() += 1;
    }
    println!("{fates:?}");
    for (start, why) in NOT_RUN {
        assert!(
            fates.contains_key(&Fate::NotRun(why)),
            "no page has {start:?} any more"
        );
    }
    let count = |of: fn(&Fate) -> bool| all.iter().filter(|(_, fate)| of(fate)).count();
    let run = count(|fate| matches!(fate, Fate::Run | Fate::NoBoard));
    let elsewhere = count(|fate| matches!(fate, Fate::Elsewhere));
    let not_run = count(|fate| matches!(fate, Fate::NotRun(_)));
    assert!(4 * not_run < all.len(), "{not_run} of {}", all.len());
    let said = format!(
        "Of {} lines of `softrig` on the pages, {run} are run, {elsewhere} are the same as one that is, and {not_run} have a reason",
        all.len()
    );
    println!("{said}");
    let page = softrig_tests::process::root().join("CONTRIBUTING.md");
    let page = std::fs::read_to_string(page).unwrap();
    let page = page.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(page.contains(&said), "CONTRIBUTING.md does not say: {said}");
}

#[test]
fn what_a_page_shows_is_found_in_order_and_an_ellipsis_is_anything() {
    let output = "one  two\nthree 3.14 s\nfour\n";
    for quoted in ["one two\n", "three … s\n", "one …\n…\nfour\n", "… two\n"] {
        assert_eq!(missing(quoted, output), None, "{quoted}");
    }
    for (quoted, first) in [
        ("one\n", "one"),
        ("four\none two\n", "one two"),
        ("three … m\n", "three … m"),
    ] {
        assert_eq!(missing(quoted, output), Some(first));
    }
}
