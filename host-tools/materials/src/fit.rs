//! Ludwick's law fitted to a tensile curve.
//!
//! The paper's exponents come out of the public tensile curves only when the true stress is plotted
//! against the engineering strain, the modulus is held at its table value, and the misfit is
//! measured in strain (largest strain 6). Consistent measures miss the ten exponents by 0.83 (root
//! mean square) or more, whatever the range, the residual and the modulus
//! (`tests/tests/materials.rs`). So none of these choices is made silently: [`Choice`] lists them.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::{DMatrix, DVector, Dyn, Owned};

use super::curve::{Measure, TensileCurve};
use softrig_formats::error::InputError;
use strum::{Display, EnumMessage, EnumString, IntoStaticStr, VariantArray};

/// How the modulus enters a fit.
#[derive(Clone, Copy, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Modulus {
    /// Fitted together with the exponent.
    Free,
    /// Held at a value in MPa, which must be finite and above zero.
    #[serde(untagged)]
    Fixed(f64),
}

/// In which direction the distance between curve and law is measured.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    schemars::JsonSchema,
    serde::Serialize,
    Display,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Residual {
    /// σ − E εⁿ, in MPa.
    Stress,
    /// ε − (σ/E)^(1/n), without unit.
    Strain,
}

impl Residual {
    /// The unit of the residual.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Stress => "MPa",
            Self::Strain => "1",
        }
    }
}

/// Everything that a fit has to decide and that moves its result.
#[derive(Clone, Copy, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
pub struct Choice {
    /// The stress measure.
    pub stress: Measure,
    /// The strain measure, also of the range.
    pub strain: Measure,
    /// The smallest and the largest strain that count; all if absent.
    pub range: Option<(f64, f64)>,
    /// Whether the modulus is fitted.
    #[serde(rename = "modulus_mpa")]
    pub modulus: Modulus,
    /// The direction of the residual.
    pub residual: Residual,
}

impl Default for Choice {
    /// A consistent pair: engineering stress against engineering strain, because the beam of
    /// [`model_core::ludwick`] integrates the stress over the undeformed section with ε = κy, which
    /// are exactly those two measures.
    fn default() -> Self {
        Self {
            stress: Measure::Engineering,
            strain: Measure::Engineering,
            range: None,
            modulus: Modulus::Free,
            residual: Residual::Stress,
        }
    }
}

impl Choice {
    /// The choices that reproduce the paper's Table I best, root mean square
    /// 0.108 over its ten exponents: true stress against engineering strain up
    /// to 6, misfit in strain, modulus held at the table's value in MPa.
    pub const fn paper(modulus_mpa: f64) -> Self {
        Self {
            stress: Measure::True,
            strain: Measure::Engineering,
            range: Some((0.0, 6.0)),
            modulus: Modulus::Fixed(modulus_mpa),
            residual: Residual::Strain,
        }
    }

    /// Whether stress and strain are of one measure.
    pub fn is_consistent(&self) -> bool {
        self.stress == self.strain
    }
}

/// A fitted number.
#[derive(Clone, Copy, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard error, for independent residuals; absent if the value was
    /// held.
    pub standard_error: Option<f64>,
}

/// A law and how well it describes the curve.
#[derive(Clone, Copy, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
pub struct LawFit {
    /// The exponent n; 1, held, for Hooke.
    pub exponent: Estimate,
    /// The modulus E.
    pub modulus_mpa: Estimate,
    /// Root mean square of the residual, in its unit.
    pub rms: f64,
    /// Share of the variance that the law explains; negative where a constant
    /// would do better, which a held modulus can cause.
    pub r_squared: f64,
    /// Correlation of neighbouring residuals. Near 1 the misfit is the law's
    /// shape rather than noise, and the standard errors are far too small.
    pub lag_one_correlation: f64,
}

impl LawFit {
    /// Computes the stress in MPa at a strain.
    pub fn stress_mpa(&self, strain: f64) -> f64 {
        let magnitude = self.modulus_mpa.value * strain.abs().powf(self.exponent.value);
        magnitude.copysign(strain)
    }

    /// Computes the strain at a stress in MPa.
    pub fn strain(&self, stress_mpa: f64) -> f64 {
        let ratio = stress_mpa.abs() / self.modulus_mpa.value;
        ratio.powf(1.0 / self.exponent.value).copysign(stress_mpa)
    }

