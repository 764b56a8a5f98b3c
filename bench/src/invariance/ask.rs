//! Asks `softrig`, and keeps what it said, so that an interrupted run goes on where it stopped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use softrig_formats::recording::meta_beside;

use super::answer::{Answer, Likeness};
use super::cases::{Case, CaseSet};
use super::pose::{Posed, Question, pose};
use super::ways::Way;
use crate::blind::cases::stable_hash;
use crate::blind::verdicts::{at_once, remaining};
use softrig_tests::process::{LOOK_AGAIN, reason, succeed, within};
use softrig_tests::{text_of, write};

/// Kept answers of another version of the ways are asked for again.
const VERSION: u32 = 2;
/// How long `softrig init` may take.
const INIT_LIMIT: Duration = Duration::from_secs(300);

/// What became of a question.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// It was answered.
    Answered(Answer),
    /// It was asked, and there is no answer.
    Silent(String),
    /// It took too long.
    TooLong,
    /// Somebody ended the program: that says nothing about the question, and is not kept.
    Ended,
    /// It cannot be asked in this way.
    LeftOut(String),
}

/// A reply, and what it took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// Hash of everything that was asked.
    key: String,
    /// What became of the question.
    pub reply: Reply,
    /// Wall time of the diagnosis (s).
    pub seconds: f64,
}

/// The program that is asked.
#[derive(Clone, Debug)]
pub struct Rig {
    program: PathBuf,
    threads: usize,
    limit: Duration,
    /// Hash of the program: answers of another one are not its own.
    pub hash: String,
}

impl Rig {
    /// Takes a program that diagnoses with so many threads, for so long.
    ///
    /// # Errors
    ///
    /// If it cannot be read.
    pub fn new(program: &Path, threads: usize, limit: Duration) -> Result<Self, String> {
        let bytes = fs::read(program)
            .map_err(|error| format!("cannot read {}: {error}", program.display()))?;
        Ok(Self {
            program: program
                .canonicalize()
                .map_err(|error| format!("{}: {error}", program.display()))?,
            threads,
            limit,
            hash: format!("{:016x}", stable_hash(&bytes)),
        })
    }

    /// Poses the question of a case in a way and asks it, unless `folder` has the reply.
    ///
    /// # Errors
    ///
    /// If a file cannot be read or written, or the program cannot be started.
    pub fn ask(&self, case: &Case, way: Way, folder: &Path) -> Result<Asked, String> {
        let kept = folder.join("asked.json");
        let key = key_of(case, way)?;
        if let Some(asked) = Asked::read(&kept)
            && asked.key == key
            // With more time there may be an answer.
            && (asked.reply != Reply::TooLong || asked.seconds >= self.limit.as_secs_f64())
        {
            return Ok(asked);
        }
        let first_model = |recordings: &[PathBuf], path: &Path| self.init(recordings, path);
        let posed = pose(case, way, folder, &first_model)?;
        let clock = Instant::now();
        let reply = match posed {
            Posed::LeftOut(why) => Reply::LeftOut(why),
            Posed::Question(question) => self.diagnose(&question, folder)?,
        };
        let asked = Asked {
            key,
            reply,
            seconds: clock.elapsed().as_secs_f64(),
        };
        if asked.reply != Reply::Ended {
            let text = serde_json::to_string_pretty(&asked).map_err(|error| error.to_string())?;
            write(&kept, &text)?;
        }
        Ok(asked)
    }

