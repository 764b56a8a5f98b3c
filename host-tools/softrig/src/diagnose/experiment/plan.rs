//! Plans the next experiment: the run that best separates the remaining rivals.
//!
//! Candidate runs are simulated with each rival. Where another setup of the rig changes what a rival
//! says, they are simulated for that too: no pressure tells a weight from a spring, and a person
//! would turn the rig. With rival A taken as true, rival B is refitted within the information of the
//! existing recordings. Its remaining error, in units of the noise, is the expected evidence of the
//! run (T-optimality: Atkinson and Fedorov 1975).

use std::cmp::Ordering;

use model_core::actuator::Model;
use model_core::catalogue::Kind;
use model_core::effects::Change;
use nalgebra::{DMatrix, DVector, RowSVector};
use rayon::prelude::*;
use wire::decimal::Hundredths;
use wire::protocol::{ControlMode, Named, Segment, total_ms};

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::work::policy::Policy;
use crate::estimate::fitter::Fitter;
use crate::estimate::nuisance::Prior;
use crate::estimate::placement::Placement;
use crate::estimate::{Dataset, Nuisance, Session};
use crate::sim::protocol::play;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::{Meta, PASCAL_PER_KPA, Recording};
use softrig_formats::setup::Setup;

/// Evidence (Δχ²) from which a run is expected to separate two rivals: very strong (Kass and
/// Raftery 1995: 10) for the best of some dozens of runs.
pub const VERY_STRONG: f64 = 20.0;

/// Evidence (Δχ²) about one pair beyond which more decides nothing.
const BEYOND_DOUBT: f64 = 5.0 * VERY_STRONG;

/// The share of a run that the angle sensor has to show for a person to call it a recording.
const SEEN: f64 = 0.9;

/// Minutes that any run needs beside its own time: to start it and to look at it.
const ANY_RUN_MIN: f64 = 1.0;

/// Minutes to turn the base.
const TURN_MIN: f64 = 1.0;

/// Minutes to hang something at the tip.
const LOAD_MIN: f64 = 1.0;

/// Minutes to put in another tube and to see that it is tight.
const TUBE_MIN: f64 = 5.0;

/// Minutes to put in another part and to calibrate it.
const PART_MIN: f64 = 30.0;

/// How many times as long another tube is.
const LONGER: f64 = 4.0;

/// How many times as heavy another load is.
const HEAVIER: f64 = 2.0;

/// How long a rest is proposed (s): a person has a coffee, and the bench cools down.
const REST_S: f64 = 600.0;

/// Minutes of work and waiting that a run needs.
pub fn work_min(protocol: &ProtocolFile) -> f64 {
    let setup = &protocol.setup;
    let each = [
        setup.tilt_deg.map(|_| TURN_MIN),
        setup.tip_load_g.map(|_| LOAD_MIN),
        setup.tube_mm.map(|_| TUBE_MIN),
        setup.rested_s.map(|seconds| seconds / 60.0),
        setup.new_part.map(|_| PART_MIN),
    ];
    let run_min = f64::from(protocol.total_ms()) / 60_000.0;
    ANY_RUN_MIN + run_min + each.into_iter().flatten().sum::<f64>()
}

/// Samples per second of a simulated run.
const RATE_HZ: u32 = 50;

/// The limits of the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Highest set-point (°).
    pub highest_deg: f64,
    /// Highest pressure (kPa).
    pub highest_kpa: f64,
    /// Longest run (s).
    pub longest_s: f64,
    /// The angles (rad) between which the angle sensor was calibrated; none where that is not
    /// known. What lies beyond is not fitted, and decides nothing.
    pub shown: Option<[f64; 2]>,
    /// Length of the tube in the recordings so far (mm), where they say it.
    pub tube_mm: Option<f64>,
    /// How far the actuator was bent so far (rad).
    pub stretched_rad: f64,
    /// The largest load that hung at its tip so far (g), so that its lever is known; none if
    /// nothing did.
    pub load_g: Option<f64>,
}

