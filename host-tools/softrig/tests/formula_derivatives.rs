//! Formulas of the user's own have exact derivatives by dual numbers, on which fits rely.

use model_core::effects::Instant;
use proptest::prelude::*;
use softrig::sim::dual::Dual;
use softrig_formats::formula::Formula;
use softrig_formats::recording::PASCAL_PER_KPA;

const PARAMETERS: [&str; 3] = ["a", "b", "c"];

const FORMULAS: [&str; 11] = [
    "a*tanh(w/b) + c*th^3",
    "a*sin(b*th)*exp(-c*abs(w))",
    "a*sign(w)*abs(w)^b + c",
    "sqrt(abs(th) + a)*log(1 + b*p) - tan(c*t/8)",
    "max(a*th, b*w) + min(c, p)",
    "pow(abs(th), a)/(b + t) - c^2",
    "a/(b + th^2) + c*w*abs(w)",
    "(a + b*p)*tanh(w/0.1) + c*th",
    "a^b + abs(w)^-2*c",
    "exp(-(w/b)^2)*a*tanh(10*w/b) + c*cos(pi*th)",
    "a*2^th + b*th^-1 + c*t^0.5",
];

proptest! {
    /// At any numbers, also those that no state has.
    #[test]
    fn any_state_has_an_end(
        which in 0..FORMULAS.len(),
        parameters in prop::array::uniform3(any::<f64>()),
        state in prop::array::uniform4(any::<f64>()),
    ) {
        let formula = Formula::parse(FORMULAS[which], &PARAMETERS).unwrap();
        let program = formula.program().unwrap();
        let [angle, rate, pressure, time] = state.map(Dual::<3>::constant);
        let _ = program.at(
            &parameters.map(Dual::constant),
            &Instant { time, angle, rate, pressure },
            &[Dual::constant(0.0); 2],
        );
    }

    /// Compared with finite differences.
    #[test]
    fn derivatives_agree_with_differences(
        which in 0..FORMULAS.len(),
        parameters in prop::array::uniform3(0.2..2.0_f64),
        state in prop::array::uniform4(0.2..2.0_f64),
        negative in any::<bool>(),
    ) {
        let text = FORMULAS[which];
        let mut state = state;
        if negative {
            state[1] = -state[1];
        }
        let formula = Formula::parse(text, &PARAMETERS).unwrap();
        let program = formula.program().unwrap();
        let all = [
            parameters[0], parameters[1], parameters[2], state[0], state[1], state[2], state[3],
        ];
        let number = |all: [f64; 7]| {
            let [a, b, c, th, w, p, t] = all;
            let pressure = p * PASCAL_PER_KPA;
            program.at(&[a, b, c], &Instant { time: t, angle: th, rate: w, pressure }, &[0.0; 2])
        };
        let dual: [Dual<7>; 7] =
            std::array::from_fn(|index| Dual::variable(all[index], index, 1.0));
        let [a, b, c, th, w, p, t] = dual;
        let exact = program.at(
            &[a, b, c],
            &Instant { time: t, angle: th, rate: w, pressure: p * Dual::constant(PASCAL_PER_KPA) },
            &[Dual::constant(0.0); 2],
        );
        prop_assert!((exact.value() - number(all)).abs() < 1e-12 * exact.value().abs().max(1.0));
        for (index, slope) in exact.partials().into_iter().enumerate() {
            let moved = |by: f64| {
                let mut moved = all;
                moved[index] += by;
                number(moved)
            };
            let h = 1e-4;
            let difference = (8.0 * (moved(h) - moved(-h)) - moved(2.0 * h) + moved(-2.0 * h))
                / (12.0 * h);
            // Where a kink lies between, neither is right.
            let one_sided = (moved(h) - moved(0.0)) / h;
            if (one_sided - difference).abs() < 1e-2 * (1.0 + difference.abs()) {
                prop_assert!(
                    (slope - difference).abs() < 1e-5 * difference.abs().max(1.0),
                    "{text}, {index} at {all:?}: {slope} beside {difference}"
                );
            }
        }
    }
}
