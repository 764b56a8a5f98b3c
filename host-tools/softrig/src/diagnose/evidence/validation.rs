//! Validation: errors on segments that were not fitted.
//!
//! `--holdout` recordings are simulated with the fitted model. Without them, segments are
//! left out in turn (cross-validation), repeats of one run together: a repeat that stays in
//! the fit would give the answer away. A left-out segment is simulated with its session,
//! whose zeros and initial state come from the other segments. If nothing of a session is
//! fitted, its zeros and initial state are estimated on it, and nothing else.
//!
//! Leave-out fits use one Gauss–Newton step ([`crate::estimate::information`]), and are
//! refitted only where that cannot be trusted.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;

use crate::diagnose::fit::candidates::{Candidate, free_parameters};
use crate::diagnose::recordings::noise::{NoiseFloor, repeats};
use crate::diagnose::work::policy::Policy;
use crate::estimate::fit::Effort;
use crate::estimate::fitter::{Fitter, Validation};
use crate::estimate::horizon::{Squares, block_errors};
use crate::estimate::placement::Placement;
use crate::estimate::{Dataset, Segment};
use crate::sim::board::{self, OnBoard};
use softrig_formats::model_file::{ModelFile, parameters};

/// Fewest different runs. With fewer, leaving one out would ask for extrapolation, and
/// repeats are left out one by one.
const FEWEST_UNITS: usize = 5;

/// Number of folds where repeats are not kept together.
const FOLDS: usize = 4;

/// Largest number of folds. Each fit then uses 90 % of the data, and the time is linear in the
/// number of runs.
const MOST_FOLDS: usize = 10;

/// Leave-out fits use one Gauss–Newton step; they are refitted if the squared error on the
/// omitted segments exceeds this multiple of the full fit's.
const TRUSTED: f64 = 1.2;

/// Steps of these: the full fit is near, and a thousandth of the error decides nothing.
const REFITTED: Effort = Effort::Steps(4);

/// Held-out errors (rad).
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// The model as supplied.
    pub nominal: f64,
    /// The nominal structure, refitted.
    pub refit: f64,
    /// The repaired model.
    pub repaired: f64,
    /// What the board predicts with the repaired model; where it cannot, as `repaired`.
    pub repaired_on_board: f64,
    /// Noise floor of the held-out runs.
    pub floor: f64,
    /// Whether segments were left out in turn rather than given by `--holdout`.
    pub in_turn: bool,
    /// Whether all held-out runs repeat fitted ones.
    pub only_repeats: bool,
    /// Errors of each held-out run.
    pub runs: Vec<HeldOutRun>,
}

/// Errors (rad) on one held-out run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOutRun {
    /// The model as supplied.
    pub nominal: f64,
    /// The nominal structure, refitted.
    pub refit: f64,
    /// What the board predicts with the repaired model, where it can.
    pub repaired_on_board: f64,
}

impl HeldOut {
    /// Share of the gap between refit and noise floor that the repair removes.
    pub fn gap_closed(&self) -> f64 {
        share_closed(self.refit, self.repaired, self.floor)
    }

    /// Whether the repaired model leaves only noise.
    pub fn at_noise(&self) -> bool {
        self.repaired <= Policy::STANDARD.at_noise * self.floor
    }
}

/// Share of the gap between `before` and `floor` that `after` removes, at most
/// 1; negative for a repair that makes it worse.
pub fn share_closed(before: f64, after: f64, floor: f64) -> f64 {
    let gap = before - floor;
    if gap <= 0.0 {
        return 0.0;
    }
    ((before - after) / gap).clamp(-1.0, 1.0)
}

/// RMS errors (rad) at three horizons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Over a quarter of a swing.
    pub short: f64,
    /// Over two and a half swings.
    pub medium: f64,
    /// Over whole segments.
    pub full: f64,
}

