//! The grammar of one term: a force that no effect of the catalogue makes.
//!
//! A catalogue ends somewhere, and a lab's actuator does not care where. What is missing is then
//! looked for as one term of factors that an engineer can read ([`terms`]). A term is an effect by a
//! formula ([`Formulated`]): it is simulated, fitted, judged, written and exported as one of the
//! user's own.
//!
//! Ranges of frequencies, thresholds and times go with the size of the recordings, in half decades,
//! so that two rigs of one size have the same terms.

use model_core::catalogue::Kind;
use model_core::effects::custom::{Formula, Origin};
use softrig_formats::family::Family;
use softrig_formats::own_effects::{DeclaredMemory, DeclaredParameter, Formulated, Hold};

use crate::diagnose::score::scales::Scales;

/// How the names of terms begin.
pub const PREFIX: &str = "term_";

/// A factor of a term.
#[derive(Clone, Debug)]
struct Factor {
    /// In the name of an effect.
    name: &'static str,
    /// In sentences.
    title: &'static str,
    /// In the formula.
    text: String,
    /// What a size is divided by in its unit; empty where it has no dimension.
    unit: &'static str,
    /// A frequency, a threshold or a time in it.
    shape: Option<DeclaredParameter>,
    /// What its memory follows, if it has one; the shape is then its time constant.
    follows: Option<&'static str>,
    /// The effect of the catalogue that it is by itself.
    is: Option<Kind>,
    /// The kind of a term that ends with it.
    family: Family,
}

impl Factor {
    fn of(name: &'static str, title: &'static str, text: &str, unit: &'static str) -> Self {
        Self {
            name,
            title,
            text: text.into(),
            unit,
            shape: None,
            follows: None,
            is: None,
            family: Family::StiffnessShape,
        }
    }

    fn a_kind_of(self, family: Family) -> Self {
        Self { family, ..self }
    }

    fn is(self, kind: Kind) -> Self {
        Self {
            is: Some(kind),
            ..self
        }
    }

    /// The same, held until the end.
    fn held(mut self) -> Self {
        if let Some(shape) = &mut self.shape {
            shape.hold = Hold::UntilNamed;
        }
        self
    }

    /// With a memory z that follows this, faster than the longest session and not within a sample.
    fn remembering(self, follows: &'static str, sizes: Sizes) -> Self {
        let times = [0.003 * sizes.duration, 0.3 * sizes.duration];
        let shaped = self.shaped("tau", times, "s");
        Self {
            follows: Some(follows),
            ..shaped
        }
    }

    /// With a parameter of its shape between two bounds, from their middle on a logarithmic scale.
    fn shaped(self, key: &str, bounds: [f64; 2], unit: &str) -> Self {
        let [min, max] = bounds.map(two_digits);
        Self {
            shape: Some(DeclaredParameter {
                key: key.into(),
                value: two_digits((min * max).sqrt()),
                min: Some(min),
                max: Some(max),
                unit: unit.into(),
                hold: Hold::Free,
            }),
            ..self
        }
    }
}

/// A number of the grammar, as a person would write it.
fn two_digits(number: f64) -> f64 {
    format!("{number:.1e}").parse().unwrap_or(number)
}

/// Sizes of the recordings, in half decades: the next larger 1 or √10 times a power of ten.
#[derive(Clone, Copy, Debug)]
struct Sizes {
    /// Largest angle (rad).
    angle: f64,
    /// Fastest rate (rad/s).
    rate: f64,
    /// Longest session (s).
    duration: f64,
    /// Highest pressure (kPa).
    kpa: f64,
}

impl Sizes {
    fn of(scales: &Scales) -> Self {
        let rounded = |value: f64| {
            let halves = (2.0 * libm::log10(value.max(1e-6)) - 1e-9).ceil();
            two_digits(libm::pow(10.0, 0.5 * halves))
        };
        Self {
            angle: rounded(scales.angle()),
            rate: rounded(scales.rate()),
            duration: rounded(scales.duration()),
            kpa: rounded(1e-3 * scales.pressure()),
        }
    }
}

