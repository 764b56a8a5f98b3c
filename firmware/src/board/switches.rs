//! End switches and emergency stop: looked at in the interrupt of the clock.

use firmware::{
    byte::Byte,
    pins::{self, settled},
};

use super::{pins::pin_type, shared::SharedByte};

pub(super) use firmware::pins::{PUSHED, RETRACTED, STOP};

type RetractedEnd = pin_type!(Input, RETRACTED_END);
type PushedEnd = pin_type!(Input, PUSHED_END);
type EmergencyStop = pin_type!(Input, EMERGENCY_STOP);

/// The last look and the one before.
static LAST: SharedByte = SharedByte::new(0xff);
static BEFORE: SharedByte = SharedByte::new(0xff);
/// What counts. Until they were looked at, all are pressed.
static PRESSED: SharedByte = SharedByte::new(0xff);

/// The three switches.
pub struct Switches {
    _pins: Pins,
}

/// Their pins.
type Pins = pins::Switches<RetractedEnd, PushedEnd, EmergencyStop>;

/// Which of them are pressed, or have a broken wire.
#[derive(Clone, Copy)]
pub struct Pressed(u8);

impl core::ops::BitOr<u8> for Pressed {
    type Output = Self;

    fn bitor(self, more: u8) -> Self {
        Self(self.0 | more)
    }
}

impl Pressed {
    /// The end switch at the retracted end.
    pub const fn retracted_end(self) -> bool {
        self.0 & RETRACTED != 0
    }

    /// The end switch at the pushed-in end.
    pub const fn pushed_end(self) -> bool {
        self.0 & PUSHED != 0
    }

    /// The emergency stop.
    pub const fn emergency_stop(self) -> bool {
        self.0 & STOP != 0
    }
}

impl Switches {
    /// Creates the switches' inputs.
    ///
    /// # Safety
    ///
    /// Only once: the pins have one owner.
    pub unsafe fn new() -> Self {
        // SAFETY: passed on.
        unsafe {
            Self {
                _pins: Pins {
                    retracted_end: RetractedEnd::new(),
                    pushed_end: PushedEnd::new(),
                    emergency_stop: EmergencyStop::new(),
                },
            }
        }
    }

    /// What is pressed now.
    pub fn pressed(&self) -> Pressed {
        Pressed(PRESSED.get())
    }
}

/// What is pressed now, for the interrupt that makes pulses.
#[inline(always)]
pub(super) fn now() -> u8 {
    PRESSED.get()
}

/// Looks at the pins; called by the clock.
#[inline(always)]
pub(super) fn sample() {
    let mut pins = Pins {
        retracted_end: RetractedEnd::beside(),
        pushed_end: PushedEnd::beside(),
        emergency_stop: EmergencyStop::beside(),
    };
    let now = pins.levels();
    let last = LAST.get();
    let before = BEFORE.get();
    PRESSED.set(settled(now, last, before));
    BEFORE.set(last);
    LAST.set(now);
}