impl Errors {
    /// From the squared errors of each segment: short, medium, full.
    pub fn of(segments: &[[Squares; 3]]) -> Self {
        let [short, medium, full] = std::array::from_fn(|horizon| {
            let all = segments.iter().map(|squares| squares[horizon]);
            all.fold(Squares::default(), Squares::with).mean().sqrt()
        });
        Self {
            short,
            medium,
            full,
        }
    }

    /// In the order of the horizons.
    pub fn values(&self) -> [f64; 3] {
        [self.short, self.medium, self.full]
    }
}

/// Squared errors of each segment: over blocks of two horizons, and over whole segments
/// from these residuals (rad).
pub fn at_horizons(
    residuals: &[Vec<f64>],
    horizons: [f64; 2],
    over_blocks: impl Fn(f64) -> Vec<Squares>,
) -> Vec<[Squares; 3]> {
    let [short, medium] = horizons.map(over_blocks);
    residuals
        .iter()
        .map(|residual| Squares::of(residual))
        .zip(short.into_iter().zip(medium))
        .map(|(full, (short, medium))| [short, medium, full])
        .collect()
}

/// A fold of a structure: the model as fitted without it, and what that leaves there.
#[derive(Clone)]
struct LeftOut {
    model: Model<f64>,
    validation: Validation,
}

/// The folds of a structure, in the order of the validator's; one where segments are held out.
type Folds = Arc<Vec<LeftOut>>;

/// Whether zeros and initial states of sessions that are fitted in part are estimated anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Zeros {
    Anew,
    /// A few segments hardly change them.
    AsFitted,
}

/// A structure as fitted: the key of its held-out errors. Two fits of one structure
/// predict differently.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    added: Vec<Kind>,
    free: Vec<ParameterId>,
    values: Vec<u64>,
    level: Option<u64>,
}

impl Key {
    fn of(candidate: &Candidate) -> Self {
        let fit = &candidate.fit;
        Self {
            added: candidate.added.clone(),
            free: fit.free.clone(),
            values: parameters(&fit.model)
                .into_iter()
                .filter_map(|(id, _)| fit.model.value(id))
                .map(f64::to_bits)
                .collect(),
            level: candidate.level.map(|level| level.intensity.to_bits()),
        }
    }
}

/// Validates structures on held-out segments.
pub struct CrossValidator<'a> {
    file: &'a ModelFile,
    /// The data with its held-out segments; if there are none, the fitted ones are left out
    /// in turn.
    fitter: &'a Fitter<'a>,
    /// The model as supplied.
    supplied: Model<f64>,
    /// Fitted segments of each fold, by index; empty if some segments are held out.
    folds: Vec<Vec<usize>>,
    /// Noise floor of the held-out segments (rad).
    floor: f64,
    /// Whether every held-out segment repeats a fitted one.
    only_repeats: bool,
    /// RMS error (rad) of a fit up to which it is worth another without each fold.
    refitted_up_to: f64,
    /// What was found before: several steps need the same.
    memo: Mutex<BTreeMap<(Key, Zeros), Folds>>,
}

impl<'a> CrossValidator<'a> {
    /// Creates a cross-validator. `input` (rad) is the error from noise of the pressure.
    pub fn new(file: &'a ModelFile, fitter: &'a Fitter<'a>, input: f64) -> Self {
        Self::with_folds(file, fitter, input, MOST_FOLDS)
    }

