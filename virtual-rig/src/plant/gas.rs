// SPDX-License-Identifier: GPL-3.0-or-later
//! The air between plunger and actuator: an ideal gas with leaks.
//!
//! With the valve closed the air is conserved: pushing in compresses, pulling back beyond where it
//! was closed makes a vacuum. By default compression is isothermal and the actuator does not swell:
//! healthy rigs that are [drawn](crate::bench::draw_gas) do both.

/// The air's configuration, in SI units.
///
/// ```text
/// p = a (1 + w)/V                          a: amount of air times RT (Pa·m³)
/// V = V_s + s p_l                          syringe, dead volume, and what the actuator swells by
/// ȧ = −V (p − p₀) Σ 1/τ                    leak, and the vent while it is open
/// ẇ = 0.4 (1 + w) d(ln a/V)/dt − w/τ_c     heat of compression
/// τ_t ṗ_l = (p − p₀) − p_l                 tube to sensor and actuator
/// ```
///
/// | symbol | quantity | default |
/// |---|---|---|
/// | V | syringe plus dead volume of tube and actuator | 56 ml + 4 ml retracted |
/// | p₀ | atmospheric pressure | 101.325 kPa |
/// | τ | leak; vent valve; the fault `leak` | 2500 s; 0.08 s; 3 s |
/// | w | how much warmer than the room, as a share of its temperature | – |
/// | τ_c | cooling of the air | at once |
/// | s | swelling of the actuator | 0 |
/// | p_l | gauge pressure in the line | – |
/// | τ_t | tube | 20 ms |
///
/// The time constants hold at constant volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gas {
    /// Volume of tube and actuator (m³).
    pub dead_volume_m3: f64,
    /// Absolute atmospheric pressure (Pa).
    pub atmosphere_pa: f64,
    /// Time constant of the leak that every rig has (s).
    pub leak_s: f64,
    /// Time constant of the open vent valve (s).
    pub vent_s: f64,
    /// Time constant of the leak that is a fault (s).
    pub fault_leak_s: f64,
    /// Time constant of the tube (s).
    pub tube_s: f64,
    /// Time constant with which compressed air cools (s); zero is at once.
    pub cools_s: f64,
    /// Volume that the actuator gains with the pressure (m³/Pa).
    pub swells_m3_per_pa: f64,
}

/// What a share of density adds to the temperature: γ − 1 of air.
const WARMS: f64 = 0.4;

impl Default for Gas {
    fn default() -> Self {
        Self {
            dead_volume_m3: 4e-6,
            atmosphere_pa: 101_325.0,
            leak_s: 2500.0,
            vent_s: 0.08,
            fault_leak_s: 3.0,
            tube_s: 0.02,
            cools_s: 0.0,
            swells_m3_per_pa: 0.0,
        }
    }
}

/// The air's state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Absolute pressure at the room's temperature times volume (Pa·m³).
    amount: f64,
    /// Volume (m³).
    volume: f64,
    /// How much warmer than the room it is, as a share of its temperature.
    warmer: f64,
    /// Gauge pressure in the syringe (Pa).
    syringe: f64,
    /// Gauge pressure in the line (Pa).
    line: f64,
}

impl Air {
    /// Air at atmospheric pressure in `volume_m3`.
    pub fn at_rest(gas: &Gas, volume_m3: f64) -> Self {
        Self {
            amount: gas.atmosphere_pa * volume_m3,
            volume: volume_m3,
            warmer: 0.0,
            syringe: 0.0,
            line: 0.0,
        }
    }

    /// Advances by `dt` seconds, at the end of which the volume, without what the actuator swells
    /// by, is `volume_m3`.
    /// Leak and tube are solved exactly for a volume that is held meanwhile.
    pub fn step(&mut self, gas: &Gas, volume_m3: f64, vented: bool, leaking: bool, dt: f64) {
        let mut rate = 1.0 / gas.leak_s;
        if vented {
            rate += 1.0 / gas.vent_s;
        }
        if leaking {
            rate += 1.0 / gas.fault_leak_s;
        }
        let volume = volume_m3 + gas.swells_m3_per_pa * self.line;
        let density = self.amount / self.volume;
        let compressed = self.amount * (1.0 + self.warmer) / volume - gas.atmosphere_pa;
        self.syringe = compressed * (-rate * dt).exp();
        self.amount = (self.syringe + gas.atmosphere_pa) * volume / (1.0 + self.warmer);
        self.volume = volume;
        // With a time of zero it is as warm as the room at once.
        if gas.cools_s > 0.0 {
            let denser = self.amount / volume / density;
            let warmth = (1.0 + self.warmer) * denser.powf(WARMS) - 1.0;
            self.warmer = warmth * (-dt / gas.cools_s).exp();
        }
        self.line += (self.syringe - self.line) * -(-dt / gas.tube_s).exp_m1();
    }

    /// Gauge pressure at sensor and actuator (Pa).
    pub fn line_pa(&self) -> f64 {
        self.line
    }

