//! The exponent from a data sheet, by the paper's least-squares fit.
//!
//! The coefficients used by the board and every other tool are constants of
//! [`model_core::material`]. Here their fit is repeated from the table, as a check, and
//! with two additions to the paper: standard errors, and the error of the prediction for
//! a material outside the fit.

use model_core::material::{DataSheet, Material, TABLE_I};
use model_core::power::Exact;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// The smallest and the largest value of each figure of the data sheet in Table
/// I, in its unit there: modulus (MPa), mixed viscosity (cps), tensile strength
/// (MPa).
pub const TABLE_RANGES: [(&str, &str, f64, f64); 3] = [
    ("modulus", "MPa", 0.06, 0.62),
    ("mixed viscosity", "cps", 3_000.0, 35_000.0),
    ("tensile strength", "MPa", 0.83, 5.51),
];

/// Least squares of the exponent on the three regressors of Eq. 8, without
/// intercept.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictorFit {
    /// x₁ (per MPa), x₂ and x₃ of Eq. 8.
    pub coefficients: [f64; 3],
    /// Their standard errors.
    pub standard_errors: [f64; 3],
    /// Coefficient over standard error; beyond ±[`critical_t`](Self::critical_t)
    /// it differs significantly from zero.
    pub t_values: [f64; 3],
    /// Standard deviation of the residuals.
    pub residual_deviation: f64,
    /// Rows less coefficients.
    pub degrees_of_freedom: usize,
    inverse_normal_matrix: Matrix3<f64>,
}

/// A predicted exponent.
#[derive(Clone, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
pub struct Prediction {
    /// The exponent n.
    pub exponent: f64,
    /// Standard error of predicting one new material.
    pub standard_error: f64,
    /// The interval that holds the exponent of a new material with a
    /// probability of 95 %, if the residuals are normal.
    pub interval95: [f64; 2],
    /// Sentences about figures outside the table and impossible results.
    pub warnings: Vec<String>,
}

/// How well materials are predicted that the fit has not seen.
#[derive(Clone, Copy, Debug, PartialEq, schemars::JsonSchema, serde::Serialize)]
pub struct LeaveOneOut {
    /// Root mean square error of the predictor.
    pub predictor_rms: f64,
    /// Root mean square error of predicting the mean of the other materials.
    pub mean_rms: f64,
}

/// Why a predictor could not be fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{rows} materials do not determine three coefficients; give at least four that differ")]
pub struct PredictorError {
    /// Materials that were given.
    pub rows: usize,
}

/// Returns the eight rows of Table I that the paper fits to.
pub fn eight_rows() -> Vec<Material> {
    TABLE_I
        .into_iter()
        .filter(|material| material.held_out.is_none())
        .collect()
}

fn regressors(data_sheet: &DataSheet<f64>) -> Vector3<f64> {
    Vector3::from(data_sheet.regressors::<Exact>())
}

impl PredictorFit {
    /// Fits Eq. 8 to the exponents of Table I of the given materials.
    ///
    /// # Errors
    ///
    /// [`PredictorError`] if there are fewer than four materials or their data
    /// sheets are too much alike.
    pub fn new(materials: &[Material]) -> Result<Self, PredictorError> {
        let rows = materials.len();
        let error = PredictorError { rows };
        let degrees_of_freedom = rows.checked_sub(3).filter(|d| *d > 0).ok_or(error)?;
        let matrix = DMatrix::from_fn(rows, 3, |row, column| {
            regressors(&materials[row].data_sheet())[column]
        });
        let exponents = DVector::from_iterator(rows, materials.iter().map(Material::exponent));
        let svd = matrix.clone().svd(true, true);
        if svd.rank(1e-9 * svd.singular_values.max()) < 3 {
            return Err(error);
        }
        let solution = svd.solve(&exponents, 0.0).map_err(|_| error)?;
        let right = svd.v_t.as_ref().ok_or(error)?;
        // (XᵀX)⁻¹ from the singular values keeps the digits that forming XᵀX
        // would lose.
        let inverse_normal_matrix = Matrix3::from_fn(|i, j| {
            (0..3)
                .map(|k| right[(k, i)] * right[(k, j)] / svd.singular_values[k].powi(2))
                .sum::<f64>()
        });
        let residuals = exponents - matrix * &solution;
        let residual_deviation = (residuals.norm_squared() / degrees_of_freedom as f64).sqrt();
        let coefficients = [solution[0], solution[1], solution[2]];
        let standard_errors =
            [0, 1, 2].map(|i| residual_deviation * inverse_normal_matrix[(i, i)].sqrt());
        Ok(Self {
            coefficients,
            standard_errors,
            t_values: [0, 1, 2].map(|i| coefficients[i] / standard_errors[i]),
            residual_deviation,
            degrees_of_freedom,
            inverse_normal_matrix,
        })
    }

