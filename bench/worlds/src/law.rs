//! What a case can hide: one table of laws with their equations, which are
//! written again from the catalogue's.
//!
//! A diagnosis that is tested on recordings of its own simulator is tested
//! against itself. Nothing here comes from the crates under test, and for a part
//! of the effects there are other formulas for the same phenomenon, as real
//! actuators have them. [`World`](super::world::World) integrates them.
//!
//! M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ + Q = g p_c, everything in SI units and radians:
//! θ angle (rad), ω = θ̇ (rad/s), p pressure that the sensor in the line
//! measures (Pa), p_c pressure that acts (Pa), y what the angle sensor shows
//! (rad).

use serde::{Deserialize, Serialize};

use super::world::{Base, Line, power};

/// The most numbers that a law has.
pub const VALUES: usize = 4;

/// Integrated states of one effect.
pub(super) const STATES: usize = 8;
/// Remembered numbers of one effect.
pub(super) const MEMORY: usize = 8;
/// The most effects at once.
pub const EFFECTS: usize = 2;

/// A number of a law.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// Key in model files; keys of other laws than the catalogue's are only
    /// read by people.
    pub key: &'static str,
    /// Value in files for one SI unit.
    pub per_si: f64,
}

const fn q(key: &'static str) -> Quantity {
    Quantity { key, per_si: 1.0 }
}
const fn kpa(key: &'static str) -> Quantity {
    Quantity { key, per_si: 1e-3 }
}

/// What is known about a law beside its equation.
#[derive(Clone, Copy, Debug)]
pub struct LawWords {
    /// Name in answers.
    pub name: &'static str,
    /// The kind of the catalogue that it is a case of; none if it is outside.
    pub kind: Option<&'static str>,
    /// Whether it is the catalogue's own formula.
    pub same: bool,
    /// Its numbers.
    pub quantities: &'static [Quantity],
    /// Which of them make the effect larger, and with which power.
    pub sizes: &'static [(usize, f64)],
}