impl Limits {
    /// The same with what these recordings say of the rig: the range of the angle sensor (the
    /// narrowest where they differ), the tube, and how far the actuator was bent.
    #[must_use]
    pub fn of_rig(self, recordings: &[Recording]) -> Self {
        let ranges = recordings
            .iter()
            .filter_map(|recording| recording.meta.angle_range_deg)
            .map(|range| range.map(f64::to_radians));
        let narrowest = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        let setups = || recordings.iter().filter_map(|it| it.meta.setup.as_ref());
        let loads = setups().filter_map(|setup| setup.tip_load_g);
        let angles = recordings.iter().flat_map(|recording| &recording.angle);
        let sizes = angles.map(|angle| angle.abs()).filter(|it| it.is_finite());
        Self {
            shown: ranges.reduce(narrowest),
            tube_mm: setups().find_map(|setup| setup.tube_mm),
            load_g: loads.filter(|&grams| grams > 0.0).reduce(f64::max),
            stretched_rad: sizes.fold(0.0, f64::max),
            ..self
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            highest_deg: 90.0,
            highest_kpa: 170.0,
            longest_s: 180.0,
            shown: None,
            tube_mm: None,
            stretched_rad: 0.0,
            load_g: None,
        }
    }
}

/// A proposed run with its expected evidence.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// The run, and the setup of the rig for it.
    pub protocol: ProtocolFile,
    /// By index, the pair of rivals that it separates least among those that it tells apart; if it
    /// tells none apart, the pair that it separates most.
    pub separates: (usize, usize),
    /// Expected evidence about that pair (twice a log-likelihood ratio).
    pub evidence: f64,
    /// Whether that is expected to be enough.
    pub decides: bool,
}

/// Ranks runs that separate `rivals`, best first: runs that are expected to tell a pair of them
/// apart, among these the ones that the angle sensor shows, then by the pairs told apart per minute
/// of work ([`work_min`]). Where no pair is, by the evidence about all pairs per minute. `noise` is
/// the standard deviation of the measured angle (rad).
///
/// The smaller evidence of both directions, either rival taken as true, counts.
pub fn proposals(
    nominal: &Model<f64>,
    rivals: &[Candidate],
    noise: f64,
    limits: &Limits,
) -> Vec<Proposal> {
    if rivals.len() < 2 {
        return Vec::new();
    }
    let runs = protocols(limits);
    let mut proposals: Vec<(Rank, Proposal)> = setups(rivals, limits)
        .into_par_iter()
        .flat_map(|setup| {
            let runs = runs.par_iter();
            runs.map(move |protocol| protocol.clone().standing(setup.clone()))
        })
        .filter_map(|protocol| {
            let recording = drive(&protocol, nominal, limits)?;
            let prior = Prior::of(&recording);
            let runs: Vec<PredictedRun> = rivals
                .iter()
                .map(|rival| PredictedRun::of(rival, nominal, &recording, &prior, noise, limits))
                .collect::<Option<_>>()?;
            let pairs = (0..rivals.len()).flat_map(|a| (a + 1..rivals.len()).map(move |b| (a, b)));
            let each: Vec<((usize, usize), Separation)> = pairs
                .map(|(a, b)| {
                    let one_way = |truth: usize, rival: usize| {
                        missed(
                            &runs[truth],
                            &runs[rival],
                            &rivals[rival],
                            noise,
                            limits.shown,
                        )
                    };
                    ((a, b), one_way(a, b).or_less(one_way(b, a)))
                })
                .filter(|(_, it)| it.evidence.is_finite())
                .collect();
            let by_evidence = |a: &&((usize, usize), Separation),
                               b: &&((usize, usize), Separation)| {
                a.1.evidence.total_cmp(&b.1.evidence)
            };
            let told: Vec<_> = each.iter().filter(|(_, it)| it.is_told()).collect();
            let least_told = told.iter().copied().min_by(by_evidence);
            let &(separates, Separation { evidence, .. }) =
                least_told.or_else(|| each.iter().max_by(by_evidence))?;
            let minutes = work_min(&protocol);
            let capped = each.iter().map(|(_, it)| it.evidence.min(BEYOND_DOUBT));
            let rank = Rank {
                decides: least_told.is_some(),
                is_seen: runs.iter().all(|run| run.is_seen(limits.shown)),
                told_in_a_minute: told.len() as f64 / minutes,
                evidence_in_a_minute: capped.sum::<f64>() / minutes,
            };
            let proposal = Proposal {
                protocol,
                separates,
                evidence,
                decides: rank.decides,
            };
            Some((rank, proposal))
        })
        .collect();
    proposals.sort_by(|(a, _), (b, _)| b.compare(a));
    proposals
        .into_iter()
        .map(|(_, proposal)| proposal)
        .collect()
}