/// Static curves of the angle.
fn curves(sizes: Sizes) -> Vec<Factor> {
    let angle = sizes.angle;
    // From hardly a bend to some periods within the angle.
    let waves = [1.5 / angle, 30.0 / angle];
    let bends = [0.5 / angle, 100.0 / angle];
    // From hardly a bend to three hundred times the slope at the end.
    let steepness = [0.3 / angle, 6.0 / angle];
    let thresholds = [0.02 * angle, angle];
    let of = Factor::of;
    vec![
        of("angle", "force in proportion to the angle", "th", "rad").is(Kind::LinearStiffness),
        of(
            "angle_squared",
            "force with the square of the angle",
            "th^2",
            "rad^2",
        ),
        of(
            "angle_cubed",
            "force with the cube of the angle",
            "th^3",
            "rad^3",
        )
        .is(Kind::CubicStiffness),
        of(
            "angle_5",
            "force with the fifth power of the angle",
            "th^5",
            "rad^5",
        ),
        of("sine", "force with the sine of the angle", "sin(th)", "").is(Kind::Gravity),
        of(
            "cosine",
            "force with one minus the cosine of the angle",
            "(1 - cos(th))",
            "",
        ),
        of("wave", "wave over the angle", "sin(k*th)", "").shaped("k", waves, "1/rad"),
        of(
            "even_wave",
            "even wave over the angle",
            "(1 - cos(k*th))",
            "",
        )
        .shaped("k", waves, "1/rad"),
        of(
            "root",
            "force with the root of the angle",
            "sign(th)*sqrt(abs(th))",
            "rad^0.5",
        ),
        of(
            "logarithm",
            "force with the logarithm of the angle",
            "sign(th)*log(1 + k*abs(th))",
            "",
        )
        .shaped("k", bends, "1/rad"),
        of(
            "exponential",
            "force that grows exponentially with the angle",
            "sign(th)*(exp(k*abs(th)) - 1)",
            "",
        )
        .shaped("k", steepness, "1/rad"),
        of(
            "contact",
            "contact beyond an angle",
            "max(th - th0, 0)",
            "rad",
        )
        .shaped("th0", thresholds, "rad")
        .is(Kind::EndStop),
        of(
            "soft_contact",
            "rounded contact beyond an angle",
            "max(th - th0, 0)^1.5",
            "rad^1.5",
        )
        .shaped("th0", thresholds, "rad"),
    ]
}

/// Powers of the pressure, where it is above that of the air, and what begins at a pressure.
fn pressures(sizes: Sizes) -> Vec<Factor> {
    let thresholds = [0.02 * sizes.kpa, sizes.kpa];
    let of = Factor::of;
    vec![
        of("pressure", "the pressure", "p", "kPa"),
        of(
            "pressure_squared",
            "the square of the pressure",
            "p^2",
            "kPa^2",
        ),
        of(
            "pressure_root",
            "the root of the pressure",
            "sqrt(max(p, 0))",
            "kPa^0.5",
        ),
        of(
            "pressure_beyond",
            "the pressure beyond a threshold",
            "max(p - p0, 0)",
            "kPa",
        )
        .shaped("p0", thresholds, "kPa"),
    ]
}

/// What dissipation grows with: never below zero.
fn growths(sizes: Sizes) -> Vec<Factor> {
    let of = Factor::of;
    let never_below = [
        of("angle", "the angle", "abs(th)", "rad"),
        of("angle_squared", "the square of the angle", "th^2", "rad^2"),
        of(
            "angle_and_pressure",
            "angle and pressure",
            "abs(th)*max(p, 0)",
            "rad/kPa",
        ),
        of("pressure", "the pressure", "max(p, 0)", "kPa"),
    ];
    // The pressure itself may be below zero, its powers are not.
    let powers = pressures(sizes).into_iter().skip(1);
    never_below.into_iter().chain(powers).collect()
}

/// What opposes the motion.
fn resistances(sizes: Sizes) -> Vec<Factor> {
    // How sharp a sign is hardly matters to what it is: it is fitted in the end.
    let widths = [0.001 * sizes.rate, 0.1 * sizes.rate];
    let width = two_digits(0.01 * sizes.rate);
    let of = |name, title, text, unit| {
        Factor::of(name, title, text, unit).a_kind_of(Family::RateDamping)
    };
    vec![
        of("damping", "damping", "w", "(rad/s)"),
        of("friction", "dry friction", "tanh(w/s)", "")
            .shaped("s", widths, "rad/s")
            .held()
            .is(Kind::CoulombFriction)
            .a_kind_of(Family::DryFriction),
        of("fast_damping", "quadratic damping", "w*abs(w)", "(rad/s)^2").is(Kind::QuadraticDamping),
        of(
            "cubic_damping",
            "damping with the cube of the rate",
            "w^3",
            "(rad/s)^3",
        ),
        of(
            "thinning_damping",
            "damping with the root of the rate",
            &format!("w/sqrt(sqrt(w^2 + {}))", two_digits(width * width)),
            "(rad/s)^0.5",
        ),
    ]
}

