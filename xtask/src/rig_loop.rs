//! The loop from a rig to a repaired model: what the demo and `bench loop` share.
//!
//! Nothing in it is staged: the simulator executes the image that a board would
//! get, and every number comes over the serial port or from `rig`.

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
    avr,
    json::Value,
    shell::{Outcome, cargo, root, run, target_dir},
};

/// What is recorded, by the name that the board knows.
pub const PROTOCOL: &str = "steps";

/// How long the simulator may take to offer its port.
const PORT_LIMIT: Duration = Duration::from_secs(120);

/// The programs of the loop.
#[derive(Clone, Debug)]
pub struct Programs {
    /// The command `rig`.
    pub rig: PathBuf,
    /// The simulator.
    pub simulator: PathBuf,
    /// The firmware (ELF).
    pub image: PathBuf,
}

impl Programs {
    /// Builds them.
    pub fn build() -> Outcome<Self> {
        // One build with one profile: what both have in common is compiled once, and
        // `cargo rig` finds it made.
        run(cargo()
            .args(["build", "--release", "--locked"])
            .args(["-p", "host-tools", "--bin", "rig"])
            .args(["-p", "virtual-rig", "--bin", "virtual-rig"]))?;
        Ok(Self {
            rig: target_dir().join("release/rig"),
            simulator: target_dir().join("release/virtual-rig"),
            image: avr::build()?,
        })
    }

    /// `rig`, run in the workspace's root, so that the paths it prints are short.
    pub fn rig(&self) -> Command {
        command(&self.rig)
    }
}

fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root());
    command
}

/// Which actuator the simulator draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawn {
    /// The seed of the actuator and of the rig's noise.
    pub seed: u64,
    /// The kind of effect that it hides; by the seed where none is named.
    pub effect: Option<String>,
}

/// Where one pass through the loop leaves its files.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder anew: recordings of an earlier pass would be taken for
    /// ones of this pass.
    pub fn clear(path: PathBuf) -> Outcome<Self> {
        match fs::remove_dir_all(root().join(&path)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(format!("cannot clear {}: {error}", path.display()).into());
            }
            _ => {}
        }
        for folder in ["before", "after"] {
            let folder = root().join(&path).join(folder);
            fs::create_dir_all(&folder)
                .map_err(|error| format!("cannot create {}: {error}", folder.display()))?;
        }
        Ok(Self(path))
    }

    /// A file in it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn read(&self, name: &str) -> Outcome<String> {
        let path = self.file(name);
        fs::read_to_string(root().join(&path))
            .map_err(|error| format!("cannot read {}: {error}", path.display()).into())
    }

    /// What the simulated actuator has and the owner's model has not.
    pub fn hidden(&self) -> Outcome<Vec<String>> {
        Ok(without(
            effect_kinds(&self.read("truth.toml")?),
            &effect_kinds(&self.read("model.toml")?),
        ))
    }

    /// What the diagnosis said.
    pub fn verdict(&self) -> Outcome<Verdict> {
        Verdict::parse(&self.read("verdict.json")?)
            .ok_or_else(|| format!("{} is no verdict", self.file("verdict.json").display()).into())
    }
}

/// The simulated board behind its serial port.
pub struct Board {
    process: Child,
    /// The port.
    pub port: String,
}

impl Board {
    /// Starts it with a drawn actuator, whose models go into the folder, and with
    /// an image, or empty.
    pub fn start(
        simulator: &Path,
        drawn: &Drawn,
        folder: &Folder,
        image: Option<&Path>,
        complaints: Stdio,
    ) -> Outcome<Self> {
        let seed = drawn.seed.to_string();
        let mut command = command(simulator);
        command.args(["serve", "--hide", &seed, "--seed", &seed, "--speed", "max"]);
        if let Some(effect) = &drawn.effect {
            command.args(["--effect", effect]);
        }
        if let Some(image) = image {
            command.arg("--image").arg(image);
        }
        command
            .arg("--model-out")
            .arg(folder.file("model.toml"))
            .arg("--truth-out")
            .arg(folder.file("truth.toml"));
        let mut process = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(complaints)
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
            .recv_timeout(PORT_LIMIT)
            .map_err(|_| "the virtual rig did not offer a serial port")?;
        Ok(started)
    }

    /// Stops it.
    pub fn stop(mut self) -> Outcome {
        self.process
            .kill()
            .map_err(|error| format!("cannot stop the virtual rig: {error}").into())
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // A failed step must not leave it running.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Uploads the nominal model, which lacks what the actuator hides.
pub fn upload_model(programs: &Programs, board: &Board, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["upload", "--port", &board.port, "--model"])
        .arg(folder.file("model.toml"));
    command
}

/// Uploads the repaired model, with the zeros of the sensors as the diagnosis
/// estimated them.
pub fn upload_repaired(programs: &Programs, board: &Board, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["upload", "--port", &board.port, "--model"])
        .arg(folder.file("repaired.toml"))
        .arg("--zeros")
        .arg(folder.file("verdict.json"));
    command
}

