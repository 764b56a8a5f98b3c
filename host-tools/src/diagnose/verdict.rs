//! The verdict as data: what `--json` writes, and its schema.

use schemars::JsonSchema;
use serde::Serialize;

/// The schema number of this structure.
pub const SCHEMA: u32 = 1;

/// The answer to "what is missing?".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// One or several effects are named.
    EffectFound,
    /// The structure is right; parameters moved.
    ParametersOnly,
    /// The nominal model is already at the noise floor.
    NoDiscrepancy,
    /// Several effects explain the recordings equally well.
    CannotTell,
    /// The model is inadequate and no known effect restores it.
    Unexplained,
}

/// A verdict, as written to JSON.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Verdict {
    /// Number of this schema.
    pub schema: u32,
    /// The answer.
    pub verdict: Answer,
    /// Every effect that is named.
    pub effects: Vec<NamedEffect>,
    /// Rival explanations, best first; the answer set of `cannot_tell`.
    pub alternatives: Vec<Alternative>,
    /// Whether the repair is good enough.
    pub adequacy: Adequacy,
    /// Where the gap lives, strongest feature first.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// RMS error on the fitted recordings, in degrees.
    pub rmse_deg: FittedError,
    /// RMS error on recordings that were not fitted, in degrees.
    pub holdout_rmse_deg: HeldOutError,
    /// Runs that would separate the surviving rivals.
    pub next_experiment: Vec<Experiment>,
    /// Files that were fitted, then files held out.
    pub recordings: Vec<String>,
    /// Seed of everything random.
    pub seed: u64,
    /// Version of the tool.
    pub tool_version: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// An effect with its parameters in the units of model files.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct NamedEffect {
    /// Kind, as in model files.
    pub kind: String,
    /// Parameters by key.
    pub parameters: serde_json::Map<String, serde_json::Value>,
    /// 95 % intervals by key, of the parameters that were fitted.
    pub interval95: serde_json::Map<String, serde_json::Value>,
    /// Probability among the rivals that were tried.
    pub probability: f64,
}

/// A rival explanation.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Alternative {
    /// Its effects.
    pub kinds: Vec<String>,
    /// Probability among the explanations of the same size.
    pub probability: f64,
    /// Difference of the information criterion to the best.
    pub delta_bic: f64,
}

/// The second axis of the verdict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Adequacy {
    /// Whether the residual of the final model cannot be told from noise.
    pub adequate: bool,
    /// Share of the held-out gap between refit and noise floor that the repair
    /// removes.
    pub holdout_gap_closed: f64,
    /// Whether the formula itself fits, or only its kind.
    pub exact_form: bool,
}

/// A feature with which the missing force goes.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Place {
    /// The feature.
    pub feature: String,
    /// Share of the missing force, 0 to 1.
    pub share_of_gap: f64,
    /// A sentence.
    pub text: String,
}

/// RMS errors on fitted recordings, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct FittedError {
    /// The model as supplied.
    pub nominal: f64,
    /// The same structure, refitted.
    pub refit: f64,
    /// With the named effects; equal to `refit` where there are none.
    pub repaired: f64,
    /// What noise alone leaves.
    pub noise_floor: f64,
}

/// RMS errors on held-out recordings, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct HeldOutError {
    /// The model as supplied.
    pub nominal: f64,
    /// The same structure, refitted.
    pub refit: f64,
    /// With the named effects, in the board's own arithmetic.
    pub repaired: f64,
}

/// A run that would separate rivals.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Experiment {
    /// Name of the protocol.
    pub protocol: String,
    /// The rivals that it separates.
    pub separates: Vec<String>,
    /// Evidence that it is expected to bring.
    pub expected_delta_chi2: f64,
}

/// The JSON Schema of a verdict.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(Verdict).into()
}
