//! What recordings have to show before an effect can be known.
//!
//! Where a pressure only rises, a loop is a curve, play is an offset and dry friction a
//! threshold: a fit to such runs is good, its parameters are anything, and the name is a
//! guess. An effect whose [`Need`] no fitted session meets is not tried, and the report says what to
//! record.

use model_core::catalogue::Kind;
use model_core::effects::{Info, Need, Place};

use crate::estimate::Dataset;
use crate::statistics::{noise, swing};
use softrig_formats::recording::Recording;

/// Least return, as a share of the swing of the recordings, that is one.
const RETURNS: f64 = 0.1;

/// Least return in standard deviations of the noise.
const BEYOND_NOISE: f64 = 6.0;

/// Why an effect was not tried, as a clause.
pub const fn unmet(need: Need) -> &'static str {
    match need {
        Need::Drive => "the pressure never changes in these recordings",
        Need::Reversal => "the pressure never turns back in these recordings",
        Need::Return => "the angle never comes back in these recordings",
    }
}

/// What recordings show.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    drive: bool,
    reversal: bool,
    comes_back: bool,
}

impl Shown {
    /// By the sessions that are fitted, at least in part.
    pub fn by(data: &Dataset) -> Self {
        /// Least change of a pressure (Pa).
        const CHANGES: f64 = 1.0;
        let runs = || fitted_sessions(data);
        let largest = largest_swing(data);
        Self {
            drive: runs().any(|run| {
                let first = run.pressure.first().copied().unwrap_or(0.0);
                run.pressure.iter().any(|p| (p - first).abs() >= CHANGES)
            }),
            reversal: runs().any(|run| returns(&run.time, &run.pressure, swing(&run.pressure))),
            comes_back: runs().any(|run| returns(&run.time, &run.angle, largest)),
        }
    }

    /// The first need of an effect that is not met.
    pub fn unmet(self, kind: Kind) -> Option<Need> {
        let Info { place, needs, .. } = kind.info();
        let drive = (*place == Place::Input).then_some(Need::Drive);
        drive
            .into_iter()
            .chain(needs.iter().copied())
            .find(|need| match need {
                Need::Drive => !self.drive,
                Need::Reversal => !self.reversal,
                Need::Return => !self.comes_back,
            })
    }
}

/// Whether an actuator is loaded a second time in a session that is fitted at least in part: its
/// angle goes, comes back and goes again.
pub fn is_loaded_again(data: &Dataset) -> bool {
    let largest = largest_swing(data);
    fitted_sessions(data).any(|run| legs(&run.time, &run.angle, largest) >= 3)
}

/// The sessions that are fitted, at least in part.
fn fitted_sessions(data: &Dataset) -> impl Iterator<Item = &Recording> {
    let sessions = data.sessions().iter().enumerate();
    sessions
        .filter(|(index, _)| !data.fitted_ranges(*index).is_empty())
        .map(|(_, session)| session.recording())
}

/// The largest swing of the angle in a session that is fitted at least in part (rad).
fn largest_swing(data: &Dataset) -> f64 {
    fitted_sessions(data)
        .map(|run| swing(&run.angle))
        .fold(0.0, f64::max)
}

/// The number of ways back and forth in a series, each by a share of a swing.
fn legs(time: &[f64], values: &[f64], swing: f64) -> usize {
    let least = least_return(time, values, swing);
    let (mut high, mut low) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut legs, mut rises) = (0, None);
    for &value in values {
        high = high.max(value);
        low = low.min(value);
        if rises != Some(true) && value - low > least {
            (legs, rises, high) = (legs + 1, Some(true), value);
        } else if rises != Some(false) && high - value > least {
            (legs, rises, low) = (legs + 1, Some(false), value);
        }
    }
    legs
}

/// The least change of a series that is a way back.
fn least_return(time: &[f64], values: &[f64], swing: f64) -> f64 {
    RETURNS * swing + BEYOND_NOISE * noise(time, values)
}

