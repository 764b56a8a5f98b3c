//! n = 1, Hooke's law: the step response has a closed form.

use model_core::dynamics::Dynamics;
use model_core::integrate::Scheme;

use crate::support::{F64, model_of, run};

/// Angle (rad) and rate (rad/s) after a step from rest, for M = `inertia`.
fn step_response(d: &Dynamics<f64>, pressure_pa: f64, time: f64) -> (f64, f64) {
    let end = d.input_gain * pressure_pa / d.stiffness;
    let decay = d.damping / (2.0 * d.inertia);
    let square = d.stiffness / d.inertia - decay * decay;
    let envelope = (-decay * time).exp();
    // e^(−decay·t) times these two solve the homogeneous equation.
    let (even, odd) = if square.abs() < 1e-9 {
        (1.0, time)
    } else if square > 0.0 {
        let w = square.sqrt();
        ((w * time).cos(), (w * time).sin() / w)
    } else {
        let w = (-square).sqrt();
        ((w * time).cosh(), (w * time).sinh() / w)
    };
    let angle = end * (1.0 - envelope * (even + decay * odd));
    let rate = end * envelope * odd * d.stiffness / d.inertia;
    (angle, rate)
}

#[test]
fn linear_step_response_is_the_closed_form() {
    let critical = 2.0 * (0.36_f64 * 1.5).sqrt();
    for (name, damping) in [
        ("undamped", 0.0),
        ("underdamped", 0.3 * critical),
        ("critically damped", critical),
        ("overdamped", 4.0 * critical),
    ] {
        let d = Dynamics {
            inertia: 0.36,
            damping,
            stiffness: 1.5,
            exponent: 1.0,
            input_gain: 2e-5,
        };
        let model = model_of(d);
        let pressure_pa = model.holding_pressure(1.0);
        let (dt, steps) = (1e-3, 10_000);
        let mut worst = [0.0_f64; 2];
        let start = model.at_rest(0.0, 0.0);
        run(
            Scheme::Rk4,
            &model,
            start,
            |_| pressure_pa,
            (dt, steps),
            F64,
            |k, state| {
                let (angle, rate) = step_response(&d, pressure_pa, f64::from(k) * dt);
                worst[0] = worst[0].max((state.angle - angle).abs());
                worst[1] = worst[1].max((state.rate - rate).abs());
            },
        );
        println!("{name}: {:.1e} rad, {:.1e} rad/s", worst[0], worst[1]);
        assert!(worst[0] < 1e-10 && worst[1] < 1e-10, "{name}: {worst:?}");
    }
}