/// How far a run separates two rivals.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Separation {
    /// Twice the logarithm of a likelihood ratio, as if the formulas were exact.
    evidence: f64,
    /// Mean square of what the rival cannot follow, in squares of the noise.
    excess: f64,
}

impl Separation {
    /// The lesser of two.
    fn or_less(self, other: Self) -> Self {
        if other.evidence < self.evidence {
            other
        } else {
            self
        }
    }

    /// Whether the rival would be left behind. In thousands of samples a difference far below
    /// the noise is very strong evidence between two exact formulas, and no formula is exact: a
    /// rival that leaves an error comparable with that of the best stays one.
    fn is_told(&self) -> bool {
        let times = (1.0 + self.excess).sqrt();
        self.evidence >= VERY_STRONG && times > Policy::STANDARD.comparable
    }
}

/// What a run is ranked by, the first first.
#[derive(Clone, Copy, Debug)]
struct Rank {
    /// Whether it is expected to tell a pair of rivals.
    decides: bool,
    /// Whether the angle sensor shows it.
    is_seen: bool,
    /// Pairs of rivals told in a minute of work.
    told_in_a_minute: f64,
    /// Evidence about all pairs in a minute of work, of each at most what is beyond doubt.
    evidence_in_a_minute: f64,
}

impl Rank {
    fn compare(&self, other: &Self) -> Ordering {
        let first = (self.decides, self.is_seen).cmp(&(other.decides, other.is_seen));
        let told = self.told_in_a_minute.total_cmp(&other.told_in_a_minute);
        let evidence = self
            .evidence_in_a_minute
            .total_cmp(&other.evidence_in_a_minute);
        first.then(told).then(evidence)
    }
}

/// How the rig could stand: as it does, and changed where that changes what a rival says.
///
/// Where one of the rivals is a weight, on a base that is turned by 90° one way or the other. Where
/// one is a lag of the air, with a longer tube, if it is known how long it was; with twice the load,
/// if one hung at the tip before and its lever is known; where one is a loss by the first stretch,
/// after a rest, which everything else forgets.
fn setups(rivals: &[Candidate], limits: &Limits) -> Vec<Setup> {
    /// A quarter of a turn (°), one way and the other: the weight pulls most at the zero of the
    /// angle, and the actuator sags where its sensor sees it or where it does not.
    const TURNED: [f64; 2] = [90.0, -90.0];
    let tells = |change: Change| {
        rivals.iter().any(|rival| {
            let mut effects = rival.fit.model.effects();
            effects.any(|effect| effect.kind().info().told_by.contains(&change))
        })
    };
    let usual = Setup::default;
    // What the first stretch has taken is not there to be seen again: all that such a run says
    // is that nothing is forgotten over a rest.
    let as_it_is = if tells(Change::Rested) && limits.stretched_rad > 0.0 {
        Setup {
            rested_s: Some(REST_S),
            ..usual()
        }
    } else {
        usual()
    };
    let mut all = vec![as_it_is];
    if tells(Change::Turned) {
        all.extend(TURNED.map(|tilt| Setup {
            tilt_deg: Some(tilt),
            ..usual()
        }));
    }
    // Its weight and its inertia move with one lever, which no lag and no spring imitates.
    all.extend(limits.load_g.map(|grams| Setup {
        tip_load_g: Some(HEAVIER * grams),
        ..usual()
    }));
    if tells(Change::LongerTube) {
        all.extend(limits.tube_mm.map(|tube_mm| Setup {
            tube_mm: Some(LONGER * tube_mm),
            ..usual()
        }));
    }
    all
}

/// Where an actuator rests without pressure (rad): a turned one sags.
fn resting(model: &Model<f64>) -> f64 {
    /// Halvings of half a turn: a millionth of a radian.
    const HALVINGS: usize = 21;
    let [mut low, mut high] = [-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2];
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if model.holding_pressure(middle) * model.dynamics().input_gain > 0.0 {
            high = middle;
        } else {
            low = middle;
        }
    }
    f64::midpoint(low, high)
}

