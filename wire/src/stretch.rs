//! The sections of firmware whose cycles are counted.
//!
//! The board writes the number of a section to GPIOR0, a register without a function, at its
//! start, and zero at its end. On real hardware that costs two cycles; the simulator counts
//! the cycles between.

/// One step of the base equation, minimax power function.
pub const STEP_MINIMAX: u8 = 1;
/// One step of the base equation, guarded micromath power function.
pub const STEP_MICROMATH: u8 = 2;
/// One evaluation of the minimax power function.
pub const POWER_MINIMAX: u8 = 3;
/// One evaluation of the guarded micromath power function.
pub const POWER_MICROMATH: u8 = 4;
/// Nothing: what the marks themselves cost.
pub const NOTHING: u8 = 5;

/// One step of the base equation, by the table of the power.
pub const STEP_TABLE: u8 = 7;
/// One step with the dearest three effects together.
pub const STEP_DEAREST: u8 = 8;

/// The first of the stretches that are one step with one effect, in the order of
/// the catalogue.
pub const FIRST_EFFECT: u8 = 16;

/// The stretch that is one step with the effect at `index` of the catalogue.
#[allow(clippy::cast_possible_truncation)] // 16 + 127 fit.
pub const fn effect(index: usize) -> u8 {
    FIRST_EFFECT + if index < 127 { index as u8 } else { 127 }
}

/// The effect's place in the catalogue, for a stretch that is a step with one.
pub const fn effect_index(stretch: u8) -> Option<usize> {
    if stretch < FIRST_EFFECT {
        return None;
    }
    Some((stretch - FIRST_EFFECT) as usize)
}

/// The name of a stretch without an effect, for tables.
pub const fn name(stretch: u8) -> Option<&'static str> {
    Some(match stretch {
        STEP_MINIMAX => "step_minimax",
        STEP_MICROMATH => "step_micromath",
        POWER_MINIMAX => "power_minimax",
        POWER_MICROMATH => "power_micromath",
        NOTHING => "nothing",
        STEP_TABLE => "step_table",
        STEP_DEAREST => "step_dearest",
        _ => return None,
    })
}

/// Marks sections of the program; the numbers are those of this module.
pub trait Probe {
    /// Marks the start of a section.
    fn open(&mut self, stretch: u8);
    /// Marks its end.
    fn close(&mut self);
}

/// A probe that marks nothing: on a desktop there are no cycles to count.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    fn open(&mut self, _stretch: u8) {}
    fn close(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_and_the_rest_do_not_collide() {
        for stretch in 0..=u8::MAX {
            assert!(name(stretch).is_none() || effect_index(stretch).is_none());
        }
        for index in 0..127 {
            assert_eq!(effect_index(effect(index)), Some(index));
        }
    }
}
