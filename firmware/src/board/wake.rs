//! What the main program sleeps for: a control period, or a byte.
//!
//! Of the 14 000 interrupts a second at rest 100 are a reason to go on. Asking the clock and the serial port
//! after each of them takes twice as long as asking one flag.

use super::shared::SharedFlag;

/// Something came since [`forget`].
static IS_CALLED: SharedFlag = SharedFlag::new(false);

/// There is work: called by an interrupt.
#[inline(always)]
pub(super) fn call() {
    IS_CALLED.set(true);
}

/// Nothing has come. Who calls this has yet to look for what came before.
#[inline(always)]
pub(super) fn forget() {
    IS_CALLED.set(false);
}

/// Whether there is work.
#[inline(always)]
pub(super) fn is_called() -> bool {
    IS_CALLED.get()
}