    /// Computes the residual at a sample, data minus law.
    pub fn residual(&self, direction: Residual, strain: f64, stress_mpa: f64) -> f64 {
        match direction {
            Residual::Stress => stress_mpa - self.stress_mpa(strain),
            Residual::Strain => strain - self.strain(stress_mpa),
        }
    }
}

/// Ludwick's law and Hooke's, fitted to the same samples.
#[derive(Clone, Debug, PartialEq)]
pub struct CurveFit {
    /// The choices that were made.
    pub choice: Choice,
    /// Number of samples that counted.
    pub points: usize,
    /// Smallest and largest strain among them.
    pub strains: (f64, f64),
    /// Ludwick's law.
    pub ludwick: LawFit,
    /// Hooke's law, with the modulus free or held as for Ludwick's.
    pub hooke: LawFit,
}

impl CurveFit {
    /// What was fitted to what, in a sentence without its end.
    pub fn choice_sentence(&self) -> String {
        match self.choice.modulus {
            Modulus::Free => self.choice_but("modulus free"),
            Modulus::Fixed(mpa) => self.choice_but(&format!("modulus held at {mpa} MPa")),
        }
    }

    /// The same with other words on the modulus.
    pub fn choice_but(&self, modulus: &str) -> String {
        let choice = &self.choice;
        let range = choice
            .range
            .map_or("whole curve".to_owned(), |(low, high)| {
                format!("range {low} to {high}")
            });
        format!(
            "{} stress against {} strain, {range}, {modulus}, misfit in {}",
            choice.stress, choice.strain, choice.residual
        )
    }

    /// What a reader of the numbers has to know, with what was noted of the curve.
    pub fn notes(&self, curve: &TensileCurve) -> Vec<String> {
        let mut notes = curve.notes.clone();
        if !self.choice.is_consistent() {
            notes.push(format!(
                "{} stress and {} strain are not a consistent pair: the exponent describes this \
                 plot, and the beam formulas need engineering stress and strain",
                self.choice.stress, self.choice.strain
            ));
        }
        let correlation = self.ludwick.lag_one_correlation;
        if correlation > CORRELATED {
            notes.push(format!(
                "neighbouring residuals correlate by {correlation:.3}: the misfit is mostly the \
                 law's shape rather than noise, and the standard errors are too small"
            ));
        }
        if self.strains.1 > FAR_BEYOND * ACTUATOR_STRAIN {
            notes.push(format!(
                "the paper's actuator strains by {ACTUATOR_STRAIN:.2} at 90° and this fit goes to \
                 {:.2}; --range 0,0.5 fits what the actuator sees",
                self.strains.1
            ));
        }
        notes
    }
}

/// Largest strain in the paper's actuator at 90°: 20 mm from the neutral surface to the far
/// side, over 94 mm of length.
const ACTUATOR_STRAIN: f64 = 0.020 * std::f64::consts::FRAC_PI_2 / 0.094;

/// Times that strain beyond which a fit says little of the actuator.
const FAR_BEYOND: f64 = 3.0;

/// Correlation of neighbouring residuals from which they are the law's and not the noise's.
const CORRELATED: f64 = 0.5;

/// Different strains that a fit needs: two parameters and two to judge them by.
const NEEDED_STRAINS: usize = 4;
/// Exponents outside are an artefact of data that do not grow with strain.
const PLAUSIBLE_EXPONENTS: std::ops::RangeInclusive<f64> = 0.05..=10.0;

/// Beyond any misfit, yet its square is far from the end of `f64`.
const HUGE_MISFIT: f64 = 1e100;

/// Returns the strains and stresses (MPa) that count under a choice.
pub fn selected(curve: &TensileCurve, choice: &Choice) -> (Vec<f64>, Vec<f64>) {
    curve
        .samples
        .iter()
        .map(|sample| {
            (
                sample.strain(choice.strain),
                sample.stress_mpa(choice.stress),
            )
        })
        .filter(|(strain, _)| {
            choice
                .range
                .is_none_or(|(low, high)| *strain >= low && *strain <= high)
        })
        .unzip()
}

