//! The result of a diagnosis, and what is said and written of it.

pub mod repair;

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;
use softrig_formats::family::{self, names};
use softrig_formats::left_out::LeftOut;
use softrig_formats::model_file::to_file_units;
use softrig_formats::numbers::tidy;

use super::decide::finding::{Explanation, Finding};
use super::decide::verdict::{
    Adequacy, EndedBy, Experiment, FittedError, HeldOutError, NamedEffect, Place, Remaining,
    Repair, SCHEMA, Step, TestError, Verdict,
};
use super::evidence::free_run::{self, FittedModel, TestRun};
use super::evidence::measure::{Closure, leaves_beyond};
use super::evidence::validation::HeldOut;
use super::experiment::plan::{Limits, Proposal, propose, work_min};
use super::fit::candidates::{Candidate, SkippedEffect};
use super::fit::identifiability::Identifiability;
use super::recordings::noise::NoiseFloor;
use super::recordings::quality::Concern;
use super::score::grammar::is_term;
use super::score::localise::Gap;
use super::score::steps::StepGap;
use super::search::selection::FittedStructure;
use super::work::budget::BudgetEnd;
use super::work::request::Request;
use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::start_from::StartFrom;
use crate::estimate::usable::Matter;
use repair::Upload;
use softrig_formats::recording::Recording;

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
    /// Errors on the test recordings, which chose nothing; empty if there are none.
    pub test: Vec<TestRun>,
    /// The best of the rivals that remain, as fitted.
    pub rivals: Vec<Candidate>,
    /// Every structure with a final fit, with its evidence.
    pub tried: Vec<FittedStructure>,
    /// Runs that would separate the surviving rivals, best first.
    pub proposals: Vec<(Proposal, [Vec<Kind>; 2])>,
    /// Formulas that push like one of those that were tried: that one, and they.
    pub alike: Vec<[Kind; 2]>,
    /// Whether the repaired model is adequate.
    pub adequacy: Adequacy,
    /// The missing force of the refit, and its features.
    pub gap: Gap,
    /// Features of the responses to steps in which the refit is off.
    pub steps: Vec<StepGap>,
    /// Effects that were not tried, because they do not apply or the time was up.
    pub untried: Vec<SkippedEffect>,
    /// The parts that were not done, if a budget ended the search.
    pub ended: Option<BudgetEnd>,
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
    pub(super) fn of(
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

impl Diagnosis {
    /// A value of the output (rad) with its unit: `0.52°`, or `0.52 mm` where that is what the
    /// column holds.
    pub fn shown(&self, radians: f64) -> String {
        self.data.measurand().value(radians)
    }

    /// The nominal, the refitted and the repaired model over test recordings, whose angle at rest
    /// (rad) is subtracted as from those that were fitted.
    pub(super) fn tested(
        &self,
        tests: &[(&Recording, StartFrom)],
        subtracted: f64,
    ) -> Vec<TestRun> {
        let fits = [&self.nominal, &self.refit, &self.repaired.fit];
        let models = fits.map(|fit| FittedModel::of(fit, &self.data));
        free_run::runs(tests, &models, &self.data, subtracted)
    }

    /// The runs that separate the rivals best within other limits than those of [`Limits::default`]
    /// and of the recordings, with the effects that they separate.
    pub fn experiments_within(
        &self,
        request: &Request<'_>,
        limits: Limits,
    ) -> Vec<(Proposal, [Vec<Kind>; 2])> {
        propose(&request.file.model, &self.rivals, self.floor.rms, &limits)
    }

    /// The concern that a session stood otherwise than its metadata say, on which the answer then
    /// rests.
    pub fn contradicted_setup(&self) -> Option<&Concern> {
        let mut concerns = self.concerns.iter();
        concerns.find(|concern| concern.matter == Matter::Turned)
    }

    /// Formulas that push like this one in these recordings.
    pub fn alike_to(&self, kind: Kind) -> impl Iterator<Item = Kind> {
        let pairs = self.alike.iter().filter(move |[own, _]| *own == kind);
        pairs.map(|[_, other]| *other)
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
            steps: self
                .steps
                .iter()
                .map(|it| Step {
                    feature: it.feature.name().to_owned(),
                    measured: tidy(it.measured),
                    simulated: tidy(it.simulated),
                    steps: it.steps,
                    alike: it.alike,
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
            test: self.test.iter().map(TestError::of).collect(),
            nuisance: self.zeros(),
            upload: self.upload(request.file) == Upload::Worth,
            upload_refused: match self.upload(request.file) {
                Upload::Refused(why) => Some(why),
                Upload::Worth | Upload::Unchanged => None,
            },
            simulation: None,
            next_experiment: self
                .proposals
                .iter()
                .map(|(proposal, [a, b])| Experiment {
                    protocol: proposal.protocol.name.clone(),
                    tilt_deg: proposal.protocol.setup.tilt_deg,
                    tip_load_g: proposal.protocol.setup.tip_load_g,
                    tube_mm: proposal.protocol.setup.tube_mm,
                    rested_s: proposal.protocol.setup.rested_s,
                    work_min: tidy(work_min(&proposal.protocol)),
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
                .map(BudgetEnd::not_tried)
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

    /// What the refitted model leaves beyond the noise (rad), as the answer is made by it.
    pub fn beyond_noise(&self) -> f64 {
        let errors = [self.refit.rmse(), self.held_out.refit];
        leaves_beyond(errors, self.floor.total())
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
                    formula: is_term(*kind).then(|| kind.info().equation.to_owned()),
                    title: is_term(*kind).then(|| kind.info().title.to_owned()),
                    alike: self
                        .alike_to(*kind)
                        .map(|other| other.info().equation.to_owned())
                        .collect(),
                }
            })
            .collect()
    }
}