/// What relaxes: the part of a force that its memory has not caught up with.
fn relaxing(sizes: Sizes) -> Vec<Factor> {
    let of = |name, title, text, unit, follows| {
        let factor = Factor::of(name, title, text, unit).a_kind_of(Family::Creep);
        factor.remembering(follows, sizes)
    };
    vec![
        of(
            "relaxing_angle",
            "relaxing force with the angle",
            "(th - z)",
            "rad",
            "th",
        )
        .is(Kind::MaxwellBranch),
        of(
            "relaxing_angle_squared",
            "relaxing force with the square of the angle",
            "(th^2 - z)",
            "rad^2",
            "th^2",
        ),
        of(
            "relaxing_angle_cubed",
            "relaxing force with the cube of the angle",
            "(th^3 - z)",
            "rad^3",
            "th^3",
        ),
        of("relaxing_pressure", "relaxing drive", "(p - z)", "kPa", "p"),
        of(
            "relaxing_pressure_by_angle",
            "relaxing stiffness by the pressure",
            "th*(p - z)",
            "rad/kPa",
            "p",
        ),
    ]
}

/// What a force grows with that was before: never below zero.
fn pasts(sizes: Sizes) -> Vec<Factor> {
    let of = |name, title, text, unit, follows| {
        Factor::of(name, title, text, unit).remembering(follows, sizes)
    };
    vec![
        of("past_speed", "the recent speed", "z", "(rad/s)", "abs(w)"),
        of("past_angle", "the recent angle", "z", "rad", "abs(th)"),
        of(
            "past_pressure",
            "the recent pressure",
            "z",
            "kPa",
            "max(p, 0)",
        ),
    ]
}

/// The terms that recordings of this size are searched for, without those that an effect of
/// `tried` is.
///
/// ```text
/// Q = c f(θ) h(p)          elastic: a static curve of the angle, by itself or with the pressure
/// Q = c m(θ or p) g(ω)     dissipative: damping or friction that grows with angle or pressure
/// Q = (a + b m) g(ω)       the same with a part that is always there
/// Q = c e^{−t/τ} f(θ) h(p) what passes while the rig warms up
/// Q = c (f − z), ż = (f − z)/τ what relaxes, of the angle or the pressure
/// Q = c z g(ω or θ)        damping, friction or stiffness by what was before
/// ```
///
/// The last two have a memory z, a hidden state that follows the angle, the pressure or the speed.
///
/// Every term keeps its dimensions: its size has a unit, and what opposes the motion cannot drive
/// it (its sizes are not negative, m and g have one sign).
pub fn terms(scales: &Scales, tried: &[Kind]) -> Vec<Kind> {
    terms_of(Sizes::of(scales), tried)
}

/// Whether a term has this name.
pub fn is_name_of_term(name: &str) -> bool {
    let any = Sizes {
        angle: 1.0,
        rate: 1.0,
        duration: 10.0,
        kpa: 100.0,
    };
    terms_of(any, &[]).iter().any(|kind| kind.name() == name)
}

