//! Measures the errors of the power functions and of the elementary functions
//! they stand on, and prints the tables of `docs/power.md`.
//!
//! ```text
//! cargo run --release -p softrig-bench --example power_error
//! ```
//!
//! Everything is compared with the platform's `f64` functions, in absolute
//! value, on fixed sweeps: the output is the same on every run. Takes about
//! half a minute.

use std::f32::consts::PI;

use micromath::F32Ext;
use model_core::elementary::{LARGEST_ANGLE, cos, exp, exp2, ln, log2, sin, tanh};
use model_core::power::{GuardedMicromath, Minimax, Power};

/// micromath as it comes, for comparison.
#[derive(Clone, Copy, Debug, Default)]
struct Unguarded;

impl Power<f32> for Unguarded {
    fn pow(base: f32, exponent: f32) -> f32 {
        F32Ext::powf(base, exponent)
    }
}

/// The largest value seen and where it was.
#[derive(Clone, Copy, Default)]
struct Worst<Place> {
    value: f64,
    place: Place,
}

impl<Place> Worst<Place> {
    fn take(&mut self, value: f64, place: Place) {
        // NaN counts as the worst of all: no comparison may swallow it.
        if value > self.value || value.is_nan() {
            *self = Self { value, place };
        }
    }
}

/// Every `step`-th `f32` of a positive range.
fn sweep(low: f32, high: f32, step: u32) -> impl Iterator<Item = f32> {
    (low.to_bits()..=high.to_bits())
        .step_by(usize::try_from(step).expect("a step fits"))
        .map(f32::from_bits)
}

fn power_error<P: Power<f32>>(low: f32, high: f32, exponents: &[f32]) -> Worst<(f32, f32)> {
    let mut worst = Worst::default();
    for &exponent in exponents {
        for base in sweep(low, high, 613) {
            let exact = f64::from(base).powf(f64::from(exponent));
            let error = (f64::from(P::pow(base, exponent)) - exact).abs() / exact;
            worst.take(error, (base, exponent));
        }
    }
    worst
}

/// How often, and by how much at most, the power falls from one `f32` to the
/// next, over all of them between 10⁻⁴ and π.
fn falls<P: Power<f32>>(exponents: &[f32]) -> (u64, Worst<(f32, f32)>) {
    let (mut count, mut worst) = (0, Worst::default());
    for &exponent in exponents {
        let mut before = 0.0;
        for base in sweep(1e-4, PI, 1) {
            let here = P::pow(base, exponent);
            if here < before {
                count += 1;
                worst.take(f64::from((before - here) / before), (base, exponent));
            }
            before = here;
        }
    }
    (count, worst)
}

fn print_power_row<P: Power<f32>>(name: &str, exponents: &[f32]) {
    let whole = power_error::<P>(1e-4, PI, exponents);
    let ordinary = power_error::<P>(0.1, PI, exponents);
    println!(
        "| {name} | {:.2e} | {:.4e}, {} | {:.2e} |",
        whole.value, whole.place.0, whole.place.1, ordinary.value
    );
}

fn print_falls_row<P: Power<f32>>(name: &str, exponents: &[f32]) {
    let (count, worst) = falls::<P>(exponents);
    if count == 0 {
        println!("| {name} | 0 | – | – |");
    } else {
        println!(
            "| {name} | {count} | {:.2e} | {}, {} |",
            worst.value, worst.place.0, worst.place.1
        );
    }
}

/// How an elementary function is compared.
#[derive(Clone, Copy)]
struct Measure {
    relative: bool,
    both_sides: bool,
}

const RELATIVE: Measure = Measure {
    relative: true,
    both_sides: true,
};
const POSITIVE: Measure = Measure {
    relative: true,
    both_sides: false,
};
const ABSOLUTE: Measure = Measure {
    relative: false,
    both_sides: true,
};

