//! Diagnosis: which effect does a model lack? A false name is worse than "cannot tell".
//!
//! A row is a room, and knows only the rooms above it:
//!
//! | room | what it does |
//! |---|---|
//! | [`work`] | what is asked, how long it may take, who is told, and the [constants](work::policy) of the decision |
//! | [`recordings`] | [their quality](recordings::quality), their [noise](recordings::noise), what can be seen in them at all |
//! | [`score`] | which effects look like what is missing, and [where the gap is](score::localise) |
//! | [`fit`] | structures with effects, fitted; which parameters are [determined](fit::identifiability) |
//! | [`evidence`] | errors [held out](evidence::validation), how sure a difference is, doubts |
//! | [`mod@decide`] | the answer, made once, as a [finding](decide::finding) and a [verdict](decide::verdict) |
//! | [`mod@search`] | which structures are fitted, and what is left of them; it asks the decision whether to go on |
//! | [`experiment`] | the run that separates rivals; whether the rig stood as it is said |
//! | [`explain`] | all of it as a [`Diagnosis`], in words and in JSON, and the [repaired model](explain::repair) |

pub mod decide;
pub mod evidence;
pub mod experiment;
pub mod explain;
pub mod fit;
pub mod recordings;
pub mod score;
pub mod search;
pub mod work;

use std::borrow::Cow;

use model_core::catalogue::Kind;

use crate::estimate::Dataset;
use crate::estimate::assemble::as_read;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::far_zeros;
use crate::estimate::start_from::StartFrom;
use crate::estimate::unit_errors;
use crate::estimate::usable::Matter;
use decide::finding::Finding;
use decide::verdict::Adequacy;
use decide::{Evidence, Remains, decide};
use evidence::measure;
use experiment::plan::Limits;
use experiment::plan::propose;
use experiment::turns;
pub use explain::Diagnosis;
use explain::Validations;
pub use explain::repair::Upload;
use fit::candidates::SkippedEffect;
use fit::identifiability::Identifiability;
use fit::numbers::far_numbers;
use fit::outlier::{Outlier, outlying_recording};
use fit::slow::slow_effects;
use recordings::affordable::{affordable, shortened};
use recordings::noise::NoiseFloor;
use recordings::quality;
use recordings::quality::Concern;
use score::localise::localise;
use score::steps::step_gaps;
use search::baseline;
use search::baseline::Baseline;
use search::{Options, SearchResult, search};
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;
pub use work::budget::Budget;
use work::budget::{BudgetEnd, SearchPart};
pub use work::job::Job;
use work::policy;
use work::progress::Stage;
pub use work::request::Request;

/// Diagnoses a model against recordings.
///
/// A wrong parameter is not a missing effect, so the nominal structure is refitted first; where that
/// leaves only noise, the diagnosis ends. A [budget](work::budget) can end it early: the answer then
/// claims less.
///
/// # Errors
///
/// Refuses a single recording without others for validation, unusable recordings, and a
/// model that cannot be simulated.
pub fn diagnose(request: &Request<'_>, job: &Job) -> Result<Diagnosis, InputError> {
    diagnose_from(request, &Checkpoint::default(), job)
}

/// Like [`diagnose`], with the kept fits of an interrupted run.
///
/// # Errors
///
/// Like [`diagnose`].
pub fn diagnose_from(
    request: &Request<'_>,
    checkpoint: &Checkpoint,
    job: &Job,
) -> Result<Diagnosis, InputError> {
    let tests = request.tests()?;
    // Test recordings choose nothing.
    let holdout = if tests.is_empty() {
        request.holdout
    } else {
        &[]
    };
    let files = [request.recordings, holdout];
    let mut too_many = Vec::new();
    let [fitted, held_out] = match job.allowance.time() {
        Some(time) => {
            job.progress.stage(Stage::Affordable, 0);
            let (model, free) = (&request.file.model, request.file.free.as_slice());
            let samples = affordable(model, free, request.recordings, time);
            files.map(|recordings| {
                let (used, concern) = shortened(recordings, samples, time);
                too_many.extend(concern);
                used
            })
        }
        None => files.map(Cow::Borrowed),
    };
    let used = Request {
        recordings: &fitted,
        holdout: &held_out,
        start_from: &[],
        ..*request
    };
    let mut assembled = as_read(used.recordings, used.holdout)?;
    let fitted = assembled.data.indices(true).len();
    if fitted == 0 || (fitted < 2 && assembled.data.indices(false).is_empty()) {
        return Err(InputError::new(
            format!("a diagnosis needs two runs or more, and {fitted} can be used"),
            "record more, or name some with --holdout: a cause that was fitted and tested on the same run proves nothing",
        ));
    }
    refuse_implausible(request.file, &assembled.data)?;
    assembled = assembled.from_rest(used.recordings);
    assembled.data = assembled.data.knowing(&request.file.within);
    // What starts a test starts a fit.
    if let Some((_, StartFrom::Samples(samples))) = tests.first() {
        assembled.data = assembled.data.starting_from(*samples);
    }
    let mut pass = Pass::with_zeros(&used, &assembled.data, checkpoint, job)?;
    let mut odd_concern = None;
    let mut left_out = None;
    if let Some(outlier) = pass.outlier() {
        if job.may_begin(SearchPart::WithoutOutlier) {
            job.progress
                .again("once more, without the recording that does not belong");
            let others = assembled.data.dropping(outlier.index);
            let path = assembled.data.fitted().nth(outlier.index);
            let path = path.map(|segment| segment.recording.path.clone());
            let mut files = request.recordings.iter();
            left_out = path.and_then(|path| files.position(|file| file.path == path));
            pass = Pass::with_zeros(&used, &others, checkpoint, job)?;
            odd_concern = Some(outlier.concern);
        } else {
            odd_concern = Some(outlier.kept);
        }
    }
    let concerns = odd_concern
        .into_iter()
        .chain(too_many)
        .chain(assembled.concerns)
        .filter(|concern| concern.matter != Matter::LeftOut);
    let diagnosis = pass.diagnosis(&used, concerns.collect(), job);
    Ok(Diagnosis {
        left_out,
        not_used: assembled.left_out,
        test: diagnosis.tested(&tests, assembled.subtracted),
        ..diagnosis
    })
}