/// Unknowns of a session's own: both zeros, the initial angle, and the sensor's curve.
const OWN: usize = 5;

/// A run simulated with one rival.
struct PredictedRun {
    /// The sensor reading (rad); the actuator rests at first.
    shown: DVector<f64>,
    /// The first reading (rad).
    start: f64,
    /// Derivatives by its parameters, in the solver coordinates of its fit.
    by_parameters: DMatrix<f64>,
    /// Derivatives by the session's own unknowns, in prior standard deviations: the
    /// pressure zero, the angle zero at the same motion, the initial angle, and a square and
    /// a cubic of the sensor's curve.
    by_nuisance: DMatrix<f64>,
    /// Standard deviation of the zero of the angle (rad).
    zero_deviation: f64,
    /// Standard deviation of the measured initial angle (rad).
    start_deviation: f64,
}

impl PredictedRun {
    /// Whether a sensor with such a range (rad) shows it, and where it begins.
    fn is_seen(&self, sensor: Option<[f64; 2]>) -> bool {
        let Some([low, high]) = sensor else {
            return true;
        };
        let range = low..=high;
        let shown = self.shown.iter().filter(|it| range.contains(*it)).count();
        range.contains(&self.start) && shown as f64 >= SEEN * self.shown.len() as f64
    }

    /// The run of a rival under the pressure of `recording`; none without samples.
    fn of(
        rival: &Candidate,
        nominal: &Model<f64>,
        recording: &Recording,
        prior: &Prior,
        noise: f64,
        limits: &Limits,
    ) -> Option<Self> {
        /// Step of the finite differences, in standard deviations.
        const STEP: f64 = 0.1;
        let model = &rival.fit.model;
        let mut rest = Nuisance::AT_ZERO;
        let placement = Placement {
            stretched_rad: limits.stretched_rad,
            ..Placement::of_recording(recording, limits.tube_mm)
        };
        let placed = placement.place(model);
        let settled = if placement.moves_the_rest() {
            resting(&placed)
        } else {
            0.0
        };
        rest.start.angle = placed.reading(&placed.at_rest(settled, 0.0));
        let data = Dataset::known(recording.clone(), rest).standing(placement);
        let session: &Session = data.sessions().first()?;
        let shown = |nuisance: &Nuisance| DVector::from_vec(session.simulate(model, nuisance));
        // One sample gives the initial angle, with the noise as its standard deviation.
        let start_deviation = noise.max(1e-6);
        let zero_deviation = prior.deviation.angle_zero;
        let slope = |moved: &dyn Fn(f64) -> Nuisance| {
            (shown(&moved(STEP)) - shown(&moved(-STEP))) / (2.0 * STEP)
        };
        let by_pressure_zero = slope(&|by| Nuisance {
            pressure_zero: by * prior.deviation.pressure_zero,
            ..rest
        });
        let by_start = slope(&|by| {
            let mut moved = rest;
            moved.start.angle += by * start_deviation;
            moved
        });
        let by_angle_zero = DVector::from_element(by_start.len(), zero_deviation);
        let as_shown = shown(&rest);
        let range = as_shown.amax().max(f64::MIN_POSITIVE);
        let off = Policy::STANDARD.tolerance * range;
        let [square, cubic] = [2, 3].map(|power| as_shown.map(|it| off * (it / range).powi(power)));
        Some(Self {
            shown: as_shown,
            start: rest.start.angle,
            by_parameters: Fitter::new(nominal, &data).derivatives(&rival.fit),
            by_nuisance: DMatrix::from_columns(&[
                by_pressure_zero,
                by_angle_zero,
                by_start,
                square,
                cubic,
            ]),
            zero_deviation,
            start_deviation,
        })
    }
}

