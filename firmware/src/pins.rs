//! What hangs at single pins, behind the traits of embedded-hal: the vent valve, the light, and the
//! switches.
//!
//! A pin that can fail has no place here: an output that is not set is a valve that stays shut.

use core::convert::Infallible;

use embedded_hal::digital::{InputPin, OutputPin};

use crate::io;

/// The valve's transistor: open unless the pin holds it closed.
#[derive(Debug)]
pub struct Valve<P>(P);

impl<P: OutputPin<Error = Infallible>> Valve<P> {
    /// Creates the valve, open.
    pub fn new(mut pin: P) -> Self {
        let Ok(()) = pin.set_low();
        Self(pin)
    }

    /// Moves the valve.
    #[inline(always)]
    pub fn set(&mut self, valve: io::Valve) {
        let Ok(()) = self.0.set_state((valve == io::Valve::Closed).into());
    }
}

/// The light on the board.
#[derive(Debug)]
pub struct Light<P>(P);

impl<P: OutputPin<Error = Infallible>> Light<P> {
    /// Creates the light, dark unless the pin was high.
    pub fn new(pin: P) -> Self {
        Self(pin)
    }

    /// Switches it.
    #[inline(always)]
    pub fn set(&mut self, is_on: bool) {
        let Ok(()) = self.0.set_state(is_on.into());
    }
}

/// The retracted end switch in [`Switches`] and [`settled`].
pub const RETRACTED: u8 = 1;
/// The pushed-in end switch.
pub const PUSHED: u8 = 2;
/// The emergency stop.
pub const STOP: u8 = 4;

/// The three switches. All are normally closed to ground with a pull-up: pressed, broken or pulled
/// out they read high.
#[derive(Debug)]
pub struct Switches<R, P, S> {
    /// At the retracted end.
    pub retracted_end: R,
    /// At the pushed-in end.
    pub pushed_end: P,
    /// The emergency stop.
    pub emergency_stop: S,
}

impl<R, P, S> Switches<R, P, S>
where
    R: InputPin<Error = Infallible>,
    P: InputPin<Error = Infallible>,
    S: InputPin<Error = Infallible>,
{
    /// Which read high now: a bit each.
    #[inline(always)]
    pub fn levels(&mut self) -> u8 {
        let level = |is_high: bool, bit: u8| if is_high { bit } else { 0 };
        let Ok(retracted) = self.retracted_end.is_high();
        let Ok(pushed) = self.pushed_end.is_high();
        let Ok(stop) = self.emergency_stop.is_high();
        level(retracted, RETRACTED) | level(pushed, PUSHED) | level(stop, STOP)
    }
}

/// Which switches count as pressed after the last three looks, 1.25 ms apart: long wires beside a
/// motor's catch spikes, so a level counts once it was seen in two of them.
#[inline(always)]
pub const fn settled(now: u8, last: u8, before: u8) -> u8 {
    now & last | last & before | now & before
}

#[cfg(test)]
mod tests {
    use embedded_hal::digital::ErrorType;

    use super::*;

    /// A pin of a desktop.
    #[derive(Default)]
    struct Level(bool);

    impl ErrorType for &mut Level {
        type Error = Infallible;
    }

    impl OutputPin for &mut Level {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0 = false;
            Ok(())
        }
        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0 = true;
            Ok(())
        }
    }

    impl InputPin for &mut Level {
        fn is_high(&mut self) -> Result<bool, Infallible> {
            Ok(self.0)
        }
        fn is_low(&mut self) -> Result<bool, Infallible> {
            Ok(!self.0)
        }
    }

    #[test]
    fn the_valve_is_open_from_the_start_and_closed_by_a_high_level_only() {
        let mut pin = Level(true);
        let mut valve = Valve::new(&mut pin);
        assert!(!valve.0.0);
        valve.set(io::Valve::Closed);
        assert!(valve.0.0);
        valve.set(io::Valve::Open);
        assert!(!pin.0);
    }

    #[test]
    fn each_switch_has_its_bit() {
        for pressed in 0..8 {
            let [mut retracted, mut pushed, mut stop] =
                [RETRACTED, PUSHED, STOP].map(|bit| Level(pressed & bit != 0));
            let mut switches = Switches {
                retracted_end: &mut retracted,
                pushed_end: &mut pushed,
                emergency_stop: &mut stop,
            };
            assert_eq!(switches.levels(), pressed);
        }
    }

    #[test]
    fn one_look_of_three_is_a_spike() {
        for spike in [(7, 0, 0), (0, 7, 0), (0, 0, 7)] {
            assert_eq!(settled(spike.0, spike.1, spike.2), 0);
            assert_eq!(settled(!spike.0 & 7, !spike.1 & 7, !spike.2 & 7), 7);
        }
        assert_eq!(settled(STOP | PUSHED, STOP, 0), STOP);
    }
}