/// Fits Ludwick's and Hooke's law to a tensile curve.
///
/// # Errors
///
/// [`InputError`] if the choice is impossible, leaves too few samples, or no
/// plausible curve fits.
pub fn fit(curve: &TensileCurve, choice: &Choice) -> Result<CurveFit, InputError> {
    if let Some((low, high)) = choice.range
        && !(low.is_finite() && high.is_finite() && low < high)
    {
        return Err(InputError::new(
            format!("the range {low},{high} is empty"),
            "give the smaller strain first",
        ));
    }
    if let Modulus::Fixed(mpa) = choice.modulus
        && !(mpa.is_finite() && mpa > 0.0)
    {
        return Err(InputError::new(
            format!("a modulus of {mpa} MPa is impossible"),
            "give a number above zero, or `free`",
        ));
    }
    let (strains, stresses) = selected(curve, choice);
    let mut sorted = strains.clone();
    sorted.sort_by(f64::total_cmp);
    let distinct = {
        let mut distinct = sorted.clone();
        distinct.dedup();
        distinct.len()
    };
    let (Some(&smallest), Some(&largest), NEEDED_STRAINS..) =
        (sorted.first(), sorted.last(), distinct)
    else {
        let all = || curve.samples.iter().map(|s| s.strain(choice.strain));
        let file_low = all().fold(f64::INFINITY, f64::min);
        let file_high = all().fold(f64::NEG_INFINITY, f64::max);
        let (low, high) = choice.range.unwrap_or((file_low, file_high));
        return Err(InputError::new(
            format!(
                "strains from {low:.4} to {high:.4} hold {distinct} different values and a fit \
                 needs {NEEDED_STRAINS}"
            ),
            format!("widen --range (the file spans {file_low:.4} to {file_high:.4})"),
        )
        .in_file(&curve.path));
    };
    let no_fit = |reason: String| {
        InputError::new(
            format!("no Ludwick curve fits ({reason})"),
            "look at the curve, then narrow --range or fix --modulus-mpa",
        )
        .in_file(&curve.path)
    };
    let problem = |exponent| Problem::new(&strains, &stresses, choice, exponent);
    let ludwick = problem(None).solve().map_err(no_fit)?;
    if !PLAUSIBLE_EXPONENTS.contains(&ludwick.exponent.value) {
        return Err(no_fit(format!(
            "the exponent went to {:.3}",
            ludwick.exponent.value
        )));
    }
    let hooke = problem(Some(1.0)).solve().map_err(no_fit)?;
    Ok(CurveFit {
        choice: *choice,
        points: strains.len(),
        strains: (smallest, largest),
        ludwick,
        hooke,
    })
}

/// The least-squares problem in ln E and ln n, which keeps both positive.
#[derive(Clone)]
struct Problem<'a> {
    strains: &'a [f64],
    stresses: &'a [f64],
    residual: Residual,
    log_modulus: f64,
    log_exponent: f64,
    fits_modulus: bool,
    fits_exponent: bool,
}

impl<'a> Problem<'a> {
    fn new(
        strains: &'a [f64],
        stresses: &'a [f64],
        choice: &Choice,
        exponent: Option<f64>,
    ) -> Self {
        let mut problem = Self {
            strains,
            stresses,
            residual: choice.residual,
            log_modulus: 0.0,
            log_exponent: exponent.unwrap_or(1.0).ln(),
            fits_modulus: matches!(choice.modulus, Modulus::Free),
            fits_exponent: exponent.is_none(),
        };
        problem.start(choice.modulus);
        problem
    }

    /// Starts from the straight line that the law is on logarithmic axes.
    fn start(&mut self, modulus: Modulus) {
        let logs: Vec<(f64, f64)> = self
            .strains
            .iter()
            .zip(self.stresses)
            .filter(|(strain, stress)| **strain > 0.0 && **stress > 0.0)
            .map(|(strain, stress)| (strain.ln(), stress.ln()))
            .collect();
        let count = logs.len().max(1) as f64;
        let mean_x = logs.iter().map(|(x, _)| x).sum::<f64>() / count;
        let mean_y = logs.iter().map(|(_, y)| y).sum::<f64>() / count;
        let covariance: f64 = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
        let variance: f64 = logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
        let slope = covariance / variance;
        if self.fits_exponent && PLAUSIBLE_EXPONENTS.contains(&slope) {
            self.log_exponent = slope.ln();
        }
        self.log_modulus = match modulus {
            Modulus::Fixed(mpa) => mpa.ln(),
            Modulus::Free => mean_y - self.log_exponent.exp() * mean_x,
        };
    }

