//! Ludwick's law, and the stiffness of a beam made of such a material.
//!
//! A moulded silicone is not Hookean: its stress grows with a power of its strain. This module
//! takes that power law from the material to the one number that the equation of motion needs,
//! the bending stiffness `K_n`.
//!
//! Source: Yang, Stuart, Kurkcu and Tomizuka, arXiv 2311.02527. Its Eqs. 11 and 12 need care:
//! see [`Ludwick::stiffness`] and [`SecondMoment::AsPrinted`].

use crate::power::{Power, signed_power};
use crate::real::Real;

/// A quantity that a material or a beam is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Quantity {
    /// The modulus E.
    Modulus,
    /// The exponent n.
    Exponent,
    /// The length L of a beam.
    Length,
    /// The width b of a beam.
    Width,
    /// The height h of a beam.
    Height,
    /// The viscosity of a mixed silicone before it cures.
    MixedViscosity,
    /// The stress at which a material tears.
    TensileStrength,
}

impl Quantity {
    /// The name and the unit that an operator knows the quantity by.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Modulus => "modulus",
            Self::Exponent => "exponent",
            Self::Length => "length",
            Self::Width => "width",
            Self::Height => "height",
            Self::MixedViscosity => "mixed viscosity",
            Self::TensileStrength => "tensile strength",
        }
    }
}

/// Why a quantity was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum QuantityError {
    /// The value is NaN or infinite.
    NotFinite(Quantity),
    /// The value is zero or negative.
    NotPositive(Quantity),
    /// The value is above what the formulas are meant for.
    TooLarge(Quantity),
}

impl core::fmt::Display for QuantityError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotFinite(quantity) => {
                write!(f, "the {} must be a finite number", quantity.name())
            }
            Self::NotPositive(quantity) => {
                write!(f, "the {} must be greater than zero", quantity.name())
            }
            Self::TooLarge(quantity) => {
                write!(f, "the {} is too large to be meant", quantity.name())
            }
        }
    }
}

impl core::error::Error for QuantityError {}

/// Returns a value that is finite and above zero, or says what is wrong with it.
pub(crate) fn positive<R: Real>(value: R, quantity: Quantity) -> Result<R, QuantityError> {
    if !value.is_finite() {
        Err(QuantityError::NotFinite(quantity))
    } else if value > R::zero() {
        Ok(value)
    } else {
        Err(QuantityError::NotPositive(quantity))
    }
}

/// The largest exponent that [`Ludwick::new`] accepts.
///
/// Table I ends at 2.5; above 10 a beam is a hinge with a stop, and h^(n+2)
/// leaves the range of `f32`.
pub const MAXIMUM_EXPONENT: i16 = 10;

/// A material that follows σ = sign(ε) E |ε|ⁿ.
///
/// E is the modulus of the law (Pa), n its exponent, 1 for Hooke; stress σ in Pa (paper, Eq. 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ludwick<R> {
    modulus_pa: R,
    exponent: R,
}

/// A beam of rectangular section, its neutral surface at half its height.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(clippy::struct_field_names)] // the unit is what the suffix is for
pub struct Beam<R> {
    length_m: R,
    width_m: R,
    height_m: R,
}

/// Which formula gives the second moment of the section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SecondMoment {
    /// (1/2)^(n+1) b h^(n+2)/(n+2), which is b h³/12 at n = 1.
    #[default]
    Corrected,
    /// (1/2)ⁿ b h^(n+2)/(n+2) as the paper prints it (Eq. 12), twice the
    /// former. For reproducing the paper's numbers only.
    ///
    /// At n = 1 it gives b h³/6, not the b h³/12 of Eq. 10. With ε = κy,
    /// M = ∫ σ y dA = E κⁿ · 2b ∫₀^{h/2} y^(n+1) dy gives the factor of [`Self::Corrected`], which
    /// agrees with the authors' published code.
    AsPrinted,
}

impl<R: Real> Beam<R> {
    /// Creates a beam from its length along the bending axis, its width across
    /// and its height in the direction of bending, all in metres.
    ///
    /// # Errors
    ///
    /// [`QuantityError`] if a dimension is not a finite number above zero.
    pub fn new(length_m: R, width_m: R, height_m: R) -> Result<Self, QuantityError> {
        Ok(Self {
            length_m: positive(length_m, Quantity::Length)?,
            width_m: positive(width_m, Quantity::Width)?,
            height_m: positive(height_m, Quantity::Height)?,
        })
    }

    /// The length L in metres.
    pub fn length_m(&self) -> R {
        self.length_m
    }

    /// The width b in metres.
    pub fn width_m(&self) -> R {
        self.width_m
    }

    /// The height h in metres.
    pub fn height_m(&self) -> R {
        self.height_m
    }