macro_rules! laws {
    ($( $(#[$doc:meta])* $variant:ident $name:literal $kind:expr, $same:expr, [$($quantity:expr),*], [$($size:expr),*]; )+) => {
        /// The laws that a case can hide: an equation, in brackets its numbers in
        /// the order in which they are stored, and its source where it has one.
        ///
        /// The names of these variants are a part of the seed of runs: where one is
        /// renamed, its cases are others.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum Law { $( $(#[$doc])* $variant, )+ }

        impl Law {
            /// Every law.
            pub const ALL: &'static [Self] = &[$( Self::$variant ),+];

            /// Its row of the table.
            pub const fn row(self) -> &'static LawWords {
                match self { $( Self::$variant => const { &LawWords {
                    name: $name, kind: $kind, same: $same,
                    quantities: &[$($quantity),*], sizes: &[$($size),*],
                } }, )+ }
            }
        }
    };
}

laws! {
    /// Q = T tanh(ω/ω_s) (T, ω_s).
    CoulombTanh "coulomb_tanh" Some("coulomb_friction"), true, [q("force_n"), q("smoothing_rad_per_s")], [(0, 1.0)];
    /// LuGre without Stribeck effect: ż = ω − |ω|z/s, Q = T(z/s) + σ₁ż with σ₁
    /// = 0.3 √(T M/s) (T, s) (Canudas de Wit et al. 1995).
    CoulombLugre "coulomb_lugre" Some("coulomb_friction"), false, [q("force_n"), q("presliding_rad")], [(0, 1.0)];
    /// Q = T ω/√(ω² + ω_s²) (T, ω_s).
    CoulombRoot "coulomb_root" Some("coulomb_friction"), false, [q("force_n"), q("smoothing_rad_per_s")], [(0, 1.0)];
    /// Q = (T + ΔT e^{−(ω/ω_S)²}) tanh(ω/ω_s) (T, ΔT, ω_S, ω_s).
    StribeckGauss "stribeck_gauss" Some("stribeck_friction"), true, [q("force_n"), q("extra_force_n"), q("stribeck_rad_per_s"), q("smoothing_rad_per_s")], [(0, 1.0), (1, 1.0)];
    /// The same with e^{−|ω|/ω_S} (Tustin 1947) and ω/√(ω² + ω_s²).
    StribeckExponential "stribeck_exponential" Some("stribeck_friction"), false, [q("force_n"), q("extra_force_n"), q("stribeck_rad_per_s"), q("smoothing_rad_per_s")], [(0, 1.0), (1, 1.0)];
    /// LuGre: ż = ω − |ω|σ₀z/(T + ΔT e^{−(ω/ω_S)²}), σ₀ = (T + ΔT)/s (T, ΔT, ω_S, s).
    StribeckLugre "stribeck_lugre" Some("stribeck_friction"), false, [q("force_n"), q("extra_force_n"), q("stribeck_rad_per_s"), q("presliding_rad")], [(0, 1.0), (1, 1.0)];
    /// Q = d ω|ω| (d).
    QuadraticDrag "quadratic_drag" Some("quadratic_damping"), true, [q("damping_n_s2_per_rad2")], [(0, 1.0)];
    /// Turbulent flow in a smooth tube, Q = d ω|ω|^0.75 (d) (Blasius 1913).
    QuadraticBlasius "quadratic_blasius" Some("quadratic_damping"), false, [q("drag")], [(0, 1.0)];
    /// C → C(1 + c₁|θ|) (c₁).
    AngleDamping "angle_damping" Some("angle_dependent_damping"), true, [q("slope_per_rad")], [(0, 1.0)];
    /// C → C(1 + c₂θ²) (c₂).
    AngleDampingSquare "angle_damping_square" Some("angle_dependent_damping"), false, [q("curvature_per_rad2")], [(0, 1.0)];
    /// C → C(1 + a) where ω < 0 (a).
    AsymmetricDamping "asymmetric_damping" Some("asymmetric_damping"), true, [q("ratio")], [(0, 1.0)];
    /// The same with a smooth change, ½(1 − tanh(ω/ω_a)) (a, ω_a).
    AsymmetricSmooth "asymmetric_smooth" Some("asymmetric_damping"), false, [q("ratio"), q("width_rad_per_s")], [(0, 1.0)];
    /// Q = k₁(θ − z), ż = (θ − z)/τ (k₁, τ).
    MaxwellOne "maxwell_one" Some("maxwell_branch"), true, [q("stiffness_n_per_rad"), q("time_constant_s")], [(0, 1.0)];
    /// Two such branches (k₁, τ₁, k₂, τ₂).
    MaxwellTwo "maxwell_two" Some("maxwell_branch"), false, [q("stiffness_n_per_rad"), q("time_constant_s"), q("stiffness_2_n_per_rad"), q("time_constant_2_s")], [(0, 1.0), (2, 1.0)];
    /// Creep that goes as a power of time: branches at τ/4, τ, 4τ, 16τ whose
    /// stiffness falls as τ^−0.3 (k, τ).
    MaxwellPower "maxwell_power" Some("maxwell_branch"), false, [q("stiffness_n_per_rad"), q("time_constant_s")], [(0, 1.0)];
    /// Q = a w, D ẇ = ω − ½|ω|w − ½ω|w| (a, D).
    BoucWen "bouc_wen" Some("bouc_wen_hysteresis"), true, [q("force_n"), q("yield_rad")], [(0, 1.0)];
    /// Dahl: D ẇ = ω |1 − w sign ω|^1.5 sign(1 − w sign ω), Q = a w (a, D) (Dahl 1968).
    HysteresisDahl "hysteresis_dahl" Some("bouc_wen_hysteresis"), false, [q("force_n"), q("yield_rad")], [(0, 1.0)];
    /// Prandtl–Ishlinskii: six stops with radii from D/4 to 3D/2, in sum a (a, D).
    HysteresisStops "hysteresis_stops" Some("bouc_wen_hysteresis"), false, [q("force_n"), q("yield_rad")], [(0, 1.0)];
    /// Q = G (sin(θ + θ₀) − sin θ₀) (G, θ₀).
    Gravity "gravity" Some("gravity"), true, [q("force_n"), q("tilt_rad")], [(0, 1.0)];
    /// Weight spread along an arc: the mean of sin over it,
    /// Q = 2G {(cos θ₀ − cos(θ + θ₀))/θ − sin θ₀} (G, θ₀).
    GravityArc "gravity_arc" Some("gravity"), false, [q("force_n"), q("tilt_rad")], [(0, 1.0)];
    /// n → n + Δn (Δn).
    ExponentShift "exponent_shift" Some("exponent_shift"), true, [q("delta")], [(0, 1.0)];
    /// Q = k₃θ³ (k₃).
    Cubic "cubic" Some("cubic_stiffness"), true, [q("stiffness_n_per_rad3")], [(0, 1.0)];
    /// Hardening without a linear part: Q = k (sinh(βθ)/β − θ) (k, β).
    CubicSinh "cubic_sinh" Some("cubic_stiffness"), false, [q("stiffness_n_per_rad"), q("rate_per_rad")], [(0, 1.0)];
    /// Q = k θ (k).
    LinearStiffness "linear_stiffness" Some("linear_stiffness"), true, [q("stiffness_n_per_rad")], [(0, 1.0)];
    /// A spring that softens: Q = k θ₁ tanh(θ/θ₁) (k, θ₁).
    LinearSoftening "linear_softening" Some("linear_stiffness"), false, [q("stiffness_n_per_rad"), q("angle_rad")], [(0, 1.0)];
    /// Q = k_s max(θ − θ_s, 0) (k_s, θ_s).
    EndStop "end_stop" Some("end_stop"), true, [q("stiffness_n_per_rad"), q("angle_rad")], [(0, 1.0)];
    /// Progressive contact with loss: Q = k_s x^1.5 (1 + 0.2 ω), x = max(θ − θ_s, 0)
    /// (k_s, θ_s) (Hunt and Crossley 1975).
    EndStopProgressive "end_stop_progressive" Some("end_stop"), false, [q("stiffness"), q("angle_rad")], [(0, 1.0)];
    /// K → K(1 + ρt) (ρ).
    StiffnessDrift "stiffness_drift" Some("stiffness_drift"), true, [q("rate_per_s")], [(0, 1.0)];
    /// K → K(1 + ρ t₀ ln(1 + t/t₀)) (ρ, t₀).
    StiffnessDriftLog "stiffness_drift_log" Some("stiffness_drift"), false, [q("rate_per_s"), q("time_s")], [(0, 1.0)];
    /// K → K(1 − δ(1 − e^{−θ_max/θ_m})) (δ, θ_m).
    Mullins "mullins" Some("mullins_softening"), true, [q("loss"), q("angle_rad")], [(0, 1.0)];
    /// K → K(1 − δ tanh(θ_max²/θ_m²)) (δ, θ_m).
    MullinsSquare "mullins_square" Some("mullins_softening"), false, [q("loss"), q("angle_rad")], [(0, 1.0)];
    /// ξ̈ + 2ζ₂ω₂ξ̇ + ω₂²ξ = −b θ̈, y = θ + ξ (f₂, ζ₂, b).
    SecondMode "second_mode" Some("second_mode"), true, [q("frequency_hz"), q("damping_ratio"), q("coupling")], [(2, 1.0)];
    /// The same and a third mode at 2.7 f₂ with b/3.
    SecondModePair "second_mode_pair" Some("second_mode"), false, [q("frequency_hz"), q("damping_ratio"), q("coupling")], [(2, 1.0)];
    /// τ ṗ_c = p − p_c (τ).
    Lag "lag" Some("pneumatic_lag"), true, [q("time_constant_s")], [(0, 1.0)];
    /// A line of second order with the same delay: p̈_c = ω²(p − p_c) − 2ζωṗ_c, ω = 2ζ/τ (τ, ζ).
    LagSecondOrder "lag_second_order" Some("pneumatic_lag"), false, [q("time_constant_s"), q("damping_ratio")], [(0, 1.0)];
    /// A distributed line: two lags, ⅔τ and ⅓τ (τ).
    LagDistributed "lag_distributed" Some("pneumatic_lag"), false, [q("time_constant_s")], [(0, 1.0)];
    /// p_c(t) = p(t − t_d) (t_d).
    DeadTime "dead_time" Some("dead_time"), true, [q("delay_s")], [(0, 1.0)];
    /// Transport with dispersion: eight lags of t_d/8 (t_d).
    DeadTimeDispersed "dead_time_dispersed" Some("dead_time"), false, [q("delay_s")], [(0, 1.0)];
    /// Lag with τ_fill where p > p_c, else τ_vent (τ_fill, τ_vent).
    VentAsymmetry "vent_asymmetry" Some("vent_asymmetry"), true, [q("fill_s"), q("vent_s")], [(1, 1.0)];
    /// Lag while filling, an orifice while venting: ṗ_c = −√(p_v (p_c − p))/τ_vent,
    /// p_v = 40 kPa (τ_fill, τ_vent).
    VentOrifice "vent_orifice" Some("vent_asymmetry"), false, [q("fill_s"), q("vent_s")], [(1, 1.0)];
    /// F = g max(p − p₀, 0) (p₀).
    Threshold "threshold" Some("pressure_threshold"), true, [kpa("pressure_kpa")], [(0, 1.0)];
    /// The same with a smooth corner: w ln(1 + e^{(p − p₀)/w}), less its value
    /// without pressure (p₀, w).
    ThresholdSmooth "threshold_smooth" Some("pressure_threshold"), false, [kpa("pressure_kpa"), kpa("width_kpa")], [(0, 1.0), (1, 1.0)];
    /// K → K(1 + k_p p_c) (k_p).
    PressureStiffening "pressure_stiffening" Some("pressure_stiffening"), true, [Quantity { key: "per_kpa", per_si: 1e3 }], [(0, 1.0)];
    /// K → K(1 + k_p p_c/(1 + p_c/p_s)) (k_p, p_s).
    PressureStiffeningSaturating "pressure_stiffening_saturating" Some("pressure_stiffening"), false, [Quantity { key: "per_kpa", per_si: 1e3 }, kpa("saturation_kpa")], [(0, 1.0)];
    /// Play of half-width b on p (b).
    Backlash "backlash" Some("input_backlash"), true, [kpa("half_width_kpa")], [(0, 1.0)];
    /// The mean of three plays of b/2, b and 3b/2 (Prandtl–Ishlinskii) (b).
    BacklashPlays "backlash_plays" Some("input_backlash"), false, [kpa("half_width_kpa")], [(0, 1.0)];
    /// The chamber loses air behind the sensor: ṗ_c = ṗ − p_c/τ (τ).
    Leak "leak" Some("leak"), true, [q("time_constant_s")], [(0, -1.0)];
    /// The same through an orifice: ṗ_c = ṗ − √(p_v p_c)/τ, p_v = 40 kPa (τ).
    LeakOrifice "leak_orifice" Some("leak"), false, [q("time_constant_s")], [(0, -1.0)];
    /// τ ẏ = θ − y (τ).
    SensorLag "sensor_lag" Some("sensor_lag"), true, [q("time_constant_s")], [(0, 1.0)];
    /// ÿ = ω²(θ − y) − 2ζωẏ, ω = 2ζ/τ (τ, ζ).
    SensorLagSecondOrder "sensor_lag_second_order" Some("sensor_lag"), false, [q("time_constant_s"), q("damping_ratio")], [(0, 1.0)];
    /// y = θ + b (b).
    SensorOffset "sensor_offset" Some("sensor_offset"), true, [q("offset_rad")], [(0, 1.0)];
    /// y = θ + cθ² (c).
    SensorNonlinearity "sensor_nonlinearity" Some("sensor_nonlinearity"), true, [q("curvature_per_rad")], [(0, 1.0)];
    /// y = θ + cθ²/(1 + s|θ|) (c, s).
    SensorNonlinearitySaturating "sensor_nonlinearity_saturating" Some("sensor_nonlinearity"), false, [q("curvature_per_rad"), q("saturation_per_rad")], [(0, 1.0)];
    /// y = θ + rt (r).
    SensorDrift "sensor_drift" Some("sensor_drift"), true, [q("rate_rad_per_s")], [(0, 1.0)];
    /// y = θ + rτ(1 − e^{−t/τ}) (r, τ).
    SensorDriftSettling "sensor_drift_settling" Some("sensor_drift"), false, [q("rate_rad_per_s"), q("time_constant_s")], [(0, 1.0)];
    /// Q = A sin(2πft + φ) (A, f, φ).
    Periodic "periodic" Some("periodic_disturbance"), true, [q("force_n"), q("frequency_hz"), q("phase_rad")], [(0, 1.0)];
    /// A triangular wave, (2/π) arcsin sin (A, f, φ).
    PeriodicTriangle "periodic_triangle" Some("periodic_disturbance"), false, [q("force_n"), q("frequency_hz"), q("phase_rad")], [(0, 1.0)];
    /// A sine whose phase is another one in every run (A, f, φ).
    PeriodicUnsynchronised "periodic_unsynchronised" Some("periodic_disturbance"), false, [q("force_n"), q("frequency_hz"), q("phase_rad")], [(0, 1.0)];

    /// Outside the catalogue: stiffer by a once θ > θ₁ until θ < θ₂, as shape
    /// memory or a fold that has opened (a, θ₁, θ₂).
    TwoStepStiffness "two_step_stiffness" None, false, [q("ratio"), q("on_rad"), q("off_rad")], [(0, 1.0)];
    /// Outside: a relief valve behind the sensor, p_c = min(p, p_r) (p_r).
    ReliefValve "relief_valve" None, false, [kpa("limit_kpa")], [(0, -1.0)];
    /// Outside: a delay that vanishes as pressure builds up, t_d e^{−p/p_d} (t_d, p_d).
    PressureDependentDelay "pressure_dependent_delay" None, false, [q("delay_s"), kpa("decay_kpa")], [(0, 1.0)];
    /// Outside: coupling to torsion, Q = A θ sin(kθ) (A, k).
    Torsion "torsion" None, false, [q("force_n_per_rad"), q("wave_per_rad")], [(0, 1.0)];
    /// Outside: bellows, Q = A sin(2πθ/λ) (A, λ).
    PeriodicStiffness "periodic_stiffness" None, false, [q("force_n"), q("period_rad")], [(0, 1.0)];
    /// Outside: stiction with break-away and ageing. LuGre whose level is
    /// T(1 + r s), where s grows with τ at rest and is lost in sliding (T, r, τ).
    StictionAgeing "stiction_ageing" None, false, [q("force_n"), q("ratio"), q("time_constant_s")], [(0, 1.0)];
    /// Outside: warming, C → C(1 − a(1 − e^{−t/τ})) (a, τ).
    WarmingDamping "warming_damping" None, false, [q("ratio"), q("time_constant_s")], [(0, 1.0)];
    /// Outside: snap-through, Q = −A u e^{½ − u²/2}, u = (θ − θ_c)/w, with its
    /// value at rest removed (A, θ_c, w).
    SnapThrough "snap_through" None, false, [q("force_n"), q("angle_rad"), q("width_rad")], [(0, 1.0)];
    /// Outside: a lag that grows with the bend, τ(0.1 + θ²) ṗ_c = p − p_c (τ).
    AmplitudeLag "amplitude_lag" None, false, [q("time_constant_s")], [(0, 1.0)];
    /// Outside: a sensor that does not move between θ_c − w and θ_c + w (w, θ_c).
    SensorDeadZone "sensor_dead_zone" None, false, [q("half_width_rad"), q("angle_rad")], [(0, 1.0)];
    /// Outside: a force without any rule, twelve sines between 0.15 and 4 Hz whose
    /// phases are others in every run (A, seed).
    RandomForce "random_force" None, false, [q("force_n"), q("seed")], [(0, 1.0)];

    /// A loop with a shape, on benches only: Q = a w, D ẇ = ω − ½|ω|w − B ω|w|
    /// (a, D, B) (Wen 1976, with β = ½ and γ = B).
    BoucWenShape "bouc_wen_shape" Some("bouc_wen_hysteresis"), false, [q("force_n"), q("yield_rad"), q("shape")], [(0, 1.0)];
    /// Outside, on benches only: stiction that grows with the time at rest. A
    /// bristle holds up to [`break_away`] after a rest; once it slips, F_c
    /// (F_c, ΔF, τ, s) (Armstrong-Hélouvry et al. 1994, section 2.2).
    DwellStiction "dwell_stiction" None, false, [q("force_n"), q("extra_force_n"), q("time_constant_s"), q("presliding_rad")], [(0, 1.0), (1, 1.0)];
    /// Outside, on benches only: K → K(1 + a sin(2πft + φ)) (a, f, φ).
    PulsatingStiffness "pulsating_stiffness" None, false, [q("ratio"), q("frequency_hz"), q("phase_rad")], [(0, 1.0)];
    /// Outside, on benches only: a large force without any rule, whose path is
    /// drawn by [`coloured`](super::world::coloured) and acts from outside (sd, τ).
    /// To who reads an answer it is what [`RandomForce`](Self::RandomForce) is.
    ColouredForce "random_force" None, false, [q("force_n"), q("time_constant_s")], [(0, 1.0)];
}

impl Law {
    /// What only benches hide. The other sets draw from the rest by its number, so
    /// that their cases stay what they were.
    pub const OF_BENCHES: [Self; 4] = [
        Self::BoucWenShape,
        Self::DwellStiction,
        Self::PulsatingStiffness,
        Self::ColouredForce,
    ];

    /// The laws that every set can hide.
    pub fn of_every_set() -> impl Iterator<Item = Self> {
        let all = Self::ALL.iter().copied();
        all.filter(|law| !Self::OF_BENCHES.contains(law))
    }

    /// The laws for a kind of the catalogue, the catalogue's own first.
    pub fn of_kind(kind: &str) -> Vec<Self> {
        let mut list: Vec<Self> = Self::of_every_set()
            .filter(|law| law.row().kind == Some(kind))
            .collect();
        list.sort_by_key(|law| !law.row().same);
        list
    }

    /// The law that a kind has in its n-th turn: every second time another one
    /// than the catalogue's, where there is one.
    pub fn in_turn(kind: &str, turn: usize) -> Self {
        let laws = Self::of_kind(kind);
        if turn.is_multiple_of(2) || laws.len() == 1 {
            laws[0]
        } else {
            laws[1 + turn / 2 % (laws.len() - 1)]
        }
    }

    /// The laws outside the catalogue that every set can hide.
    pub fn outside() -> Vec<Self> {
        Self::of_every_set()
            .filter(|law| law.row().kind.is_none())
            .collect()
    }

    /// How many numbers it has.
    pub const fn numbers(self) -> usize {
        self.row().quantities.len()
    }
}

/// The names of the catalogue's kinds, each once, in its order.
pub fn kinds() -> Vec<&'static str> {
    let mut names = Vec::new();
    for kind in Law::ALL.iter().filter_map(|law| law.row().kind) {
        if !names.contains(&kind) {
            names.push(kind);
        }
    }
    names
}