    fn law(&self) -> LawFit {
        let held = |log: f64| Estimate {
            value: log.exp(),
            standard_error: None,
        };
        LawFit {
            exponent: held(self.log_exponent),
            modulus_mpa: held(self.log_modulus),
            rms: 0.0,
            r_squared: 0.0,
            lag_one_correlation: 0.0,
        }
    }

    fn misfits(&self) -> Vec<f64> {
        let law = self.law();
        self.strains
            .iter()
            .zip(self.stresses)
            .map(|(strain, stress)| law.residual(self.residual, *strain, *stress))
            .collect()
    }

    /// Derivatives of the residual at a sample by ln E and ln n.
    fn slopes(&self, law: &LawFit, strain: f64, stress: f64) -> [f64; 2] {
        let n = law.exponent.value;
        // A power times a logarithm goes to zero with its base.
        let times_log = |value: f64, base: f64| {
            if base > 0.0 { value * base.ln() } else { 0.0 }
        };
        match self.residual {
            Residual::Stress => {
                let fitted = law.stress_mpa(strain);
                [-fitted, -n * times_log(fitted, strain.abs())]
            }
            Residual::Strain => {
                let fitted = law.strain(stress);
                let ratio = stress.abs() / law.modulus_mpa.value;
                [fitted / n, times_log(fitted, ratio) / n]
            }
        }
    }

    fn solve(self) -> Result<LawFit, String> {
        let parameters = usize::from(self.fits_modulus) + usize::from(self.fits_exponent);
        let solved = if parameters == 0 {
            self
        } else {
            let (solved, report) = LevenbergMarquardt::new()
                .with_ftol(1e-14)
                .with_xtol(1e-12)
                .with_gtol(1e-12)
                .minimize(self);
            match report.termination {
                TerminationReason::ResidualsZero
                | TerminationReason::Orthogonal
                | TerminationReason::Converged { .. }
                // The last digit is reached before the tolerance.
                | TerminationReason::NoImprovementPossible(_) => solved,
                other => return Err(format!("the search ended with {other:?}")),
            }
        };
        solved.judge(parameters)
    }

    fn judge(&self, parameters: usize) -> Result<LawFit, String> {
        let misfits = self.misfits();
        let count = misfits.len() as f64;
        let squares: f64 = misfits.iter().map(|r| r * r).sum();
        let data = match self.residual {
            Residual::Stress => self.stresses,
            Residual::Strain => self.strains,
        };
        let mean = data.iter().sum::<f64>() / count;
        let spread: f64 = data.iter().map(|value| (value - mean).powi(2)).sum();
        let mut law = self.law();
        law.rms = (squares / count).sqrt();
        law.r_squared = if spread > 0.0 {
            1.0 - squares / spread
        } else {
            0.0
        };
        law.lag_one_correlation = if squares > 0.0 {
            misfits
                .windows(2)
                .map(|pair| pair[0] * pair[1])
                .sum::<f64>()
                / squares
        } else {
            0.0
        };
        if !(law.rms.is_finite() && law.exponent.value > 0.0 && law.modulus_mpa.value > 0.0) {
            return Err("the search left all bounds".to_owned());
        }
        if parameters > 0 {
            let errors = self
                .jacobian()
                .and_then(|jacobian| (jacobian.transpose() * jacobian).try_inverse())
                .map(|inverse| {
                    let variance = squares / (count - parameters as f64).max(1.0);
                    inverse.diagonal().map(|entry| (variance * entry).sqrt())
                })
                .ok_or("the samples do not determine it")?;
            let mut errors = errors.iter();
            // The parameters are logarithms: their errors are relative.
            if self.fits_modulus {
                law.modulus_mpa.standard_error =
                    errors.next().map(|error| error * law.modulus_mpa.value);
            }
            if self.fits_exponent {
                law.exponent.standard_error = errors.next().map(|error| error * law.exponent.value);
            }
        }
        Ok(law)
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        let mut parameters = parameters.iter();
        if self.fits_modulus {
            self.log_modulus = parameters.next().copied().unwrap_or(self.log_modulus);
        }
        if self.fits_exponent {
            self.log_exponent = parameters.next().copied().unwrap_or(self.log_exponent);
        }
    }