    /// The same with at most `most` folds: fewer are faster and stricter.
    pub fn with_folds(
        file: &'a ModelFile,
        fitter: &'a Fitter<'a>,
        input: f64,
        most: usize,
    ) -> Self {
        let fitted = fitter.data.recordings(true);
        let given = fitter.data.recordings(false);
        let (floor, folds, only_repeats) = if given.is_empty() {
            let floor = NoiseFloor::of(&fitted);
            let folds = merged(folds(fitted.len(), &floor.groups), most);
            let only_repeats = folds.iter().all(|fold| {
                let fitted = |other: &usize| !fold.contains(other);
                fold.iter()
                    .all(|&run| repeats_one(run, &floor.groups, fitted))
            });
            (floor, folds, only_repeats)
        } else {
            let floor = NoiseFloor::of(&given);
            let count = fitted.len();
            let all = [fitted, given].concat();
            let groups = repeats(&all);
            let only_repeats =
                (count..all.len()).all(|run| repeats_one(run, &groups, |&other| other < count));
            (floor, Vec::new(), only_repeats)
        };
        Self {
            file,
            fitter,
            supplied: file.model,
            folds,
            floor: libm::hypot(floor.rms, input),
            only_repeats,
            refitted_up_to: f64::INFINITY,
            memo: Mutex::default(),
        }
    }

    /// The same beside the model as supplied, where the file's was refitted.
    pub fn beside(self, supplied: Model<f64>) -> Self {
        Self { supplied, ..self }
    }

    /// The fitter to the data with its held-out segments.
    pub fn fitter(&self) -> &'a Fitter<'a> {
        self.fitter
    }

    /// Raises the floor (rad) to one that includes the rig's repeatability.
    pub fn raise_floor(&mut self, rms: f64) {
        self.floor = self.floor.max(rms);
    }

    /// Skips the leave-out refits of structures that leave more than `most` (rad) where they are
    /// fitted: they are not rivals, and one step has to do even where it leaves them worse.
    pub fn refitting_up_to(&mut self, most: f64) {
        self.refitted_up_to = most;
    }

    /// RMS error (rad) of a fitted structure on held-out runs.
    pub fn error_of(&self, candidate: &Candidate) -> f64 {
        self.rms(&self.squares_of(candidate))
    }

    /// Sum of squared errors of a fitted structure on each run.
    fn squares_of(&self, candidate: &Candidate) -> Vec<f64> {
        let folds = self.left_out(candidate, Zeros::Anew);
        self.in_order(&folds, |_, fold| squares(&fold.validation.residuals))
    }

    /// The noise floor of the held-out runs (rad).
    pub fn floor(&self) -> f64 {
        self.floor
    }

    /// Whether every held-out run repeats a fitted one.
    pub fn has_only_repeats(&self) -> bool {
        self.only_repeats
    }

    /// RMS error (rad) over all segments, from the sum of each.
    fn rms(&self, squares: &[f64]) -> f64 {
        let samples: usize = self.lengths().iter().sum();
        (squares.iter().sum::<f64>() / samples.max(1) as f64).sqrt()
    }

    /// Number of samples of each held-out segment.
    fn lengths(&self) -> Vec<usize> {
        let length = |segment: &Segment| segment.range.len();
        if self.in_turn() {
            self.fitter.data.fitted().map(length).collect()
        } else {
            self.fitter.data.held_out().map(length).collect()
        }
    }

    /// Whether segments are left out in turn rather than given by `--holdout`.
    pub fn in_turn(&self) -> bool {
        !self.folds.is_empty()
    }

    /// Share of the held-out gap between refit and noise floor that a structure
    /// removes.
    pub fn gap_closed(&self, refit: &Candidate, candidate: &Candidate) -> f64 {
        share_closed(self.error_of(refit), self.error_of(candidate), self.floor)
    }

    /// Errors of the nominal model, its refit and the repaired one.
    pub fn errors(&self, refit: &Candidate, repaired: &Candidate) -> HeldOut {
        let lengths = self.lengths();
        let nominal = self.nominal_squares();
        let before = self.squares_of(refit);
        let folds = self.left_out(repaired, Zeros::Anew);
        let after = self.in_order(&folds, board_squares);
        let each = |run: usize, squares: &[f64]| {
            let samples = lengths[run].max(1) as f64;
            (squares.get(run).copied().unwrap_or(0.0) / samples).sqrt()
        };
        HeldOut {
            nominal: self.rms(&nominal),
            refit: self.rms(&before),
            repaired: if repaired.added.is_empty() {
                self.rms(&before)
            } else {
                self.error_of(repaired)
            },
            repaired_on_board: self.rms(&after),
            floor: self.floor,
            in_turn: self.in_turn(),
            only_repeats: self.only_repeats,
            runs: (0..lengths.len())
                .map(|run| HeldOutRun {
                    nominal: each(run, &nominal),
                    refit: each(run, &before),
                    repaired_on_board: each(run, &after),
                })
                .collect(),
        }
    }