/// A law with its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Effect {
    /// The law.
    pub law: Law,
    /// Its numbers in SI units; unused ones are zero.
    pub values: [f64; VALUES],
}

impl Effect {
    /// The effect made larger by a factor.
    pub fn scaled(mut self, factor: f64) -> Self {
        for &(index, exponent) in self.law.row().sizes {
            self.values[index] *= factor.powf(exponent);
        }
        self
    }
}

/// Pressure (Pa) at which an orifice and a lag of the same τ flow alike.
const ORIFICE_PRESSURE: f64 = 40e3;

/// √(p_v Δp), made linear below 0.2 kPa where the flow is laminar.
fn orifice(difference: f64) -> f64 {
    difference * (ORIFICE_PRESSURE / (difference.abs() + 200.0)).sqrt()
}

/// Radius of each stop of the Prandtl–Ishlinskii hysteresis over D.
const STOPS: [f64; 6] = [0.25, 0.5, 0.75, 1.0, 1.25, 1.5];

/// What the effects see.
#[derive(Clone, Copy)]
pub(super) struct Moment {
    pub(super) time: f64,
    pub(super) angle: f64,
    pub(super) rate: f64,
    pub(super) pressure: f64,
    pub(super) run: u32,
}

/// A phase (rad) that looks drawn but is the same every time.
fn drawn_phase(index: f64, run: u32) -> f64 {
    let turns = 0.618_033_988_75 * f64::from(run + 1) * (index + 1.0) + 0.324_7 * index * index;
    std::f64::consts::TAU * turns.fract()
}

