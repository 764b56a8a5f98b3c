//! From recordings to a verdict: which effect does the model lack?
//!
//! The steps, each a module whose output is data that reports can show:
//!
//! 1. [`quality`] and [`slips`]: recordings that cannot be used are refused, others
//!    noted.
//! 2. [`noise`]: how small a residual can get.
//! 3. [`identify`]: refit, for a wrong parameter is not a missing effect, and
//!    which parameters the recordings determine.
//! 4. Adequate? If what is left cannot be told from noise, stop and say so.
//! 5. [`mod@localise`]: where the gap lives, by a [`smoother`].
//! 6. [`mod@search`]: simulate and fit the [`candidates`] of the catalogue, alone
//!    and [`together`].
//! 7. [`select`]: which structure the recordings ask for, with rivals that
//!    cannot be rejected kept; [`mod@bootstrap`]: could chance have asked for it?
//!    [`holdout`]: does it also hold on runs that were not fitted?
//! 8. [`judge`]; the answer is written as a [`verdict`].
//! 9. [`plan`]: the run that would separate the rivals.
//!
//! A false name is worse than "cannot tell".

pub mod bootstrap;
pub mod candidates;
pub mod holdout;
pub mod identify;
pub mod judge;
pub mod localise;
pub mod noise;
pub mod plan;
pub mod quality;
pub mod search;
pub mod select;
pub mod slips;
pub mod smoother;
pub mod together;
pub mod verdict;

use model_core::actuator::{Model, ParameterId};

use crate::checkpoint::Checkpoint;
use crate::error::InputError;
use crate::fit::{Excerpt, Fit, Fitter, Pieces, Run};
use crate::model_file::{ModelFile, tidy, to_file_units};
use crate::recording::Recording;
use crate::statistics::correlated_rms;
use candidates::{Candidate, Ground, Scales, Untried, applicable};
use holdout::{HeldOut, Judge};
use identify::Identifiability;
use judge::{Court, Findings, Tried};
use localise::{Gap, localise};
use noise::NoiseFloor;
use plan::{Limits, Proposal};
use quality::Concern;
use verdict::{
    Adequacy, Alternative, Answer, Experiment, FittedError, HeldOutError, NamedEffect, Place,
    SCHEMA, Verdict,
};

/// A residual counts as noise if its correlated part stays below this share of
/// the noise floor …
const CORRELATED_SHARE: f64 = 0.15;

/// … and its RMS below this factor of the floor, …
const RMS_FACTOR: f64 = 1.08;

/// … each with as many times what the noise of the measured pressure leaves.
const INPUT_FACTOR: f64 = 1.5;

/// Proposals for the next experiment that are kept.
const PROPOSALS: usize = 3;

/// What to diagnose.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The nominal model.
    pub file: &'a ModelFile,
    /// Recordings to fit.
    pub recordings: &'a [Recording],
    /// Recordings to judge by; if empty, each recording is left out in turn.
    pub holdout: &'a [Recording],
    /// Seed of everything random.
    pub seed: u64,
}

/// Everything that a diagnosis found.
#[derive(Clone, Debug)]
pub struct Diagnosis {
    /// The answer.
    pub answer: Answer,
    /// What is wrong with the recordings themselves.
    pub concerns: Vec<Concern>,
    /// Index of a recording that was left out, since it behaves like another
    /// actuator. Everything per recording is without it.
    pub left_out: Option<usize>,
    /// Noise floor of the fitted recordings.
    pub floor: NoiseFloor,
    /// The nominal model against the recordings.
    pub nominal: Fit,
    /// The nominal structure, refitted.
    pub refit: Fit,
    /// The repaired model; the refit where nothing is named.
    pub repaired: Candidate,
    /// Probability of each named effect, in the order of `repaired.added`.
    pub probability: Vec<f64>,
    /// Which parameters of the refit, and of the repaired model, the
    /// recordings determine.
    pub identifiability: [Identifiability; 2],
    /// Held-out errors.
    pub held_out: HeldOut,
    /// Rivals, best first.
    pub alternatives: Vec<Alternative>,
    /// The best of the rivals that remain, as fitted.
    pub rivals: Vec<Candidate>,
    /// Every structure that was fitted to the end, with its evidence.
    pub tried: Vec<Tried>,
    /// Runs that would separate the surviving rivals, best first.
    pub proposals: Vec<(Proposal, [Vec<String>; 2])>,
    /// The second axis.
    pub adequacy: Adequacy,
    /// Where the gap of the refit lives.
    pub gap: Gap,
    /// Effects that the recordings cannot speak about.
    pub untried: Vec<Untried>,
}

/// Tells a person what is going on during long work.
pub type Progress<'a> = &'a (dyn Fn(&str) + Sync);

/// Diagnoses a model against recordings.
///
/// # Errors
///
/// Refuses a single recording without others to judge by, recordings that are
/// damaged beyond handling, and a model that cannot be simulated.
pub fn diagnose(request: &Request<'_>, progress: Progress<'_>) -> Result<Diagnosis, InputError> {
    diagnose_from(request, &Checkpoint::default(), progress)
}