    /// The |t| above which a coefficient differs from zero at 95 %.
    pub fn critical_t(&self) -> f64 {
        StudentsT::new(0.0, 1.0, self.degrees_of_freedom as f64)
            .map_or(f64::INFINITY, |distribution| {
                distribution.inverse_cdf(0.975)
            })
    }

    /// Predicts the exponent of a material from its data sheet.
    pub fn predict(&self, data_sheet: &DataSheet<f64>) -> Prediction {
        let x = regressors(data_sheet);
        let exponent = Vector3::from(self.coefficients).dot(&x);
        // The new material has the same residual variance as those of the fit.
        let standard_error =
            self.residual_deviation * (1.0 + (self.inverse_normal_matrix * x).dot(&x)).sqrt();
        let half_width = self.critical_t() * standard_error;
        let figures = [
            data_sheet.modulus_mpa(),
            data_sheet.mixed_viscosity_cps(),
            data_sheet.tensile_strength_mpa(),
        ];
        let mut warnings: Vec<String> = TABLE_RANGES
            .iter()
            .zip(figures)
            .filter(|((_, _, low, high), figure)| figure < low || figure > high)
            .map(|((name, unit, low, high), figure)| {
                format!(
                    "the {name} of {figure} {unit} is outside Table I ({low} to {high} {unit}): \
                     the prediction extrapolates"
                )
            })
            .collect();
        if exponent <= 0.0 {
            warnings.push(format!(
                "an exponent of {exponent:.3} is impossible: these figures are too far from \
                 Table I to be used"
            ));
        }
        Prediction {
            exponent,
            standard_error,
            interval95: [exponent - half_width, exponent + half_width],
            warnings,
        }
    }
}

/// Leaves out each material in turn and predicts it from the others.
///
/// # Errors
///
/// [`PredictorError`] if fewer than five materials are given, or they are too
/// much alike.
pub fn leave_one_out(materials: &[Material]) -> Result<LeaveOneOut, PredictorError> {
    let mut squares = [0.0, 0.0];
    for left_out in 0..materials.len() {
        let others: Vec<Material> = materials
            .iter()
            .enumerate()
            .filter(|(index, _)| *index != left_out)
            .map(|(_, material)| *material)
            .collect();
        let fit = PredictorFit::new(&others)?;
        let mean = others.iter().map(Material::exponent::<f64>).sum::<f64>() / others.len() as f64;
        let truth: f64 = materials[left_out].exponent();
        let predicted = fit.predict(&materials[left_out].data_sheet()).exponent;
        squares[0] += (predicted - truth).powi(2);
        squares[1] += (mean - truth).powi(2);
    }
    let count = materials.len() as f64;
    let [predictor_rms, mean_rms] = squares.map(|sum: f64| (sum / count).sqrt());
    if materials.is_empty() {
        return Err(PredictorError { rows: 0 });
    }
    Ok(LeaveOneOut {
        predictor_rms,
        mean_rms,
    })
}

#[cfg(test)]
mod tests {
    use model_core::material::{Predictor, find};

    use super::*;

    fn predicted(fit: &PredictorFit, name: &str) -> Prediction {
        fit.predict(&find(name).unwrap().data_sheet())
    }

    #[test]
    fn the_fit_of_the_paper_as_it_is_described() {
        let fit = PredictorFit::new(&eight_rows()).unwrap();
        for (coefficient, expected) in fit
            .coefficients
            .iter()
            .zip([-0.748_293, 0.430_245, 3.825_142])
        {
            assert!((coefficient - expected).abs() < 5e-7, "{coefficient}");
        }
        let near = |name: &str, expected: f64| {
            let exponent = predicted(&fit, name).exponent;
            assert!((exponent - expected).abs() < 5e-5, "{name} {exponent}");
        };
        near("Dragon Skin 20", 2.3726);
        near("Dragon Skin FX-Pro", 1.7700);
    }

    #[test]
    #[allow(clippy::cast_possible_truncation)]
    fn the_constants_of_the_core_are_this_fit() {
        let fit = PredictorFit::new(&eight_rows()).unwrap();
        let core = Predictor::EIGHT_ROWS;
        let constants = [
            core.per_mpa,
            core.per_root_viscosity,
            core.per_root_tensile_strength,
        ];
        assert_eq!(
            fit.coefficients.map(|c| (c as f32).to_bits()),
            constants.map(f32::to_bits),
            "the fit gives {:?}",
            fit.coefficients.map(|c| c as f32)
        );
    }