impl Effect {
    /// Pressure behind this effect; the rates of its states go into `rates`.
    pub(super) fn input(
        &self,
        line: &Line,
        at: Moment,
        states: &[f64],
        memory: &[f64; MEMORY],
        rates: &mut [f64],
    ) -> f64 {
        let p = at.pressure;
        let [a, b, ..] = self.values;
        match self.law {
            Law::Lag => {
                rates[0] = (p - states[0]) / a;
                states[0]
            }
            Law::LagSecondOrder => {
                let natural = 2.0 * b / a;
                rates[0] = states[1];
                rates[1] = natural * natural * (p - states[0]) - 2.0 * b * natural * states[1];
                states[0]
            }
            Law::LagDistributed => {
                rates[0] = (p - states[0]) / (2.0 * a / 3.0);
                rates[1] = (states[0] - states[1]) / (a / 3.0);
                states[1]
            }
            Law::DeadTime => line.at(at.time - a),
            Law::DeadTimeDispersed => {
                let mut before = p;
                for k in 0..8 {
                    rates[k] = (before - states[k]) * 8.0 / a;
                    before = states[k];
                }
                before
            }
            Law::VentAsymmetry => {
                rates[0] = (p - states[0]) / if p > states[0] { a } else { b };
                states[0]
            }
            Law::VentOrifice => {
                rates[0] = if p > states[0] {
                    (p - states[0]) / a
                } else {
                    orifice(p - states[0]) / b
                };
                states[0]
            }
            Law::Threshold => (p - a).max(0.0),
            Law::ThresholdSmooth => {
                let corner = |p: f64| {
                    let x = (p - a) / b;
                    b * (x.max(0.0) + (-x.abs()).exp().ln_1p())
                };
                corner(p) - corner(0.0)
            }
            Law::Backlash => play(memory[0], p, a),
            Law::BacklashPlays => {
                let of = |k: usize| play(memory[k], p, 0.5 * a * (k + 1) as f64);
                (of(0) + of(1) + of(2)) / 3.0
            }
            Law::Leak => {
                rates[0] = (p - states[0]) / a;
                p - states[0]
            }
            Law::LeakOrifice => {
                rates[0] = orifice(p - states[0]) / a;
                p - states[0]
            }
            Law::ReliefValve => p.min(a),
            Law::PressureDependentDelay => line.at(at.time - a * (-p.max(0.0) / b).exp()),
            Law::AmplitudeLag => {
                rates[0] = (p - states[0]) / (a * (0.1 + at.angle * at.angle));
                states[0]
            }
            _ => p,
        }
    }

