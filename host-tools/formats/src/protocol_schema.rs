//! The JSON Schema of protocol files, for editors that complete and check TOML by one.
//!
//! Kinds, tracks and the numbers of a setup are those that the readers know.

use serde_json::{Map, Value, json};

use crate::protocol_file::{CONTROL_MODES, unit};
use crate::setup::NUMBERS;
use wire::protocol::MAX_SEGMENTS;

/// The schema of a protocol file. That a repeat goes back to an earlier segment, and that numbers
/// have at most two decimals, only the reader can tell.
pub fn schema() -> Value {
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A protocol file of softrig",
        "type": "object",
        "required": ["schema", "segment"],
        "additionalProperties": false,
        "properties": {
            "schema": { "const": 1, "description": "Version of the layout" },
            "name": { "type": "string", "description": "Name for recordings" },
            "title": { "type": "string", "description": "Its purpose, in one line" },
            "setup": setup(),
            "segment": {
                "type": "array",
                "minItems": 1,
                "maxItems": MAX_SEGMENTS,
                "items": { "oneOf": segments() },
            },
        },
    })
}

/// How the rig is to stand.
fn setup() -> Value {
    let numbers = NUMBERS.iter().map(|(name, unit, range)| {
        let number = json!({
            "type": "number",
            "minimum": range.start(),
            "maximum": range.end(),
            "description": unit,
        });
        ((*name).to_owned(), number)
    });
    let mut properties: Map<String, Value> = numbers.collect();
    properties.insert(
        "new_part".to_owned(),
        json!({ "enum": ["actuator", "sensor"] }),
    );
    json!({
        "type": "object",
        "description": "Required rig setup",
        "additionalProperties": false,
        "properties": properties,
    })
}

/// Each kind of segment, those that track something once for each of it.
fn segments() -> Vec<Value> {
    let seconds = || json!({ "type": "number", "minimum": 0.0, "description": "s" });
    let of = |kind: &str, track: Option<&str>, keys: Vec<(String, Value)>| {
        let mut properties = Map::new();
        properties.insert("kind".to_owned(), json!({ "const": kind }));
        if let Some(track) = track {
            properties.insert("track".to_owned(), json!({ "const": track }));
        }
        properties.extend(keys);
        let required: Vec<&String> = properties.keys().collect();
        json!({
            "type": "object",
            "required": required,
            "additionalProperties": false,
            "properties": properties,
        })
    };
    let mut all = Vec::new();
    for (mode, track) in CONTROL_MODES {
        let level = |name: &str| {
            let unit = unit(mode);
            (
                format!("{name}_{unit}"),
                json!({ "type": "number", "description": unit }),
            )
        };
        let duration = || ("duration_s".to_owned(), seconds());
        for kind in ["step", "ramp"] {
            all.push(of(kind, Some(track), vec![level("level"), duration()]));
        }
        let period = ("period_s".to_owned(), seconds());
        let sum = vec![level("centre"), level("amplitude"), period, duration()];
        all.push(of("multisine", Some(track), sum));
    }
    for kind in ["hold", "release"] {
        all.push(of(kind, None, vec![("duration_s".to_owned(), seconds())]));
    }
    let count = || json!({ "type": "integer", "minimum": 1 });
    let again = ["from", "times"].map(|key| (key.to_owned(), count()));
    all.push(of("repeat", None, again.to_vec()));
    all
}
