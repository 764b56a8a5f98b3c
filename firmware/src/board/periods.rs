//! The count of control periods, which the last conversion of one raises and the clock reads.

use firmware::{byte::Byte, design::OVERSAMPLING};

use super::{shared::SharedByte, wake};

/// Beats in a control period: a conversion of either sensor each.
pub(super) const BEATS: u8 = 2 * OVERSAMPLING as u8;

/// Control periods since reset; wraps.
static PERIODS: SharedByte = SharedByte::new(0);

/// Control periods that began since reset; wraps.
#[inline(always)]
pub(super) fn begun() -> u8 {
    PERIODS.get()
}

/// All conversions of a period are there: the next begins.
#[inline(always)]
pub(super) fn begin() {
    PERIODS.set(PERIODS.get().wrapping_add(1));
    wake::call();
}