/// The remaining error of a rival against the assumed truth, after its parameters, zeros
/// and initial angle are refitted within their priors. Angles that the sensor does not show
/// (rad) count for nothing.
///
/// ```text
/// Δχ² = min over dp, dz of |δ − J dp − N dz|²/σ² + dpᵀ Λ dp + Σ (dz/s)²,   δ = y_A − y_B
/// ```
///
/// with J the derivatives of B's run by its parameters and Λ the information matrix of the existing
/// recordings (a profile likelihood to second order). The zeros of both sensors and the initial
/// state are estimated in every fit, so differences that they can compensate are no evidence: N are
/// the derivatives of B's run by them, and s their prior standard deviations ([`Prior`]). Nor is
/// what the sensor's own curve can be off: a square and a cubic of the angle, each known to a share
/// of the range.
fn missed(
    truth: &PredictedRun,
    rival: &PredictedRun,
    candidate: &Candidate,
    noise: f64,
    sensor: Option<[f64; 2]>,
) -> Separation {
    // The number of samples that would be recorded.
    let weight = 100.0 / f64::from(RATE_HZ);
    let variance = noise.powi(2).max(1e-12);
    let mut shown = truth.shown.len();
    let (parameters, nuisance) = (&rival.by_parameters, &rival.by_nuisance);
    let mut difference = &truth.shown - &rival.shown;
    let (free, own) = (parameters.ncols(), nuisance.ncols());
    let mut jacobian = DMatrix::zeros(difference.len(), free + own);
    jacobian.columns_mut(0, free).copy_from(parameters);
    jacobian.columns_mut(free, own).copy_from(nuisance);
    for (row, angle) in truth.shown.iter().enumerate() {
        if sensor.is_some_and(|[low, high]| !(low..=high).contains(angle)) {
            shown -= 1;
            difference[row] = 0.0;
            jacobian.row_mut(row).fill(0.0);
        }
    }
    let mut scaled = jacobian.tr_mul(&difference) * weight;
    let mut normal = jacobian.tr_mul(&jacobian) * weight;
    if let Some(known) = candidate.fit.curvature() {
        let mut of_parameters = normal.view_mut((0, 0), (free, free));
        of_parameters += known;
    }
    // Prior means: both zeros are zero, and the initial angle is that of the assumed truth;
    // all in their standard deviations.
    let measured = (truth.start - rival.start) / rival.start_deviation;
    let of_zero = rival.zero_deviation / rival.start_deviation;
    let known_before = [
        ([1.0, 0.0, 0.0, 0.0, 0.0], 0.0),
        ([0.0, 1.0, 0.0, 0.0, 0.0], 0.0),
        ([0.0, of_zero, 1.0, 0.0, 0.0], measured),
        ([0.0, 0.0, 0.0, 1.0, 0.0], 0.0),
        ([0.0, 0.0, 0.0, 0.0, 1.0], 0.0),
    ];
    let mut unmoved = weight * difference.norm_squared();
    for (row, value) in known_before {
        let row = RowSVector::<f64, OWN>::from(row);
        let mut of_nuisance = normal.view_mut((free, free), (own, own));
        of_nuisance += row.transpose() * row * variance;
        let mut moved = scaled.rows_mut(free, own);
        moved += row.transpose() * value * variance;
        unmoved += value * value * variance;
    }
    for k in 0..normal.nrows() {
        normal[(k, k)] += 1e-9 * normal[(k, k)] + f64::MIN_POSITIVE;
    }
    let absorbed = normal
        .cholesky()
        .map_or(0.0, |factor| scaled.dot(&factor.solve(&scaled)));
    let evidence = (unmoved - absorbed).max(0.0) / variance;
    Separation {
        evidence,
        excess: evidence / (weight * shown.max(1) as f64),
    }
}

/// The pressure of a protocol played by a board, as a recording without measured angles;
/// none if it exceeds the limits.
fn drive(protocol: &ProtocolFile, nominal: &Model<f64>, limits: &Limits) -> Option<Recording> {
    let play = play(protocol, nominal, RATE_HZ);
    let within = |command: &f64| command.abs() <= limits.highest_kpa * PASCAL_PER_KPA;
    play.command.iter().all(within).then_some(Recording {
        name: protocol.name.clone(),
        time: play.time,
        pressure: play.pressure,
        // A rough angle, which bounds the step length.
        angle: play.setpoint,
        meta: Meta {
            setup: Some(protocol.setup.clone()),
            ..Meta::default()
        },
        ..Recording::default()
    })
}