    /// Changes the base parameters.
    pub(super) fn modulate(
        &self,
        at: Moment,
        states: &[f64],
        memory: &[f64; MEMORY],
        base: &mut Base,
    ) {
        let [a, b, c, _] = self.values;
        match self.law {
            Law::AngleDamping => base.damping *= 1.0 + a * at.angle.abs(),
            Law::AngleDampingSquare => base.damping *= 1.0 + a * at.angle * at.angle,
            Law::AsymmetricDamping if at.rate < 0.0 => base.damping *= 1.0 + a,
            Law::AsymmetricSmooth => {
                base.damping *= 1.0 + 0.5 * a * (1.0 - (at.rate / b).tanh());
            }
            Law::ExponentShift => base.exponent += a,
            Law::StiffnessDrift => base.stiffness *= 1.0 + a * at.time,
            Law::StiffnessDriftLog => {
                base.stiffness *= 1.0 + a * b * (at.time / b).ln_1p();
            }
            Law::Mullins => {
                let most = memory[0].max(at.angle.abs());
                base.stiffness *= 1.0 - a * (1.0 - (-most / b).exp());
            }
            Law::MullinsSquare => {
                let most = memory[0].max(at.angle.abs()) / b;
                base.stiffness *= 1.0 - a * (most * most).tanh();
            }
            Law::PressureStiffening => base.stiffness *= 1.0 + a * at.pressure,
            Law::PressureStiffeningSaturating => {
                base.stiffness *= 1.0 + a * at.pressure / (1.0 + at.pressure.max(0.0) / b);
            }
            Law::TwoStepStiffness => base.stiffness *= 1.0 + a * states[0],
            Law::WarmingDamping => {
                base.damping *= 1.0 - a * (1.0 - (-at.time / b).exp());
            }
            Law::PulsatingStiffness => {
                base.stiffness *= 1.0 + a * (std::f64::consts::TAU * b * at.time + c).sin();
            }
            _ => {}
        }
    }

