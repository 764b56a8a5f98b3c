//! Batches: many independent diagnoses, for thousands of recordings.
//!
//! A manifest lists cases, each a model and its recordings. Each case writes to a folder of
//! its own and shares nothing else, so cases may run one after the other, as an array of
//! jobs on a cluster, or in any order, and may be stopped at any time. A case with results of
//! the same inputs is skipped.

pub mod manifest;
pub mod results;

use std::fmt::Write as _;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use manifest::{Case, Cases};
use results::CaseResult;
use softrig::diagnose::{Budget, Job, Request, diagnose_from};
use softrig::estimate::checkpoint::Checkpoint;
use softrig::estimate::placement::with_tip_load;
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::model_file::ModelFile;
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::{check_distinct, read_all};
use softrig_report::provenance::{Provenance, sha256};

/// Where the results of one case are.
///
/// ```text
/// OUT/CASE/verdict.json     as of --json
/// OUT/CASE/repaired.toml    as of -o
/// OUT/CASE/warnings.txt     warnings of the diagnosis, if any
/// OUT/CASE/inputs.sha256    hashes of the inputs and results, as `sha256sum` writes them; last
/// OUT/CASE/error.txt        instead of them, if a case could not be diagnosed
/// OUT/results.parquet       one row per case
/// ```
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

/// The outcome of a case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It is diagnosed.
    Diagnosed,
    /// It was before, from the same inputs.
    Known,
    /// Its inputs are at fault; the text says how.
    Failed(String),
    /// The batch was stopped; nothing is written.
    Stopped,
}

impl Folder {
    /// The folder of a case below `out`.
    pub fn of(out: &Path, case: &Case) -> Self {
        Self(out.join(&case.name))
    }

    /// Refuses a link in its place: what it points to belongs to somebody else.
    ///
    /// # Errors
    ///
    /// Names the link.
    pub fn refuse_link(&self) -> Result<(), InputError> {
        if self.0.is_symlink() {
            return Err(InputError::new(
                "is a link, and the folder of a case is written to",
                "remove the link, or choose another folder after -o",
            )
            .in_file(&self.0));
        }
        Ok(())
    }

    /// The verdict.
    pub fn verdict(&self) -> PathBuf {
        self.0.join("verdict.json")
    }

    /// The model to go on with.
    pub fn repaired(&self) -> PathBuf {
        self.0.join("repaired.toml")
    }

    /// Warnings about the recordings: not complete, rows lost, odd units.
    pub fn warnings(&self) -> PathBuf {
        self.0.join("warnings.txt")
    }

    /// The digest of the inputs.
    pub fn inputs(&self) -> PathBuf {
        self.0.join("inputs.sha256")
    }

    /// Why there are none.
    pub fn error(&self) -> PathBuf {
        self.0.join("error.txt")
    }

    /// What is there of the results of these inputs.
    fn holds(&self, inputs: &str) -> Held {
        let text = std::fs::read_to_string(self.inputs()).unwrap_or_default();
        if !text.starts_with(inputs) {
            return Held::Nothing;
        }
        let results = [self.verdict(), self.repaired()].map(|path| std::fs::read(path).ok());
        match results {
            [Some(verdict), Some(repaired)]
                if text == with_results(inputs, &verdict, &repaired) =>
            {
                Held::Results
            }
            _ => Held::Damaged,
        }
    }

    /// Removes a file, if it is there.
    fn forget(&self, file: &Path) -> Result<(), InputError> {
        match std::fs::remove_file(file) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(InputError::from_io(&self.0, &error))
            }
            _ => Ok(()),
        }
    }
}

/// What a folder holds of the results of some inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Held {
    /// Those of other inputs, or none.
    Nothing,
    /// All, as they were written.
    Results,
    /// Files that are missing or are not as they were written.
    Damaged,
}

/// The hashes of inputs, and those of the results.
fn with_results(inputs: &str, verdict: &[u8], repaired: &[u8]) -> String {
    let [verdict, repaired] = [verdict, repaired].map(sha256);
    format!("{inputs}# results\n{verdict}  verdict.json\n{repaired}  repaired.toml\n")
}

