//! Sessions and their segments.
//!
//! A [`Session`] is simulated whole, from its first sample, with its own clock and
//! zeros. A [`Segment`] is a range of its samples. A segment that is left out is still
//! simulated with its session; only its residuals are not fitted. A segment cannot be
//! simulated alone.

use std::ops::Range;
use std::sync::Arc;

use model_core::actuator::Model;
use model_core::power::Power;

use super::nuisance::{Nuisance, Prior};
use super::placement::Placement;
use crate::estimate::denoise;
use crate::sim::board::{BoardLimit, OnBoard};
use crate::sim::dual::FromF64;
use crate::sim::simulate::{
    Grain, InitialState, Origin, Signal, Stepping, Trajectory, run_as_it_is, run_from,
};
use crate::statistics::swing;
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::KnownRange;
use softrig_formats::recording::Recording;
use softrig_formats::setup::{NewPart, Setup};

/// A recording that is simulated whole.
///
/// Copies share the samples: fits change guesses and priors of many sessions many times,
/// and never a sample.
#[derive(Clone, Debug)]
pub struct Session {
    recording: Arc<Recording>,
    signal: Arc<Signal>,
    prior: Prior,
    guess: Nuisance,
    /// Whether zeros and initial state are estimated; otherwise they are `guess`.
    estimated: bool,
    /// Time on the rig's clock at the first sample (s).
    clock: f64,
    /// How the rig stood.
    placement: Placement,
    interval: f64,
    /// The usual time between samples as they were recorded (s).
    sampled_every: f64,
    largest_angle: f64,
    largest_pressure: f64,
    /// Samples whose angle is not usable.
    silent: Vec<Range<usize>>,
    /// Step length of simulations.
    grain: Grain,
}

/// What the angle sensor shows (rad), its zero included.
fn shown<R: FromF64>(run: Trajectory<R>, nuisance: &Nuisance) -> Vec<f64> {
    let readings = run.reading.into_iter();
    readings
        .map(|reading| reading.to_f64() + nuisance.angle_zero)
        .collect()
}

/// The pressure that drives simulations.
fn signal_of(recording: &Recording) -> Signal {
    let signal = Signal::new(recording.time.clone(), denoise::pressure(recording));
    if recording.columns.band_limited {
        signal.band_limited()
    } else {
        signal
    }
}

impl Session {
    /// Prepares a recording: removes the noise of its pressure, interpolates it, and
    /// finds the initial state. The angle is not usable in `silent`.
    pub fn new(recording: Recording, clock: f64, silent: Vec<Range<usize>>) -> Self {
        let prior = Prior::of(&recording);
        let largest = |values: &[f64]| {
            let values = values.iter();
            values.fold(0.0, |largest: f64, value| value.abs().max(largest))
        };
        Self {
            signal: Arc::new(signal_of(&recording)),
            guess: prior.mean,
            prior,
            estimated: true,
            clock,
            placement: Placement::of_recording(&recording, None),
            interval: recording.interval(),
            sampled_every: recording.interval(),
            largest_angle: largest(&recording.angle),
            largest_pressure: largest(&recording.pressure),
            silent,
            recording: Arc::new(recording),
            grain: Grain::Fine,
        }
    }

    /// The same session with longer integration steps, for ranking.
    pub fn coarse(self) -> Self {
        Self {
            grain: Grain::Coarse,
            ..self
        }
    }

    /// The same session with another measured pressure (Pa).
    pub fn with_pressure(self, pressure: Vec<f64>) -> Self {
        let recording = Recording {
            pressure,
            ..Recording::clone(&self.recording)
        };
        Self {
            signal: Arc::new(signal_of(&recording)),
            recording: Arc::new(recording),
            ..self
        }
    }

    /// The same session after its own input was played once: a period of a steady state, with the
    /// one before it.
    pub fn twice(&self) -> Self {
        let time = &self.recording.time;
        let period = time.last().map_or(0.0, |last| last - time[0]) + self.interval;
        let again = |values: &[f64]| [values, values].concat();
        let later = time.iter().map(|time| time + period);
        let recording = Recording {
            time: time.iter().copied().chain(later).collect(),
            pressure: again(&self.recording.pressure),
            angle: again(&self.recording.angle),
            name: self.recording.name.clone(),
            meta: self.recording.meta.clone(),
            columns: self.recording.columns,
            measurand: self.recording.measurand.clone(),
            ..Recording::default()
        };
        Self {
            placement: self.placement,
            grain: self.grain,
            ..Self::new(recording, self.clock, Vec::new())
        }
    }

