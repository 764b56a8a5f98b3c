//! What the benchmark knows of the catalogue's kinds: which resemble each other, for drawing
//! and for counting. The diagnosis has families of its own, which are not asked here.

/// A kind of the catalogue.
struct EffectWords {
    kind: &'static str,
    /// What it acts by: of a pair, the two are drawn from different groups.
    group: &'static str,
    /// Members of a family may be named for each other where data do not tell them apart.
    family: &'static str,
    /// Look-alikes as the catalogue lists them; the relation goes both ways.
    look_alikes: &'static [&'static str],
}

const fn row(
    kind: &'static str,
    group: &'static str,
    family: &'static str,
    look_alikes: &'static [&'static str],
) -> EffectWords {
    EffectWords {
        kind,
        group,
        family,
        look_alikes,
    }
}

#[rustfmt::skip] // A table.
const ROWS: [EffectWords; 27] = [
    row("coulomb_friction", "friction", "dry friction", &["bouc_wen_hysteresis", "input_backlash"]),
    row("stribeck_friction", "friction", "dry friction", &["coulomb_friction"]),
    row("bouc_wen_hysteresis", "friction", "dry friction", &["input_backlash", "maxwell_branch"]),
    row("input_backlash", "friction", "play", &[]),
    row("maxwell_branch", "memory", "creep", &["stiffness_drift", "mullins_softening", "sensor_drift"]),
    row("leak", "memory", "creep", &["maxwell_branch"]),
    row("stiffness_drift", "memory", "drift", &["sensor_drift", "mullins_softening"]),
    row("sensor_drift", "memory", "drift", &[]),
    row("mullins_softening", "memory", "first stretch", &[]),
    row("quadratic_damping", "damping", "rate damping", &["angle_dependent_damping", "vent_asymmetry"]),
    row("angle_dependent_damping", "damping", "rate damping", &["maxwell_branch"]),
    row("asymmetric_damping", "damping", "rate damping", &["vent_asymmetry"]),
    // Elasticity, and what shifts or bends the static curve.
    row("exponent_shift", "static", "stiffness shape", &["cubic_stiffness", "sensor_nonlinearity"]),
    row("cubic_stiffness", "static", "stiffness shape", &["end_stop"]),
    row("linear_stiffness", "static", "stiffness shape", &["exponent_shift", "pressure_threshold"]),
    row("gravity", "static", "stiffness shape", &["exponent_shift", "sensor_nonlinearity"]),
    row("end_stop", "static", "stiffness shape", &[]),
    row("pressure_stiffening", "static", "stiffness shape", &["exponent_shift", "cubic_stiffness"]),
    row("sensor_nonlinearity", "static", "stiffness shape", &[]),
    row("pressure_threshold", "static", "offset", &["sensor_offset"]),
    row("sensor_offset", "static", "offset", &[]),
    row("pneumatic_lag", "delay", "input path", &["dead_time", "sensor_lag"]),
    row("dead_time", "delay", "input path", &["sensor_lag"]),
    row("vent_asymmetry", "delay", "input path", &[]),
    row("sensor_lag", "delay", "sensor path", &[]),
    row("periodic_disturbance", "oscillation", "periodic", &[]),
    row("second_mode", "oscillation", "second mode", &["periodic_disturbance"]),
];

fn of(kind: &str) -> Option<&'static EffectWords> {
    ROWS.iter().find(|row| row.kind == kind)
}

/// What a kind acts by.
pub fn group(kind: &str) -> &'static str {
    of(kind).map_or("static", |row| row.group)
}

/// The family of a kind; its own name where it has none.
pub fn family(kind: &str) -> &str {
    of(kind).map_or(kind, |row| row.family)
}

/// Whether the catalogue lists two kinds as look-alikes.
pub fn look_alike(a: &str, b: &str) -> bool {
    let lists = |a: &str, b: &str| of(a).is_some_and(|row| row.look_alikes.contains(&b));
    lists(a, b) || lists(b, a)
}

#[cfg(test)]
mod tests {
    use super::super::law::kinds;
    use super::*;

    #[test]
    fn every_kind_has_one_row() {
        let mut known = kinds();
        let mut rows = ROWS.map(|row| row.kind);
        known.sort_unstable();
        rows.sort_unstable();
        assert_eq!(known, rows);
    }

    #[test]
    fn look_alikes_go_both_ways() {
        assert!(look_alike("coulomb_friction", "stribeck_friction"));
        assert!(look_alike("stribeck_friction", "coulomb_friction"));
        assert!(!look_alike("gravity", "leak"));
        for row in &ROWS {
            let known = |other: &&str| of(other).is_some();
            assert!(row.look_alikes.iter().all(known), "{}", row.kind);
        }
    }
}