/// How cases are diagnosed.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Where the recordings stand in their files, as far as the command line says.
    pub layout: Layout,
    /// The same, where neither command line, case nor model says it: as `softrig.toml` does.
    pub folder: Layout,
    /// Random seed.
    pub seed: u64,
    /// Effects of the user's own, tried in every case.
    pub own: Option<OwnEffects>,
    /// Whether formulas are tried where no effect is enough.
    pub formulas: bool,
    /// The time budget of one case's search.
    pub budget: Option<Budget>,
    /// Diagnose also the cases whose results are there.
    pub anew: bool,
}

/// Every Nth case from the Kth on.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// K, from 0.
    pub index: usize,
    /// N.
    pub of: usize,
}

/// A batch: where its results go, and how it is worked off.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// The folder of all results.
    pub out: &'a Path,
    /// How cases are diagnosed.
    pub settings: &'a Settings,
    /// Only these cases, without the table of all.
    pub share: Option<Share>,
    /// How many cases are diagnosed at a time, each on its part of the threads.
    pub jobs: NonZero<usize>,
}

/// What became of the cases of a batch.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// How many were asked for.
    pub cases: usize,
    /// For each that failed, where it says why.
    pub failed: Vec<PathBuf>,
    /// For each with warnings, where they stand.
    pub warned: Vec<PathBuf>,
}

impl Summary {
    /// That cases have warnings, in a sentence.
    pub fn warning(&self) -> Option<String> {
        let first = self.warned.first()?;
        Some(format!(
            "{} of {} cases have warnings; those of the first are in {}",
            self.warned.len(),
            self.cases,
            first.display()
        ))
    }

    /// That cases failed, in a sentence.
    pub fn failure(&self) -> Option<String> {
        let first = self.failed.first()?;
        let (failed, cases) = (self.failed.len(), self.cases);
        Some(if first.exists() {
            format!(
                "{failed} of {cases} cases could not be diagnosed; for the first, see {}",
                first.display()
            )
        } else {
            format!("{failed} of {cases} cases could not be diagnosed, for the reasons above")
        })
    }
}

/// Where the table of all cases is.
pub fn table(out: &Path) -> PathBuf {
    out.join("results.parquet")
}

/// The results of all cases, read from their folders.
pub fn rows<'a>(
    out: &'a Path,
    cases: &'a mut dyn Cases,
) -> impl Iterator<Item = anyhow::Result<CaseResult>> + 'a {
    (0..cases.count()).map(|place| Ok(CaseResult::read(out, &cases.case(place)?)))
}

/// What a batch has to do yet, and what became of the rest.
struct Left<'a> {
    cases: &'a mut dyn Cases,
    places: std::iter::Enumerate<std::iter::StepBy<std::ops::Range<usize>>>,
    /// By the numbers of the cases.
    failed: Vec<(usize, PathBuf)>,
    warned: Vec<(usize, PathBuf)>,
}