    /// Computes I = b h³/12 in m⁴ (Eq. 10).
    pub fn linear_second_moment(&self) -> R {
        let h = self.height_m;
        self.width_m * h * h * h / R::from_i16(12)
    }

    /// Computes K = 2 E I/L² in N/rad (Eqs. 9 and 10) for a Hookean beam of
    /// modulus `modulus_pa` that is loaded at its tip.
    ///
    /// # Errors
    ///
    /// [`QuantityError`] if the modulus is not a finite number above zero.
    pub fn linear_stiffness(&self, modulus_pa: R) -> Result<R, QuantityError> {
        let modulus = positive(modulus_pa, Quantity::Modulus)?;
        let two = R::from_i16(2);
        Ok(two * modulus * self.linear_second_moment() / (self.length_m * self.length_m))
    }
}

impl<R: Real> Ludwick<R> {
    /// Creates a material from its modulus E in pascals and its exponent n.
    ///
    /// # Errors
    ///
    /// [`QuantityError`] if either is not a finite number above zero, or if the
    /// exponent is above [`MAXIMUM_EXPONENT`].
    pub fn new(modulus_pa: R, exponent: R) -> Result<Self, QuantityError> {
        let exponent = positive(exponent, Quantity::Exponent)?;
        if exponent > R::from_i16(MAXIMUM_EXPONENT) {
            return Err(QuantityError::TooLarge(Quantity::Exponent));
        }
        Ok(Self {
            modulus_pa: positive(modulus_pa, Quantity::Modulus)?,
            exponent,
        })
    }

    /// The modulus E in pascals.
    pub fn modulus_pa(&self) -> R {
        self.modulus_pa
    }

    /// The exponent n.
    pub fn exponent(&self) -> R {
        self.exponent
    }

    /// Computes the stress in pascals at a strain (Eq. 2, continued to negative
    /// strains as an odd function).
    pub fn stress<P: Power<R>>(&self, strain: R) -> R {
        self.modulus_pa * signed_power::<R, P>(strain, self.exponent)
    }

    /// Computes the strain at a stress in pascals, the inverse of
    /// [`stress`](Self::stress).
    pub fn strain<P: Power<R>>(&self, stress_pa: R) -> R {
        signed_power::<R, P>(stress_pa / self.modulus_pa, R::one() / self.exponent)
    }

    /// Computes the second moment `I_n` of a beam's section in m^(n+3).
    pub fn second_moment<P: Power<R>>(&self, beam: &Beam<R>, form: SecondMoment) -> R {
        let n = self.exponent;
        let half_height = beam.height_m * R::half();
        // b h (h/2)^(n+1) is (1/2)^(n+1) b h^(n+2) with one power fewer.
        let corrected =
            beam.width_m * beam.height_m * P::pow(half_height, n + R::one()) / (n + R::from_i16(2));
        form.scale(corrected)
    }

    /// Computes the bending stiffness `K_n` in N/radⁿ for a load at the tip
    /// (Eq. 11), P = `K_n` θⁿ.
    ///
    /// `K_n` = ((n+1)/n)ⁿ E `I_n`/L^(n+1), with the load P in N and the angle θ of the tip in rad.
    ///
    /// Eq. 11 is a small-deflection result for a load at the tip. The curvature is then
    /// κ(s) = (P (L−s)/(E `I_n`))^(1/n), and its integral over the length is the tip angle. It is not
    /// exact at 60° or 90°, and a pressure loads the beam rather with the same moment everywhere, for
    /// which [`Ludwick::moment_stiffness`] holds at any angle.
    pub fn stiffness<P: Power<R>>(&self, beam: &Beam<R>, form: SecondMoment) -> R {
        let n = self.exponent;
        // I_n/L^(n+1) = b h (h/2L)^(n+1)/(n+2): the ratio is without unit, so
        // the power stays far from the ends of `f32`.
        let slenderness = beam.height_m * R::half() / beam.length_m;
        let corrected = P::pow((n + R::one()) / n, n)
            * self.modulus_pa
            * beam.width_m
            * beam.height_m
            * P::pow(slenderness, n + R::one())
            / (n + R::from_i16(2));
        form.scale(corrected)
    }

    /// Computes the stiffness against a pure moment in N·m/radⁿ,
    /// T = E `I_n` (θ/L)ⁿ, exact at any angle for a uniform beam.
    pub fn moment_stiffness<P: Power<R>>(&self, beam: &Beam<R>, form: SecondMoment) -> R {
        let n = self.exponent;
        let half_height = beam.height_m * R::half();
        let corrected = self.modulus_pa
            * beam.width_m
            * beam.height_m
            * half_height
            * P::pow(half_height / beam.length_m, n)
            / (n + R::from_i16(2));
        form.scale(corrected)
    }
}