/// The candidate runs: the named protocols of every board, and families of others.
///
/// Families of steps, ramps, small reversals, holds and multisines, within the limits.
pub fn protocols(limits: &Limits) -> Vec<ProtocolFile> {
    let mut list: Vec<ProtocolFile> = Named::ALL
        .iter()
        .map(|&named| ProtocolFile::named(named))
        .collect();
    list.extend(steps_ramps_and_reversals());
    list.extend(cycles_holds_and_sines());
    list.retain(|protocol| {
        let highest = protocol
            .segments
            .iter()
            .filter(|segment| {
                segment
                    .mode()
                    .is_some_and(|mode| mode != ControlMode::Pressure)
            })
            .map(|segment| f64::from(segment.highest().0) / 100.0)
            .fold(0.0, f64::max);
        highest <= limits.highest_deg
            && f64::from(total_ms(&protocol.segments[..])) / 1000.0 <= limits.longest_s
    });
    list
}

const MODE: ControlMode = ControlMode::AngleOpenLoop;

const fn level(degrees: i32) -> Hundredths {
    Hundredths(100 * degrees)
}

const fn step(degrees: i32, duration_ms: u32) -> Segment {
    Segment::Step {
        mode: MODE,
        level: level(degrees),
        duration_ms,
    }
}

const fn ramp(degrees: i32, duration_ms: u32) -> Segment {
    Segment::Ramp {
        mode: MODE,
        level: level(degrees),
        duration_ms,
    }
}

const fn release(duration_ms: u32) -> Segment {
    Segment::Release { duration_ms }
}

/// Protocols that separate friction, hysteresis and damping.
fn steps_ramps_and_reversals() -> Vec<ProtocolFile> {
    let mut list = Vec::new();
    let mut add = |name: String, title: String, segments: Vec<Segment>| {
        list.push(ProtocolFile::new(name, title, segments));
    };
    for degrees in [10, 20, 45, 75] {
        add(
            format!("step{degrees}"),
            format!("a step to {degrees} degrees and its release, twice"),
            vec![
                step(degrees, 6_000),
                release(5_000),
                Segment::Repeat { from: 0, times: 1 },
            ],
        );
    }
    for (name, seconds) in [("fast", 1), ("slow", 25)] {
        add(
            format!("triangle_{name}"),
            format!("triangles to 80 degrees, {seconds} s up and {seconds} s down"),
            vec![
                ramp(80, seconds * 1000),
                ramp(0, seconds * 1000),
                Segment::Repeat { from: 0, times: 1 },
                release(4_000),
            ],
        );
    }
    for middle in [20, 45, 75] {
        add(
            format!("small_reversals_{middle}"),
            format!("triangles of 3 degrees about {middle} degrees, slow and fast"),
            vec![
                step(middle, 4_000),
                ramp(middle + 3, 1_000),
                ramp(middle - 3, 2_000),
                ramp(middle, 1_000),
                Segment::Repeat { from: 1, times: 3 },
                ramp(middle + 3, 4_000),
                ramp(middle - 3, 8_000),
                ramp(middle, 4_000),
                Segment::Repeat { from: 5, times: 1 },
                release(4_000),
            ],
        );
    }
    list
}