impl Batch<'_> {
    /// Diagnoses the cases and tells `progress` of each; `say` gets a line for each as it is done.
    /// Where all are asked for, their table is written at the end.
    ///
    /// # Errors
    ///
    /// Those of the disk, of the manifest and of `say`, which end the batch. What is wrong with a
    /// case is in the summary.
    pub fn run(
        &self,
        cases: &mut dyn Cases,
        job: &Job,
        say: &(dyn Fn(&str) -> anyhow::Result<()> + Sync),
    ) -> anyhow::Result<Summary> {
        let Share { index, of } = self.share.unwrap_or(Share { index: 0, of: 1 });
        let places = (index..cases.count()).step_by(of);
        let count = places.len();
        job.progress.cases(count);
        let left = Mutex::new(Left {
            cases,
            places: places.enumerate(),
            failed: Vec::new(),
            warned: Vec::new(),
        });
        self.work_off(|| {
            let worked = self.work(&left, count, job, say);
            if worked.is_err() {
                job.allowance.stop();
            }
            worked
        })?;
        let mut left = left.into_inner().unwrap_or_else(PoisonError::into_inner);
        if self.share.is_none() && !job.allowance.is_stopped() {
            results::write(&table(self.out), rows(self.out, left.cases))?;
        }
        let in_order = |of: &mut Vec<(usize, PathBuf)>| {
            of.sort_unstable();
            of.drain(..).map(|(_, path)| path).collect()
        };
        Ok(Summary {
            cases: count,
            failed: in_order(&mut left.failed),
            warned: in_order(&mut left.warned),
        })
    }

    /// Lets as many workers as asked for do `work`.
    fn work_off(&self, work: impl Fn() -> anyhow::Result<()> + Sync) -> anyhow::Result<()> {
        let jobs = self.jobs.get();
        if jobs == 1 {
            return work();
        }
        // A pool for each: in a common one a worker that waits for a fit would begin another case.
        let threads = (rayon::current_num_threads() / jobs).max(1);
        let work = || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            pool.build()?.install(&work)
        };
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..jobs).map(|_| scope.spawn(work)).collect();
            let ended = workers.into_iter().map(|worker| match worker.join() {
                Ok(ended) => ended,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            ended.collect()
        })
    }

    /// Diagnoses one case after the other until none is left.
    fn work(
        &self,
        left: &Mutex<Left<'_>>,
        count: usize,
        job: &Job,
        say: &(dyn Fn(&str) -> anyhow::Result<()> + Sync),
    ) -> anyhow::Result<()> {
        let left = || left.lock().unwrap_or_else(PoisonError::into_inner);
        while !job.allowance.is_stopped() {
            let (index, case, width) = {
                let mut left = left();
                let Some((index, place)) = left.places.next() else {
                    break;
                };
                (index, left.cases.case(place)?, left.cases.longest_name())
            };
            let clock = Instant::now();
            let how = match diagnose(&case, self.out, self.settings, job)? {
                Outcome::Stopped => break,
                Outcome::Failed(error) => {
                    let path = Folder::of(self.out, &case).error();
                    left().failed.push((index, path));
                    Err(error)
                }
                Outcome::Known => Ok("known".to_owned()),
                Outcome::Diagnosed => Ok(format!("{:.1} s", clock.elapsed().as_secs_f64())),
            };
            let found = match how {
                Err(error) => error.lines().next().unwrap_or_default().to_owned(),
                Ok(how) => {
                    let row = CaseResult::read(self.out, &case);
                    if row.warnings.is_some() {
                        let path = Folder::of(self.out, &case).warnings();
                        left().warned.push((index, path));
                    }
                    let how: Vec<String> = [how].into_iter().chain(row.warned()).collect();
                    format!("{} ({})", row.summary(), how.join(", "))
                }
            };
            let found = format!("{:<width$}  {found}", case.name);
            say(&format!("{}/{count} {found}", index + 1))?;
            job.progress.case(found);
        }
        Ok(())
    }
}