impl SecondMoment {
    fn scale<R: Real>(self, corrected: R) -> R {
        match self {
            Self::Corrected => corrected,
            Self::AsPrinted => corrected + corrected,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::power::Exact;
    use proptest::prelude::*;

    const E: f64 = 0.34e6;

    fn beam() -> Beam<f64> {
        Beam::new(0.094, 0.030, 0.024).unwrap()
    }

    fn law(exponent: f64) -> Ludwick<f64> {
        Ludwick::new(E, exponent).unwrap()
    }

    fn relative(a: f64, b: f64) -> f64 {
        (a - b).abs() / b.abs()
    }

    /// ∫₀¹ f by the tanh–sinh rule, which keeps its accuracy where the
    /// integrand has an infinite slope at an end.
    fn integrate(f: impl Fn(f64) -> f64) -> f64 {
        let step = 1.0 / 64.0;
        (-400..=400)
            .map(|k| {
                let t = f64::from(k) * step;
                let (u, weight) = (
                    (t.sinh() * core::f64::consts::FRAC_PI_2).tanh(),
                    core::f64::consts::FRAC_PI_2 * t.cosh()
                        / (t.sinh() * core::f64::consts::FRAC_PI_2).cosh().powi(2),
                );
                if weight < 1e-30 {
                    0.0
                } else {
                    f(f64::midpoint(u, 1.0)) * weight * step / 2.0
                }
            })
            .sum()
    }

    #[test]
    fn the_quadrature_of_these_tests_is_right() {
        assert!(relative(integrate(|x| x.powi(7)), 1.0 / 8.0) < 1e-13);
        assert!(relative(integrate(|x| x.powf(0.4)), 1.0 / 1.4) < 1e-13);
        assert!(relative(integrate(f64::exp), core::f64::consts::E - 1.0) < 1e-13);
    }

    #[test]
    fn an_exponent_of_one_is_the_linear_beam() {
        let hooke = law(1.0);
        let linear = beam().linear_stiffness(E).unwrap();
        let i = beam().linear_second_moment();
        let close = |a: f64, b: f64| relative(a, b) < 4.0 * f64::EPSILON;
        assert!(close(i, 0.030 * 0.024_f64.powi(3) / 12.0));
        assert!(close(
            hooke.second_moment::<Exact>(&beam(), SecondMoment::Corrected),
            i
        ));
        assert!(close(
            hooke.stiffness::<Exact>(&beam(), SecondMoment::Corrected),
            linear
        ));
        assert!((hooke.stress::<Exact>(0.3) - E * 0.3).abs() < 1e-9);
    }

    #[test]
    fn the_printed_second_moment_is_twice_too_large() {
        for exponent in [1.0, 1.538, 2.365, 2.5] {
            let ratio = law(exponent).stiffness::<Exact>(&beam(), SecondMoment::AsPrinted)
                / law(exponent).stiffness::<Exact>(&beam(), SecondMoment::Corrected);
            assert!((ratio - 2.0).abs() < 1e-15);
        }
        let printed = law(1.0).second_moment::<Exact>(&beam(), SecondMoment::AsPrinted);
        assert!(relative(printed, 0.030 * 0.024_f64.powi(3) / 6.0) < 1e-14);
    }

    #[test]
    fn the_second_moment_is_the_integral_over_the_section() {
        let curvature: f64 = 13.7;
        for exponent in [0.7, 1.0, 1.538, 2.174, 2.365, 3.0] {
            let law = law(exponent);
            let (b, h) = (0.030, 0.024);
            // Both halves of the section carry the same moment.
            let moment = integrate(|x| {
                let y = x * h / 2.0;
                law.stress::<Exact>(curvature * y) * y * b
            }) * h;
            let from_integral = moment / (E * curvature.powf(exponent));
            let from_formula = law.second_moment::<Exact>(&beam(), SecondMoment::Corrected);
            assert!(
                relative(from_formula, from_integral) < 1e-11,
                "n = {exponent}"
            );
        }
    }

    #[test]
    fn the_tip_angle_is_the_integral_of_the_curvature() {
        let length = 0.094;
        for exponent in [0.7, 1.0, 1.538, 2.174, 2.365, 3.0] {
            let law = law(exponent);
            let rigidity = E * law.second_moment::<Exact>(&beam(), SecondMoment::Corrected);
            for load in [0.001, 0.02, 0.4] {
                let angle = length
                    * integrate(|x| (load * length * (1.0 - x) / rigidity).powf(1.0 / exponent));
                let stiffness = law.stiffness::<Exact>(&beam(), SecondMoment::Corrected);
                let back = stiffness * angle.powf(exponent);
                assert!(
                    relative(back, load) < 1e-9,
                    "n = {exponent}: {back} for {load}"
                );
            }
            let moment = 0.03;
            let curvature = (moment / rigidity).powf(1.0 / exponent);
            let back = law.moment_stiffness::<Exact>(&beam(), SecondMoment::Corrected)
                * (curvature * length).powf(exponent);
            assert!(relative(back, moment) < 1e-12);
        }
    }

    #[test]
    fn the_stiffness_of_the_authors_actuator() {
        for (exponent, expected) in [
            (1.0, 2.660),
            (1.538, 0.805),
            (1.727, 0.528),
            (2.174, 0.194),
            (2.365, 0.127),
            (2.5, 0.094),
        ] {
            let stiffness = law(exponent).stiffness::<Exact>(&beam(), SecondMoment::Corrected);
            assert!(
                (stiffness - expected).abs() < 5e-4,
                "n = {exponent}: {stiffness}"
            );
        }
        let at_90 = |n: f64| {
            law(n).stiffness::<Exact>(&beam(), SecondMoment::Corrected)
                * core::f64::consts::FRAC_PI_2.powf(n)
        };
        assert!((at_90(1.0) - 4.18).abs() < 5e-3);
        assert!((at_90(2.365) - 0.37).abs() < 5e-3);
    }

    #[test]
    fn impossible_quantities_are_named() {
        use Quantity::{Exponent, Height, Length, Modulus, Width};
        let refused = |result: Result<Beam<f64>, QuantityError>| result.unwrap_err();
        assert_eq!(
            refused(Beam::new(0.0, 1.0, 1.0)),
            QuantityError::NotPositive(Length)
        );
        assert_eq!(
            refused(Beam::new(1.0, f64::NAN, 1.0)),
            QuantityError::NotFinite(Width)
        );
        assert_eq!(
            refused(Beam::new(1.0, 1.0, f64::INFINITY)),
            QuantityError::NotFinite(Height)
        );
        assert_eq!(
            Ludwick::new(-1.0, 1.0),
            Err(QuantityError::NotPositive(Modulus))
        );
        assert_eq!(
            Ludwick::new(1.0, 0.0),
            Err(QuantityError::NotPositive(Exponent))
        );
        assert_eq!(
            Ludwick::new(1.0, 10.5),
            Err(QuantityError::TooLarge(Exponent))
        );
        assert_eq!(
            beam().linear_stiffness(0.0),
            Err(QuantityError::NotPositive(Modulus))
        );
        assert_eq!(
            QuantityError::NotPositive(Height).to_string(),
            "the height must be greater than zero"
        );
    }

    proptest! {
        #[test]
        fn stress_is_odd_monotone_and_invertible(
            exponent in 0.5..4.0,
            strain in 1e-3..8.0,
        ) {
            let law = law(exponent);
            let stress = law.stress::<Exact>(strain);
            prop_assert_eq!(law.stress::<Exact>(-strain).to_bits(), (-stress).to_bits());
            prop_assert!(law.stress::<Exact>(strain * 1.01) > stress);
            prop_assert!(relative(law.strain::<Exact>(stress), strain) < 1e-12);
            prop_assert!(relative(law.strain::<Exact>(-stress), -strain) < 1e-12);
        }

        #[test]
        fn the_two_ways_to_the_stiffness_agree(
            exponent in 0.5..4.0,
            length in 0.01..1.0,
            width in 0.001..0.1,
            height in 0.001..0.1,
        ) {
            let law = law(exponent);
            let beam = Beam::new(length, width, height).unwrap();
            let direct = law.stiffness::<Exact>(&beam, SecondMoment::Corrected);
            let through_moment = ((exponent + 1.0) / exponent).powf(exponent)
                * E
                * law.second_moment::<Exact>(&beam, SecondMoment::Corrected)
                / length.powf(exponent + 1.0);
            prop_assert!(relative(direct, through_moment) < 1e-12);
            let moment = law.moment_stiffness::<Exact>(&beam, SecondMoment::Corrected);
            let from_moment = ((exponent + 1.0) / exponent).powf(exponent) * moment / length;
            prop_assert!(relative(direct, from_moment) < 1e-12);
        }

        #[test]
        fn the_board_computes_the_same_stiffness(exponent in 1.0..3.0_f64) {
            let exact = law(exponent).stiffness::<Exact>(&beam(), SecondMoment::Corrected);
            #[allow(clippy::cast_possible_truncation)]
            let board = Ludwick::new(0.34e6_f32, exponent as f32)
                .unwrap()
                .stiffness::<<f32 as Real>::DefaultPower>(
                    &Beam::new(0.094_f32, 0.030, 0.024).unwrap(),
                    SecondMoment::Corrected,
                );
            prop_assert!(relative(f64::from(board), exact) < 1e-5, "{board} for {exact}");
        }
    }
}