    fn params(&self) -> DVector<f64> {
        let mut parameters = Vec::new();
        if self.fits_modulus {
            parameters.push(self.log_modulus);
        }
        if self.fits_exponent {
            parameters.push(self.log_exponent);
        }
        DVector::from_vec(parameters)
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        // A trial step may overflow. A huge misfit makes the search turn back
        // there; a missing one would make it give up.
        let finite = |misfit: f64| {
            if misfit.is_finite() {
                misfit.clamp(-HUGE_MISFIT, HUGE_MISFIT)
            } else {
                HUGE_MISFIT
            }
        };
        Some(DVector::from_vec(
            self.misfits().into_iter().map(finite).collect(),
        ))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let law = self.law();
        let columns = usize::from(self.fits_modulus) + usize::from(self.fits_exponent);
        let skipped = usize::from(!self.fits_modulus);
        let mut jacobian = DMatrix::zeros(self.strains.len(), columns);
        for (row, (strain, stress)) in self.strains.iter().zip(self.stresses).enumerate() {
            let slopes = self.slopes(&law, *strain, *stress);
            for column in 0..columns {
                let slope = slopes[column + skipped];
                if !slope.is_finite() {
                    return None;
                }
                jacobian[(row, column)] = slope;
            }
        }
        Some(jacobian)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// A curve that follows a law, with an alternating error on the stress.
    fn synthetic(modulus: f64, exponent: f64, ripple: f64) -> TensileCurve {
        use std::fmt::Write as _;
        let mut text = "strain,stress_mpa\n".to_owned();
        for i in 0..200_u32 {
            let strain = f64::from(i) * 0.02;
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            let stress = modulus * strain.powf(exponent) + sign * ripple;
            writeln!(text, "{strain},{stress}").unwrap();
        }
        TensileCurve::parse(Path::new("synthetic.csv"), text.as_bytes()).unwrap()
    }

    #[test]
    fn an_exact_curve_gives_its_law_back() {
        for exponent in [0.6, 1.0, 1.538, 2.365] {
            let curve = synthetic(0.34, exponent, 0.0);
            for residual in [Residual::Stress, Residual::Strain] {
                for modulus in [Modulus::Free, Modulus::Fixed(0.34)] {
                    let choice = Choice {
                        modulus,
                        residual,
                        ..Choice::default()
                    };
                    let fit = fit(&curve, &choice).unwrap();
                    let law = fit.ludwick;
                    assert!(
                        (law.exponent.value - exponent).abs() < 1e-9,
                        "{choice:?} {law:?}"
                    );
                    assert!((law.modulus_mpa.value - 0.34).abs() < 1e-9);
                    assert!(law.r_squared > 1.0 - 1e-12 && law.rms < 1e-9);
                    assert_eq!(
                        law.modulus_mpa.standard_error.is_none(),
                        modulus != Modulus::Free
                    );
                    assert!(law.exponent.standard_error.is_some());
                    assert_eq!(fit.hooke.exponent.value.to_bits(), 1.0_f64.to_bits());
                    assert!((exponent - 1.0).abs() < 1e-12 || fit.hooke.rms > 100.0 * law.rms);
                }
            }
        }
    }

    #[test]
    fn hooke_is_the_straight_line_through_the_origin() {
        let curve = synthetic(0.34, 1.6, 0.01);
        let fit = fit(&curve, &Choice::default()).unwrap();
        let (strains, stresses) = selected(&curve, &fit.choice);
        let product: f64 = strains.iter().zip(&stresses).map(|(e, s)| e * s).sum();
        let square: f64 = strains.iter().map(|e| e * e).sum();
        assert!((fit.hooke.modulus_mpa.value - product / square).abs() < 1e-9);
        let count = strains.len() as f64;
        let variance = strains
            .iter()
            .zip(&stresses)
            .map(|(e, s)| (s - product / square * e).powi(2))
            .sum::<f64>()
            / (count - 1.0);
        let error = fit.hooke.modulus_mpa.standard_error.unwrap();
        assert!((error / (variance / square).sqrt() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn standard_errors_grow_with_the_scatter_and_the_ripple_is_seen() {
        let error = |ripple| {
            let fit = fit(&synthetic(0.34, 2.0, ripple), &Choice::default()).unwrap();
            assert!((fit.ludwick.rms / ripple - 1.0).abs() < 0.02);
            assert!(fit.ludwick.lag_one_correlation < -0.9);
            fit.ludwick.exponent.standard_error.unwrap()
        };
        let ratio = error(0.02) / error(0.01);
        assert!((ratio - 2.0).abs() < 0.05, "{ratio}");
    }

    #[test]
    fn the_analytic_slopes_are_the_numerical_ones() {
        let curve = synthetic(0.34, 2.0, 0.01);
        for residual in [Residual::Stress, Residual::Strain] {
            let choice = Choice {
                residual,
                ..Choice::default()
            };
            let (strains, stresses) = selected(&curve, &choice);
            let problem = Problem {
                log_modulus: (0.4_f64).ln(),
                log_exponent: (1.7_f64).ln(),
                ..Problem::new(&strains, &stresses, &choice, None)
            };
            let jacobian = problem.jacobian().unwrap();
            for column in 0..2 {
                let at = |step: f64| {
                    let mut moved = problem.clone();
                    let mut parameters = moved.params();
                    parameters[column] += step;
                    moved.set_params(&parameters);
                    moved.misfits()
                };
                let step = 1e-6;
                for (row, (up, down)) in at(step).iter().zip(at(-step)).enumerate() {
                    let numerical = (up - down) / (2.0 * step);
                    let analytic = jacobian[(row, column)];
                    assert!(
                        (numerical - analytic).abs() < 1e-7,
                        "{residual:?} {row} {column}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_far_start_still_arrives() {
        let curve = synthetic(0.34, 2.0, 0.0);
        for (exponent, modulus) in [(0.4, 0.1), (0.5, 2.0), (5.0, 0.02), (6.0, 2.0)] {
            for residual in [Residual::Stress, Residual::Strain] {
                let choice = Choice {
                    residual,
                    ..Choice::default()
                };
                let (strains, stresses) = selected(&curve, &choice);
                let law = Problem {
                    log_exponent: f64::ln(exponent),
                    log_modulus: f64::ln(modulus),
                    ..Problem::new(&strains, &stresses, &choice, None)
                }
                .solve()
                .unwrap();
                let found = law.exponent.value;
                assert!(
                    (found - 2.0).abs() < 1e-6,
                    "{residual:?} from {exponent}: {found}"
                );
            }
        }
    }

    #[test]
    fn the_range_is_in_the_chosen_strain() {
        let curve = synthetic(0.34, 2.0, 0.0);
        let choice = Choice {
            strain: Measure::True,
            stress: Measure::True,
            range: Some((0.5, 1.0)),
            ..Choice::default()
        };
        let fit = fit(&curve, &choice).unwrap();
        assert!(fit.strains.0 >= 0.5 && fit.strains.1 <= 1.0);
        assert!(fit.points < curve.samples.len());
    }

    #[test]
    fn impossible_fits_are_refused_with_advice() {
        let curve = synthetic(0.34, 2.0, 0.0);
        let refused = |change: &dyn Fn(&mut Choice)| {
            let mut choice = Choice::default();
            change(&mut choice);
            fit(&curve, &choice).unwrap_err().to_string()
        };
        assert!(refused(&|c| c.range = Some((3.0, 1.0))).contains("give the smaller strain first"));
        assert!(refused(&|c| c.range = Some((9.0, 10.0))).contains("widen --range"));
        assert!(refused(&|c| c.range = Some((0.0, f64::NAN))).contains("empty"));
        assert!(refused(&|c| c.modulus = Modulus::Fixed(0.0)).contains("above zero, or `free`"));
        let flat = TensileCurve::parse(
            Path::new("flat.csv"),
            b"strain,stress_mpa\n0.1,1\n0.2,1\n0.3,1\n0.4,1\n0.5,1\n",
        )
        .unwrap();
        let message = fit(&flat, &Choice::default()).unwrap_err().to_string();
        assert!(
            message.starts_with("flat.csv: no Ludwick curve fits"),
            "{message}"
        );
        let same = TensileCurve::parse(
            Path::new("same.csv"),
            b"strain,stress_mpa\n0.1,1\n0.1,1\n0.1,1\n0.1,1\n0.1,1\n",
        )
        .unwrap();
        let message = fit(&same, &Choice::default()).unwrap_err().to_string();
        assert!(message.contains("hold 1 different values"), "{message}");
    }
}