/// Prints the largest error over a range of |x|, on both sides of 0 if the
/// function has two.
fn print_elementary_row(
    name: &str,
    (low, high): (f32, f32),
    Measure {
        relative,
        both_sides,
    }: Measure,
    computed: fn(f32) -> f32,
    exact: fn(f64) -> f64,
) {
    let mut worst = Worst::default();
    for magnitude in sweep(low, high, 11) {
        let sides: &[f32] = if both_sides {
            &[magnitude, -magnitude]
        } else {
            &[magnitude]
        };
        for &x in sides {
            let should = exact(f64::from(x));
            let mut error = (f64::from(computed(x)) - should).abs();
            if relative && should != 0.0 {
                error /= should.abs();
            }
            worst.take(error, x);
        }
    }
    let sign = if both_sides { "±" } else { "" };
    let kind = if relative { "relative" } else { "absolute" };
    println!(
        "| {name} | {sign}[{low:e}, {high:e}] | {:.2e} {kind} | {:.6e} |",
        worst.value, worst.place
    );
}

fn main() {
    let exponents: Vec<f32> = (0..=40_u8).map(|i| 1.0 + f32::from(i) / 20.0).collect();

    println!("theta in [1e-4, pi] rad, n = 1, 1.05 … 3; relative error\n");
    println!("| implementation | largest error | at θ, n | largest, θ ≥ 0.1 |");
    println!("|---|---|---|---|");
    print_power_row::<Minimax>("`Minimax`", &exponents);
    print_power_row::<GuardedMicromath>("`GuardedMicromath`", &exponents);
    print_power_row::<Unguarded>("micromath 2.1 `powf`, unguarded", &exponents);

    println!("\nby exponent\n");
    println!("| n | `Minimax` | `GuardedMicromath` | unguarded |");
    println!("|---|---|---|---|");
    for exponent in [1.0, 1.25, 1.5, 2.0, 2.365, 2.5, 3.0] {
        println!(
            "| {exponent} | {:.2e} | {:.2e} | {:.2e} |",
            power_error::<Minimax>(1e-4, PI, &[exponent]).value,
            power_error::<GuardedMicromath>(1e-4, PI, &[exponent]).value,
            power_error::<Unguarded>(1e-4, PI, &[exponent]).value,
        );
    }

    let watched = [1.000_1, 1.5, 2.0, 2.365, 3.0];
    println!("\nfalls between neighbouring f32, all of [1e-4, pi], n = {watched:?}\n");
    println!("| implementation | falls | largest | at θ, n |");
    println!("|---|---|---|---|");
    print_falls_row::<Minimax>("`Minimax`", &watched);
    print_falls_row::<GuardedMicromath>("`GuardedMicromath`", &watched);
    print_falls_row::<Unguarded>("micromath 2.1 `powf`, unguarded", &watched);

    println!("\nelementary functions\n");
    println!("| function | range | largest error | at |");
    println!("|---|---|---|---|");
    let tiny = f32::MIN_POSITIVE;
    let quarter = std::f32::consts::FRAC_PI_4;
    print_elementary_row("`exp2`", (1e-8, 126.0), RELATIVE, exp2, f64::exp2);
    for range in [(1e-8, 1.0), (1.0, 10.0), (10.0, 87.0)] {
        print_elementary_row("`exp`", range, RELATIVE, exp, f64::exp);
    }
    print_elementary_row("`log2`", (tiny, f32::MAX), POSITIVE, log2, f64::log2);
    print_elementary_row("`ln`", (tiny, f32::MAX), POSITIVE, ln, f64::ln);
    for range in [(1e-8, 0.55), (0.55, 20.0)] {
        print_elementary_row("`tanh`", range, RELATIVE, tanh, f64::tanh);
    }
    print_elementary_row("`sin`", (1e-8, quarter), RELATIVE, sin, f64::sin);
    for range in [(quarter, 100.0), (100.0, LARGEST_ANGLE)] {
        print_elementary_row("`sin`", range, ABSOLUTE, sin, f64::sin);
    }
    for range in [(1e-8, 100.0), (100.0, LARGEST_ANGLE)] {
        print_elementary_row("`cos`", range, ABSOLUTE, cos, f64::cos);
    }
}
