//! How large forces, angles and rates are in the recordings, and where fits of an effect start.

use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use model_core::effects::{Parameter, Place, Unit};

use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::HARDLY_VISIBLE;
use crate::estimate::smooth::motions;

/// Scales of forces, angles and rates in the recordings. Initial guesses and
/// plausibility are relative to them.
#[derive(Clone, Debug, PartialEq)]
pub struct Scales {
    /// Largest angle (rad).
    angle: f64,
    /// Spring force at the largest angle (N).
    force: f64,
    /// 99th percentile of the measured rate (rad/s).
    rate: f64,
    /// Largest pressure (Pa).
    pressure: f64,
    /// Time between samples (s).
    interval: f64,
    /// Duration of the longest session (s).
    duration: f64,
    /// Spectral lines of the residual (Hz).
    lines: Vec<f64>,
}

impl Scales {
    /// Takes the scales from the nominal model and the recordings, and the spectral lines
    /// from the residual of the refit.
    pub fn of(fitter: &Fitter<'_>, refit: &Fit) -> Self {
        let d = fitter.nominal.dynamics();
        let angle = fitter.data.largest_angle().max(1e-3);
        let pressure = fitter
            .data
            .fitted()
            .flat_map(|segment| &segment.recording.pressure)
            .fold(0.0, |largest: f64, p| largest.max(p.abs()));
        let spring = d.stiffness * libm::pow(angle, d.exponent);
        let force = spring
            .max(d.input_gain.abs() * pressure)
            .max(f64::MIN_POSITIVE);
        Self {
            angle,
            force,
            rate: fastest_rate(fitter).max(1e-3),
            pressure,
            interval: fitter
                .data
                .sessions()
                .first()
                .map_or(0.01, |session| session.interval()),
            duration: fitter
                .data
                .sessions()
                .iter()
                .map(|session| session.recording().duration())
                .fold(0.0, f64::max),
            lines: spectral_lines(fitter, refit),
        }
    }

    /// The size beyond which a parameter (SI units) is implausible; none for parameters
    /// without a scale here. A time constant far beyond the longest run is implausible: a
    /// creep that never ends is a spring.
    pub fn plausible(&self, row: &Parameter) -> Option<f64> {
        match row.unit {
            Unit::Second => Some(self.duration),
            // Parameters of a user's formula have the range that the user gives.
            Unit::One | Unit::Radian | Unit::Hertz | Unit::Given(_) => None,
            Unit::PerRadian => Some(3.0 / self.angle),
            _ => Some(self.size(row)),
        }
    }

    /// The dynamics of the same time constant C/K at critical damping, C²/(4 K) = M, where
    /// the inertia does not show in `fitted`; none where it does.
    ///
    /// A missing force can make a swing look like a creep: the refit then ends where the
    /// inertia does not show, and with the right effect no fit finds the way back.
    pub fn swinging(&self, fitted: &Dynamics<f64>) -> Option<Dynamics<f64>> {
        let damping = fitted.damping;
        let slope = fitted.stiffness * libm::pow(self.angle, fitted.exponent - 1.0);
        let critical = 4.0 * fitted.inertia * slope / damping;
        let is_hidden = fitted.inertia < HARDLY_VISIBLE * self.interval * damping;
        let times = critical / damping;
        (is_hidden && times > 0.0 && times < 1.0).then_some(Dynamics {
            damping: critical,
            stiffness: times * fitted.stiffness,
            input_gain: times * fitted.input_gain,
            ..*fitted
        })
    }

    /// Largest angle (rad).
    pub const fn angle(&self) -> f64 {
        self.angle
    }

    /// 99th percentile of the measured rate (rad/s).
    pub const fn rate(&self) -> f64 {
        self.rate
    }

    /// Largest pressure (Pa).
    pub const fn pressure(&self) -> f64 {
        self.pressure
    }

    /// Duration of the longest session (s).
    pub const fn duration(&self) -> f64 {
        self.duration
    }

    /// Largest force of spring or drive (N).
    pub const fn force(&self) -> f64 {
        self.force
    }

    /// Values of a parameter at which fits of an effect start, in SI units.
    pub fn starts_of(&self, kind: Kind, row: &Parameter) -> Vec<f64> {
        match row.held {
            Some(held) => vec![held_value(row, held, self)],
            None if row.unit == Unit::Hertz => self.lines.clone(),
            None => row
                .starts
                .iter()
                .map(|start| f64::from(*start) * self.size(row))
                // A very small delay is a guess as well.
                .chain((kind.info().place == Place::Input).then_some(self.interval))
                .collect(),
        }
    }

    /// The natural scale of a parameter in SI units, which its initial guesses multiply.
    pub fn size(&self, row: &Parameter) -> f64 {
        match row.unit {
            Unit::Newton => self.force,
            Unit::NewtonPerRad => self.force / self.angle,
            Unit::NewtonPerRad3 => self.force / self.angle.powi(3),
            Unit::NewtonSecond2PerRad2 => self.force / self.rate.powi(2),
            Unit::RadianPerSecond => self.rate,
            Unit::PerRadian => 1.0 / self.angle,
            Unit::PerSecond => 1.0 / self.duration.max(self.interval),
            Unit::KiloPascal => self.pressure,
            Unit::PerKiloPascal => 1.0 / self.pressure.max(1.0),
            _ => 1.0,
        }
    }
}