    /// RMS error of the model as supplied (rad).
    pub fn nominal_error(&self) -> f64 {
        self.rms(&self.nominal_squares())
    }

    /// Squared errors of the supplied model on each segment; its zeros and initial states
    /// are estimated without that segment as well.
    fn nominal_squares(&self) -> Vec<f64> {
        let validated = self.data_of_folds().map(|data| {
            let fitter = self.of(&data);
            LeftOut {
                model: self.supplied,
                validation: fitter.validate(&self.supplied),
            }
        });
        let folds: Vec<LeftOut> = validated.collect();
        self.in_order(&folds, |_, fold| squares(&fold.validation.residuals))
    }

    /// Residuals (rad) of a fitted structure on each held-out segment.
    pub fn residuals_of(&self, candidate: &Candidate) -> Vec<Vec<f64>> {
        let folds = self.left_out(candidate, Zeros::AsFitted);
        self.in_order(&folds, |_, fold| fold.validation.residuals.clone())
    }

    /// RMS errors (rad) of a fitted structure on held-out segments, over blocks of two horizons
    /// (s) and over whole segments.
    pub fn predicted(&self, candidate: &Candidate, horizons: [f64; 2]) -> Errors {
        let folds = self.left_out(candidate, Zeros::AsFitted);
        let found: Vec<[Squares; 3]> = self.in_order(&folds, |data, fold| {
            let LeftOut { model, validation } = fold;
            at_horizons(&validation.residuals, horizons, |horizon| {
                block_errors(model, data, &validation.nuisances, horizon, false)
            })
        });
        Errors::of(&found)
    }