    fn diagnose(&self, question: &Question, folder: &Path) -> Result<Reply, String> {
        let verdict = folder.join("verdict.json");
        let _ = fs::remove_file(&verdict); // One that is there is another question's.
        let mut command = Command::new(&self.program);
        command.arg("diagnose").arg("--model").arg(&question.model);
        command.args(&question.recordings);
        if !question.holdout.is_empty() {
            command.arg("--holdout").args(&question.holdout);
        }
        if let Some(units) = &question.units {
            command.args(units.flags().split_whitespace());
        }
        command
            .args(["--seed", &question.seed.to_string(), "--json"])
            .arg(&verdict)
            .env("RAYON_NUM_THREADS", self.threads.to_string());
        let complaints = folder.join("complaints.txt");
        let Some(status) = within(&mut command, self.limit, &complaints)? else {
            return Ok(Reply::TooLong);
        };
        let answer = fs::read_to_string(&verdict)
            .ok()
            .and_then(|text| Answer::of(&serde_json::from_str(&text).ok()?));
        Ok(match answer {
            Some(answer) => Reply::Answered(answer),
            // By a signal.
            None if status.code().is_none() => Reply::Ended,
            None => Reply::Silent(reason(&complaints, status)),
        })
    }

    /// Lets `softrig init` make a first model of recordings.
    fn init(&self, recordings: &[PathBuf], path: &Path) -> Result<(), String> {
        let mut command = Command::new(&self.program);
        command.arg("init").arg("--recording").args(recordings);
        command.arg("-o").arg(path);
        succeed(&mut command, INIT_LIMIT, &path.with_file_name("init.txt"))
    }
}

impl Asked {
    /// A reply that was got elsewhere, and that nobody keeps.
    pub fn of(reply: Reply, seconds: f64) -> Self {
        Self {
            key: String::new(),
            reply,
            seconds,
        }
    }

    fn read(path: &Path) -> Option<Self> {
        serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
    }

    /// The answer, if there is one.
    pub fn answer(&self) -> Option<&Answer> {
        match &self.reply {
            Reply::Answered(answer) => Some(answer),
            _ => None,
        }
    }
}

/// Hash of everything that a reply depends on, but for the program.
fn key_of(case: &Case, way: Way) -> Result<String, String> {
    let mut text = format!("{VERSION} {} {:?}\n", way.name(), case.columns);
    text += &text_of(&case.model)?;
    for (role, paths) in [("fit", &case.recordings), ("holdout", &case.holdout)] {
        for path in paths {
            text += &format!("\n{role} {}\n", path.display());
            text += &text_of(path)?;
            let meta = meta_beside(path);
            if meta.exists() {
                text += &text_of(&meta)?;
            }
        }
    }
    Ok(format!("{:016x}", stable_hash(text.as_bytes())))
}

/// The replies to one case: plain, then each way.
#[derive(Clone, Debug)]
pub struct CaseReplies {
    /// Name of the case.
    pub name: String,
    /// The plain question.
    pub plain: Asked,
    /// The same question, otherwise.
    pub ways: Vec<(Way, Asked)>,
}

