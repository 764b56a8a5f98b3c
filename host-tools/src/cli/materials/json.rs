//! The JSON of `softrig materials`.
//!
//! Scripts rely on these keys and their order, so they are written down here as types, apart
//! from the text that people read. Numbers are in the units of their keys; ratios, exponents
//! and strains have none.

use std::collections::BTreeMap;

use model_core::material::{DataSheet, HeldOut, Material, TABLE_I};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Serialize, Serializer};
use softrig_materials::curve::TensileCurve;
use softrig_materials::fit::{Choice, CurveFit, LawFit};
use softrig_materials::predictor::{LeaveOneOut, Prediction, PredictorFit};
use softrig_materials::table_row;

/// Version of each of these layouts.
const SCHEMA: u32 = 1;

/// The schema of what any of the subcommands writes: they differ in the keys that they have.
pub(in crate::cli) fn schema() -> Schema {
    let mut generator = SchemaGenerator::default();
    let each = [
        generator.subschema_for::<List>(),
        generator.subschema_for::<Predicted<'static>>(),
        generator.subschema_for::<Curve<'static>>(),
        generator.subschema_for::<Curves<'static>>(),
    ];
    let mut schema = json_schema!({
        "title": "Materials",
        "description": "What softrig materials writes with --json: list, predict, and fit-curve of one curve and of several.",
        "oneOf": each,
    });
    schema.insert(
        "$schema".to_owned(),
        generator.settings().meta_schema.clone().into(),
    );
    schema.insert("$defs".to_owned(), generator.take_definitions(true).into());
    schema
}

/// `softrig materials list`.
#[derive(JsonSchema, Serialize)]
pub(super) struct List {
    /// Version of this layout.
    schema: u32,
    /// Where the table is from.
    source: String,
    /// The rows of Table I.
    materials: Vec<Row>,
    /// The exponent from a data sheet (Eq. 8), as it is fitted to the table.
    predictor: Predictors,
}

#[derive(JsonSchema, Serialize)]
struct Predictors {
    /// Fitted to the rows that the paper fits to.
    eight_rows: Predictor,
    /// Fitted to all ten.
    all_rows: Predictor,
    /// Errors for materials that a fit has not seen.
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
#[derive(JsonSchema, Serialize)]
struct Row {
    /// The material.
    name: &'static str,
    /// Ludwick's exponent n.
    exponent: f64,
    #[serde(flatten)]
    data_sheet: Figures,
    /// Its row in Table II, if the paper holds it out.
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

#[derive(JsonSchema, Serialize)]
struct RowOfTableTwo {
    /// Ludwick's exponent n, measured.
    exponent: f64,
    /// What the paper's predictor says.
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
#[derive(JsonSchema, Serialize)]
struct Figures {
    /// Modulus at 100 % strain (MPa).
    modulus_mpa: f64,
    /// Viscosity of the mixed silicone (cP).
    mixed_viscosity_cps: f64,
    /// Tensile strength (MPa).
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

#[derive(JsonSchema, Serialize)]
struct Predictor {
    /// Of modulus, viscosity and tensile strength, as Eq. 8 has them.
    coefficients: [f64; 3],
    /// Their standard errors.
    standard_errors: [f64; 3],
    /// Coefficients in standard errors.
    t_values: [f64; 3],
    /// Beyond this a t value is significant at 5 %.
    critical_t: f64,
    /// Standard deviation of the residual exponents.
    residual_deviation: f64,
    /// Rows less coefficients.
    degrees_of_freedom: usize,
    /// The exponents of the materials that the paper holds out, by name.
    #[serde(serialize_with = "as_map")]
    #[schemars(with = "BTreeMap<String, f64>")]
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

/// `softrig materials predict`.
#[derive(JsonSchema, Serialize)]
pub(super) struct Predicted<'a> {
    /// Version of this layout.
    schema: u32,
    #[serde(flatten)]
    prediction: &'a Prediction,
    /// What was given.
    data_sheet: Figures,
    /// Rows of Table I that the predictor was fitted to.
    rows: usize,
    /// Of modulus, viscosity and tensile strength, as Eq. 8 has them.
    coefficients: [f64; 3],
    /// Errors for materials that a fit has not seen.
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

/// `softrig materials fit-curve` of one curve.
#[derive(JsonSchema, Serialize)]
pub(super) struct Curve<'a> {
    /// Version of this layout.
    schema: u32,
    /// The file of the curve.
    file: String,
    /// What was tested.
    material: &'a str,
    /// How it was fitted.
    choice: Chosen<'a>,
    /// Samples that were fitted.
    points: usize,
    /// Smallest strain that was fitted.
    strain_low: f64,
    /// Largest strain that was fitted.
    strain_high: f64,
    /// Unit of the residuals: MPa, or 1 for strains.
    residual_unit: &'static str,
    /// Ludwick's law, stress = E strain^n.
    ludwick: &'a LawFit,
    /// Hooke's law, for comparison.
    hooke: &'a LawFit,
    /// The row of Table I of this material, if it has one.
    table_i: Option<Row>,
    /// Sentences about what is unusual.
    notes: Vec<String>,
    /// Version of softrig.
    tool_version: &'static str,
}

#[derive(JsonSchema, Serialize)]
struct Chosen<'a> {
    /// Whether the choice is that of --paper.
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

/// `softrig materials fit-curve` of several curves.
#[derive(JsonSchema, Serialize)]
pub(super) struct Curves<'a> {
    /// Version of this layout.
    schema: u32,
    /// All of them, in the order in which they were given.
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
