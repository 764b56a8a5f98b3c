//! The JSON Schema of model files, for editors that complete and check TOML by one.
//!
//! It is made from the tables that the reader uses: the base equation, the catalogue and the ranges.

use model_core::catalogue::Kind;
use model_core::effects::Parameter;
use serde_json::{Map, Value, json};

use crate::columns::{OPTIONAL, Quantity};
use crate::model_file::base;
use crate::own_effects;
use crate::ranges::Range;

/// The schema of a model file. What only the reader can tell, such as the names in `[fit] free` that
/// depend on the effects, is not in it.
pub fn schema() -> Value {
    let dynamics: Map<String, Value> = base()
        .map(|(_, row)| (row.key.to_owned(), number(row)))
        .collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A model file of softrig",
        "type": "object",
        "required": ["schema", "dynamics"],
        "additionalProperties": false,
        "properties": {
            "schema": { "const": 1, "description": "Version of the layout" },
            "name": { "type": "string", "description": "Name in reports" },
            "dynamics": {
                "type": "object",
                "description": "M θ'' + C θ' + K sign(θ)|θ|^n = g p",
                "additionalProperties": false,
                "properties": dynamics,
            },
            "actuator": {
                "type": "object",
                "description": "Material and dimensions, from which missing numbers are taken",
                "additionalProperties": false,
                "properties": {
                    "material": { "type": "string", "description": "A name of `softrig materials list`" },
                    "length_m": { "type": "number", "exclusiveMinimum": 0.0 },
                    "width_m": { "type": "number", "exclusiveMinimum": 0.0 },
                    "height_m": { "type": "number", "exclusiveMinimum": 0.0 },
                },
            },
            "fit": {
                "type": "object",
                "additionalProperties": false,
                "properties": {
                    "free": {
                        "type": "array",
                        "items": { "type": "string" },
                        "description": "What fits may move: damping, stiffness, coulomb_friction.force_n, …",
                    },
                    "within": { "type": "object", "description": "How well a parameter is known" },
                },
            },
            "effect": {
                "type": "array",
                "description": "Effects beside the equation",
                "items": { "oneOf": effects() },
            },
            "recording": recording(),
        },
    })
}

/// A number with its range.
fn number(row: &Parameter) -> Value {
    let range = Range::of_key(row.key).unwrap_or_else(|| Range::of_parameter(row));
    json!({
        "type": "number",
        "minimum": range.least,
        "maximum": range.most,
        "description": format!("{} ({})", row.symbol, row.unit.symbol()),
    })
}

/// Each kind of effect with its parameters.
fn effects() -> Vec<Value> {
    let catalogue = Kind::ALL.iter().chain(Kind::ON_DESKTOP);
    let mut effects: Vec<Value> = catalogue
        .filter(|kind| **kind != Kind::Table)
        .map(|kind| {
            let rows = kind.parameters();
            let mut properties = Map::new();
            properties.insert("kind".to_owned(), json!({ "const": kind.name() }));
            properties.extend(rows.iter().map(|row| (row.key.to_owned(), number(row))));
            let left_in = rows.iter().filter(|row| row.left_out().is_none());
            let required: Vec<&str> = std::iter::once("kind")
                .chain(left_in.map(|row| row.key))
                .collect();
            json!({
                "type": "object",
                "title": kind.info().title,
                "description": format!("{} {}", kind.info().equation, kind.info().text),
                "required": required,
                "additionalProperties": false,
                "properties": properties,
            })
        })
        .collect();
    effects.push(json!({
        "type": "object",
        "title": "table",
        "required": ["kind", "of", "nodes", "forces_n"],
        "additionalProperties": false,
        "properties": {
            "kind": { "const": Kind::Table.name() },
            "of": { "type": "string" },
            "nodes": { "type": "array", "items": { "type": "number" } },
            "forces_n": { "type": "array", "items": { "type": "number" } },
        },
    }));
    effects.push(json!({
        "type": "object",
        "title": "an effect by formula",
        "required": ["kind", "name", "force"],
        "properties": {
            "kind": { "const": own_effects::KIND },
            "name": { "type": "string" },
            "force": { "type": "string", "description": "Q in N, of th, w, p, t, the parameters and the memory" },
            "memory": {
                "type": "object",
                "description": "Hidden states z: dz/dt = (follows - z)/time_constant",
                "additionalProperties": {
                    "type": "object",
                    "required": ["follows", "time_constant"],
                    "additionalProperties": false,
                    "properties": {
                        "follows": { "type": "string" },
                        "time_constant": { "type": "string", "description": "A parameter, in s" },
                    },
                },
            },
            "parameters": { "type": "object" },
        },
    }));
    effects
}

/// The layout of recordings.
fn recording() -> Value {
    let of = |values: Value| -> Map<String, Value> {
        let keys = Quantity::ALL.map(|quantity| quantity.key().to_owned());
        keys.into_iter().map(|key| (key, values.clone())).collect()
    };
    let mut columns = of(json!({ "type": "string" }));
    columns.extend(OPTIONAL.map(|name| (name.to_owned(), json!({ "type": "string" }))));
    json!({
        "type": "object",
        "description": "Columns and units of the recordings, if they are not time_s, pressure_kpa and angle_deg",
        "additionalProperties": false,
        "properties": {
            "columns": { "type": "object", "additionalProperties": false, "properties": columns },
            "units": {
                "type": "object",
                "additionalProperties": false,
                "properties": of(json!({ "type": "string" })),
            },
            "scale": {
                "type": "object",
                "description": "Two numbers of the file, each with what it is in its unit",
                "additionalProperties": false,
                "properties": of(json!({
                    "type": "array",
                    "minItems": 2,
                    "maxItems": 2,
                    "items": { "type": "array", "minItems": 2, "maxItems": 2, "items": { "type": "number" } },
                })),
            },
            "absolute_pressure_kpa": { "type": "number", "description": "Pressure of the air" },
            "angle_zero_deg": { "type": "number", "description": "The angle at rest" },
            "flip_angle": { "type": "boolean" },
            "skip_rows": { "type": "integer", "minimum": 0 },
            "setup": { "type": "object", "description": "Setup of the rig" },
        },
    })
}
