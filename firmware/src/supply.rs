//! The board's supply, by the processor's reference.
//!
//! The converter compares with the supply V, which is the sensors' too. So it cannot see V, but it
//! sees the reference V₀ shrink when V grows: counts = 1024 V₀/V. A supply that sags below what the
//! driver's and the valve's transistor want for a high level moves nothing reliably, long before
//! the processor notices (2.7 V).
//!
//! V₀ is 1.1 V within a tenth (ATmega2560 data sheet, 31.5: 1.0 to 1.2 V), and so is V.

use crate::{design::OVERSAMPLING, io::Oversampled};

/// The reference (mV).
const REFERENCE_MV: u32 = 1_100;

/// Supply (mV) below which the rig is not armed.
pub const LEAST_MV: u32 = 4_500;

/// Sum of conversions of a supply of 1 mV.
const SUM_MV: u32 = REFERENCE_MV * 1024 * OVERSAMPLING as u32;

/// The largest sum of a supply that is high enough.
#[allow(clippy::cast_possible_truncation)] // 4 004.
const MOST: u16 = (SUM_MV / LEAST_MV) as u16;

/// Whether a supply is too low, or not measured.
pub fn is_low(reading: Oversampled) -> bool {
    reading.0 > MOST
}

/// One part in so many by which the reference may move while the rig is armed: 4 %.
const MOST_MOVED: u16 = 25;

/// Whether the reference moved since the rig was armed.
///
/// The sensors and the converter have the same supply, so a reading is none the worse for one that sags; it
/// is if the two part, and which of it happened nobody can tell from here. So nothing is corrected.
pub fn has_moved(armed: Oversampled, now: Oversampled) -> bool {
    let are_known = armed.0 > 0 && armed.is_measured() && now.is_measured();
    are_known && armed.0.abs_diff(now.0) > armed.0 / MOST_MOVED
}

/// The supply (mV); none where it was not measured.
pub fn millivolts(reading: Oversampled) -> Option<u16> {
    let sum = Some(reading).filter(|it| it.is_measured())?.0;
    u16::try_from(SUM_MV.checked_div(u32::from(sum))?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum of conversions of a supply (V).
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn reading(volts: f64) -> Oversampled {
        Oversampled((1.1 / volts * 1024.0).round() as u16 * OVERSAMPLING)
    }

    #[test]
    fn a_supply_is_read_within_a_count_and_low_below_4_5_volts() {
        for volts in [2.8, 4.2, 4.45, 4.55, 5.0, 5.5] {
            let found = f64::from(millivolts(reading(volts)).unwrap()) / 1000.0;
            assert!((found / volts - 1.0).abs() < 0.003, "{volts}: {found}");
            assert_eq!(is_low(reading(volts)), volts < 4.5, "{volts}");
        }
    }

    #[test]
    fn a_supply_that_moves_by_a_twentieth_has_moved() {
        let armed = reading(5.0);
        for (volts, moved) in [
            (4.75, true),
            (4.85, false),
            (5.0, false),
            (5.15, false),
            (5.3, true),
        ] {
            assert_eq!(has_moved(armed, reading(volts)), moved, "{volts}");
        }
        assert!(!has_moved(Oversampled::NOT_MEASURED, armed));
        assert!(!has_moved(armed, Oversampled::NOT_MEASURED));
        assert!(!has_moved(Oversampled::default(), armed));
    }

    #[test]
    fn what_was_not_measured_is_low_and_no_number() {
        assert!(is_low(Oversampled::NOT_MEASURED));
        assert_eq!(millivolts(Oversampled::NOT_MEASURED), None);
        assert_eq!(millivolts(Oversampled(0)), None);
    }
}