/// Records a session into `before/run.csv` or `after/run.csv`.
pub fn record(programs: &Programs, board: &Board, folder: &Folder, when: &str) -> Command {
    let mut command = programs.rig();
    command
        .args(["record", "--port", &board.port, "--protocol", PROTOCOL])
        .arg("-o")
        .arg(folder.file(when).join("run.csv"));
    command
}

/// Diagnoses the session that was recorded before the repair.
pub fn diagnose(programs: &Programs, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["diagnose", "--model"])
        .arg(folder.file("model.toml"))
        .arg(folder.file("before/run.csv"))
        .arg("--json")
        .arg(folder.file("verdict.json"))
        .arg("-o")
        .arg(folder.file("repaired.toml"));
    command
}

/// Compares what the board predicted before and after with what it measured.
pub fn gap(programs: &Programs, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .arg("gap")
        .arg(folder.file("before/run.csv"))
        .arg("--after")
        .arg(folder.file("after/run.csv"));
    command
}

/// The kinds of a model file's effects, in the order of the file.
pub fn effect_kinds(model: &str) -> Vec<String> {
    let mut is_effect = false;
    let mut kinds = Vec::new();
    for line in model.lines().map(str::trim) {
        if line.starts_with('[') {
            is_effect = line.starts_with("[[effect]]");
        }
        let value = line
            .strip_prefix("kind")
            .and_then(|rest| rest.trim_start().strip_prefix('='));
        if let (true, Some(value)) = (is_effect, value) {
            let quoted = value.split(['"', '\'']).nth(1);
            kinds.extend(quoted.map(str::to_owned));
        }
    }
    kinds
}

/// What is in `all` and not in `known`; each of `known` stands for one.
fn without(mut all: Vec<String>, known: &[String]) -> Vec<String> {
    for kind in known {
        if let Some(index) = all.iter().position(|other| other == kind) {
            all.remove(index);
        }
    }
    all
}

/// What `rig diagnose --json` says, as far as the loop needs it.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// One of the five verdicts, as in the file.
    pub answer: String,
    /// Kinds of the effects that are named.
    pub named: Vec<String>,
    /// The alternatives, best first; each may be several effects together.
    pub alternatives: Vec<Vec<String>>,
    /// The family of the rivals, where they are of one.
    pub family: Option<String>,
    /// Whether the named effect explains only part of the gap.
    pub is_part: bool,
    /// Whether the board gains by the repaired model.
    pub upload: bool,
    /// How long the diagnosis took (s).
    pub seconds: f64,
}

impl Verdict {
    /// Reads the file's text; none if it is no verdict.
    pub fn parse(text: &str) -> Option<Self> {
        let json = Value::parse(text)?;
        let list = |key: &str| json.get(key).map_or(&[][..], Value::items);
        let text = |value: &Value, key: &str| Some(value.get(key)?.text()?.to_owned());
        Some(Self {
            answer: text(&json, "verdict")?,
            named: list("effects")
                .iter()
                .filter_map(|effect| text(effect, "kind"))
                .collect(),
            alternatives: list("alternatives")
                .iter()
                .map(|alternative| {
                    let kinds = alternative.get("kinds").map_or(&[][..], Value::items);
                    let kinds = kinds.iter().filter_map(Value::text);
                    kinds.map(str::to_owned).collect()
                })
                .collect(),
            family: text(&json, "family"),
            is_part: text(&json, "strength").as_deref() == Some("part"),
            upload: json.get("upload") != Some(&Value::Bool(false)),
            seconds: json
                .get("seconds")
                .and_then(Value::number)
                .unwrap_or(f64::NAN),
        })
    }

    /// A sentence for someone who has never seen a verdict.
    pub fn sentence(&self) -> String {
        let named = in_words(&self.named);
        let (are, they) = if self.named.len() > 1 {
            ("are", "they explain")
        } else {
            ("is", "it explains")
        };
        match self.answer.as_str() {
            "effect_found" if self.is_part => {
                format!("{named} {are} missing; {they} part of the gap.")
            }
            "effect_found" => format!("{named} {are} missing."),
            "parameters_only" => {
                "no effect is missing; the parameters were off, and are corrected.".into()
            }
            "no_discrepancy" => "nothing is missing; the model was right already.".into(),
            "cannot_tell" => {
                let sets: Vec<String> = self.alternatives.iter().map(|set| in_words(set)).collect();
                let sets = if sets.is_empty() {
                    "several effects".into()
                } else {
                    sets.join(", or ")
                };
                let family = self.family.as_ref();
                let family = family.map_or(String::new(), |family| format!(" (all are {family})"));
                format!("something is missing, and these data cannot tell what: {sets}{family}.")
            }
            "unexplained" => {
                "something is missing that no effect of the catalogue explains; no name is given."
                    .into()
            }
            other => format!("{}.", other.replace('_', " ")),
        }
    }
}