/// The 99th percentile of the measured rate (rad/s).
fn fastest_rate(fitter: &Fitter<'_>) -> f64 {
    let mut rates: Vec<f64> = fitter
        .data
        .fitted()
        .flat_map(|segment| motions(&segment.recording))
        .map(|motion| motion.rate.abs())
        .collect();
    rates.sort_unstable_by(f64::total_cmp);
    rates
        .get(rates.len() * 99 / 100)
        .copied()
        .unwrap_or_default()
}

/// The spectral lines (Hz) of the residuals, relative to their surroundings. A fit finds
/// an oscillation of twenty periods only from within a twentieth of its frequency, so it
/// has to start there.
fn spectral_lines(fitter: &Fitter<'_>, refit: &Fit) -> Vec<f64> {
    /// Step of the frequencies (Hz).
    const STEP: f64 = 0.05;
    /// Least distance of two lines (Hz).
    const APART: f64 = 0.4;
    /// Frequencies on each side that make up the surroundings.
    const AROUND: usize = 24;
    /// Number of lines.
    const COUNT: usize = 4;
    let intervals: Vec<f64> = fitter
        .data
        .fitted()
        .map(|segment| segment.recording.interval())
        .collect();
    let slowest = intervals.iter().copied().fold(0.0, f64::max);
    let highest = (0.4 / slowest).min(30.0);
    // At most some hundred.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let count = (highest / STEP) as usize;
    let power: Vec<f64> = (1..=count)
        .map(|k| {
            let angular = std::f64::consts::TAU * STEP * k as f64;
            refit
                .residuals
                .iter()
                .zip(&intervals)
                .map(|(series, interval)| {
                    let (sin, cos) = libm::sincos(angular * interval);
                    let (mut c, mut s, mut re, mut im) = (1.0, 0.0, 0.0, 0.0);
                    for value in series {
                        re += value * c;
                        im += value * s;
                        (c, s) = (c * cos - s * sin, s * cos + c * sin);
                    }
                    re * re + im * im
                })
                .sum()
        })
        .collect();
    let mut prominent: Vec<(f64, usize)> = (0..count)
        .map(|k| {
            let from = k.saturating_sub(AROUND);
            let mut around: Vec<f64> = power[from..(k + AROUND).min(count)].to_vec();
            (
                power[k] / crate::statistics::median(&mut around).max(f64::MIN_POSITIVE),
                k,
            )
        })
        .collect();
    prominent.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut lines: Vec<f64> = Vec::new();
    for (_, k) in prominent {
        let frequency = STEP * (k + 1) as f64;
        if lines.len() < COUNT && lines.iter().all(|line| (line - frequency).abs() > APART) {
            lines.push(frequency);
        }
    }
    lines
        .into_iter()
        .map(|line| refined(fitter, refit, line, STEP))
        .collect()
}

/// Refines a line within `width` (Hz) to the resolution of whole sessions: an oscillation
/// keeps its phase through all segments, and a fit finds it only from within a part of one
/// period over the whole session.
fn refined(fitter: &Fitter<'_>, refit: &Fit, estimate: f64, width: f64) -> f64 {
    /// Steps for each frequency that a session resolves.
    const FINER: f64 = 4.0;
    let data = fitter.data;
    let longest = data
        .sessions()
        .iter()
        .map(|session| session.recording().duration())
        .fold(0.0, f64::max);
    let step = 1.0 / (FINER * longest.max(1.0));
    let power = |frequency: f64| -> f64 {
        let angular = std::f64::consts::TAU * frequency;
        let mut sums = vec![(0.0, 0.0); data.sessions().len()];
        for (segment, residual) in data.fitted().zip(refit.residuals.iter()) {
            let (re, im) = &mut sums[segment.session];
            for (time, value) in segment.recording.time.iter().zip(residual) {
                let (sin, cos) = libm::sincos(angular * time);
                *re += value * cos;
                *im += value * sin;
            }
        }
        sums.iter().map(|(re, im)| re * re + im * im).sum()
    };
    // At most some hundred.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let count = (width / step).ceil() as usize;
    (0..=2 * count)
        .map(|k| estimate + (k as f64 - count as f64) * step)
        .filter(|frequency| *frequency > 0.0)
        .map(|frequency| (power(frequency), frequency))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(estimate, |(_, frequency)| frequency)
}

/// The value at which a parameter is held: the catalogue's. But a smoothed sign function
/// is no sharper than a two-hundredth of the fastest rate: a sharper one changes only the
/// cost of the integration.
pub fn held_value(row: &Parameter, held: f32, scales: &Scales) -> f64 {
    let held = f64::from(held);
    if row.unit == Unit::RadianPerSecond {
        held.max(0.005 * scales.rate)
    } else {
        held
    }
}

/// Every combination of the choices for each parameter of an effect.
pub fn combinations(kind: Kind, choices: impl Fn(&Parameter) -> Vec<f64>) -> Vec<Vec<f64>> {
    let mut values: Vec<Vec<f64>> = vec![Vec::new()];
    for row in kind.parameters() {
        let choices = choices(row);
        values = values
            .into_iter()
            .flat_map(|head| {
                choices.iter().map(move |choice| {
                    let mut all = head.clone();
                    all.push(*choice);
                    all
                })
            })
            .collect();
    }
    values
}
