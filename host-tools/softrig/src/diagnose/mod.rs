//! Diagnosis: which effect does a model lack?
//!
//! Each step is a module whose output is data that reports can show:
//!
//! 1. [`quality`] and [`unit_errors`] refuse unusable recordings and report other problems.
//! 2. [`noise`] estimates the noise floor.
//! 3. [`identifiability`] refits the nominal structure, since a wrong parameter is not a
//!    missing effect, and finds which parameters the recordings determine.
//! 4. If the residual of the refit cannot be distinguished from noise, the diagnosis ends.
//! 5. [`mod@localise`] shows which feature the missing force goes with, by a [`smoother`].
//! 6. [`mod@search`] fits the [`candidates`] of the catalogue, alone and in [`pairs`].
//! 7. [`validation`] tests structures on held-out runs, [`draws`] show how sure a difference
//!    is, and [`doubts`] what keeps a structure from being named; [`selection`] is what is left.
//! 8. [`mod@decide`] makes the answer, once: a [`finding`], written as a [`verdict`].
//! 9. [`plan`] proposes the run that separates the rivals, and [`turns`] says where a session
//!    behaves as if the rig had stood otherwise than it is said.
//!
//! A [`budget`] can end the search early; the answer then claims less. Where it is too short for
//! a search on all samples, an [affordable](mod@affordable) part of them is used.
//!
//! A false name is worse than "cannot tell".

pub(crate) mod affordable;
pub mod allowance;
pub(crate) mod baseline;
pub mod budget;
pub mod candidates;
pub(crate) mod decide;
pub(crate) mod discrepancy;
pub(crate) mod doubts;
pub(crate) mod draws;
pub mod executor;
pub mod finding;
pub(crate) mod grade;
pub mod identifiability;
pub mod job;
pub(crate) mod levels;
pub mod localise;
pub mod measure;
pub(crate) mod needs;
pub mod noise;
pub(crate) mod pairs;
pub mod plan;
pub mod policy;
pub mod progress;
pub(crate) mod quality;
pub mod request;
pub(crate) mod scales;
pub mod score;
pub(crate) mod search;
pub mod selection;
pub(crate) mod singles;
pub(crate) mod smoother;
pub mod structures;
pub(crate) mod tables;
pub(crate) mod turns;
pub mod validation;
pub mod verdict;

use std::borrow::Cow;

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;

use crate::estimate::Dataset;
use crate::estimate::assemble::as_read;
use crate::estimate::checkpoint::Checkpoint;
use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::far_zeros;
use crate::estimate::unit_errors;
use crate::estimate::usable::Matter;
use crate::sim::board::{self, Unseen};
use affordable::{affordable, shortened};
use baseline::Baseline;
pub use budget::Budget;
use budget::{Ended, SearchPart};
use candidates::{Candidate, Untried};
use decide::{Evidence, Remains, decide};
use finding::{Explanation, Finding, names};
use identifiability::Identifiability;
pub use job::Job;
use localise::{Gap, localise};
use noise::NoiseFloor;
use plan::{Limits, Proposal};
use progress::Stage;
use quality::Concern;
pub use request::Request;
use search::{Options, Searched, search};
use selection::FittedStructure;
use softrig_formats::error::InputError;
use softrig_formats::family;
use softrig_formats::left_out::LeftOut;
use softrig_formats::model_file::{ModelFile, to_file_units};
use softrig_formats::numbers::tidy;
use softrig_formats::recording::Recording;
use softrig_formats::settings_file::from_model;
use validation::HeldOut;
use verdict::{
    Adequacy, Answer, Closure, EndedBy, Experiment, FittedError, HeldOutError, NamedEffect, Place,
    Remaining, Repair, SCHEMA, Verdict, Zeros,
};

/// Number of proposals for the next experiment.
const PROPOSALS: usize = 3;