/// Asks all cases of a set in all ways, so many at a time, and reports each reply on
/// standard error.
///
/// # Errors
///
/// The first run that cannot be made; what was asked by then is kept.
pub fn ask_all(
    rig: &Rig,
    sets: &[CaseSet],
    ways: &[Way],
    keep: &Path,
    jobs: usize,
) -> Result<Vec<Vec<CaseReplies>>, String> {
    let every_way: Vec<Way> = std::iter::once(Way::Plain)
        .chain(ways.iter().copied())
        .collect();
    let queue: Vec<(usize, usize, Way)> = sets
        .iter()
        .enumerate()
        .flat_map(|(set, it)| (0..it.cases.len()).map(move |case| (set, case)))
        .flat_map(|(set, case)| every_way.iter().map(move |&way| (set, case, way)))
        .collect();
    let replies: Mutex<Vec<Option<Asked>>> = Mutex::new(vec![None; queue.len()]);
    let (next, done, asked_now) = (
        AtomicUsize::new(0),
        AtomicUsize::new(0),
        AtomicUsize::new(0),
    );
    let clock = Instant::now();
    let work = || -> Result<(), String> {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(&(set, case, way)) = queue.get(index) else {
                return Ok(());
            };
            let set = &sets[set];
            let case = &set.cases[case];
            let folder = keep.join(&set.name).join(&case.name).join(way.name());
            let began = Instant::now();
            let asked = match rig.ask(case, way, &folder) {
                Ok(asked) => asked,
                Err(error) => {
                    // Nobody begins another.
                    next.store(queue.len(), Ordering::Relaxed);
                    return Err(format!("{} {}: {error}", set.name, case.name));
                }
            };
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            // What was kept tells nothing about the time that is left.
            if began.elapsed() > LOOK_AGAIN {
                let now = asked_now.fetch_add(1, Ordering::Relaxed) + 1;
                let left = queue.len() - done;
                eprintln!(
                    "{done:>5} of {}  {} {} {}: {}, {:.1} s; {}",
                    queue.len(),
                    set.name,
                    case.name,
                    way.name(),
                    asked.in_words(),
                    asked.seconds,
                    remaining(clock.elapsed(), now, now + left)
                );
            }
            replies.lock().unwrap_or_else(PoisonError::into_inner)[index] = Some(asked);
        }
    };
    at_once(jobs, work)?;
    let replies = replies.into_inner().unwrap_or_else(PoisonError::into_inner);
    let mut replies = replies.into_iter().flatten();
    Ok(sets
        .iter()
        .map(|set| {
            let cases = set.cases.iter().filter_map(|case| {
                Some(CaseReplies {
                    name: case.name.clone(),
                    plain: replies.next()?,
                    ways: ways
                        .iter()
                        .copied()
                        .zip(replies.by_ref().take(ways.len()))
                        .collect(),
                })
            });
            cases.collect()
        })
        .collect())
}

impl Asked {
    /// The reply as one reads it.
    pub fn in_words(&self) -> String {
        match &self.reply {
            Reply::Answered(answer) => answer.to_string(),
            Reply::Silent(why) => format!("no answer ({why})"),
            Reply::TooLong => "no answer (took too long)".into(),
            Reply::Ended => "no answer (was ended; the next run asks again)".into(),
            Reply::LeftOut(why) => format!("left out ({why})"),
        }
    }
}

/// How alike two replies are; none where one has no answer.
pub fn likeness(plain: &Asked, way: Way, other: &Asked) -> Option<Likeness> {
    let (before, after) = (plain.answer()?, other.answer()?);
    Some(Likeness::of(before, after, way.changes_first_model()))
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt;
    use std::sync::MutexGuard;

    use super::*;
    use crate::invariance::known::Labels;

    /// A program that is written while another thread starts one cannot be started.
    static ALONE: Mutex<()> = Mutex::new(());

    fn alone() -> MutexGuard<'static, ()> {
        ALONE.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A program that takes the place of `softrig`: it counts how often it was asked, and answers
    /// by the seed.
    const STAND_IN: &str = r#"#!/bin/sh
here=$(dirname "$0")
echo >> "$here/count"
if [ "$1" = init ]; then echo "error: no plateau" >&2; exit 2; fi
while [ $# -gt 0 ]; do
  case "$1" in
    --json) shift; json="$1" ;;
    --seed) shift; seed="$1" ;;
    */slow.csv) exec sleep 30 ;;
    */killed.csv) kill $$ ;;
    */bad.csv) echo "warning: odd" >&2; echo "error: $1: is bad" >&2; exit 2 ;;
  esac
  shift