    /// The same session of a rig that stood like this.
    pub fn standing(self, placement: Placement) -> Self {
        Self { placement, ..self }
    }

    /// The same session as a part of one that was sampled every so many seconds.
    pub fn sampled(self, every: f64) -> Self {
        Self {
            sampled_every: every,
            ..self
        }
    }

    /// The same session with known zeros and initial state.
    pub fn knowing(self, known: Nuisance) -> Self {
        Self {
            guess: known,
            estimated: false,
            ..self
        }
    }

    /// The same session with a guess and a prior that were found on more samples.
    pub fn guessing(self, guess: Nuisance, prior: &Prior) -> Self {
        Self {
            guess,
            prior: *prior,
            ..self
        }
    }

    /// The whole recording.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// The pressure that drives simulations, its zero not subtracted.
    pub fn signal(&self) -> &Signal {
        &self.signal
    }

    /// The prior of zeros and initial state.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The initial guess of zeros and initial state.
    pub fn guess(&self) -> Nuisance {
        self.guess
    }

    /// Whether zeros and initial state are estimated.
    pub fn is_estimated(&self) -> bool {
        self.estimated
    }

    /// Time on the rig's clock at the first sample (s).
    pub fn clock(&self) -> f64 {
        self.clock
    }

    /// How the rig stood.
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// The model as the rig stood in this session: everything else is shared between sessions.
    pub fn placed<R: FromF64, P: Power<R>>(&self, model: &Model<R, P>) -> Model<R, P> {
        self.placement.place(model)
    }

    /// The usual time between samples (s).
    pub fn interval(&self) -> f64 {
        self.interval
    }

    /// The usual time between samples (s) of the recording, however it is thinned.
    pub fn sampled_every(&self) -> f64 {
        self.sampled_every
    }

    /// Largest pressure measured (Pa), of either sign.
    pub fn largest_pressure(&self) -> f64 {
        self.largest_pressure
    }

    /// Largest angle measured (rad), which bounds the step length.
    pub fn largest_angle(&self) -> f64 {
        self.largest_angle
    }

    /// Samples whose angle is not usable: they are simulated, and not fitted.
    pub fn silent(&self) -> &[Range<usize>] {
        &self.silent
    }

    /// How a model is integrated between two samples.
    pub fn stepping<R: FromF64, P: Power<R>>(&self, model: &Model<R, P>) -> Stepping {
        self.stepping_by(model, Grain::Fine)
    }

    /// The same with steps at least as long as those of `grain`.
    pub fn stepping_by<R: FromF64, P: Power<R>>(
        &self,
        model: &Model<R, P>,
        grain: Grain,
    ) -> Stepping {
        Stepping::of(
            model,
            self.interval,
            self.largest_angle,
            self.grain.max(grain),
        )
    }

    /// The simulated reading of the angle sensor (rad), its zero included.
    pub fn simulate(&self, model: &Model<f64>, nuisance: &Nuisance) -> Vec<f64> {
        let (origin, stepping) = (self.origin(nuisance), self.stepping(model));
        shown(
            run_from(&self.placed(model), &self.signal, origin, stepping),
            nuisance,
        )
    }

    /// The same in another arithmetic.
    pub fn simulate_in<R: FromF64, P: Power<R>>(
        &self,
        model: &Model<R, P>,
        nuisance: &Nuisance,
    ) -> Vec<f64> {
        let (origin, stepping) = (self.origin(nuisance), self.stepping(model));
        shown(
            run_as_it_is(&self.placed(model), &self.signal, origin, stepping),
            nuisance,
        )
    }

    /// The same as the board predicts it.
    ///
    /// # Errors
    ///
    /// [`BoardLimit`].
    pub fn predict(&self, board: &OnBoard, nuisance: &Nuisance) -> Result<Vec<f64>, BoardLimit> {
        let mut readings = board.predict(&self.signal, self.origin(nuisance))?;
        for reading in &mut readings {
            *reading += nuisance.angle_zero;
        }
        Ok(readings)
    }