    /// The data with its held-out segments, or without each fold in turn.
    fn data_of_folds(&self) -> impl Iterator<Item = Cow<'a, Dataset>> {
        let data = self.fitter.data;
        let all = (!self.in_turn()).then_some(Cow::Borrowed(data));
        let without = |fold: &Vec<usize>| Cow::Owned(data.without(fold));
        all.into_iter().chain(self.folds.iter().map(without))
    }

    fn of<'b>(&self, data: &'b Dataset) -> Fitter<'b>
    where
        'a: 'b,
    {
        Fitter::new(self.fitter.nominal, data)
    }

    /// What is taken of each segment of each fold, in the order of the segments.
    fn in_order<T: Default + Clone>(
        &self,
        folds: &[LeftOut],
        take: impl Fn(&Dataset, &LeftOut) -> Vec<T>,
    ) -> Vec<T> {
        let mut taken = self
            .data_of_folds()
            .zip(folds)
            .map(|(data, fold)| take(&data, fold));
        if !self.in_turn() {
            return taken.next().unwrap_or_default();
        }
        let mut each = vec![T::default(); self.lengths().len()];
        for (fold, found) in self.folds.iter().zip(taken) {
            let mut places = fold.clone();
            places.sort_unstable();
            for (run, it) in places.into_iter().zip(found) {
                each[run] = it;
            }
        }
        each
    }

    /// A structure without each fold. It is kept, unless there are so many samples that every
    /// structure's would need more memory than all else.
    fn left_out(&self, candidate: &Candidate, zeros: Zeros) -> Folds {
        /// Most samples of data whose residuals are kept.
        const KEPT: usize = 300_000;
        let mut sessions = self.fitter.data.sessions().iter().enumerate();
        let in_part = |(index, _)| {
            let data = self.fitter.data;
            data.ranges(index, true).len() + data.ranges(index, false).len() > 1
        };
        // A session that is held out whole has no zeros from elsewhere.
        let zeros = if sessions.any(in_part) {
            zeros
        } else {
            Zeros::AsFitted
        };
        let key = (Key::of(candidate), zeros);
        let memo = || self.memo.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = memo().get(&key) {
            return Arc::clone(known);
        }
        let folds = self.data_of_folds().enumerate().map(|(place, data)| {
            let fold = self.folds.get(place);
            match fold {
                Some(fold) => self.without_fold(candidate, &data, fold, zeros),
                None => validated(&self.of(&data), &candidate.fit.model, zeros),
            }
        });
        let found: Folds = Arc::new(folds.collect());
        if self.fitter.data.samples() <= KEPT {
            memo().insert(key, Arc::clone(&found));
        }
        found
    }

    /// A structure without a fold that `rest` holds out.
    fn without_fold(
        &self,
        candidate: &Candidate,
        rest: &Dataset,
        fold: &[usize],
        zeros: Zeros,
    ) -> LeftOut {
        // Zeros and initial states hardly change without a few segments.
        let data = rest.guessing(&candidate.fit.nuisances);
        let rest = &self.of(&data);
        // A much worse error suggests that the step left the range of the quadratic
        // approximation.
        let is_rival = candidate.added.is_empty() || candidate.fit.rmse() <= self.refitted_up_to;
        let by_step = candidate
            .fit
            .without(fold)
            .map(|model| validated(rest, &model, zeros))
            .filter(|found| {
                let fitted: f64 = fold
                    .iter()
                    .filter_map(|&run| candidate.fit.residuals.get(run))
                    .flatten()
                    .map(|residual| residual * residual)
                    .sum();
                let left: f64 = squares(&found.validation.residuals).iter().sum();
                left <= TRUSTED * fitted || !is_rival && left.is_finite()
            });
        by_step.unwrap_or_else(|| {
            let free = if candidate.fit.free.is_empty() {
                free_parameters(self.file, &candidate.added)
            } else {
                candidate.fit.free.clone()
            };
            let refitted =
                rest.at(candidate.level.as_ref())
                    .fit(&candidate.fit.model, &free, REFITTED);
            validated(rest, &refitted.model, zeros)
        })
    }
}

/// A model on what is held out.
fn validated(fitter: &Fitter<'_>, model: &Model<f64>, zeros: Zeros) -> LeftOut {
    LeftOut {
        model: *model,
        validation: match zeros {
            Zeros::Anew => fitter.validate(model),
            Zeros::AsFitted => fitter.validate_near(model),
        },
    }
}

/// Assigns runs to folds: repeats together, or one by one if there are too few different
/// runs.
fn folds(runs: usize, repeats: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let mut units: Vec<Vec<usize>> = Vec::new();
    for index in 0..runs {
        match repeats.iter().find(|group| group.contains(&index)) {
            Some(group) if group.first() == Some(&index) => units.push(group.clone()),
            Some(_) => {}
            None => units.push(vec![index]),
        }
    }
    if units.len() >= FEWEST_UNITS {
        return units;
    }
    // Every fold keeps other repeats of its runs in the fit.
    let mut folds = vec![Vec::new(); FOLDS.min(runs)];
    for (place, unit) in units.into_iter().enumerate() {
        for (member, run) in unit.into_iter().enumerate() {
            let fold = (place + member) % folds.len();
            folds[fold].push(run);
        }
    }
    folds.retain(|fold| !fold.is_empty());
    folds
}

/// Merges folds into at most `most`.
fn merged(folds: Vec<Vec<usize>>, most: usize) -> Vec<Vec<usize>> {
    if folds.len() <= most {
        return folds;
    }
    let mut merged = vec![Vec::new(); most];
    for (place, fold) in folds.into_iter().enumerate() {
        merged[place % most].extend(fold);
    }
    merged
}