/// One search over recordings, and what it leaves to be decided.
struct Pass {
    searched: SearchResult,
    concerns: Vec<Concern>,
}

impl Pass {
    /// With estimated zeros, unless they hide an effect. If the estimated zeros alone explain the
    /// recordings, but their penalty exceeds the price of an effect, the effects are tried again
    /// with zeros as calibrated. If none explains the recordings, the zeros remain the answer.
    fn with_zeros(
        request: &Request<'_>,
        data: &Dataset,
        checkpoint: &Checkpoint,
        job: &Job,
    ) -> Result<Self, InputError> {
        let estimated = Self::of(request, data, checkpoint, job)?;
        let baseline = &estimated.searched.baseline;
        // The best of so many effects, by as much as is very strong evidence for one.
        let choices = (Kind::NAMES.len() + request.own_kinds().len()) as f64;
        let effect = policy::Search::STANDARD.effect_evidence + 2.0 * libm::log(choices);
        if estimated.searched.remains == Remains::More
            || cost_of_zeros(&baseline.data, &baseline.refit.fit) < effect
            || !job.may_begin(SearchPart::Calibrated)
        {
            return Ok(estimated);
        }
        job.progress.again("once more, with zeros as calibrated");
        let calibrated = Self::of(request, &data.calibrated(), checkpoint, job)?;
        // Not if it is open only because the time was up.
        let ranking = &calibrated.searched.found.ranking;
        let explains =
            !ranking.rivals.is_empty() && (ranking.is_firm || job.allowance.ended().is_none());
        Ok(if explains { calibrated } else { estimated })
    }

    fn of(
        request: &Request<'_>,
        data: &Dataset,
        checkpoint: &Checkpoint,
        job: &Job,
    ) -> Result<Self, InputError> {
        job.progress.stage(Stage::Quality, 0);
        let (floor, mut concerns) = examined(data)?;
        let baseline = Baseline::of(request, data, &floor, job)?;
        let options = Options {
            checkpoint,
            job,
            seed: request.seed,
            own: request.own_kinds(),
            formulas: request.formulas,
            without: request.without,
        };
        let searched = search(baseline, options);
        concerns.extend(searched.baseline.remarks.iter().cloned());
        Ok(Self { searched, concerns })
    }

    /// A recording that no structure fits together with the others.
    fn outlier(&self) -> Option<Outlier> {
        let SearchResult {
            found, baseline, ..
        } = &self.searched;
        let (file, floor) = (&baseline.file, &baseline.floor);
        if floor.is_all_that_remains(&found.repaired.fit) || baseline.data.segments().len() < 3 {
            return None;
        }
        let fitter = Fitter::new(&file.model, &baseline.data);
        let mut candidates = found.best().into_iter().chain([&baseline.refit]);
        candidates.find_map(|it| outlying_recording(file, &fitter, it, floor))
    }

    fn answer(&self, job: &Job) -> Finding {
        let policy = &policy::Policy::STANDARD;
        let SearchResult {
            remains,
            found,
            baseline,
            ..
        } = &self.searched;
        let most_noise = policy.most_noise * baseline::swing_of_all(&baseline.data);
        let evidence = Evidence {
            remains: *remains,
            is_noisy: baseline.floor.total() > most_noise,
            scored: &found.rows.scored,
            ranking: &found.ranking,
            beside: found.beside,
            repaired: &found.repaired.added,
            undone: &job.allowance.undone(),
        };
        decide(&evidence, policy)
    }