/// The result of a diagnosis.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// The answer.
    pub finding: Finding,
    /// Concerns about the recordings.
    pub concerns: Vec<Concern>,
    /// What was left out of the files, or changed in them.
    pub not_used: Vec<LeftOut>,
    /// Index of a recording that was left out because it behaves like another actuator.
    pub left_out: Option<usize>,
    /// The sessions and their segments, as they were used.
    pub data: Dataset,
    /// Residuals on the held-out segments.
    pub validation: Validations,
    /// Noise floor of the fitted recordings.
    pub floor: NoiseFloor,
    /// The nominal model against the recordings.
    pub nominal: Fit,
    /// The nominal structure, refitted.
    pub refit: Fit,
    /// What a model may be off without it mattering (rad).
    pub tolerance: f64,
    /// Closure of the repaired model at three horizons; none where nothing is added.
    pub closure: Option<Closure>,
    /// The missing force of the repaired model, and its features.
    pub gap_left: Option<Gap>,
    /// The model that predicts held-out segments best, with or without named effects; the
    /// refit where none is better.
    pub repaired: Candidate,
    /// Identifiability of the refit and of the repaired model.
    pub identifiability: [Identifiability; 2],
    /// Held-out errors.
    pub held_out: HeldOut,
    /// The best of the rivals that remain, as fitted.
    pub rivals: Vec<Candidate>,
    /// Every structure with a final fit, with its evidence.
    pub tried: Vec<FittedStructure>,
    /// Runs that would separate the surviving rivals, best first.
    pub proposals: Vec<(Proposal, [Vec<Kind>; 2])>,
    /// Whether the repaired model is adequate.
    pub adequacy: Adequacy,
    /// The missing force of the refit, and its features.
    pub gap: Gap,
    /// Effects that were not tried, because they do not apply or the time was up.
    pub untried: Vec<Untried>,
    /// The parts that were not done, if a budget ended the search.
    pub ended: Option<Ended>,
}

/// Diagnoses a model against recordings.
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
    let files = [request.recordings, request.holdout];
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
    Ok(Diagnosis {
        left_out,
        not_used: assembled.left_out,
        ..pass.diagnosis(&used, concerns.collect(), job)
    })
}