    /// The origin of a simulation of the session.
    pub fn origin<R: FromF64>(&self, nuisance: &Nuisance) -> Origin<R> {
        Origin {
            start: InitialState {
                angle: R::from_f64(nuisance.start.angle - nuisance.angle_zero),
                rate: R::from_f64(nuisance.start.rate),
            },
            past: R::from_f64(nuisance.past),
            stretched: self.placement.stretched_rad,
            pressure_zero: R::from_f64(nuisance.pressure_zero),
            clock: R::from_f64(self.clock),
        }
    }

    /// For each sample, whether its angle is not usable.
    pub fn silence(&self) -> Vec<bool> {
        let mut silent = vec![false; self.recording.len()];
        for range in &self.silent {
            silent[range.clone()].fill(true);
        }
        silent
    }

    /// Simulated minus measured angle (rad); zero where the measured one is not usable.
    pub fn residual_of(&self, simulated: &[f64]) -> Vec<f64> {
        let mut residual: Vec<f64> = simulated
            .iter()
            .zip(&self.recording.angle)
            .map(|(simulated, measured)| simulated - measured)
            .collect();
        for range in &self.silent {
            residual[range.clone()].fill(0.0);
        }
        residual
    }

    /// The recording with the zeros subtracted.
    pub fn corrected(&self, nuisance: &Nuisance) -> Recording {
        let mut recording = Recording::clone(&self.recording);
        for pressure in &mut recording.pressure {
            *pressure -= nuisance.pressure_zero;
        }
        for angle in &mut recording.angle {
            *angle -= nuisance.angle_zero;
        }
        recording
    }
}

/// A range of a session's samples.
#[derive(Clone, Debug)]
pub struct Segment {
    /// The samples of the segment, with the session's time and a name of their
    /// own.
    pub recording: Recording,
    /// Index of the session.
    pub session: usize,
    /// Its samples there.
    pub range: Range<usize>,
}

/// A segment before it is part of a data set.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Its samples in the session.
    pub range: Range<usize>,
    /// Name and metadata of the segment.
    pub about: Recording,
    /// Whether it is fitted.
    pub fitted: bool,
}

/// Sessions cut into segments, of which some are fitted and others held out.
#[derive(Clone, Debug, Default)]
pub struct Dataset {
    sessions: Vec<Arc<Session>>,
    segments: Vec<Arc<Segment>>,
    /// Whether each segment is fitted.
    fitted: Vec<bool>,
    /// What is known of base parameters beside the recordings.
    known: Vec<KnownRange>,
}

impl Dataset {
    /// A data set of recordings that are sessions of one segment each, all
    /// fitted.
    pub fn of(recordings: &[Recording]) -> Self {
        let mut this = Self::default();
        for recording in recordings {
            let silent = crate::statistics::clipped(&recording.time, &recording.angle);
            let mark = Mark {
                range: 0..recording.len(),
                about: recording.clone(),
                fitted: true,
            };
            this.push(Session::new(recording.clone(), 0.0, silent), vec![mark]);
        }
        this.in_order()
    }

    /// A data set of one recording whose zeros and initial state are known.
    pub fn known(recording: Recording, known: Nuisance) -> Self {
        let mut this = Self::default();
        let mark = Mark {
            range: 0..recording.len(),
            about: Recording::default(),
            fitted: true,
        };
        let session = Session::new(recording, 0.0, Vec::new()).knowing(known);
        this.push(session, vec![mark]);
        this
    }

    /// Adds a session with its segments.
    pub fn push(&mut self, session: Session, marks: Vec<Mark>) {
        let number = self.sessions.len();
        for mark in marks {
            let whole = &session.recording;
            let range = mark.range;
            let recording = Recording {
                name: mark.about.name,
                path: mark.about.path,
                meta: mark.about.meta,
                ..whole.slice(&range)
            };
            self.segments.push(Arc::new(Segment {
                recording,
                session: number,
                range,
            }));
            self.fitted.push(mark.fitted);
        }
        self.sessions.push(Arc::new(session));
    }