    #[test]
    fn all_ten_rows() {
        let fit = PredictorFit::new(&TABLE_I).unwrap();
        assert_eq!(fit.degrees_of_freedom, 7);
        let near = |name: &str, expected: f64| {
            let exponent = predicted(&fit, name).exponent;
            assert!((exponent - expected).abs() < 5e-5, "{name} {exponent}");
        };
        near("Dragon Skin 20", 2.3729);
        near("Dragon Skin FX-Pro", 1.7321);
    }

    #[test]
    fn unseen_materials_are_predicted_little_better_than_by_the_mean() {
        let errors = leave_one_out(&TABLE_I).unwrap();
        assert!((errors.predictor_rms - 0.293).abs() < 5e-4, "{errors:?}");
        assert!((errors.mean_rms - 0.388).abs() < 5e-4, "{errors:?}");
    }

    #[test]
    fn only_the_tensile_strength_is_significant() {
        for rows in [eight_rows(), TABLE_I.to_vec()] {
            let fit = PredictorFit::new(&rows).unwrap();
            let critical = fit.critical_t();
            assert!(fit.t_values[0].abs() < critical, "{:?}", fit.t_values);
            assert!(fit.t_values[1].abs() < critical);
            assert!(fit.t_values[2].abs() > critical);
        }
        // The tabulated 97.5 % point of Student's t with 5 degrees of freedom.
        let fit = PredictorFit::new(&eight_rows()).unwrap();
        assert!((fit.critical_t() - 2.5706).abs() < 5e-5);
    }

    #[test]
    fn the_standard_error_of_a_prediction_agrees_with_leaving_one_out() {
        let rows = TABLE_I.to_vec();
        let fit = PredictorFit::new(&rows).unwrap();
        for left_out in 0..rows.len() {
            let mut others = rows.clone();
            let material = others.remove(left_out);
            let sheet = material.data_sheet();
            let truth: f64 = material.exponent();
            let prediction = fit.predict(&sheet);
            // The leverage h is in the standard error, s √(1 + h), and also turns
            // a residual e into the error of an unseen row, e/(1 − h).
            let leverage = (prediction.standard_error / fit.residual_deviation).powi(2) - 1.0;
            let unseen = PredictorFit::new(&others).unwrap().predict(&sheet);
            let expected = (truth - prediction.exponent) / (1.0 - leverage);
            assert!(
                ((truth - unseen.exponent) - expected).abs() < 1e-10,
                "{}",
                material.name
            );
        }
    }

    #[test]
    fn the_residuals_are_orthogonal_to_the_regressors() {
        let rows = eight_rows();
        let fit = PredictorFit::new(&rows).unwrap();
        let mut sums = Vector3::zeros();
        for material in &rows {
            let x = regressors(&material.data_sheet());
            sums += x * (material.exponent::<f64>() - Vector3::from(fit.coefficients).dot(&x));
        }
        assert!(sums.norm() < 1e-12, "{sums}");
    }

    #[test]
    fn the_ranges_are_those_of_the_table() {
        let figures = |pick: fn(&DataSheet<f64>) -> f64| {
            TABLE_I
                .iter()
                .map(move |material| pick(&material.data_sheet()))
        };
        let picks: [fn(&DataSheet<f64>) -> f64; 3] = [
            DataSheet::modulus_mpa,
            DataSheet::mixed_viscosity_cps,
            DataSheet::tensile_strength_mpa,
        ];
        for (pick, (_, _, low, high)) in picks.into_iter().zip(TABLE_RANGES) {
            let smallest = figures(pick).fold(f64::INFINITY, f64::min);
            let largest = figures(pick).fold(0.0, f64::max);
            assert_eq!(
                (smallest.to_bits(), largest.to_bits()),
                (low.to_bits(), high.to_bits())
            );
        }
    }

    #[test]
    fn extrapolation_is_said() {
        let fit = PredictorFit::new(&eight_rows()).unwrap();
        assert_eq!(
            predicted(&fit, "Dragon Skin 20").warnings,
            Vec::<String>::new()
        );
        let soft = fit.predict(&DataSheet::new(0.03, 9_000.0, 1.0).unwrap());
        assert_eq!(
            soft.warnings,
            [
                "the modulus of 0.03 MPa is outside Table I (0.06 to 0.62 MPa): \
              the prediction extrapolates"
            ]
        );
        let hard = fit.predict(&DataSheet::new(9.0, 90_000.0, 0.1).unwrap());
        assert_eq!(hard.warnings.len(), 4);
        assert!(hard.warnings[3].contains("impossible"));
        assert!(hard.standard_error > 3.0 * soft.standard_error);
    }

    #[test]
    fn too_few_materials_are_refused() {
        assert!(PredictorFit::new(&TABLE_I[..3]).is_err());
        assert!(PredictorFit::new(&[TABLE_I[0]; 6]).is_err());
        assert!(leave_one_out(&TABLE_I[..4]).is_err());
        assert!(leave_one_out(&[]).is_err());
    }
}