/// One search over recordings, and what it leaves to be decided.
struct Pass {
    searched: Searched,
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
        };
        let searched = search(baseline, options);
        concerns.extend(searched.baseline.remarks.iter().cloned());
        Ok(Self { searched, concerns })
    }

    /// A recording that no structure fits together with the others.
    fn outlier(&self) -> Option<quality::Outlier> {
        let Searched {
            found, baseline, ..
        } = &self.searched;
        let (file, floor) = (&baseline.file, &baseline.floor);
        if floor.is_all_that_remains(&found.repaired.fit) || baseline.data.segments().len() < 3 {
            return None;
        }
        let fitter = Fitter::new(&file.model, &baseline.data);
        let mut candidates = found.best().into_iter().chain([&baseline.refit]);
        candidates.find_map(|it| quality::outlying_recording(file, &fitter, it, floor))
    }

    /// The answer.
    fn answer(&self, job: &Job) -> Finding {
        let policy = &policy::Policy::STANDARD;
        let Searched {
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
        let Searched {
            found,
            mut untried,
            baseline,
            ..
        } = searched;
        // Rivals of an answer that does not stand are not planned for.
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
        // What the answer stands on is said first.
        let setups = turns::contradictions(file, data, refit, floor.rms, job);
        let concerns = about_files
            .into_iter()
            .chain(setups)
            .chain(concerns)
            .chain(quality::slow_effects(repaired, data))
            .chain(far_zeros(&repaired.fit, data))
            .collect();
        let proposals = if rivals.len() > 1 && job.may_begin(SearchPart::Experiment) {
            let sensor = Limits::default().of_rig(request.recordings);
            propose(&file.model, &rivals, floor, &sensor)
        } else {
            Vec::new()
        };
        let ended = job.allowance.ended();
        untried.extend(out_of_time(ended.as_ref(), &repaired.added));
        Diagnosis {
            concerns,
            not_used: Vec::new(),
            left_out: None,
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
fn out_of_time(ended: Option<&Ended>, repaired: &[Kind]) -> Vec<Untried> {
    let kinds = ended.map(Ended::kinds).unwrap_or_default().into_iter();
    let untried = kinds.filter(|kind| !repaired.contains(kind));
    let reason = "the time was up";
    untried.map(|kind| Untried { kind, reason }).collect()
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

/// What is to become of the model that `-o` writes on a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Upload {
    /// It is worth an upload.
    Worth,
    /// It is the supplied one, unchanged.
    Unchanged,
    /// It predicts better on the computer, and not on the board: a sentence or two that say
    /// why.
    Refused(String),
}

/// Residuals (rad) on the held-out segments, of the nominal model, the refit, the
/// repaired model and the rivals. Empty where there are none.
#[derive(Clone, Debug, Default)]
pub struct Validations {
    /// A series a held-out segment.
    pub nominal: Vec<Vec<f64>>,
    /// The same.
    pub refit: Vec<Vec<f64>>,
    /// The same.
    pub repaired: Vec<Vec<f64>>,
    /// The same for each rival.
    pub rivals: Vec<Vec<Vec<f64>>>,
}

impl Validations {
    fn of(
        fitter: &Fitter<'_>,
        nominal: &Model<f64>,
        refit: &Candidate,
        repaired: &Candidate,
        rivals: &[Candidate],
    ) -> Self {
        if fitter.data.held_out().next().is_none() {
            return Self::default();
        }
        let of = |model: &Model<f64>| fitter.validate(model).residuals;
        Self {
            nominal: of(nominal),
            refit: of(&refit.fit.model),
            repaired: of(&repaired.fit.model),
            rivals: rivals.iter().map(|rival| of(&rival.fit.model)).collect(),
        }
    }
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

/// The runs that separate rivals best, with the effects that they separate.
fn propose(
    nominal: &Model<f64>,
    rivals: &[Candidate],
    floor: &NoiseFloor,
    limits: &Limits,
) -> Vec<(Proposal, [Vec<Kind>; 2])> {
    let added = |index: usize| rivals[index].added.clone();
    plan::proposals(nominal, rivals, floor.rms, limits)
        .into_iter()
        .take(PROPOSALS)
        .map(|proposal| {
            let (a, b) = proposal.separates;
            (proposal, [added(a), added(b)])
        })
        .collect()
}

impl Diagnosis {
    /// The runs that separate the rivals best within other limits than those of [`Limits::default`]
    /// and of the recordings, with the effects that they separate.
    pub fn experiments_within(
        &self,
        request: &Request<'_>,
        limits: Limits,
    ) -> Vec<(Proposal, [Vec<Kind>; 2])> {
        propose(&request.file.model, &self.rivals, &self.floor, &limits)
    }

    /// The concern that a session stood otherwise than its metadata say, on which the answer then
    /// rests.
    pub fn contradicted_setup(&self) -> Option<&Concern> {
        let mut concerns = self.concerns.iter();
        concerns.find(|concern| concern.matter == Matter::Turned)
    }

    /// The model that `-o` writes: the repaired one, or the nominal one where nothing is
    /// wrong with it or the other predicts no better.
    pub fn model_to_keep<'a>(&'a self, nominal: &'a ModelFile) -> &'a Model<f64> {
        if self.is_better() {
            &self.repaired.fit.model
        } else {
            &nominal.model
        }
    }

    /// The text of that model file, with a comment above added effects.
    pub fn model_text(&self, nominal: &ModelFile) -> String {
        let what = match &self.finding {
            Finding::Quiet { .. } | Finding::Named { .. } => "Added by softrig diagnose.".into(),
            Finding::OutOfTime { .. } | Finding::Unexplained { .. } => {
                "Added by softrig diagnose: lowers the error, not named.".into()
            }
            undecided if undecided.families().is_empty() => {
                "Added by softrig diagnose: one of several that these recordings cannot tell apart."
                    .into()
            }
            undecided => format!("representative of {}", family::title(undecided.families())),
        };
        nominal.text_with(self.model_to_keep(nominal), &format!("# {what}\n"))
    }

    /// Whether the repaired model predicts held-out runs better than the nominal one.
    pub fn is_better(&self) -> bool {
        self.finding.answer() != Answer::NoDiscrepancy
            && self.held_out.repaired < self.held_out.nominal
    }

    /// What is to become of the written model on a board.
    pub fn upload(&self, file: &ModelFile) -> Upload {
        if !self.is_better() {
            return Upload::Unchanged;
        }
        if let Finding::Rivals { .. } = self.finding {
            return Upload::Refused(
                "These recordings do not tell the explanations apart: upload none of them yet. A \
                 wrong one predicts these runs as well, and others not."
                    .into(),
            );
        }
        let mut kept = file.clone();
        kept.model = self.fit_to_keep().model;
        let farthest = board::farthest(self.data.largest_angle());
        let refused = from_model(&kept)
            .map_err(|error| error.found)
            .and_then(|_| board::plan(&kept.model, farthest));
        if let Err(why) = refused {
            return Upload::Refused(format!(
                "The board cannot run this model: {why}. Use it on the computer."
            ));
        }
        let zeros = self.fit_to_keep().nuisances.iter();
        let mut sessions = self.data.sessions().iter().zip(zeros);
        let beyond = Err(Unseen::Pressure);
        if sessions.any(|(it, zeros)| board::is_seen(it.signal(), zeros.pressure_zero) == beyond) {
            return Upload::Refused(format!(
                "No board can run this rig: {}. Use the model on the computer.",
                Unseen::Pressure
            ));
        }
        if self.held_out.repaired_on_board < self.held_out.nominal {
            return Upload::Worth;
        }
        Upload::Refused(
            "In the steps of the board this model predicts no better than the one supplied. Use \
             it on the computer."
                .into(),
        )
    }

    /// The fit of the written model.
    fn fit_to_keep(&self) -> &Fit {
        if self.is_better() {
            &self.repaired.fit
        } else {
            &self.nominal
        }
    }

    /// The zeros of the sensors under the written model.
    pub fn zeros(&self) -> Zeros {
        Zeros::of(self.fit_to_keep(), &self.data)
    }

    /// The verdict for JSON.
    pub fn verdict(&self, request: &Request<'_>, seconds: f64) -> Verdict {
        let degrees = |radians: f64| tidy(radians.to_degrees());
        let files = request.recordings.iter().chain(request.holdout);
        Verdict {
            schema: SCHEMA,
            verdict: self.finding.answer(),
            strength: match self.finding {
                Finding::Named { strength, .. } => Some(strength),
                _ => None,
            },
            family: (!self.finding.families().is_empty())
                .then(|| family::title(self.finding.families())),
            effects: self.named_effects(),
            alternatives: self
                .finding
                .explanations()
                .iter()
                .map(Explanation::written)
                .collect(),
            adequacy: self.adequacy,
            tolerance_deg: degrees(self.tolerance),
            closure: self.closure.map(|closure| Closure {
                short: tidy(closure.short),
                medium: tidy(closure.medium),
                full: tidy(closure.full),
                overall: tidy(closure.overall),
            }),
            remaining: self.remaining(),
            repair: self.repair(),
            places: self
                .gap
                .features
                .iter()
                .map(|feature| Place {
                    feature: feature.name.to_owned(),
                    share_of_gap: tidy(feature.share),
                    text: feature.text.clone(),
                })
                .collect(),
            rmse_deg: FittedError {
                nominal: degrees(self.nominal.rmse()),
                refit: degrees(self.refit.rmse()),
                repaired: degrees(self.repaired.fit.rmse()),
                noise_floor: degrees(self.floor.rms),
            },
            holdout_rmse_deg: HeldOutError {
                nominal: degrees(self.held_out.nominal),
                refit: degrees(self.held_out.refit),
                repaired: degrees(self.held_out.repaired_on_board),
            },
            nuisance: self.zeros(),
            upload: self.upload(request.file) == Upload::Worth,
            next_experiment: self
                .proposals
                .iter()
                .map(|(proposal, [a, b])| Experiment {
                    protocol: proposal.protocol.name.clone(),
                    tilt_deg: proposal.protocol.setup.tilt_deg,
                    tip_load_g: proposal.protocol.setup.tip_load_g,
                    tube_mm: proposal.protocol.setup.tube_mm,
                    rested_s: proposal.protocol.setup.rested_s,
                    work_min: tidy(plan::work_min(&proposal.protocol)),
                    separates: [a, b].map(|kinds| names(kinds).join("+")).to_vec(),
                    expected_delta_chi2: tidy(proposal.evidence),
                })
                .collect(),
            left_out: self.not_used.clone(),
            recordings: files.map(|file| file.path.display().to_string()).collect(),
            ended: self.ended.as_ref().map(|_| EndedBy::Budget),
            not_tried: self
                .ended
                .as_ref()
                .map(Ended::not_tried)
                .unwrap_or_default(),
            seed: request.seed,
            tool_version: env!("CARGO_PKG_VERSION").to_owned(),
            seconds,
        }
    }

    /// The remaining error of the written model.
    pub fn remaining(&self) -> Remaining {
        /// Least share of the missing force of a feature that is reported.
        const SAYS_SOMETHING: f64 = 0.3;
        let left = self.held_out.repaired_on_board;
        let gap = self.gap_left.as_ref().unwrap_or(&self.gap);
        Remaining {
            rmse_deg: tidy(left.to_degrees()),
            times_noise: tidy(left / self.held_out.floor.max(f64::MIN_POSITIVE)),
            goes_with: gap
                .features
                .first()
                .filter(|feature| feature.share >= SAYS_SOMETHING)
                .map(|feature| feature.name.to_owned()),
        }
    }

    /// What the refitted model leaves beyond the noise on held-out segments (rad).
    pub fn beyond_noise(&self) -> f64 {
        let HeldOut { refit, floor, .. } = self.held_out;
        (refit * refit - floor * floor).max(0.0).sqrt()
    }

    /// The repair without a name.
    fn repair(&self) -> Option<Repair> {
        let unnamed = matches!(
            self.finding,
            Finding::Unexplained { .. } | Finding::OutOfTime { .. }
        );
        let first = self.repaired.added.first().filter(|_| unnamed)?;
        if let Some(table) = self.repaired.fit.model.table() {
            return Some(Repair {
                kind: Kind::Table.name().to_owned(),
                of: vec![table.of().name().to_owned()],
            });
        }
        Some(Repair {
            kind: first.name().to_owned(),
            of: names(&self.repaired.added),
        })
    }

    fn named_effects(&self) -> Vec<NamedEffect> {
        let fit = &self.repaired.fit;
        let first = fit.model.effects().count() - self.repaired.added.len();
        self.repaired
            .added
            .iter()
            .enumerate()
            .filter_map(|(offset, kind)| Some((offset, kind, self.finding.probability_of(*kind)?)))
            .map(|(offset, kind, probability)| {
                let slot = first + offset;
                let mut parameters = serde_json::Map::new();
                let mut interval95 = serde_json::Map::new();
                for (parameter, row) in kind.parameters().iter().enumerate() {
                    let id = ParameterId::Effect { slot, parameter };
                    let shown = |value: f64| tidy(to_file_units(&fit.model, id, value));
                    if let Some(value) = fit.model.value(id) {
                        parameters.insert(row.key.to_owned(), shown(value).into());
                    }
                    let interval = fit
                        .free
                        .iter()
                        .position(|&free| free == id)
                        .and_then(|index| fit.interval95(index));
                    if let Some((low, high)) = interval {
                        let ends = [shown(low), shown(high)];
                        interval95.insert(row.key.to_owned(), ends.into());
                    }
                }
                NamedEffect {
                    kind: kind.name().to_owned(),
                    parameters,
                    interval95,
                    probability,
                }
            })
            .collect()
    }
}