/// As [`diagnose`], taking up fits that an interrupted run has left.
///
/// # Errors
///
/// As [`diagnose`].
pub fn diagnose_from(
    request: &Request<'_>,
    checkpoint: &Checkpoint,
    progress: Progress<'_>,
) -> Result<Diagnosis, InputError> {
    let recordings = request.recordings;
    if recordings.is_empty() || (recordings.len() < 2 && request.holdout.is_empty()) {
        return Err(InputError::new(
            format!(
                "a diagnosis needs two recordings or more, and {} was given",
                recordings.len()
            ),
            "give more recordings, or name some with --holdout: a cause that was fitted and tested on the same run proves nothing",
        ));
    }
    let found = diagnose_all(request, checkpoint, progress)?;
    let Some(odd) = found.odd else {
        return Ok(found.diagnosis);
    };
    progress("once more, without the recording that does not belong");
    let others: Vec<Recording> = recordings
        .iter()
        .enumerate()
        .filter(|(index, _)| *index != odd.index)
        .map(|(_, recording)| recording.clone())
        .collect();
    let request = Request {
        recordings: &others,
        ..*request
    };
    let mut diagnosis = diagnose_all(&request, checkpoint, progress)?.diagnosis;
    diagnosis.concerns.insert(0, odd.concern);
    diagnosis.left_out = Some(odd.index);
    Ok(diagnosis)
}

/// A diagnosis, and a recording without which it should be made again.
struct Found {
    diagnosis: Diagnosis,
    odd: Option<quality::Odd>,
}

fn diagnose_all(
    request: &Request<'_>,
    checkpoint: &Checkpoint,
    progress: Progress<'_>,
) -> Result<Found, InputError> {
    let Request {
        file,
        recordings,
        holdout,
        ..
    } = *request;
    progress("quality of the recordings");
    let floor = NoiseFloor::of(recordings);
    let mut concerns = quality::examine(recordings, &floor)?;
    if !holdout.is_empty() {
        let found = quality::examine(holdout, &NoiseFloor::of(holdout))?;
        // That none is repeated, or all are short, matters for what is fitted.
        concerns.extend(found.into_iter().filter(|it| it.recording.is_some()));
    }
    slips::refuse(file, recordings)?;
    let runs = Run::all(recordings);
    let fitter = Fitter {
        nominal: &file.model,
        runs: &runs,
    };
    let held_out_runs = Run::all(holdout);
    let nominal = fitter.compare(&file.model);
    progress("refit of the nominal structure");
    let (refit, determined, identified) = identify::refit(file, &fitter);
    let file = &determined;
    if !refit.fit.sse().is_finite() {
        return Err(InputError::new(
            "the model cannot be simulated over these recordings: it diverges",
            "check units and signs of its parameters",
        )
        .in_file(&file.path));
    }
    let floor = floor.with_input(&fitter, &refit.fit.model, request.seed);
    let judge = Judge::new(file, &fitter, &held_out_runs, floor.input);
    progress("where the gap lives");
    let gap = localise(&refit.fit.model, recordings, floor.white);

    let (found, untried) = if adequate(&nominal, &floor) {
        (Findings::nothing(Answer::NoDiscrepancy, &refit), Vec::new())
    } else if adequate(&refit.fit, &floor) {
        (
            Findings::nothing(Answer::ParametersOnly, &refit),
            Vec::new(),
        )
    } else {
        let means = Means {
            checkpoint,
            progress,
            seed: request.seed,
        };
        search_and_judge(file, &fitter, &judge, &floor, &refit, means)
    };

    progress("held-out runs in the board's arithmetic");
    let held_out = judge.errors(&refit, &found.repaired);
    let is_adequate = adequate(&found.repaired.fit, &floor);
    let adequacy = Adequacy {
        adequate: is_adequate,
        holdout_gap_closed: if found.repaired.added.is_empty() {
            0.0
        } else {
            held_out.gap_closed()
        },
        exact_form: is_adequate && held_out.at_noise(),
    };
    let odd = if is_adequate || too_few_to_leave_one_out(recordings, holdout) {
        None
    } else {
        found
            .best
            .iter()
            .chain([&refit])
            .find_map(|candidate| quality::odd_one_out(file, &fitter, candidate, floor.rms))
    };
    concerns.extend(quality::slow_effects(&found.repaired, recordings));
    let proposals = propose(&file.model, &found.rivals, &floor);
    let identifiability = [
        Identifiability::of(&found.repaired.fit, &identified.held),
        identified,
    ];
    let diagnosis = Diagnosis {
        answer: found.answer,
        concerns,
        left_out: None,
        identifiability,
        floor,
        nominal,
        refit: refit.fit,
        repaired: found.repaired,
        probability: found.probability,
        held_out,
        alternatives: found.alternatives,
        rivals: found.rivals,
        tried: found.tried,
        proposals,
        adequacy,
        gap,
        untried,
    };
    Ok(Found { diagnosis, odd })
}

