//! The paper's linear rival.
//!
//! The paper compares its model with a second-order linear system, M θ̈ + C θ̇ +
//! K θ = F. Here that is the model with n = 1, without effects, and with a stiffness that
//! agrees with the nonlinear one at a chosen angle. For a comparison on recordings it is
//! refitted first.

use model_core::actuator::Model;
use model_core::dynamics::Dynamics;

/// The linear model that needs the same force as `model` at `angle` (rad).
///
/// The secant stiffness is K |θ|ⁿ⁻¹; at zero angle it would vanish or be
/// infinite, so a tenth of a radian is the least.
pub fn linear_rival(model: &Model<f64>, angle: f64) -> Model<f64> {
    let d = model.dynamics();
    let angle = angle.abs().max(0.1);
    let dynamics = Dynamics {
        stiffness: d.stiffness * libm::pow(angle, d.exponent - 1.0),
        exponent: 1.0,
        ..*d
    };
    // The parameters of a valid model stay valid.
    Model::new(dynamics, &[]).unwrap_or(*model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rival_needs_the_same_force_at_the_angle() {
        let model: Model<f64> = Model::new(
            Dynamics {
                inertia: 0.36,
                damping: 0.9,
                stiffness: 0.127,
                exponent: 2.365,
                input_gain: 2e-5,
            },
            &[],
        )
        .unwrap();
        let rival = linear_rival(&model, 1.047);
        let ratio = rival.holding_pressure(1.047) / model.holding_pressure(1.047);
        assert!((ratio - 1.0).abs() < 1e-12);
        // Below it is stiffer, above it is softer.
        assert!(rival.holding_pressure(0.5) > model.holding_pressure(0.5));
        assert!(rival.holding_pressure(1.5) < model.holding_pressure(1.5));
    }
}