fn terms_of(sizes: Sizes, tried: &[Kind]) -> Vec<Kind> {
    let is_tried = |kind: Option<Kind>| kind.is_some_and(|kind| tried.contains(&kind));
    let (curves, pressures) = (curves(sizes), pressures(sizes));
    let decay = Factor::of("passing", "that passes with time", "exp(-t/tau)", "")
        .shaped("tau", [0.02 * sizes.duration, sizes.duration], "s")
        .a_kind_of(Family::Drift);
    let mut terms: Vec<Option<Kind>> = Vec::new();
    for curve in curves.iter().filter(|curve| !is_tried(curve.is)) {
        terms.push(product(curve.name, curve.title, &[curve], None));
    }
    for pressure in &pressures[1..] {
        let title = format!("force with {}", pressure.title);
        terms.push(product(pressure.name, &title, &[pressure], None));
    }
    for curve in &curves {
        // One shape at a time: two thresholds would be two discoveries.
        let both_shaped = |pressure: &&Factor| curve.shape.is_some() && pressure.shape.is_some();
        for pressure in pressures.iter().filter(|it| !both_shaped(it)) {
            let is_catalogued = (curve.name, pressure.name) == ("angle", "pressure");
            if is_catalogued && is_tried(Some(Kind::PressureStiffening)) {
                continue;
            }
            let name = format!("{}_by_{}", curve.name, pressure.name);
            let title = format!("{}, times {}", curve.title, pressure.title);
            terms.push(product(&name, &title, &[curve, pressure], None));
        }
    }
    for resistance in resistances(sizes) {
        // Damping by itself is a part of the base.
        if resistance.name != "damping" && !is_tried(resistance.is) {
            terms.push(product(
                resistance.name,
                resistance.title,
                &[&resistance],
                Some(0.0),
            ));
        }
        for growth in growths(sizes) {
            let is_catalogued = (resistance.name, growth.name) == ("damping", "angle");
            if is_catalogued && is_tried(Some(Kind::AngleDependentDamping)) {
                continue;
            }
            let name = format!("{}_with_{}", resistance.name, growth.name);
            let title = format!("{} that grows with {}", resistance.title, growth.title);
            let alone = product(&name, &title, &[&growth, &resistance], Some(0.0));
            terms.push(alone);
            if resistance.name != "damping" {
                terms.push(with_constant(&name, &title, &growth, &resistance, alone));
            }
        }
    }
    let passing = |factors: &[&Factor], name: &str, title: &str| {
        let all: Vec<&Factor> = factors.iter().copied().chain([&decay]).collect();
        product(name, title, &all, None)
    };
    terms.push(passing(&[], "passing", "force that passes with time"));
    terms.push(passing(
        &[&pressures[0]],
        "passing_by_pressure",
        "drive that passes with time",
    ));
    terms.push(passing(
        &[&curves[0]],
        "passing_by_angle",
        "stiffness that passes with time",
    ));
    let centrifugal = Factor::of(
        "centrifugal",
        "force with the square of the rate, by the angle",
        "th*w^2",
        "rad/(rad/s)^2",
    );
    terms.push(product(
        centrifugal.name,
        centrifugal.title,
        &[&centrifugal],
        None,
    ));
    for factor in relaxing(sizes).iter().filter(|it| !is_tried(it.is)) {
        terms.push(product(factor.name, factor.title, &[factor], None));
    }
    let (resistances, angle) = (resistances(sizes), &curves[0]);
    for past in &pasts(sizes) {
        // Either has a shape of its own: the sign is as sharp as it is.
        for resistance in &resistances[..2] {
            let name = format!("{}_with_{}", resistance.name, past.name);
            let title = format!("{} that grows with {}", resistance.title, past.title);
            terms.push(product(&name, &title, &[past, resistance], Some(0.0)));
        }
        let name = format!("stiffness_with_{}", past.name);
        let title = format!("stiffness by {}", past.title);
        terms.push(product(&name, &title, &[past, angle], None));
    }
    terms.into_iter().flatten().collect()
}

/// c times the factors.
fn product(name: &str, title: &str, factors: &[&Factor], least: Option<f64>) -> Option<Kind> {
    let text: Vec<&str> = factors.iter().map(|factor| factor.text.as_str()).collect();
    let sizes = vec![size("c", factors, least)];
    term(
        name,
        title.into(),
        format!("c*{}", text.join("*")),
        sizes,
        factors,
        None,
    )
}

/// (a + b m) g: more than b m g alone only where the constant part shows.
fn with_constant(
    name: &str,
    title: &str,
    growth: &Factor,
    resistance: &Factor,
    alone: Option<Kind>,
) -> Option<Kind> {
    let sizes = vec![
        size("a", &[resistance], Some(0.0)),
        size("b", &[growth, resistance], Some(0.0)),
    ];
    term(
        &format!("{name}_and_constant"),
        format!("{title}, beside a constant part"),
        format!("(a + b*{})*{}", growth.text, resistance.text),
        sizes,
        &[growth, resistance],
        alone,
    )
}

/// A term of these sizes, with what shapes its factors.
fn term(
    name: &str,
    title: String,
    force: String,
    sizes: Vec<DeclaredParameter>,
    factors: &[&Factor],
    special_case: Option<Kind>,
) -> Option<Kind> {
    let shapes = factors.iter().filter_map(|factor| factor.shape.clone());
    let memories = factors.iter().filter_map(|factor| factor.follows);
    let memories = memories.map(|follows| DeclaredMemory {
        key: "z".into(),
        follows: follows.into(),
        time_constant: "tau".into(),
    });
    Formulated {
        name: format!("{PREFIX}{name}"),
        title,
        force,
        parameters: sizes.into_iter().chain(shapes).collect(),
        memories: memories.collect(),
        family: factors.last().map(|factor| factor.family),
        special_case,
    }
    .kind()
}