/// Whether a series both rises and falls by a share of a swing.
fn returns(time: &[f64], values: &[f64], swing: f64) -> bool {
    let least = least_return(time, values, swing);
    let (mut high, mut low) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut fall, mut rise) = (0.0_f64, 0.0_f64);
    for &value in values {
        high = high.max(value);
        low = low.min(value);
        fall = fall.max(high - value);
        rise = rise.max(value - low);
    }
    fall.min(rise) > least
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step and its release load once, two triangles twice.
    #[test]
    fn a_second_loading_goes_comes_back_and_goes_again() {
        let step = |t: f64| if t < 5.0 { 20.0 } else { 0.0 };
        let triangles = |t: f64| 20.0 * (1.0 - (t % 5.0 - 2.5).abs() / 2.5);
        let is_loaded_again = |run| is_loaded_again(&Dataset::of(&[run]));
        assert!(!is_loaded_again(run(step)));
        assert!(!is_loaded_again(run(|t| triangles(0.5 * t))));
        assert!(is_loaded_again(run(triangles)));
    }
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;
    use std::slice::from_ref;

    /// A pressure (kPa), and an angle that follows it.
    fn run(pressure: impl Fn(f64) -> f64) -> Recording {
        let time: Vec<f64> = (0..1_000).map(|k| 0.01 * f64::from(k)).collect();
        let pressure: Vec<f64> = time.iter().map(|&t| 1e3 * pressure(t)).collect();
        let angle = pressure.iter().map(|p| 1e-5 * p).collect();
        Recording {
            time,
            pressure,
            angle,
            ..Recording::default()
        }
    }

    fn unmet(runs: &[Recording], kind: Kind) -> Option<Need> {
        Shown::by(&Dataset::of(runs)).unmet(kind)
    }

    #[test]
    fn a_loop_needs_a_way_back() {
        let fills = run(|t| 50.0 * (1.0 - (-t).exp()));
        let triangle = run(|t| 50.0 - 10.0 * (t - 5.0).abs());
        for kind in [
            Kind::BoucWenHysteresis,
            Kind::CoulombFriction,
            Kind::MullinsSoftening,
        ] {
            assert_eq!(
                unmet(from_ref(&fills), kind),
                Some(Need::Return),
                "{kind:?}"
            );
            assert_eq!(unmet(&[fills.clone(), triangle.clone()], kind), None);
        }
        let play = Kind::InputBacklash;
        assert_eq!(unmet(from_ref(&fills), play), Some(Need::Reversal));
        assert_eq!(unmet(&[triangle], play), None);
        for kind in [
            Kind::MaxwellBranch,
            Kind::CubicStiffness,
            Kind::PneumaticLag,
        ] {
            assert_eq!(unmet(from_ref(&fills), kind), None, "{kind:?}");
        }
    }

    #[test]
    fn a_free_swing_shows_friction_and_nothing_of_the_tube() {
        let mut swing = run(|t| 50.0 * (6.0 * t).cos() * (-0.3 * t).exp());
        swing.pressure.fill(0.0);
        let runs = [swing];
        assert_eq!(unmet(&runs, Kind::CoulombFriction), None);
        assert_eq!(unmet(&runs, Kind::PneumaticLag), Some(Need::Drive));
        assert_eq!(unmet(&runs, Kind::InputBacklash), Some(Need::Drive));
    }

    /// Noise alone turns back all the time.
    #[test]
    fn noise_is_no_way_back() {
        let mut fills = run(|t| 50.0 * (1.0 - (-t).exp()));
        let mut random = Pcg64Mcg::seed_from_u64(1);
        for angle in &mut fills.angle {
            *angle += 0.02 * random.random_range(-1.0..1.0);
        }
        assert_eq!(unmet(&[fills], Kind::CoulombFriction), Some(Need::Return));
    }
}