    /// Q (N).
    // One arm for each law of the table.
    #[allow(clippy::too_many_lines)]
    pub(super) fn force(
        &self,
        at: Moment,
        inertia: f64,
        states: &[f64],
        memory: &[f64; MEMORY],
        rates: &mut [f64],
    ) -> f64 {
        let Moment {
            time, angle, rate, ..
        } = at;
        let [a, b, c, d] = self.values;
        let bristle = |level: f64, stiffness: f64, rates: &mut [f64]| {
            rates[0] = rate - rate.abs() * states[0] * stiffness / level;
            stiffness * states[0] + 0.3 * (stiffness * inertia).sqrt() * rates[0]
        };
        match self.law {
            Law::CoulombTanh => a * (rate / b).tanh(),
            Law::CoulombLugre => bristle(a, a / b, rates),
            Law::CoulombRoot => a * rate / rate.hypot(b),
            Law::StribeckGauss => (a + b * (-(rate / c) * (rate / c)).exp()) * (rate / d).tanh(),
            Law::StribeckExponential => (a + b * (-rate.abs() / c).exp()) * rate / rate.hypot(d),
            Law::StribeckLugre => {
                let level = a + b * (-(rate / c) * (rate / c)).exp();
                bristle(level, (a + b) / d, rates)
            }
            Law::QuadraticDrag => a * rate * rate.abs(),
            Law::QuadraticBlasius => a * power(rate, 1.75),
            Law::MaxwellOne => {
                rates[0] = (angle - states[0]) / b;
                a * (angle - states[0])
            }
            Law::MaxwellTwo => {
                rates[0] = (angle - states[0]) / b;
                rates[1] = (angle - states[1]) / d;
                a * (angle - states[0]) + c * (angle - states[1])
            }
            Law::MaxwellPower => [0.25, 1.0, 4.0, 16.0]
                .iter()
                .enumerate()
                .map(|(k, &ratio): (usize, &f64)| {
                    rates[k] = (angle - states[k]) / (b * ratio);
                    a * ratio.powf(-0.3) * (angle - states[k])
                })
                .sum(),
            Law::BoucWen => {
                let w = states[0];
                rates[0] = (rate - 0.5 * rate.abs() * w - 0.5 * rate * w.abs()) / b;
                a * w
            }
            Law::BoucWenShape => {
                let w = states[0];
                rates[0] = (rate - 0.5 * rate.abs() * w - c * rate * w.abs()) / b;
                a * w
            }
            Law::HysteresisDahl => {
                let w = states[0];
                rates[0] = rate / b * power(1.0 - w * rate.signum(), 1.5);
                a * w
            }
            Law::HysteresisStops => {
                let moved = angle - memory[6];
                let sum: f64 = STOPS
                    .iter()
                    .zip(memory)
                    .map(|(radius, stop)| {
                        let radius = radius * b;
                        (stop + moved).clamp(-radius, radius) / radius
                    })
                    .sum();
                a * sum / STOPS.len() as f64
            }
            Law::Gravity => a * ((angle + b).sin() - b.sin()),
            Law::GravityArc => {
                let mean = if angle.abs() < 1e-4 {
                    b.sin() + 0.5 * angle * b.cos()
                } else {
                    (b.cos() - (angle + b).cos()) / angle
                };
                2.0 * a * (mean - b.sin())
            }
            Law::Cubic => a * angle * angle * angle,
            Law::CubicSinh => a * ((b * angle).sinh() / b - angle),
            Law::LinearStiffness => a * angle,
            Law::LinearSoftening => a * b * (angle / b).tanh(),
            Law::EndStop => a * (angle - b).max(0.0),
            Law::EndStopProgressive => {
                let depth = (angle - b).max(0.0);
                a * depth * depth.sqrt() * (1.0 + 0.2 * rate).max(0.0)
            }
            Law::Periodic => a * (std::f64::consts::TAU * b * time + c).sin(),
            Law::PeriodicTriangle => {
                let phase = std::f64::consts::TAU * b * time + c;
                a * phase.sin().asin() * std::f64::consts::FRAC_2_PI
            }
            Law::PeriodicUnsynchronised => {
                let phase = c + drawn_phase(1.0, at.run);
                a * (std::f64::consts::TAU * b * time + phase).sin()
            }
            Law::TwoStepStiffness => {
                // The fold takes 50 ms to open or close.
                rates[0] = (memory[0] - states[0]) / 0.05;
                0.0
            }
            Law::Torsion => a * angle * (b * angle).sin(),
            Law::PeriodicStiffness => a * (std::f64::consts::TAU * angle / b).sin(),
            Law::StictionAgeing => {
                let sliding = rate.abs() / 0.05;
                rates[1] = (1.0 - states[1]) / c - states[1] * sliding / 0.1;
                bristle(a * (1.0 + b * states[1]), a * (1.0 + b) / 0.006, rates)
            }
            Law::DwellStiction => {
                let stiffness = (a + b) / d;
                rates[0] = if Contact::of(memory).slides {
                    rate - rate.abs() * stiffness * states[0] / a
                } else {
                    rate
                };
                stiffness * states[0] + 0.3 * (stiffness * inertia).sqrt() * rates[0]
            }
            Law::SnapThrough => {
                let bump = |u: f64| u * (0.5 - 0.5 * u * u).exp();
                -a * (bump((angle - b) / c) - bump(-b / c))
            }
            Law::RandomForce => (0..12)
                .map(|k| {
                    let frequency = 0.15 * 1.35f64.powi(k);
                    let phase = drawn_phase(f64::from(k) + b, at.run);
                    a / 6f64.sqrt() * (std::f64::consts::TAU * frequency * time + phase).sin()
                })
                .sum(),
            _ => 0.0,
        }
    }