/// What a search is carried out with.
#[derive(Clone, Copy)]
struct Means<'a> {
    checkpoint: &'a Checkpoint,
    progress: Progress<'a>,
    seed: u64,
}

/// Searches the structures that add effects to the refit, and judges them. Also
/// the effects that the recordings cannot speak about.
fn search_and_judge(
    file: &ModelFile,
    fitter: &Fitter<'_, '_>,
    judge: &Judge<'_, '_>,
    floor: &NoiseFloor,
    refit: &Candidate,
    means: Means<'_>,
) -> (Findings, Vec<Untried>) {
    let (kinds, untried) = applicable(&file.model, fitter);
    let pieces = Pieces::of(fitter);
    let excerpt = Excerpt::of(fitter);
    let scales = Scales::of(fitter, &refit.fit);
    let (piece_runs, excerpt_runs) = (pieces.runs(), excerpt.runs());
    let in_pieces = Fitter {
        nominal: &file.model,
        runs: &piece_runs,
    };
    let ground = Ground {
        file,
        fitter,
        pieces: (!in_step(fitter, &refit.fit)).then_some(&in_pieces),
        excerpt: &Fitter {
            nominal: &file.model,
            runs: &excerpt_runs,
        },
        scales: &scales,
        checkpoint: means.checkpoint,
    };
    let pool = search::search(&ground, floor, &kinds, refit, means.progress);
    (means.progress)("judgement on runs that were not fitted");
    let court = Court {
        ground,
        judge,
        floor,
        kinds: &kinds,
        seed: means.seed,
    };
    (court.findings(refit, &pool), untried)
}

/// Whether leaving a recording out would leave too few.
fn too_few_to_leave_one_out(recordings: &[Recording], holdout: &[Recording]) -> bool {
    recordings.len() + holdout.len() < 3
}

/// The runs that separate rivals best, with their names.
fn propose(
    believed: &Model<f64>,
    rivals: &[Candidate],
    floor: &NoiseFloor,
) -> Vec<(Proposal, [Vec<String>; 2])> {
    let names = |index: usize| judge::names(&rivals[index].added);
    plan::proposals(believed, rivals, floor.rms, &Limits::default())
        .into_iter()
        .take(PROPOSALS)
        .map(|proposal| {
            let (a, b) = proposal.separates;
            (proposal, [names(a), names(b)])
        })
        .collect()
}

/// Whether simulation and recordings keep in step: what is left is small
/// against the motion.
fn in_step(fitter: &Fitter<'_, '_>, fit: &Fit) -> bool {
    const SMALL: f64 = 0.15;
    let measured: f64 = fitter
        .runs
        .iter()
        .flat_map(|run| &run.recording.angle)
        .map(|angle| angle * angle)
        .sum();
    fit.sse() <= SMALL * SMALL * measured
}

/// Whether a residual cannot be told from noise.
fn adequate(fit: &Fit, floor: &NoiseFloor) -> bool {
    let correlated = correlated_rms(&fit.residuals);
    let input = INPUT_FACTOR * floor.input;
    correlated <= (CORRELATED_SHARE * floor.rms).hypot(input)
        && fit.rmse() <= (RMS_FACTOR * floor.rms).hypot(input)
}

impl Diagnosis {
    /// The model to go on with: where nothing is wrong with the nominal one, that.
    pub fn model_to_keep<'a>(&'a self, nominal: &'a ModelFile) -> &'a Model<f64> {
        if self.answer == Answer::NoDiscrepancy {
            &nominal.model
        } else {
            &self.repaired.fit.model
        }
    }

    /// The verdict as it is written to JSON.
    pub fn verdict(&self, request: &Request<'_>, seconds: f64) -> Verdict {
        let degrees = |radians: f64| tidy(radians.to_degrees());
        let files = request.recordings.iter().chain(request.holdout);
        Verdict {
            schema: SCHEMA,
            verdict: self.answer,
            effects: self.named_effects(),
            alternatives: self.alternatives.clone(),
            adequacy: self.adequacy,
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
            next_experiment: self
                .proposals
                .iter()
                .map(|(proposal, [a, b])| Experiment {
                    protocol: proposal.protocol.name.clone(),
                    separates: vec![a.join("+"), b.join("+")],
                    expected_delta_chi2: tidy(proposal.evidence),
                })
                .collect(),
            recordings: files.map(|file| file.path.display().to_string()).collect(),
            seed: request.seed,
            tool_version: env!("CARGO_PKG_VERSION").to_owned(),
            seconds,
        }
    }

    fn named_effects(&self) -> Vec<NamedEffect> {
        let fit = &self.repaired.fit;
        let first = fit.model.effects().count() - self.repaired.added.len();
        self.repaired
            .added
            .iter()
            .enumerate()
            .map(|(offset, kind)| {
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
                        interval95.insert(
                            row.key.to_owned(),
                            serde_json::json!([shown(low), shown(high)]),
                        );
                    }
                }
                NamedEffect {
                    kind: kind.name().to_owned(),
                    parameters,
                    interval95,
                    probability: self.probability.get(offset).copied().unwrap_or(0.0),
                }
            })
            .collect()
    }
}