    /// The answer, and all that is told with it; the concerns about the files come first.
    fn diagnosis(self, request: &Request<'_>, about_files: Vec<Concern>, job: &Job) -> Diagnosis {
        let finding = self.answer(job);
        let Self { searched, concerns } = self;
        let SearchResult {
            found,
            mut untried,
            baseline,
            ..
        } = searched;
        // Nothing is planned for rivals of an answer that does not hold.
        let rivals = match finding {
            Finding::Rivals { .. } | Finding::Shape { .. } | Finding::Trace { .. } => {
                found.rivals()
            }
            _ => Vec::new(),
        };
        let Baseline {
            data,
            file,
            nominal,
            refit,
            identified,
            floor,
            remarks: _,
        } = &baseline;
        let fitter = Fitter::new(&file.model, data);
        let validator = baseline.validator(&fitter);
        let repaired = &found.repaired;
        let localised = |fit: &Fit| localise(&fit.model, data, &fit.nuisances, floor.white);
        job.progress.stage(Stage::Gap, 0);
        let gap = localised(&refit.fit);
        job.progress.stage(Stage::Board, 0);
        let held_out = validator.errors(refit, repaired);
        let is_adequate = floor.is_all_that_remains(&repaired.fit);
        let adds = !repaired.added.is_empty();
        let adequacy = Adequacy {
            adequate: is_adequate,
            holdout_gap_closed: if adds { held_out.gap_closed() } else { 0.0 },
            exact_form: is_adequate && held_out.at_noise(),
        };
        // What the answer rests on is said first.
        let setups = turns::contradictions(file, data, refit, floor.rms, job);
        let (bent, steps) = if finding.is_quiet() {
            Default::default()
        } else {
            (
                far_numbers(file, &refit.fit),
                step_gaps(data, &refit.fit, floor.white),
            )
        };
        let concerns = about_files
            .into_iter()
            .chain(setups)
            .chain(concerns)
            .chain(bent)
            .chain(slow_effects(repaired, data))
            .chain(far_zeros(&repaired.fit, data))
            .collect();
        let proposals = if rivals.len() > 1 && job.may_begin(SearchPart::Experiment) {
            let sensor = Limits::default().of_rig(request.recordings);
            propose(&file.model, &rivals, floor.rms, &sensor)
        } else {
            Vec::new()
        };
        let ended = job.allowance.ended();
        untried.extend(out_of_time(ended.as_ref(), &repaired.added));
        Diagnosis {
            concerns,
            not_used: Vec::new(),
            left_out: None,
            test: Vec::new(),
            validation: Validations::of(&fitter, &nominal.model, refit, repaired, &rivals),
            tolerance: baseline::tolerance(data),
            closure: adds.then(|| measure::closed(&validator, refit, repaired)),
            gap_left: adds.then(|| localised(&repaired.fit)),
            identifiability: [
                Identifiability::of(&repaired.fit, &identified.held, identified.order),
                identified.clone(),
            ],
            held_out,
            tried: found.tried(validator.floor()),
            alike: found.rows.alike.clone(),
            steps,
            rivals,
            proposals,
            adequacy,
            gap,
            untried,
            ended,
            finding,
            floor: floor.clone(),
            nominal: nominal.clone(),
            refit: refit.fit.clone(),
            data: data.clone(),
            repaired: found.repaired,
        }
    }
}

/// Effects that the time was not enough for. Those of the repaired model were tried, if not fully.
fn out_of_time(ended: Option<&BudgetEnd>, repaired: &[Kind]) -> Vec<SkippedEffect> {
    let kinds = ended.map(BudgetEnd::kinds).unwrap_or_default().into_iter();
    let untried = kinds.filter(|kind| !repaired.contains(kind));
    let reason = "the time was up";
    untried.map(|kind| SkippedEffect { kind, reason }).collect()
}

/// Refuses recordings without motion, and columns that do not hold what their header says.
/// The angle is as read: one that is counted from its rest hides what the pressure rests at.
fn refuse_implausible(file: &ModelFile, data: &Dataset) -> Result<(), InputError> {
    quality::refuse_without_motion(&data.recordings(true))?;
    // By whole sessions: a segment in which hardly anything moves looks undriven.
    let sessions: Vec<Recording> = data
        .sessions()
        .iter()
        .map(|session| session.recording().clone())
        .collect();
    unit_errors::refuse(file, &sessions)
}

/// Examines fitted and held-out recordings. Returns the noise floor and the concerns.
fn examined(data: &Dataset) -> Result<(NoiseFloor, Vec<Concern>), InputError> {
    let recordings = data.recordings(true);
    let floor = NoiseFloor::of(&recordings);
    let mut concerns = quality::examine(&recordings, &floor)?;
    let held_out = data.recordings(false);
    if !held_out.is_empty() {
        let found = quality::examine(&held_out, &NoiseFloor::of(&held_out))?;
        // Missing repeats or short runs matter for fitted recordings only.
        concerns.extend(found.into_iter().filter(|it| it.recording.is_some()));
    }
    Ok((floor, concerns))
}

/// The penalty of a fit's zeros if each session had its own: the sum of squared
/// departures, in standard deviations. A zero that all recordings share has a small
/// penalty in the fit, but is a property of the rig and may have a name.
fn cost_of_zeros(data: &Dataset, fit: &Fit) -> f64 {
    data.sessions()
        .iter()
        .zip(&fit.nuisances)
        .filter(|(session, _)| session.is_estimated())
        .map(|(session, nuisance)| {
            let [pressure, angle, ..] = session.prior().departures(nuisance);
            pressure * pressure + angle * angle
        })
        .sum()
}