    /// What the sensor shows of `shown`, and the rates of states in its path.
    pub(super) fn sensor(
        &self,
        at: Moment,
        acceleration: f64,
        shown: f64,
        states: &[f64],
        rates: &mut [f64],
    ) -> f64 {
        let [a, b, c, _] = self.values;
        let mut mode = |k: usize, frequency: f64, coupling: f64| {
            let natural = std::f64::consts::TAU * frequency;
            rates[k] = states[k + 1];
            rates[k + 1] = -2.0 * b * natural * states[k + 1]
                - natural * natural * states[k]
                - coupling * acceleration;
            states[k]
        };
        match self.law {
            Law::SecondMode => shown + mode(0, a, c),
            Law::SecondModePair => shown + mode(0, a, c) + mode(2, 2.7 * a, c / 3.0),
            Law::SensorLag => {
                rates[0] = (shown - states[0]) / a;
                states[0]
            }
            Law::SensorLagSecondOrder => {
                let natural = 2.0 * b / a;
                rates[0] = states[1];
                rates[1] = natural * natural * (shown - states[0]) - 2.0 * b * natural * states[1];
                states[0]
            }
            Law::SensorOffset => shown + a,
            Law::SensorNonlinearity => shown + a * shown * shown,
            Law::SensorNonlinearitySaturating => {
                shown + a * shown * shown / (1.0 + b * shown.abs())
            }
            Law::SensorDrift => shown + a * at.time,
            Law::SensorDriftSettling => shown + a * b * (1.0 - (-at.time / b).exp()),
            Law::SensorDeadZone => shown - (shown - b).clamp(-a, a) - a,
            _ => shown,
        }
    }