/// Protocols that separate memory, drift, damping and delays.
fn cycles_holds_and_sines() -> Vec<ProtocolFile> {
    let mut list = Vec::new();
    let mut add = |name: String, title: String, segments: Vec<Segment>| {
        list.push(ProtocolFile::new(name, title, segments));
    };
    for (name, first, larger) in [("small", 40, 60), ("large", 60, 85)] {
        add(
            format!("softening_{name}"),
            format!("cycles to {first} degrees, one to {larger}, the first again"),
            vec![
                step(first, 4_000),
                release(4_000),
                Segment::Repeat { from: 0, times: 2 },
                step(larger, 4_000),
                release(4_000),
                step(first, 4_000),
                release(4_000),
                Segment::Repeat { from: 5, times: 1 },
            ],
        );
    }
    add(
        "long_hold".into(),
        "60 degrees for a minute and the recovery".into(),
        vec![step(60, 60_000), release(30_000)],
    );
    add(
        "small_steps".into(),
        "steps of 8 degrees about several angles, then larger ones".into(),
        vec![
            step(20, 3_000),
            step(28, 3_000),
            step(20, 3_000),
            step(50, 3_000),
            step(58, 3_000),
            step(50, 3_000),
            step(75, 3_000),
            step(83, 3_000),
            step(75, 3_000),
            step(15, 3_000),
            step(75, 3_000),
            step(15, 3_000),
            release(4_000),
        ],
    );
    for (name, period_ms) in [("fast", 4_000), ("slow", 20_000)] {
        add(
            format!("sines_{name}"),
            format!(
                "a multisine about 45 degrees with a base period of {} s",
                period_ms / 1000
            ),
            vec![
                step(45, 4_000),
                Segment::Multisine {
                    mode: MODE,
                    centre: level(45),
                    amplitude: level(25),
                    period_ms,
                    duration_ms: 2 * period_ms.max(10_000),
                },
                release(4_000),
            ],
        );
    }
    list
}

