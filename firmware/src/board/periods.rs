//! The count of control periods, which the last conversion of one raises and the clock reads.

use core::sync::atomic::{AtomicU8, Ordering::Relaxed};

use firmware::design::OVERSAMPLING;

/// Beats in a control period: a conversion of either sensor each.
pub(super) const BEATS: u8 = 2 * OVERSAMPLING as u8;

/// Control periods since reset; wraps.
static PERIODS: AtomicU8 = AtomicU8::new(0);

/// Control periods that began since reset; wraps.
#[inline(always)]
pub(super) fn begun() -> u8 {
    PERIODS.load(Relaxed)
}

/// All conversions of a period are there: the next begins.
#[inline(always)]
pub(super) fn begin() {
    PERIODS.store(PERIODS.load(Relaxed).wrapping_add(1), Relaxed);
}
