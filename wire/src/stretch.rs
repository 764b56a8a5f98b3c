//! The stretches of firmware whose cycles are counted.
//!
//! The board writes the number to GPIOR0, a register without a function, before
//! the stretch and zero after it. On real hardware that costs two cycles; the
//! simulator counts what lies in between.

/// One step of the equation of motion, minimax power function.
pub const STEP_MINIMAX: u8 = 1;
/// One step of the equation of motion, guarded micromath power function.
pub const STEP_MICROMATH: u8 = 2;
/// One evaluation of the minimax power function.
pub const POWER_MINIMAX: u8 = 3;
/// One evaluation of the guarded micromath power function.
pub const POWER_MICROMATH: u8 = 4;
/// Nothing: what the marks themselves cost.
pub const NOTHING: u8 = 5;

/// The name of a stretch, for tables.
pub const fn name(stretch: u8) -> Option<&'static str> {
    Some(match stretch {
        STEP_MINIMAX => "step_minimax",
        STEP_MICROMATH => "step_micromath",
        POWER_MINIMAX => "power_minimax",
        POWER_MICROMATH => "power_micromath",
        NOTHING => "nothing",
        _ => return None,
    })
}
