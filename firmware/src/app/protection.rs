//! Finds fault conditions: readings beyond limits, and conditions that count only after
//! several periods.

use crate::{
    design::{LARGEST_AT_REST_PA, LONGEST_VENTING_PERIODS, STILL_PRESSURISED_PERIODS},
    gas, ground,
    io::{Inputs, Outputs, Oversampled, Pump, Valve},
    safety::{Conditions, runs_into_end},
    sensing::Readings,
    settings::Limits,
    stall::Watch,
    supply,
};
use wire::state::State;

/// The memory of the conditions.
#[derive(Clone, Debug, Default)]
pub(super) struct Protection {
    stall: Watch,
    gas: gas::Watch,
    ground: ground::Watch,
    /// Periods for which the valve has been open; beyond [`LONGEST_VENTING_PERIODS`], those for
    /// which there is a pressure nevertheless.
    venting: u16,
    /// Whether the last reading of the pressure was above its limit.
    pressure_was_high: bool,
}

/// The inputs of the conditions.
pub(super) struct Seen<'a> {
    pub(super) limits: &'a Limits,
    pub(super) inputs: &'a Inputs,
    pub(super) readings: &'a Readings,
    /// The outputs of the period before.
    pub(super) outputs: &'a Outputs,
    pub(super) state: State,
    /// The volume that the pump displaced (µl).
    pub(super) volume: f32,
    /// The most that it may displace (µl).
    pub(super) largest: f32,
    /// Where the plunger may be at most (µl), by the air behind it.
    pub(super) farthest: f32,
    /// The supply when the rig was armed.
    pub(super) supply: Oversampled,
    /// Whether the plunger looks for the pushed-in switch.
    pub(super) seeks_pushed_end: bool,
    /// When a valid line came last (ms).
    pub(super) heard: u32,
}

impl Protection {
    /// Sets every condition that follows from readings; other conditions are set elsewhere.
    #[inline(never)]
    pub(super) fn look(&mut self, seen: &Seen, conditions: &mut Conditions) {
        let Seen {
            limits,
            inputs,
            readings,
            ..
        } = *seen;
        // Numbers above zero are in the order of their bits, which are compared in a tenth
        // of the time; what is not a number counts as much.
        let size = readings.pressure.filtered.abs().to_bits();
        let pressurised = size > LARGEST_AT_REST_PA.to_bits();
        let rate = match seen.outputs.pump {
            Pump::Rate(rate) => rate,
            Pump::Off | Pump::Brake => 0.0,
        };
        let closed = seen.outputs.valve == Valve::Closed;
        self.venting = if closed {
            0
        } else if pressurised && readings.pressure.fault.is_none() {
            self.venting.saturating_add(1)
        } else {
            self.venting.saturating_add(1).min(LONGEST_VENTING_PERIODS)
        };
        let pressure = readings.pressure.value;
        // Twice in a row: a wire that breaks within a reading leaves a mean of
        // good and bad conversions, which can look like any pressure once.
        let high = readings.pressure.fresh && pressure > limits.pressure_pa;
        let over_pressure = core::mem::replace(&mut self.pressure_was_high, high) && high;
        let gas_law = self.gas.step(&gas::Seen {
            largest: seen.largest,
            closed,
            vented: self.venting >= LONGEST_VENTING_PERIODS,
            volume: seen.volume,
            pressure: readings.pressure.filtered,
            limit: limits.pressure_pa,
            farthest: seen.farthest,
        });
        let ground_moved = self.ground.step(&ground::Seen {
            pressure: inputs.pressure,
            flex: inputs.flex,
            steps: inputs.steps,
            closed,
        });
        *conditions = Conditions {
            emergency_stop: inputs.emergency_stop,
            over_pressure,
            // A flex sensor is noisy; 20 ms do not matter to silicone.
            over_angle: readings.angle.filtered > limits.angle_rad,
            pressure_sensor: readings.pressure.fault.is_some(),
            flex_sensor: readings.angle.fault.is_some(),
            // Smoothed: the mains within a reading would be a rise or none.
            stall: self.stall.step(
                seen.largest,
                closed,
                seen.volume,
                readings.pressure.filtered,
            ),
            end_switch: runs_into_end(seen.state, inputs, rate, seen.seeks_pushed_end),
            host_silent: inputs.time_ms.wrapping_sub(seen.heard) > limits.host_timeout_ms,
            overrun: inputs.overruns > 0,
            internal: false,
            retracted_switch: false,
            motor_reversed: false,
            vent_blocked: self.venting > LONGEST_VENTING_PERIODS + STILL_PRESSURISED_PERIODS,
            out_of_reach: false,
            disagreement: false,
            gas_law,
            blind: false,
            late: false,
            supply_moved: supply::has_moved(seen.supply, inputs.supply),
            ground_moved,
            pressurised,
            supply_low: supply::is_low(inputs.supply),
            ..*conditions
        };
    }
}