/// Diagnoses a case, unless its results are there.
///
/// # Errors
///
/// The folder cannot be written. What is wrong with the case itself is an
/// [`Outcome::Failed`], so that the others go on.
fn diagnose(
    case: &Case,
    out: &Path,
    settings: &Settings,
    batch: &Job,
) -> Result<Outcome, InputError> {
    let folder = Folder::of(out, case);
    if let Err(error) = folder.refuse_link() {
        return Ok(Outcome::Failed(error.to_string()));
    }
    std::fs::create_dir_all(&folder.0).map_err(|error| InputError::from_io(&folder.0, &error))?;
    let results = inputs(case, settings).and_then(|inputs| {
        let held = folder.holds(&inputs);
        if held == Held::Results && !settings.anew {
            return Ok(None);
        }
        let mut solved = solve(case, settings, batch)?;
        if held == Held::Damaged {
            let remark = "the results that were here were damaged; the case is diagnosed again";
            solved.warnings.push(remark.to_owned());
        }
        Ok(Some((solved, inputs)))
    });
    if batch.allowance.is_stopped() {
        return Ok(Outcome::Stopped);
    }
    let (solved, inputs) = match results {
        Ok(None) => {
            folder.forget(&folder.error())?;
            return Ok(Outcome::Known);
        }
        Ok(Some(results)) => results,
        Err(error) => {
            let text = format!("{error:#}");
            write_atomically(&folder.error(), format!("{text}\n").as_bytes())?;
            return Ok(Outcome::Failed(text));
        }
    };
    // First away with what an earlier try says of itself: a job may be killed anywhere here.
    folder.forget(&folder.inputs())?;
    folder.forget(&folder.error())?;
    folder.forget(&folder.warnings())?;
    write_atomically(&folder.verdict(), solved.verdict.as_bytes())?;
    write_atomically(&folder.repaired(), solved.repaired.as_bytes())?;
    if !solved.warnings.is_empty() {
        let text = solved.warnings.join("\n") + "\n";
        write_atomically(&folder.warnings(), text.as_bytes())?;
    }
    let hashes = with_results(
        &inputs,
        solved.verdict.as_bytes(),
        solved.repaired.as_bytes(),
    );
    write_atomically(&folder.inputs(), hashes.as_bytes())?;
    Ok(Outcome::Diagnosed)
}

/// Everything that the results depend on.
fn inputs(case: &Case, settings: &Settings) -> anyhow::Result<String> {
    let Provenance { version, files, .. } = Provenance::of(
        &case.model,
        settings.own.as_ref().map(|own| own.path.as_path()),
        &case.recordings,
        &case.holdout,
        String::new(),
    )?;
    let mut text = format!(
        "# softrig {version}, seed {}, columns {:?}\n",
        settings.seed,
        settings.layout.or(&case.layout)
    );
    if settings.folder != Layout::default() {
        let _ = writeln!(text, "# folder {:?}", settings.folder);
    }
    if !settings.formulas {
        let _ = writeln!(text, "# no formulas");
    }
    if let Some(budget) = settings.budget {
        // Less time may have found less.
        let _ = writeln!(text, "# budget {budget:?}");
    }
    let mut role = "";
    for file in &files {
        // A recording that is held out now was fitted before: another diagnosis.
        if file.role != role {
            role = file.role;
            let _ = writeln!(text, "# {role}");
        }
        let _ = writeln!(text, "{}  {}", file.sha256, file.path);
    }
    Ok(text)
}

/// The results of a diagnosis, as texts.
struct Solved {
    verdict: String,
    repaired: String,
    warnings: Vec<String>,
}

fn solve(case: &Case, settings: &Settings, batch: &Job) -> anyhow::Result<Solved> {
    // Those of a thousand cases would be read by nobody: they stand beside the verdict.
    let mut warnings = Vec::new();
    check_distinct(&case.recordings, &case.holdout)?;
    let file = ModelFile::read(&case.model)?;
    warnings.extend_from_slice(&file.warnings);
    let mut warn = |text: &str| warnings.push(text.to_owned());
    if let Some(own) = &settings.own {
        own.check_beside(&file.model)?;
    }
    let said = settings.layout.or(&case.layout);
    let layout = said.or(&file.recording).or(&settings.folder);
    let recordings = read_all(&case.recordings, &layout, &mut warn)?;
    let holdout = read_all(&case.holdout, &layout, &mut warn)?;
    let file = with_tip_load(file, &recordings);
    let request = Request {
        file: &file,
        recordings: &recordings,
        holdout: &holdout,
        start_from: &[],
        own: settings.own.as_ref(),
        formulas: settings.formulas,
        without: &[],
        seed: settings.seed,
    };
    let clock = Instant::now();
    let diagnosis = diagnose_from(
        &request,
        &Checkpoint::default(),
        &batch.of_a_case(settings.budget),
    )?;
    let verdict = diagnosis.verdict(&request, clock.elapsed().as_secs_f64());
    let verdict = format!("{}\n", serde_json::to_string_pretty(&verdict)?);
    Ok(Solved {
        verdict,
        repaired: diagnosis.model_text(&file),
        warnings,
    })
}