    /// The same data with the zero of each session's input known by the range that all of them
    /// used: they have the same sensor.
    fn in_one_range(self) -> Self {
        let used = self.sessions.iter();
        let range = used
            .map(|session| swing(&session.recording.pressure))
            .fold(0.0, f64::max);
        self.mapped(|_, session| {
            let prior = session.prior.in_range(&session.recording, range)?;
            Some(Session {
                prior,
                ..session.clone()
            })
        })
    }

    /// The same data with what belongs to all sessions: the range of the input, lengths of tubes
    /// from the first that is said, and how far the actuator was bent before.
    #[must_use]
    pub fn in_order(self) -> Self {
        self.in_one_range().placed_in_order()
    }

    fn placed_in_order(self) -> Self {
        let mut sessions = self.sessions.iter();
        if sessions.all(|session| session.recording.meta.setup.is_none()) {
            return self;
        }
        let tube_mm = self.tube_mm();
        let mut bent = 0.0;
        let mut placements = self.sessions.iter().map(|session| {
            let setup = session.recording.meta.setup.as_ref();
            if setup.is_some_and(|setup| setup.new_part == Some(NewPart::Actuator)) {
                bent = 0.0;
            }
            let has_rested = setup.is_some_and(Setup::has_rested);
            let before = if has_rested { bent } else { 0.0 };
            bent = session.largest_angle.max(bent);
            Placement {
                stretched_rad: before,
                ..Placement::of_recording(&session.recording, tube_mm)
            }
        });
        self.mapped(|_, session| {
            let placement = placements.next()?;
            Some(Session {
                placement,
                ..session.clone()
            })
        })
    }

    /// Length of the tube to the actuator for which models of these data are written (mm): the
    /// first that a session says.
    pub fn tube_mm(&self) -> Option<f64> {
        let mut sessions = self.sessions.iter();
        sessions.find_map(|session| session.recording.meta.setup.as_ref()?.tube_mm)
    }

    /// The same data of a rig that stood like this in all sessions.
    #[must_use]
    pub fn standing(&self, placement: Placement) -> Self {
        self.mapped(|_, session| Some(session.clone().standing(placement)))
    }

    /// The sessions.
    pub fn sessions(&self) -> &[Arc<Session>] {
        &self.sessions
    }

    /// All segments, session by session.
    pub fn segments(&self) -> &[Arc<Segment>] {
        &self.segments
    }

    /// Indices of the segments that are fitted, or of those that are not.
    pub fn indices(&self, fitted: bool) -> Vec<usize> {
        (0..self.segments.len())
            .filter(|&index| self.fitted[index] == fitted)
            .collect()
    }

    /// The segments that are fitted.
    pub fn fitted(&self) -> impl Iterator<Item = &Segment> {
        self.chosen(true)
    }

    /// The segments that are held out.
    pub fn held_out(&self) -> impl Iterator<Item = &Segment> {
        self.chosen(false)
    }

    fn chosen(&self, fitted: bool) -> impl Iterator<Item = &Segment> {
        self.segments
            .iter()
            .zip(&self.fitted)
            .filter(move |(_, is)| **is == fitted)
            .map(|(segment, _)| segment.as_ref())
    }

    /// What the output is, as results show it: that of the first session.
    pub fn measurand(&self) -> Measurand {
        let first = self.sessions.first();
        first.map_or_else(Measurand::default, |it| it.recording.measurand.clone())
    }

    /// When time 0 of a segment was (s since 1970, UTC), if that is known: it is that of its
    /// session, of which the file may be another than that of the segment.
    pub fn zero_unix_s(&self, segment: &Segment) -> Option<f64> {
        let session = self.sessions.get(segment.session)?;
        session.recording.zero_unix_s()
    }

    /// Copies of the recordings of the segments that are fitted, or of those
    /// that are not.
    pub fn recordings(&self, fitted: bool) -> Vec<Recording> {
        self.chosen(fitted)
            .map(|segment| segment.recording.clone())
            .collect()
    }

    /// Number of samples that are fitted.
    pub fn samples(&self) -> usize {
        self.fitted().map(|segment| segment.range.len()).sum()
    }

    /// Largest angle measured (rad).
    pub fn largest_angle(&self) -> f64 {
        self.sessions
            .iter()
            .map(|session| session.largest_angle)
            .fold(0.0, f64::max)
    }