/// The size of a term, with its unit.
fn size(key: &str, factors: &[&Factor], min: Option<f64>) -> DeclaredParameter {
    let units: Vec<&str> = factors
        .iter()
        .map(|factor| factor.unit)
        .filter(|unit| !unit.is_empty())
        .collect();
    DeclaredParameter {
        key: key.into(),
        value: 1.0,
        min,
        max: None,
        unit: if units.is_empty() {
            "N".into()
        } else {
            format!("N/{}", units.join("/"))
        },
        hold: Hold::Free,
    }
}

/// Whether an effect is a term of the grammar.
pub fn is_term(kind: Kind) -> bool {
    matches!(kind, Kind::Custom(Formula(definition)) if definition.origin == Origin::Grammar)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use model_core::effects::{Instant, Mechanism};

    use super::*;

    const RIG: Sizes = Sizes {
        angle: 1.0,
        rate: 3.2,
        duration: 32.0,
        kpa: 100.0,
    };

    fn all() -> Vec<Kind> {
        terms_of(RIG, &[])
    }

    #[test]
    fn every_term_can_be_read_and_has_a_name_and_a_title_of_its_own() {
        let terms = all();
        let [names, titles] = [
            |kind: &Kind| kind.info().name,
            |kind: &Kind| kind.info().title,
        ]
        .map(|of| terms.iter().map(of).collect::<BTreeSet<_>>());
        assert_eq!(names.len(), terms.len());
        assert_eq!(titles.len(), terms.len());
        // None was dropped because its formula is not valid: 13 curves and 3 pressures, the curves
        // with 4 pressures but for 6 with a shape of their own beside a threshold, 4 resistances
        // alone, 5 with 7 growths, 4 of these with a constant part, 3 that pass, the centrifugal
        // one, 5 that relax, and 3 pasts with 2 resistances and a stiffness.
        assert_eq!(terms.len(), 13 + 3 + 46 + 4 + 35 + 28 + 3 + 1 + 5 + 9);
        assert!(terms.iter().all(|kind| is_term(*kind)));
    }

    #[test]
    fn what_the_catalogue_has_is_left_to_it() {
        let tried = [Kind::CubicStiffness, Kind::CoulombFriction];
        let names: Vec<&str> = terms_of(RIG, &tried).iter().map(|it| it.name()).collect();
        assert_eq!(names.len(), all().len() - tried.len());
        assert!(!names.contains(&"term_angle_cubed") && !names.contains(&"term_friction"));
        assert!(names.contains(&"term_angle_cubed_by_pressure"));
        assert!(names.contains(&"term_friction_with_pressure"));
    }

    /// What resists never drives, at any angle, rate and pressure, whatever sizes a fit finds.
    #[test]
    fn what_opposes_the_motion_takes_power_from_it() {
        let resists = |kind: &&Kind| {
            ["damping", "friction"]
                .iter()
                .any(|word| kind.name().contains(word))
        };
        let terms = all();
        for kind in terms.iter().filter(resists) {
            let values: Vec<f64> = kind
                .parameters()
                .iter()
                .map(|row| row.held.map_or(1.0, f64::from))
                .collect();
            assert!(kind.parameters()[0].lower >= 0.0, "{kind:?}");
            let effect = kind.build(&values).unwrap();
            for angle in [-1.0, 0.0, 0.7] {
                for rate in [-2.0, -0.01, 0.0, 0.3] {
                    for pressure in [-3e3, 0.0, 8e4] {
                        let at = Instant {
                            time: 1.0,
                            angle,
                            rate,
                            pressure,
                        };
                        // A memory of what is never below zero is never below zero.
                        for past in [0.0, 2.0] {
                            let force: f64 = effect.force(&at, &[past; 2], &mut [0.0; 2]);
                            assert!(force * rate >= 0.0, "{kind:?} at {at:?}");
                        }
                    }
                }
            }
        }
    }

    /// Every memory follows something within a time that is a parameter.
    #[test]
    fn what_is_remembered_is_followed() {
        let terms = all();
        let mut remembering = terms.iter().filter(|kind| {
            let info = kind.info();
            info.states.len() == 1 && info.equation.contains("dz/dt = (")
        });
        assert_eq!(remembering.clone().count(), 5 + 9);
        assert!(remembering.all(|kind| kind.parameters().iter().any(|row| row.key == "tau")));
    }

    /// Every size is a force by something, so that a fit starts it from the score.
    #[test]
    fn sizes_are_forces() {
        for kind in all() {
            let sizes = kind.parameters().iter().filter(|row| row.unit.is_force());
            let key = kind.parameters()[0].key;
            assert_eq!(sizes.count(), if key == "a" { 2 } else { 1 }, "{kind:?}");
        }
    }
}