    /// Gauge pressure in the syringe (Pa).
    pub fn syringe_pa(&self) -> f64 {
        self.syringe
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIGHT: Gas = Gas {
        dead_volume_m3: 10e-6,
        atmosphere_pa: 101_325.0,
        leak_s: f64::INFINITY,
        vent_s: 0.08,
        fault_leak_s: 3.0,
        tube_s: 0.02,
        cools_s: 0.0,
        swells_m3_per_pa: 0.0,
    };
    const DT: f64 = 5e-4;

    fn run(air: &mut Air, gas: &Gas, volume: f64, vented: bool, leaking: bool, seconds: f64) {
        let mut left = seconds;
        while left > DT / 2.0 {
            air.step(gas, volume, vented, leaking, DT);
            left -= DT;
        }
    }

    #[test]
    fn compression_follows_boyle_there_and_back() {
        let mut air = Air::at_rest(&TIGHT, 60e-6);
        run(&mut air, &TIGHT, 30e-6, false, false, 1.0);
        assert!((air.line_pa() - 101_325.0).abs() < 1e-6, "{air:?}");
        run(&mut air, &TIGHT, 20e-6, false, false, 1.0);
        assert!((air.line_pa() - 2.0 * 101_325.0).abs() < 1e-6, "{air:?}");
        // Back beyond the start: a vacuum, since no air came in.
        run(&mut air, &TIGHT, 80e-6, false, false, 1.0);
        assert!((air.line_pa() + 101_325.0 / 4.0).abs() < 1e-6, "{air:?}");
    }

    #[test]
    fn the_vent_empties_and_the_plunger_then_starts_from_there() {
        let mut air = Air::at_rest(&TIGHT, 60e-6);
        run(&mut air, &TIGHT, 30e-6, false, false, 1.0);
        run(&mut air, &TIGHT, 30e-6, true, false, 0.08);
        let expected = 101_325.0 * (-1.0f64).exp();
        assert!((air.syringe_pa() - expected).abs() < 1e-3 * expected);
        run(&mut air, &TIGHT, 30e-6, true, false, 2.0);
        run(&mut air, &TIGHT, 15e-6, false, false, 1.0);
        assert!((air.line_pa() - 101_325.0).abs() < 1.0);
    }

    #[test]
    fn leaks_decay_with_their_time_constants() {
        let gas = Gas {
            leak_s: 2500.0,
            ..TIGHT
        };
        for (leaking, rate) in [(false, 1.0 / 2500.0), (true, 1.0 / 2500.0 + 1.0 / 3.0)] {
            let mut air = Air::at_rest(&gas, 60e-6);
            run(&mut air, &gas, 30e-6, false, false, 1.0);
            let before = air.syringe_pa();
            run(&mut air, &gas, 30e-6, false, leaking, 3.0);
            let measured = (before / air.syringe_pa()).ln() / 3.0;
            assert!((measured / rate - 1.0).abs() < 1e-6, "{measured} {rate}");
        }
    }

    #[test]
    fn the_line_follows_the_syringe_by_the_tube() {
        let mut air = Air::at_rest(&TIGHT, 60e-6);
        run(&mut air, &TIGHT, 30e-6, false, false, 0.02);
        let share = air.line_pa() / air.syringe_pa();
        assert!((share - (1.0 - (-1.0f64).exp())).abs() < 1e-9, "{share}");
    }

    #[test]
    fn quick_compression_is_adiabatic_and_then_cools_to_boyle() {
        let gas = Gas {
            cools_s: 2.0,
            tube_s: 1e-9,
            ..TIGHT
        };
        let mut air = Air::at_rest(&gas, 60e-6);
        // Within a tenth of a time constant, in steps.
        for step in 1..=200 {
            let volume = 60e-6 - 30e-6 * f64::from(step) / 200.0;
            air.step(&gas, volume, false, false, 1e-5);
        }
        let adiabatic = 101_325.0 * (2f64.powf(1.4) - 1.0);
        assert!((air.syringe_pa() / adiabatic - 1.0).abs() < 0.01, "{air:?}");
        run(&mut air, &gas, 30e-6, false, false, 2.0);
        let expected = 101_325.0 * (1.0 + (2f64.powf(1.4) - 2.0) * (-1.0f64).exp());
        assert!((air.syringe_pa() / expected - 1.0).abs() < 0.01, "{air:?}");
        run(&mut air, &gas, 30e-6, false, false, 30.0);
        assert!((air.syringe_pa() / 101_325.0 - 1.0).abs() < 1e-4, "{air:?}");
    }

    #[test]
    fn an_actuator_that_swells_takes_its_share() {
        let gas = Gas {
            swells_m3_per_pa: 2e-6 / 100e3,
            ..TIGHT
        };
        let mut air = Air::at_rest(&gas, 60e-6);
        run(&mut air, &gas, 28e-6, false, false, 1.0);
        let volume = 28e-6 + 2e-6 * air.line_pa() / 100e3;
        let boyle = 101_325.0 * (60e-6 / volume - 1.0);
        assert!((air.line_pa() / boyle - 1.0).abs() < 1e-9, "{air:?}");
    }
}
