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
    fn what_was_not_measured_is_low_and_no_number() {
        assert!(is_low(Oversampled::NOT_MEASURED));
        assert_eq!(millivolts(Oversampled::NOT_MEASURED), None);
        assert_eq!(millivolts(Oversampled(0)), None);
    }
}