/// The runs that separate rivals best beside this noise (rad), with the effects that they separate.
pub fn propose(
    nominal: &Model<f64>,
    rivals: &[Candidate],
    noise: f64,
    limits: &Limits,
) -> Vec<(Proposal, [Vec<Kind>; 2])> {
    /// Number of proposals.
    const PROPOSALS: usize = 3;
    let added = |index: usize| rivals[index].added.clone();
    proposals(nominal, rivals, noise, limits)
        .into_iter()
        .take(PROPOSALS)
        .map(|proposal| {
            let (a, b) = proposal.separates;
            (proposal, [added(a), added(b)])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::catalogue::Kind;
    use model_core::dynamics::Dynamics;

    fn nominal() -> Model<f64> {
        Model::new(
            Dynamics {
                inertia: 0.25,
                damping: 1.5,
                stiffness: 5.0,
                exponent: 1.7,
                input_gain: 1e-4,
            },
            &[],
        )
        .unwrap()
    }

    #[test]
    fn limits_hold_for_every_protocol() {
        let limits = Limits {
            highest_deg: 60.0,
            longest_s: 60.0,
            ..Limits::default()
        };
        let list = protocols(&limits);
        assert!(list.len() >= 4);
        for protocol in &list {
            assert!(protocol.total_ms() <= 60_000, "{}", protocol.name);
            assert_eq!(wire::protocol::check(&protocol.segments[..]), Ok(()));
            let text = protocol.to_text();
            let again = ProtocolFile::parse(&text, std::path::Path::new("p.toml")).unwrap();
            assert_eq!(again.segments, protocol.segments);
        }
        let too_little = Limits {
            highest_kpa: 1.0,
            ..limits
        };
        assert!(drive(&list[0], &nominal(), &too_little).is_none());
    }

    /// A rival by its effects, of which nothing is known but their values.
    fn with(kind: Kind, values: &[f64]) -> Candidate {
        let dynamics = *nominal().dynamics();
        let model = Model::new(dynamics, &[kind.build(values).unwrap()]).unwrap();
        let none = Dataset::default();
        let fitter = Fitter::new(&model, &none);
        Candidate::of(1, fitter.compare(&model))
    }

    /// The zeros of every fit follow an offset, so it is no evidence in any run.
    #[test]
    fn an_offset_of_a_sensor_is_no_evidence() {
        let rivals = |offset_rad: f64| {
            // An offset of its own, so that nothing but the zero can follow the difference.
            [
                with(Kind::SensorOffset, &[0.0]),
                with(Kind::SensorOffset, &[offset_rad]),
            ]
        };
        let list = proposals(&nominal(), &rivals(0.02), 0.007, &Limits::default());
        assert!(list.len() > 10);
        for proposal in &list {
            // 0.02 rad are 0.57 of the zero's standard deviation of 2 degrees, which is
            // all that it costs.
            let (name, evidence) = (&proposal.protocol.name, proposal.evidence);
            assert!((evidence - 0.33).abs() < 0.05, "{name}: {evidence}");
        }
        // The same offset with friction on one side is the friction alone.
        let friction = with(Kind::CoulombFriction, &[0.2, 0.02]);
        let of = |offset: f64| {
            let pair = [friction.clone(), with(Kind::SensorOffset, &[offset])];
            proposals(&nominal(), &pair, 0.007, &Limits::default())[0].evidence
        };
        let (without, beside) = (of(0.0), of(0.02));
        assert!(without > 50.0, "{without}");
        assert!((beside / without - 1.0).abs() < 0.1, "{without} {beside}");
    }

    /// A weight that pulls an actuator out of its sensor's range is turned the other way.
    #[test]
    fn the_base_is_turned_to_where_the_sensor_sees() {
        let rivals = [
            with(Kind::Gravity, &[1.0, 0.0, 0.0, 1.0]),
            with(Kind::LinearStiffness, &[1.0]),
        ];
        let best = |shown: Option<[f64; 2]>| {
            let limits = Limits {
                shown,
                ..Limits::default()
            };
            let list = proposals(&nominal(), &rivals, 0.007, &limits);
            let turned = |it: &&Proposal| it.protocol.setup.tilt_deg.is_some();
            let best = list.iter().find(turned).unwrap();
            assert!(best.decides, "{}", best.evidence);
            best.protocol.setup.tilt_deg
        };
        assert_eq!(best(Some([0.0, 2.0])), Some(-90.0));
        assert_eq!(best(Some([-2.0, 1.57])), Some(90.0));
    }

    /// Hysteresis and friction differ most in small reversals, creep and drift
    /// over time: a planner that works says so.
    #[test]
    fn friction_and_hysteresis_are_separated_by_reversals() {
        let rivals = [
            with(Kind::CoulombFriction, &[0.4, 0.02]),
            with(Kind::BoucWenHysteresis, &[0.4, 0.06, 0.5]),
        ];
        let list = proposals(&nominal(), &rivals, 0.007, &Limits::default());
        let evidence = |name: &str| {
            list.iter()
                .find(|proposal| proposal.protocol.name == name)
                .unwrap()
                .evidence
                / f64::from(
                    list.iter()
                        .find(|proposal| proposal.protocol.name == name)
                        .unwrap()
                        .protocol
                        .total_ms(),
                )
        };
        assert!(evidence("small_reversals_45") > evidence("step45"));
        assert!(list[0].decides && list[0].evidence > VERY_STRONG);
        let decided = list.iter().take_while(|it| it.decides).count();
        assert!(list[decided..].iter().all(|it| !it.decides));
    }

    /// A lag of the air grows with the tube, and one of the sensor does not.
    #[test]
    fn a_longer_tube_tells_a_lag_of_the_air_from_one_of_the_sensor() {
        let rivals = [
            with(Kind::PneumaticLag, &[0.1]),
            with(Kind::SensorLag, &[0.1]),
        ];
        let best = |tube_mm: Option<f64>| {
            let limits = Limits {
                tube_mm,
                ..Limits::default()
            };
            proposals(&nominal(), &rivals, 0.007, &limits).remove(0)
        };
        assert_eq!(best(None).protocol.setup, Setup::default());
        let longer = proposals(
            &nominal(),
            &rivals,
            0.007,
            &Limits {
                tube_mm: Some(200.0),
                ..Limits::default()
            },
        );
        let evidence = |tube_mm: Option<f64>| {
            let is = longer
                .iter()
                .filter(|it| it.protocol.setup.tube_mm == tube_mm);
            is.map(|it| it.evidence).fold(0.0, f64::max)
        };
        assert!(evidence(Some(800.0)) > 3.0 * evidence(None));
    }

    /// A stretched actuator has nothing more to lose: a run after a rest tells what stays lost
    /// from what comes back.
    #[test]
    fn what_is_lost_for_good_is_told_by_a_rest() {
        let rivals = [
            with(Kind::MullinsSoftening, &[0.3, 0.5]),
            with(Kind::MaxwellBranch, &[2.0, 3.0, 0.0]),
        ];
        let limits = Limits {
            stretched_rad: 1.4,
            ..Limits::default()
        };
        let list = proposals(&nominal(), &rivals, 0.007, &limits);
        assert!(
            list.iter()
                .all(|it| it.protocol.setup.rested_s == Some(REST_S))
        );
        assert!(list[0].decides);
    }
}
