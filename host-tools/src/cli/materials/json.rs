//! The JSON of `rig materials`.
//!
//! Scripts rely on these keys and their order, so they are written down here as types, apart
//! from the text that people read. Numbers are in the units of their keys; ratios, exponents
//! and strains have none.

use model_core::material::{DataSheet, HeldOut, Material, TABLE_I};
use serde::{Serialize, Serializer};
use softrig_materials::curve::TensileCurve;
use softrig_materials::fit::{Choice, CurveFit, LawFit};
use softrig_materials::predictor::{LeaveOneOut, Prediction, PredictorFit};
use softrig_materials::table_row;

/// Version of each of these layouts.
const SCHEMA: u32 = 1;

/// `rig materials list`.
#[derive(Serialize)]
pub(super) struct List {
    schema: u32,
    source: String,
    materials: Vec<Row>,
    predictor: Predictors,
}

#[derive(Serialize)]
struct Predictors {
    eight_rows: Predictor,
    all_rows: Predictor,
    leave_one_out: LeaveOneOut,
}

impl List {
    /// Table I, where it is from, and what the predictor makes of it.
    pub(super) fn new(
        source: String,
        eight_rows: &PredictorFit,
        all_rows: &PredictorFit,
        leave_one_out: LeaveOneOut,
    ) -> Self {
        Self {
            schema: SCHEMA,
            source,
            materials: TABLE_I.iter().map(Row::from).collect(),
            predictor: Predictors {
                eight_rows: eight_rows.into(),
                all_rows: all_rows.into(),
                leave_one_out,
            },
        }
    }
}

/// A row of Table I.
#[derive(Serialize)]
struct Row {
    name: &'static str,
    exponent: f64,
    #[serde(flatten)]
    data_sheet: Figures,
    table_ii: Option<RowOfTableTwo>,
}

impl From<&Material> for Row {
    fn from(material: &Material) -> Self {
        Self {
            name: material.name,
            exponent: material.exponent(),
            data_sheet: (&material.data_sheet()).into(),
            table_ii: material.held_out.as_ref().map(RowOfTableTwo::from),
        }
    }
}

#[derive(Serialize)]
struct RowOfTableTwo {
    exponent: f64,
    published_estimate: f64,
}

impl From<&HeldOut> for RowOfTableTwo {
    fn from(held_out: &HeldOut) -> Self {
        Self {
            exponent: held_out.exponent(),
            published_estimate: held_out.published_estimate(),
        }
    }
}

/// What a data sheet says.
#[derive(Serialize)]
struct Figures {
    modulus_mpa: f64,
    mixed_viscosity_cps: f64,
    tensile_strength_mpa: f64,
}

impl From<&DataSheet<f64>> for Figures {
    fn from(sheet: &DataSheet<f64>) -> Self {
        Self {
            modulus_mpa: sheet.modulus_mpa(),
            mixed_viscosity_cps: sheet.mixed_viscosity_cps(),
            tensile_strength_mpa: sheet.tensile_strength_mpa(),
        }
    }
}

#[derive(Serialize)]
struct Predictor {
    coefficients: [f64; 3],
    standard_errors: [f64; 3],
    t_values: [f64; 3],
    critical_t: f64,
    residual_deviation: f64,
    degrees_of_freedom: usize,
    /// The exponents of the materials that the paper holds out, by name.
    #[serde(serialize_with = "as_map")]
    estimates: Vec<(&'static str, f64)>,
}

impl From<&PredictorFit> for Predictor {
    fn from(fit: &PredictorFit) -> Self {
        Self {
            coefficients: fit.coefficients,
            standard_errors: fit.standard_errors,
            t_values: fit.t_values,
            critical_t: fit.critical_t(),
            residual_deviation: fit.residual_deviation,
            degrees_of_freedom: fit.degrees_of_freedom,
            estimates: TABLE_I
                .iter()
                .filter(|material| material.held_out.is_some())
                .map(|material| {
                    let prediction = fit.predict(&material.data_sheet());
                    (material.name, prediction.exponent)
                })
                .collect(),
        }
    }
}

/// An object whose keys are in the order of the table, which no map of the standard library
/// keeps.
fn as_map<S: Serializer>(pairs: &[(&str, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().copied())
}

/// `rig materials predict`.
#[derive(Serialize)]
pub(super) struct Predicted<'a> {
    schema: u32,
    #[serde(flatten)]
    prediction: &'a Prediction,
    data_sheet: Figures,
    rows: usize,
    coefficients: [f64; 3],
    leave_one_out: LeaveOneOut,
}

impl<'a> Predicted<'a> {
    /// A prediction from a data sheet, by a predictor that was fitted to so many rows.
    pub(super) fn new(
        prediction: &'a Prediction,
        sheet: &DataSheet<f64>,
        rows: usize,
        fit: &PredictorFit,
        leave_one_out: LeaveOneOut,
    ) -> Self {
        Self {
            schema: SCHEMA,
            prediction,
            data_sheet: sheet.into(),
            rows,
            coefficients: fit.coefficients,
            leave_one_out,
        }
    }
}

/// `rig materials fit-curve` of one curve.
#[derive(Serialize)]
pub(super) struct Curve<'a> {
    schema: u32,
    file: String,
    material: &'a str,
    choice: Chosen<'a>,
    points: usize,
    strain_low: f64,
    strain_high: f64,
    residual_unit: &'static str,
    ludwick: &'a LawFit,
    hooke: &'a LawFit,
    table_i: Option<Row>,
    notes: Vec<String>,
    tool_version: &'static str,
}

#[derive(Serialize)]
struct Chosen<'a> {
    paper: bool,
    #[serde(flatten)]
    choice: &'a Choice,
}

impl<'a> Curve<'a> {
    /// What is fitted, and how; `paper` if the choice is that of `--paper`.
    pub(super) fn new(paper: bool, curve: &'a TensileCurve, fit: &'a CurveFit) -> Self {
        Self {
            schema: SCHEMA,
            file: curve.path.display().to_string(),
            material: &curve.material,
            choice: Chosen {
                paper,
                choice: &fit.choice,
            },
            points: fit.points,
            strain_low: fit.strains.0,
            strain_high: fit.strains.1,
            residual_unit: fit.choice.residual.unit(),
            ludwick: &fit.ludwick,
            hooke: &fit.hooke,
            table_i: table_row(curve).map(Row::from),
            notes: fit.notes(curve),
            tool_version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// `rig materials fit-curve` of several curves.
#[derive(Serialize)]
pub(super) struct Curves<'a> {
    schema: u32,
    curves: Vec<Curve<'a>>,
}

impl<'a> Curves<'a> {
    /// All of them, in the order in which they were given.
    pub(super) fn new(paper: bool, fitted: &'a [(TensileCurve, CurveFit)]) -> Self {
        Self {
            schema: SCHEMA,
            curves: fitted
                .iter()
                .map(|(curve, fit)| Curve::new(paper, curve, fit))
                .collect(),
        }
    }
}
