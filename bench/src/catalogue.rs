//! What pages show of the code: the catalogue of effects, and the constants of the diagnosis.

use model_core::catalogue::Kind;
use model_core::effects::{Parameter, Place};
use serde_json::{Value, json};
use softrig::diagnose::work::policy::{Constant, Policy, Search};

const PLACES: [(Place, &str); 3] = [
    (Place::Input, "Between the pressure sensor and the chamber"),
    (Place::Force, "On the forces"),
    (Place::Sensor, "Between the angle and what the sensor shows"),
];

/// All of it.
pub fn figures() -> Value {
    let places = PLACES.map(|(place, title)| {
        let kinds = Kind::ALL.iter().filter(|kind| kind.info().place == place);
        json!({ "title": title, "effects": kinds.map(|&kind| effect(kind)).collect::<Vec<_>>() })
    });
    let constants = |rows: &[Constant]| -> Vec<Value> {
        let rows = rows.iter().map(|(name, value, unit, meaning, origin)| {
            json!({ "name": name, "value": trimmed(*value, 4), "unit": unit, "meaning": meaning.trim(), "origin": origin })
        });
        rows.collect()
    };
    json!({
        "benchmark": "catalogue", "places": places, "constants": constants(Policy::ROWS),
        "search": constants(Search::ROWS),
    })
}

fn effect(kind: Kind) -> Value {
    let info = kind.info();
    let parameters = kind.parameters().iter().map(|row| {
        json!({
            "key": row.key, "symbol": row.symbol, "unit": row.unit.symbol(),
            "lower": number(row, row.lower), "upper": number(row, row.upper),
            "held": row.held.map(|value| number(row, value)),
            "default": row.default.map(|value| number(row, value)),
        })
    });
    json!({
        "name": info.name, "title": info.title, "equation": info.equation, "text": info.text,
        "signature": info.signature, "look_alikes": info.look_alikes,
        "is_a_table": kind == Kind::Table, "parameters": parameters.collect::<Vec<_>>(),
    })
}

/// A number of the table in the unit of files, to four digits.
fn number(row: &Parameter, value: f32) -> String {
    if value.is_infinite() {
        return if value > 0.0 { "∞" } else { "−∞" }.to_owned();
    }
    let value = row.unit.from_si(f64::from(value));
    let digits = if value == 0.0 {
        0
    } else {
        // Few enough for any table.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let digits = (3.0 - value.abs().log10().floor()).max(0.0) as usize;
        digits
    };
    trimmed(value, digits).replace('-', "−")
}

/// So many digits behind the point, without zeros at the end.
fn trimmed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.split_once('.') {
        Some(_) => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::{is_written, render};
    use softrig_tests::process::root;

    #[test]
    fn pages_say_what_the_code_says() {
        let figures = figures();
        let text = render(&figures).unwrap();
        for page in ["effects.md", "diagnosis.md", "diagnosis-details.md"] {
            assert!(
                is_written(&root().join("docs"), page, &text).unwrap(),
                "docs/{page} is out of date: cargo xtask bench catalogue --docs"
            );
        }
    }
}