/// Kinds as one says them.
pub fn in_words(kinds: &[String]) -> String {
    let kinds: Vec<String> = kinds.iter().map(|kind| kind.replace('_', " ")).collect();
    kinds.join(" and ")
}

/// The board's gap before and after (° RMS over all runs), from what `rig gap`
/// prints.
pub fn gaps(printed: &str) -> Option<(f64, f64)> {
    let mut lines = printed.lines();
    lines.find(|line| line.trim() == "before")?;
    let before: Vec<&str> = lines
        .by_ref()
        .take_while(|line| line.trim() != "after")
        .collect();
    let after: Vec<&str> = lines.take_while(|line| !line.trim().is_empty()).collect();
    Some((last_rms(&before)?, last_rms(&after)?))
}

/// The last row of a table is that of all runs, or of the only one.
fn last_rms(rows: &[&str]) -> Option<f64> {
    let mut words = rows.last()?.split_whitespace().rev();
    let largest = words.next()?.parse::<f64>();
    let rms = words.next()?.parse::<f64>();
    largest.and(rms).ok().filter(|rms| rms.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERDICT: &str = r#"{ "schema": 1, "verdict": "cannot_tell", "family": "dry friction",
        "effects": [], "where": [{"kind": "of another thing"}],
        "alternatives": [ { "kinds": ["lugre_friction"], "probability": 0.6 },
                          { "kinds": ["creep", "gravity"], "probability": 0.4 } ],
        "upload": false, "seconds": 3.25 }"#;

    fn kinds(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.into()).collect()
    }

    #[test]
    fn verdicts_are_read() {
        let verdict = Verdict::parse(VERDICT).unwrap();
        assert_eq!(verdict.answer, "cannot_tell");
        assert_eq!(verdict.named, [""; 0]);
        assert_eq!(
            verdict.alternatives,
            [kinds(&["lugre_friction"]), kinds(&["creep", "gravity"])]
        );
        assert_eq!(verdict.family.as_deref(), Some("dry friction"));
        assert!(!verdict.upload && !verdict.is_part);
        assert!((verdict.seconds - 3.25).abs() < 1e-12);
        let found = Verdict::parse(
            r#"{"verdict": "effect_found", "strength": "part",
                "effects": [{"parameters": {"kind": 1}, "kind": "gravity"}]}"#,
        )
        .unwrap();
        assert_eq!(found.named, ["gravity"]);
        // An upload is worth it unless the diagnosis says otherwise.
        assert!(found.upload && found.is_part);
        assert_eq!(Verdict::parse("{}"), None);
        assert_eq!(Verdict::parse("effect_found"), None);
    }

    #[test]
    fn each_verdict_has_a_sentence() {
        let mut verdict = Verdict::parse(VERDICT).unwrap();
        let said = verdict.sentence();
        assert!(
            said.contains("lugre friction, or creep and gravity (all are dry friction)"),
            "{said}"
        );
        verdict.named = kinds(&["gravity"]);
        for (name, part) in [
            ("effect_found", "gravity is missing."),
            ("parameters_only", "the parameters were off"),
            ("no_discrepancy", "right already"),
            ("unexplained", "no name is given"),
        ] {
            verdict.answer = name.into();
            let said = verdict.sentence();
            assert!(said.contains(part) && !said.contains('_'), "{said}");
        }
    }

    #[test]
    fn kinds_of_effects_are_read_from_models() {
        let model = "kind = \"no\"\n[dynamics]\nexponent = 2\n[[effect]] # why\nkind = \"gravity\"\n\
                     moment = 1\n[[effect]]\n  kind='creep'\n[fit]\nkind = \"no\"\n[[effect]]\nkind =";
        assert_eq!(effect_kinds(model), ["gravity", "creep"]);
        assert_eq!(
            without(effect_kinds(model), &kinds(&["creep", "lag"])),
            ["gravity"]
        );
    }

    #[test]
    fn gaps_are_read_from_the_table() {
        let printed = "The board's own prediction less its flex sensor\n\n\
                       run    RMS (°)  largest (°)\nbefore\n  run 60° 1    4.000   9.000\n  all   3.500  9.000\n\
                       after\n  run 60° 1    0.250   0.500\n\nThe gap shrank from 3.50° to 0.25° RMS, by 93 %.\n";
        assert_eq!(gaps(printed), Some((3.5, 0.25)));
        assert_eq!(gaps(""), None);
        assert_eq!(gaps("before\nafter\n"), None);
        assert_eq!(gaps("before\n all 1 2\nafter\n all NaN 1\n"), None);
    }
}