    /// Brings what is remembered up to the end of a step.
    pub(super) fn remember(&self, at: Moment, states: &[f64], memory: &mut [f64; MEMORY]) {
        let [a, b, c, d] = self.values;
        match self.law {
            Law::Mullins | Law::MullinsSquare => memory[0] = memory[0].max(at.angle.abs()),
            Law::Backlash => memory[0] = play(memory[0], at.pressure, a),
            Law::BacklashPlays => {
                for (k, slot) in memory.iter_mut().take(3).enumerate() {
                    *slot = play(*slot, at.pressure, 0.5 * a * (k + 1) as f64);
                }
            }
            Law::HysteresisStops => {
                let moved = at.angle - memory[6];
                for (slot, radius) in memory.iter_mut().zip(STOPS) {
                    *slot = (*slot + moved).clamp(-radius * b, radius * b);
                }
                memory[6] = at.angle;
            }
            Law::TwoStepStiffness => {
                if at.angle > b {
                    memory[0] = 1.0;
                } else if at.angle < c {
                    memory[0] = 0.0;
                }
            }
            Law::DwellStiction => {
                let contact = Contact::of(memory);
                let rested = at.time - contact.since;
                let held = (a + b) / d * states[0].abs();
                let next = if contact.slides {
                    // A bristle that is bent further than sliding bends it still slips.
                    Contact {
                        slides: at.rate.abs() > RESTS_BELOW || held > a,
                        since: at.time,
                    }
                } else {
                    Contact {
                        slides: held > break_away(a, b, c, rested),
                        ..contact
                    }
                };
                memory[0] = f64::from(u8::from(next.slides));
                memory[1] = next.since;
            }
            _ => {}
        }
    }
}

/// Output of a play of half-width `half` that stood at `before`.
fn play(before: f64, input: f64, half: f64) -> f64 {
    before.clamp(input - half, input + half)
}

/// F_c + ΔF (1 − e^{−t/τ}): the force (N) up to which a contact holds after a rest
/// of t (s), with F_c `sliding` (N), ΔF `extra` (N) and τ `time` (s).
pub fn break_away(sliding: f64, extra: f64, time: f64, rested: f64) -> f64 {
    sliding + extra * (1.0 - (-rested / time).exp())
}

/// Below this rate (rad/s) a sliding contact comes to rest.
const RESTS_BELOW: f64 = 0.02;

/// The state of a contact with dwell-time stiction.
#[derive(Clone, Copy)]
struct Contact {
    slides: bool,
    /// Since when it rests (s).
    since: f64,
}

impl Contact {
    fn of(memory: &[f64; MEMORY]) -> Self {
        Self {
            slides: memory[0] > 0.5,
            since: memory[1],
        }
    }
}