done
if [ "$seed" = 2 ]; then kind=leak; else kind=gravity; fi
echo "{\"verdict\": \"effect_found\", \"effects\": [{\"kind\": \"$kind\"}], \"rmse_deg\": {\"refit\": $seed}}" > "$json"
"#;

    const MODEL: &str = "schema = 1\nname = \"a\"\n\n[dynamics]\ninertia_kg_m = 1.0\n\
        damping_n_s_per_rad = 1.0\nstiffness_n_per_rad_n = 1.0\nexponent = 1.0\n\
        input_gain_n_per_kpa = 1.0\n";

    fn stand_in(test: &str, recording: &str, limit: Duration) -> (PathBuf, Rig, CaseSet) {
        let name = format!("softrig-ask-{test}-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        let _ = fs::remove_dir_all(&folder);
        let program = folder.join("rig");
        write(&program, STAND_IN).unwrap();
        fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
        write(&folder.join("case/model.toml"), MODEL).unwrap();
        let path = folder.join("case/recordings").join(recording);
        write(&path, "time_s,pressure_kpa,angle_deg\n0,0,0\n1,1,1\n").unwrap();
        let rig = Rig::new(&program, 1, limit).unwrap();
        let case = Case::read(&folder.join("case"), None).unwrap();
        let set = CaseSet {
            name: "set".into(),
            cases: vec![case],
            labels: Labels::new(),
        };
        (folder, rig, set)
    }

    #[test]
    fn an_interrupted_run_goes_on_where_it_stopped() {
        let _alone = alone();
        let minute = Duration::from_secs(60);
        let (folder, rig, set) = stand_in("resume", "a.csv", minute);
        let sets = [set];
        let ask = |ways: &[Way]| {
            let mut replies = ask_all(&rig, &sets, ways, &folder.join("keep"), 2).unwrap();
            let count = fs::read_to_string(folder.join("count")).unwrap().len();
            (replies.remove(0).remove(0), count)
        };
        let (case, count) = ask(&[Way::Seed]);
        let [(way, seed)] = case.ways.as_slice() else {
            panic!("{case:?}")
        };
        assert_eq!(count, 2);
        assert_eq!(case.plain.in_words(), "gravity");
        assert_eq!(
            likeness(&case.plain, *way, seed),
            Some(Likeness::Contradicting)
        );
        // What is kept is not asked again; what is new is.
        let (case, count) = ask(&[Way::Seed, Way::Order, Way::Third, Way::Init]);
        assert_eq!(count, 4);
        let words: Vec<String> = case.ways.iter().map(|(_, it)| it.in_words()).collect();
        assert_eq!(
            words,
            [
                "leak",
                "left out (one recording has one order)",
                "gravity",
                "left out (softrig init: error: no plateau)"
            ]
        );
        // Another recording is another question.
        let path = folder.join("case/recordings/a.csv");
        write(&path, "time_s,pressure_kpa,angle_deg\n0,0,0\n1,1,2\n").unwrap();
        assert_eq!(ask(&[Way::Seed]).1, 6);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn what_has_no_answer_says_why() {
        let _alone = alone();
        let (folder, rig, set) = stand_in("bad", "bad.csv", Duration::from_secs(60));
        let asked = rig
            .ask(&set.cases[0], Way::Plain, &folder.join("keep"))
            .unwrap();
        assert_eq!(asked.reply, Reply::Silent("error: bad.csv: is bad".into()));
        assert_eq!(likeness(&asked, Way::Seed, &asked), None);
        fs::remove_dir_all(folder).unwrap();

        let (folder, rig, set) = stand_in("killed", "killed.csv", Duration::from_secs(60));
        for count in 1..3 {
            let asked = rig.ask(&set.cases[0], Way::Plain, &folder.join("keep"));
            assert_eq!(asked.unwrap().reply, Reply::Ended);
            let asked = fs::read_to_string(folder.join("count")).unwrap();
            assert_eq!(asked.len(), count);
        }
        fs::remove_dir_all(folder).unwrap();

        let (folder, rig, set) = stand_in("slow", "slow.csv", Duration::from_millis(100));
        let keep = folder.join("keep");
        let ask = |rig: &Rig| rig.ask(&set.cases[0], Way::Plain, &keep).unwrap();
        let count = || fs::read_to_string(folder.join("count")).unwrap().len();
        assert_eq!(ask(&rig).reply, Reply::TooLong);
        assert_eq!((ask(&rig).reply, count()), (Reply::TooLong, 1));
        // With more time it is asked again.
        let longer = Rig {
            limit: Duration::from_millis(300),
            ..rig
        };
        assert_eq!((ask(&longer).reply, count()), (Reply::TooLong, 2));
        fs::remove_dir_all(folder).unwrap();
    }
}