    /// The same data with some fitted segments left out, by their place among the
    /// fitted ones.
    pub fn without(&self, places: &[usize]) -> Self {
        let mut this = self.clone();
        for (place, index) in self.indices(true).into_iter().enumerate() {
            if places.contains(&place) {
                this.fitted[index] = false;
            }
        }
        this
    }

    /// The same data without the fitted segment at this place, as if it did not exist.
    pub fn dropping(&self, place: usize) -> Self {
        let mut this = self.clone();
        if let Some(&index) = self.indices(true).get(place) {
            this.segments.remove(index);
            this.fitted.remove(index);
        }
        this
    }

    /// The same data with all segments fitted.
    pub fn all_fitted(&self) -> Self {
        Self {
            fitted: vec![true; self.segments.len()],
            ..self.clone()
        }
    }

    /// A data set of only the fitted segments at these places.
    pub fn only(&self, places: &[usize]) -> Self {
        let mut this = self.clone();
        for (place, index) in self.indices(true).into_iter().enumerate() {
            this.fitted[index] = places.contains(&place);
        }
        this
    }

    /// The same data with better guesses of zeros and initial states, one per session.
    pub fn guessing(&self, nuisances: &[Nuisance]) -> Self {
        self.mapped(|index, session| {
            nuisances
                .get(index)
                .filter(|_| session.estimated)
                .map(|guess| Session {
                    guess: *guess,
                    ..session.clone()
                })
        })
    }

    /// Zeros and initial states of every session, as they are expected before any fit.
    pub fn expected(&self) -> Vec<Nuisance> {
        let sessions = self.sessions.iter();
        let of_session = |session: &Arc<Session>| {
            if session.estimated {
                session.prior.mean
            } else {
                session.guess
            }
        };
        sessions.map(of_session).collect()
    }

    /// The same data, with what is known of base parameters beside it.
    pub fn knowing(self, known: &[KnownRange]) -> Self {
        Self {
            known: known.to_vec(),
            ..self
        }
    }

    /// What is known of base parameters beside the recordings.
    pub fn known_ranges(&self) -> &[KnownRange] {
        &self.known
    }

    /// The same data with the measured angles moved by `by` (rad).
    pub fn shifted(&self, by: f64) -> Self {
        let moved = |recording: &Recording| Recording {
            angle: recording.angle.iter().map(|angle| angle + by).collect(),
            ..recording.clone()
        };
        let mut shifted = self.mapped(|_, session| {
            let fresh = Session::new(
                moved(&session.recording),
                session.clock,
                session.silent.clone(),
            );
            Some(Session {
                sampled_every: session.sampled_every,
                grain: session.grain,
                placement: session.placement,
                ..fresh
            })
        });
        for segment in &mut shifted.segments {
            *segment = Arc::new(Segment {
                recording: moved(&segment.recording),
                ..Segment::clone(segment)
            });
        }
        shifted
    }

    /// The same data with the zeros taken to be calibrated: their prior standard
    /// deviation is a small part of the usual one.
    pub fn calibrated(&self) -> Self {
        /// Share of the usual standard deviation.
        const PART: f64 = 0.05;
        self.mapped(|_, session| {
            let mut session = session.clone();
            session.prior = session.prior.sharpened(PART);
            session.guess = session.prior.mean;
            Some(session)
        })
    }

    /// The same data whose fitted sessions start where so many first samples say, wherever these
    /// follow a parabola ([`Prior::starting_from`]).
    pub fn starting_from(&self, samples: usize) -> Self {
        self.mapped(|_, session| {
            let prior = session.prior.starting_from(&session.recording, samples)?;
            Some(Session {
                prior,
                guess: prior.mean,
                ..session.clone()
            })
        })
    }

    /// The same data with zeros whose departures weigh `zero_weight` times the noise: the
    /// model error times the root of its correlation time in samples.
    pub fn weighing_zeros(&self, zero_weight: f64) -> Self {
        self.mapped(|_, session| {
            let mut session = session.clone();
            session.prior.zero_weight = zero_weight;
            Some(session)
        })
    }

    /// The same data with the base turned by other angles (rad), by session.
    pub fn turned_as(&self, turned: impl Fn(usize, &Session) -> f64) -> Self {
        self.mapped(|index, session| {
            let turned = turned(index, session);
            let mut recording = Recording::clone(&session.recording);
            // Parts of the session are placed by what is said of it.
            let setup = recording.meta.setup.get_or_insert_default();
            setup.tilt_deg = Some(turned.to_degrees());
            Some(Session {
                placement: Placement {
                    turned_rad: turned,
                    ..session.placement
                },
                recording: Arc::new(recording),
                ..session.clone()
            })
        })
    }

