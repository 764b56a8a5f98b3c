//! Leak: p_c = p − z, ż = (p − z)/τ_L.
//!
//! Where the pressure sensor sits decides whether this is an effect at all. In the chamber, a
//! leak is measured: p falls, the model is told, and no gap is left. The form here is for a
//! sensor on the pump's side of a restriction, or for a recorded pressure that is the pump's
//! position times its gain: during a hold p stands still while the chamber empties. After the
//! release p_c is below zero, because the pump takes back air that is no longer there.

use super::{Family, Hidden, Info, Mechanism, Parameter, Place, State, Unit, parameters};
use crate::carried::Lag;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "leak",
    title: "leak",
    place: Place::Input,
    equation: "p_c = p − z, ż = (p − z)/τ_L",
    text: "The chamber loses air while the recorded pressure, on the pump's side, stands still: \
           a fitting, a pinhole, a seam. During a hold the angle falls (a creep makes it rise), \
           and after the release the actuator bends the other way for a while.",
    signature: "time since the last command edge",
    look_alikes: &["maxwell_branch"],
    family: Family::Creep,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[State {
        key: "lost_pa",
        text: "z, pressure that was lost (Pa)",
    }],
};

parameters! {
    /// Leak.
    ///
    /// The chamber loses its pressure with the time constant τ_L: ṗ_c = ṗ − p_c/τ_L. The hidden
    /// state is what has been lost, z (Pa).
    ///
    /// A run starts with z = 0: at its start nothing has been lost. A piece that was cut out of a
    /// hold starts so too, and then wrongly takes the pressure of the moment for full. No pressure
    /// holds an angle against a leak.
    Leak {
        /// Time constant τ_L (s).
        time_constant: Parameter {
            key: "time_constant_s",
            symbol: "τ_L",
            unit: Unit::Second,
            lower: 0.125,
            upper: 8192.0,
            held: None,
            default: None,
            starts: &[3.0, 20.0, 100.0],
        },
    }
}

impl<R: Real> Mechanism<R> for Leak<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn input(&self, pressure: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let chamber = pressure - hidden[0];
        rates[0] = chamber / self.time_constant;
        chamber
    }

    fn pressure_towards(&self, pressure: R, hidden: &Hidden<R>) -> R {
        pressure + hidden[0]
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: R::one() / self.time_constant,
        }
    }
}

impl Preparation for Leak<f32> {
    const CYCLES: u16 = 1_600;
    type Part = Loss;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[6.0]);

    fn prepare(&self, base: &Base) -> Self::Part {
        Loss(Lag::new(self.time_constant, base.flow.dt))
    }
}

/// Loses the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss(Lag<f32>);

impl Part for Loss {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        [0.0, step.chamber]
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        step.chamber -= self.0.follow(memory, step.chamber);
        0.0
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// A free mass under a pressure that leaks away: M θ̈ = e^(−t/τ).
    #[test]
    fn free_mass_integrates_the_decay_twice() {
        let tau = 0.8;
        let leak = Kind::Leak.build(&[tau]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[leak]);
        let end = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), 2.0, 4_000);
        let decay = f64::exp(-2.0 / tau);
        assert!((end.rate - tau * (1.0 - decay)).abs() < 1e-10);
        assert!((end.angle - tau * (2.0 - tau * (1.0 - decay))).abs() < 1e-10);
    }

    /// After a hold of τ ln 2 half is lost, and at the release that half is
    /// missing.
    #[test]
    fn release_leaves_a_pressure_below_zero() {
        let tau = 5.0;
        let leak = Kind::Leak.build(&[tau]).unwrap();
        let model = spring(0.01, 1.0, 1.0, &[leak]);
        let hold = tau * core::f64::consts::LN_2;
        let held = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), hold, 4_000);
        assert!((held.hidden[0][0] - 0.5).abs() < 1e-10);
        let released = model.derivative(&held, &Held(0.0), 0.0);
        assert!((released.hidden[0][0] + 0.1).abs() < 1e-10);
    }
}
