//! Numbers and structures that cross between Rust and Python.

use std::str::FromStr;

use numpy::{AllowTypeChange, IntoPyArray, PyArray1, PyArrayLike1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;
use softrig_formats::error::InputError as Fault;
use strum::VariantArray;

use crate::fault::raised;

/// An array of numbers that Python owns.
pub type Array<'py> = Bound<'py, PyArray1<f64>>;

/// Hands an array over.
pub fn array<'py>(py: Python<'py>, values: &[f64]) -> Array<'py> {
    values.to_vec().into_pyarray(py)
}

/// Reads a column of numbers: an array, a series, or a list.
///
/// What has another meaning as a number than one expects is refused: a date would become
/// nanoseconds, and the values behind a mask would become measurements.
pub fn numbers(py: Python<'_>, name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let refuse = |found: String, advice: &str| {
        Err(raised(
            py,
            &Fault::new(format!("{name} {found}"), advice.to_owned()),
        ))
    };
    let numpy = py.import("numpy")?;
    if given.is_instance(&numpy.getattr("ma")?.getattr("MaskedArray")?)? {
        return refuse(
            "is a masked array".into(),
            "leave the masked samples out, for instance with .compressed() on all three arrays",
        );
    }
    let plain = numpy.call_method1("asarray", (given,))?;
    let kind: String = plain.getattr("dtype")?.getattr("kind")?.extract()?;
    if !["i", "u", "f", "O"].contains(&kind.as_str()) {
        let dtype = plain.getattr("dtype")?.str()?;
        let advice = match kind.as_str() {
            "M" | "m" => "give seconds as numbers, such as (t - t[0]) / numpy.timedelta64(1, 's')",
            _ => "give numbers, one a sample",
        };
        return refuse(format!("holds {dtype}"), advice);
    }
    let dimensions: usize = plain.getattr("ndim")?.extract()?;
    if dimensions != 1 {
        return refuse(
            format!("has {dimensions} dimensions"),
            "give one number a sample",
        );
    }
    match plain.extract::<PyArrayLike1<'_, f64, AllowTypeChange>>() {
        Ok(array) => Ok(array.as_array().to_vec()),
        Err(error) => refuse(
            format!("holds something else than numbers: {error}"),
            "give numbers, one a sample",
        ),
    }
}

/// One of several words.
pub fn choice<T>(py: Python<'_>, name: &str, word: &str) -> PyResult<T>
where
    T: FromStr + VariantArray + Into<&'static str> + Copy,
{
    word.parse().map_err(|_| {
        let known: Vec<&str> = T::VARIANTS.iter().map(|&choice| choice.into()).collect();
        raised(
            py,
            &Fault::new(
                format!("{name} is {word:?}"),
                format!("use one of: {}", known.join(", ")),
            ),
        )
    })
}

/// A dictionary, or whatever else a value is, by way of Python's own reader of JSON.
pub fn from_json<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?
        .call_method1("loads", (value.to_string(),))
}

/// The opposite of [`from_json`].
pub fn to_json(py: Python<'_>, name: &str, given: &Bound<'_, PyAny>) -> PyResult<Value> {
    let refuse = |problem: String| {
        raised(
            py,
            &Fault::new(
                format!("{name} cannot be read: {problem}"),
                "give a dictionary of texts, numbers and lists",
            ),
        )
    };
    let text: String = py
        .import("json")?
        .call_method1("dumps", (given,))
        .map_err(|error| refuse(error.to_string()))?
        .extract()?;
    serde_json::from_str(&text).map_err(|error| refuse(error.to_string()))
}

/// A structure as an object with attributes, after its JSON Schema. A list that the value
/// lacks is empty, and anything else that it lacks is None. What has no fixed keys is a
/// dictionary.
pub fn object<'py>(
    py: Python<'py>,
    value: &Value,
    schema: &Value,
    definitions: &Value,
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(reference) = schema.get("$ref").and_then(Value::as_str) {
        let name = reference.rsplit('/').next().unwrap_or_default();
        return object(py, value, &definitions[name], definitions);
    }
    // An optional structure is any of itself and null.
    if let Some(either) = schema.get("anyOf").and_then(Value::as_array)
        && let Some(inner) = either.first()
        && !value.is_null()
    {
        return object(py, value, inner, definitions);
    }
    match (value, schema.get("properties"), schema.get("items")) {
        (Value::Object(map), Some(Value::Object(properties)), _) => {
            let attributes = PyDict::new(py);
            for (key, schema) in properties {
                let nothing = match schema["type"].as_str() {
                    Some("array") => Value::Array(Vec::new()),
                    _ => Value::Null,
                };
                let value = map.get(key).unwrap_or(&nothing);
                // A keyword of Python is no name of an attribute.
                let name = if key == "where" { "places" } else { key };
                attributes.set_item(name, object(py, value, schema, definitions)?)?;
            }
            py.import("types")?
                .getattr("SimpleNamespace")?
                .call((), Some(&attributes))
        }
        (Value::Array(list), _, Some(items)) => {
            let list = list
                .iter()
                .map(|value| object(py, value, items, definitions))
                .collect::<PyResult<Vec<_>>>()?;
            Ok(PyList::new(py, list)?.into_any())
        }
        _ => from_json(py, value),
    }
}