    fn mapped(&self, mut change: impl FnMut(usize, &Session) -> Option<Session>) -> Self {
        Self {
            sessions: self
                .sessions
                .iter()
                .enumerate()
                .map(|(index, session)| {
                    change(index, session).map_or_else(|| Arc::clone(session), Arc::new)
                })
                .collect(),
            ..self.clone()
        }
    }

    /// The fitted samples of a session; empty if none of its segments is fitted.
    pub fn fitted_ranges(&self, session: usize) -> Vec<Range<usize>> {
        self.ranges(session, true)
    }

    /// The ranges of a session that are fitted, or that are held out.
    pub fn ranges(&self, session: usize, fitted: bool) -> Vec<Range<usize>> {
        let first = self.segments.partition_point(|it| it.session < session);
        self.segments[first..]
            .iter()
            .zip(&self.fitted[first..])
            .take_while(|(segment, _)| segment.session == session)
            .filter(|(_, is)| **is == fitted)
            .map(|(segment, _)| segment.range.clone())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::fit::Effort;
    use crate::estimate::fitter::Fitter;
    use crate::statistics::rms;
    use model_core::actuator::ParameterId;
    use model_core::catalogue::{Effect, Kind};
    use model_core::dynamics::Dynamics;

    /// Samples of a step and its release, 100 a second.
    const STEP: usize = 600;

    fn model(effects: &[Effect<f64>]) -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.3,
            damping: 1.6,
            stiffness: 3.8,
            exponent: 1.727,
            input_gain: 1.2e-4,
        };
        Model::new(dynamics, effects).unwrap()
    }

    /// Steps of these pressures (Pa), each released again, behind a rest; and what
    /// the sensors show of a model without noise.
    fn recorded(model: &Model<f64>, steps: &[f64], known: &Nuisance) -> Recording {
        let time: Vec<f64> = (0..steps.len() * STEP).map(|k| k as f64 * 0.01).collect();
        let pressure = (0..time.len()).map(|k| {
            let share = (k % STEP) as f64 / STEP as f64;
            // Up within a third of a second, down within half.
            let up = ((share - 0.1) / 0.05).clamp(0.0, 1.0);
            let down = ((share - 0.6) / 0.08).clamp(0.0, 1.0);
            known.pressure_zero + steps[k / STEP] * (up - down)
        });
        let mut recording = Recording {
            angle: vec![0.0; time.len()],
            pressure: pressure.collect(),
            time,
            ..Recording::default()
        };
        // Steps of integration depend on the reach of the measured angle.
        for _ in 0..2 {
            let session = Session::new(recording.clone(), 0.0, Vec::new());
            recording.angle = session.simulate(model, known);
        }
        recording
    }

    fn mark(range: Range<usize>, fitted: bool) -> Mark {
        Mark {
            range,
            about: Recording::default(),
            fitted,
        }
    }

    /// The error on the held-out segment (rad), and the estimated past of its session (rad).
    fn held_out(model: &Model<f64>, data: &Dataset) -> (f64, f64) {
        let found = Fitter::new(model, data).validate(model);
        assert_eq!(found.residuals.len(), 1);
        assert_eq!(found.residuals[0].len(), STEP);
        (rms(&found.residuals[0]), found.nuisances[0].past)
    }

    /// What sessions are for: a memory that was made before a segment begins.
    #[test]
    fn a_held_out_segment_keeps_the_memory_of_its_session() {
        for (kind, values) in [
            (Kind::MullinsSoftening, &[0.4, 0.5][..]),
            (Kind::BoucWenHysteresis, &[0.4, 0.2, 0.5]),
        ] {
            let model = model(&[kind.build(values).unwrap()]);
            let steps = [60e3, 20e3, 40e3];
            let recording = recorded(&model, &steps, &Nuisance::AT_ZERO);
            let last = 2 * STEP..3 * STEP;

            let mut whole = Dataset::default();
            whole.push(
                Session::new(recording.clone(), 0.0, Vec::new()),
                vec![
                    mark(0..STEP, true),
                    mark(STEP..2 * STEP, true),
                    mark(last.clone(), false),
                ],
            );
            let (kept, past) = held_out(&model, &whole);

            let cut = Recording {
                time: recording.time[last.clone()].to_vec(),
                pressure: recording.pressure[last.clone()].to_vec(),
                angle: recording.angle[last].to_vec(),
                ..Recording::default()
            };
            let mut alone = Dataset::default();
            let session = Session::new(cut, 0.0, Vec::new());
            alone.push(session, vec![mark(0..STEP, false)]);
            let (lost, guessed) = held_out(&model, &alone);

            println!(
                "{}: {kept:e} rad whole, {lost:e} rad cut, past {past:e} and {guessed:e} rad",
                kind.name()
            );
            assert!(kept < 1e-9, "{}: {kept}", kind.name());
            assert!(past.abs() < 1e-9, "{}: {past}", kind.name());
            // A piece has lost a twentieth of a degree, or has to estimate its past.
            assert!(lost > 1e-3 || guessed.abs() > 1e-2, "{}", kind.name());
        }
    }

    /// A piece of a longer recording that begins while the actuator still creeps: the
    /// dashpot's extension by its own equation, integrated along the recorded angle, is what
    /// the fit estimates.
    #[test]
    fn a_recording_that_begins_in_mid_creep_has_a_past() {
        const TAU: f64 = 2.5;
        let model = model(&[Kind::MaxwellBranch.build(&[1.5, TAU, 0.0]).unwrap()]);
        let whole = recorded(&model, &[60e3, 20e3, 40e3], &Nuisance::AT_ZERO);
        let first = 2 * STEP - STEP / 3;
        let mut extension = whole.angle[0];
        for pair in whole.angle[..=first].windows(2) {
            // Exact for an angle that is constant over an interval.
            let middle = f64::midpoint(pair[0], pair[1]);
            extension = middle + (extension - middle) * (-0.01 / TAU).exp();
        }
        let past = extension - whole.angle[first];

        let piece = Recording {
            time: whole.time[first..].to_vec(),
            pressure: whole.pressure[first..].to_vec(),
            angle: whole.angle[first..].to_vec(),
            ..Recording::default()
        };
        let data = Dataset::of(&[piece]);
        let fit = Fitter::new(&model, &data).compare(&model);
        let found = fit.nuisances[0].past;
        println!("past {past} rad, found {found}, {:e} rad left", fit.rmse());
        assert!(past.abs() > 0.01, "{past}");
        assert!(
            (found - past).abs() < 0.05 * past.abs(),
            "{found}, not {past}"
        );
        assert!(fit.rmse() < 1e-4, "{:e}", fit.rmse());
    }

    #[test]
    fn zeros_of_the_sensors_are_found_with_the_parameters() {
        let truth = model(&[]);
        let angle_zero = 1f64.to_radians();
        let known = Nuisance {
            pressure_zero: 350.0,
            angle_zero,
            start: InitialState {
                angle: angle_zero,
                rate: 0.0,
            },
            past: 0.0,
        };
        let recording = recorded(&truth, &[15e3, 30e3, 60e3], &known);
        let data = Dataset::of(&[recording]);
        let nominal = truth
            .with_value(ParameterId::Damping, 1.4)
            .with_value(ParameterId::Stiffness, 4.1)
            .with_value(ParameterId::InputGain, 1.1e-4);
        let free = [
            ParameterId::Damping,
            ParameterId::Stiffness,
            ParameterId::InputGain,
        ];
        let fitter = Fitter::new(&nominal, &data);
        let fit = fitter.fit(&nominal, &free, Effort::Full);
        let found = fit.nuisances[0];
        println!("{found:?}, {:e} rad", fit.rmse());
        assert!((found.pressure_zero - 350.0).abs() < 20.0, "{found:?}");
        assert!(
            (found.angle_zero - angle_zero).abs() < 0.05f64.to_radians(),
            "{found:?}"
        );
        for id in free {
            let (found, truth) = (fit.model.value(id).unwrap(), truth.value(id).unwrap());
            assert!(
                (found / truth - 1.0).abs() < 2e-3,
                "{id:?}: {found}, not {truth}"
            );
        }
    }
}