/// Whether a run repeats one of those for which `fitted` holds.
fn repeats_one(run: usize, repeats: &[Vec<usize>], fitted: impl Fn(&usize) -> bool) -> bool {
    repeats
        .iter()
        .any(|group| group.contains(&run) && group.iter().any(&fitted))
}

/// Sum of squares of each run.
fn squares(residuals: &[Vec<f64>]) -> Vec<f64> {
    residuals
        .iter()
        .map(|residual| residual.iter().map(|r| r * r).sum())
        .collect()
}

/// Squared errors of what the board predicts with a model, with zeros and initial states
/// estimated in `f64`. Where the board cannot step the model or see the pressure, they are
/// those in `f64`: what is said of the repair does not depend on a board that will not run it.
fn board_squares(data: &Dataset, fold: &LeftOut) -> Vec<f64> {
    let LeftOut { model, validation } = fold;
    let Validation {
        residuals,
        nuisances,
    } = validation;
    let farthest = board::farthest(data.largest_angle());
    let prepared = |stood: Placement| OnBoard::new(&stood.place(model), farthest).ok();
    // Most sessions have the setup of the one before.
    let mut last: Option<(Placement, Option<OnBoard>)> = None;
    let mut found = residuals.clone();
    let mut places = found.iter_mut();
    for (index, (session, nuisance)) in data.sessions().iter().zip(nuisances).enumerate() {
        let ranges = data.ranges(index, false);
        let stood = session.placement();
        let (_, board) = match last.take() {
            Some(board) if board.0 == stood => last.insert(board),
            _ => last.insert((stood, prepared(stood))),
        };
        let predicted = board
            .as_ref()
            .filter(|_| !ranges.is_empty())
            .and_then(|board| session.predict(board, nuisance).ok());
        let residual = predicted.map(|predicted| session.residual_of(&predicted));
        for (range, place) in ranges.into_iter().zip(&mut places) {
            if let Some(residual) = &residual {
                *place = residual[range].to_vec();
            }
        }
    }
    squares(&found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::dataset::Mark;
    use crate::estimate::{Nuisance, Session};
    use crate::synth::example::{Hidden, make};
    use model_core::predictor::Predictor;
    use softrig_formats::recording::Recording;
    use std::path::Path;

    /// A model, and six recordings of an actuator that hides this.
    fn example(hidden: Hidden) -> (ModelFile, Dataset) {
        let example = make(hidden, 0.05, 3).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example
            .recordings
            .into_iter()
            .map(|it| it.1)
            .take(6)
            .collect();
        (file, Dataset::of(&recordings))
    }

    /// What was found for one fit of a structure says nothing of another.
    #[test]
    fn two_fits_of_one_structure_have_their_own_errors() {
        let (file, data) = example(Hidden::Effect(Kind::CubicStiffness));
        let fitter = Fitter::new(&file.model, &data);
        let fit = |from: &Model<f64>| Candidate::of(0, fitter.compare(from));
        let right = fit(&file.model);
        let off = fit(&file.model.with_value(ParameterId::Stiffness, 100.0));
        let errors = |first: &Candidate, then: &Candidate| {
            let validator = CrossValidator::new(&file, &fitter, 0.0);
            [first, then].map(|it| validator.residuals_of(it).concat())
        };
        let [a, b] = errors(&right, &off);
        let [c, d] = errors(&off, &right);
        assert_eq!([&a, &b], [&d, &c]);
    }

    /// Not by another integrator in single precision.
    #[allow(clippy::cast_possible_truncation)]
    #[test]
    fn the_error_on_the_board_is_that_of_its_predictor() {
        let example = make(Hidden::Effect(Kind::CoulombFriction), 0.05, 3).unwrap();
        let file = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
        let mut data = Dataset::default();
        let mut squares = 0.0;
        let mut samples = 0;
        let narrow: Model<f32> = file.model.map(|value| value as f32);
        let predictor = Predictor::new(&narrow, board::farthest(0.0)).unwrap();
        for (place, (_, recording, _)) in example.recordings.into_iter().take(6).enumerate() {
            let fitted = place < 4;
            let session = Session::new(recording.clone(), 0.0, Vec::new());
            let session = session.knowing(Nuisance::AT_ZERO);
            if !fitted {
                let line = |pressure: &f64| (pressure / 10.0).round() as i32;
                let pressure = session.signal().values();
                let mut prediction = predictor.start(0, line(&pressure[0]));
                samples += recording.len();
                squares += recording.angle[0].powi(2);
                for (pressure, angle) in pressure.iter().zip(&recording.angle).skip(1) {
                    predictor.step(&mut prediction, Some(line(pressure)));
                    squares += (f64::from(prediction.reading()) - angle).powi(2);
                }
            }
            let mark = Mark {
                range: 0..recording.len(),
                about: recording,
                fitted,
            };
            data.push(session, vec![mark]);
        }
        let fitter = Fitter::new(&file.model, &data);
        let candidate = Candidate::of(0, fitter.compare(&file.model));
        let validator = CrossValidator::new(&file, &fitter, 0.0);
        let found = validator.errors(&candidate, &candidate);
        let directly = (squares / samples as f64).sqrt();
        let gap = found.repaired_on_board / directly - 1.0;
        assert!(gap.abs() < 1e-9, "{found:?} {directly}");
        let runs: f64 = found.runs.iter().map(|run| run.repaired_on_board).sum();
        assert!(runs > directly && found.repaired > 0.0);
        assert!(found.repaired_on_board.to_bits() != found.repaired.to_bits());
    }

    /// A dead time that the board has no memory for.
    #[test]
    fn where_the_board_cannot_step_the_error_is_that_of_the_computer() {
        let (file, data) = example(Hidden::Nothing);
        let data = data.without(&[4, 5]);
        let late = Kind::DeadTime.build(&[0.7]).unwrap();
        let model = Model::new(*file.model.dynamics(), &[late]).unwrap();
        let fitter = Fitter::new(&model, &data);
        let candidate = Candidate::of(0, fitter.compare(&model));
        let validator = CrossValidator::new(&file, &fitter, 0.0);
        let found = validator.errors(&candidate, &candidate);
        assert!(OnBoard::new(&model, 2.3).is_err());
        assert!(
            (found.repaired_on_board - found.repaired).abs() < 1e-12,
            "{found:?}"
        );
    }

    #[test]
    fn repeats_are_left_out_together_unless_too_few_runs_differ() {
        let together = folds(7, &[vec![0, 2], vec![1, 5]]);
        assert_eq!(
            together,
            [vec![0, 2], vec![1, 5], vec![3], vec![4], vec![6]]
        );
        let apart = folds(6, &[vec![0, 1, 2], vec![3, 4, 5]]);
        assert_eq!(apart, [vec![0], vec![1, 3], vec![2, 4], vec![5]]);
        // Four steps, played twice: each fold leaves one of every step.
        let steps = folds(8, &[vec![0, 4], vec![1, 5], vec![2, 6], vec![3, 7]]);
        assert_eq!(steps, [vec![0, 7], vec![4, 1], vec![5, 2], vec![6, 3]]);
    }

    #[test]
    fn share_closed_of_all_none_and_worse() {
        assert!((share_closed(2.0, 0.5, 0.5) - 1.0).abs() < 1e-12);
        assert!((share_closed(2.0, 1.25, 0.5) - 0.5).abs() < 1e-12);
        assert!(share_closed(2.0, 2.0, 0.5).abs() < 1e-12);
        assert!(share_closed(2.0, 2.3, 0.5) < 0.0);
        // Below the floor there is no gap to close.
        assert!(share_closed(0.4, 0.3, 0.5).abs() < 1e-12);
    }
}
