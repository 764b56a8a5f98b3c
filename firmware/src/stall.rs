//! Detects a stall: the pump steps, and the pressure does not follow.
//!
//! The motor has no encoder: a slipping coupling, a detached tube or a missing supply all look
//! like completed steps. But air that is pushed into a closed volume must give a pressure
//! ([`follows`]).

use crate::control::ATMOSPHERE_PA;

/// All the air that there may be, in largest volumes of the pump.
const AIR: f32 = 2.0;

/// Required share of that rise.
const SHARE: f32 = 0.25;

/// Compressed volume, in largest volumes, over which the rise is looked for:
/// 4 ml of 50, of which a quarter of the promise is 1 kPa, well above the noise.
const WINDOW: f32 = 0.08;

/// The volume (µl) over which a rise of the pressure can be told, of a largest one (µl).
pub fn window(largest: f32) -> f32 {
    largest * WINDOW
}

/// Whether a pressure that rose (Pa) by that much follows a volume (µl) that was pushed in.
///
/// For a displaced volume Δv the isothermal gas law gives at least
///
/// ```text
/// Δp ≥ p₀ Δv / V     p₀ = 101 kPa, V: all the air that there may be
/// ```
///
/// An actuator that swells, a leak, and a small position error reduce it, so only a quarter is
/// required, with twice the syringe for V.
///
/// A `max.ul` that is too large for the syringe would put the watch off: a window of a twelfth of
/// 500 ml is never pushed in by one of 60 ml. So `largest` (µl) is what
/// [`Stroke::largest`](crate::stroke::Stroke::largest) leaves of it: what was measured, or the
/// smallest syringe.
pub fn follows(largest: f32, pushed: f32, rise: f32) -> bool {
    let promised = ATMOSPHERE_PA * pushed / (AIR * largest);
    rise >= promised * SHARE
}

/// Where the present compression began.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Watch {
    /// Volume (µl) and pressure (Pa) there; none while the valve is open.
    start: Option<(f32, f32)>,
}

impl Watch {
    /// Lets one control period pass; whether a whole window was compressed
    /// without the least rise. `largest` is the most that the pump may displace (µl),
    /// `volume` what it did (µl), `pressure` in Pa.
    pub fn step(&mut self, largest: f32, valve_closed: bool, volume: f32, pressure: f32) -> bool {
        match self.start {
            Some((from, at)) if valve_closed && volume >= from => {
                if volume - from < window(largest) {
                    return false;
                }
                self.start = Some((volume, pressure));
                !follows(largest, volume - from, pressure - at)
            }
            _ => {
                // Open, or on the way back: a compression starts here.
                self.start = valve_closed.then_some((volume, pressure));
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LARGEST: f32 = 50_000.0;

    fn compress(air_ul: f32, leak: f32) -> bool {
        pushed_in(LARGEST, air_ul, leak).is_some()
    }

    /// The volume (µl) that is pushed in before the watch finds it, of 20 ml.
    fn pushed_in(largest: f32, air_ul: f32, leak: f32) -> Option<f32> {
        let mut watch = Watch::default();
        (0..400_u16).find_map(|period| {
            let pushed = 50.0 * f32::from(period);
            let volume = 500.0 + pushed;
            let gas = ATMOSPHERE_PA * (air_ul / (air_ul - volume) - 1.0);
            watch
                .step(largest, true, volume, gas * (1.0 - leak))
                .then_some(pushed)
        })
    }

    #[test]
    fn the_window_is_a_share_of_the_syringe() {
        for (largest, pushed) in [(10_000.0, 800.0), (50_000.0, 4_000.0), (100_000.0, 8_000.0)] {
            assert_eq!(pushed_in(largest, 60e3, 1.0), Some(pushed), "{largest}");
            // The syringe of that volume, and an actuator that swells by as much as is pushed in.
            let air_ul = (largest + 60e3).min(2.0 * largest);
            assert_eq!(pushed_in(largest, air_ul, 0.5), None, "{largest}");
        }
    }

    #[test]
    fn a_closed_volume_is_no_stall_even_if_it_is_large_or_swells() {
        for air_ul in [30e3, 50e3, 100e3, 250e3] {
            assert!(!compress(air_ul, 0.0), "{air_ul}");
        }
        assert!(!compress(60e3, 0.5));
    }

    #[test]
    fn an_open_tube_is() {
        assert!(compress(50e3, 1.0));
        assert!(compress(2e6, 0.0));
    }

    #[test]
    fn small_motions_and_an_open_valve_are_not() {
        let mut watch = Watch::default();
        for period in 0..10_000_u16 {
            let volume = 2_000.0 + f32::from(period % 30) * 100.0;
            assert!(!watch.step(LARGEST, true, volume, 0.0));
            let far = f32::from(period) * 5.0;
            assert!(!Watch::default().step(LARGEST, false, far, 0.0));
        }
    }
}
