//! Whether JSON is what its schema says.

use serde_json::Value;

/// Every key of a value is one of its schema, and every key that the schema requires is there.
pub fn follows(schema: &Value, root: &Value, value: &Value, place: &str) {
    let refers = |schema: &'_ Value| match schema["$ref"].as_str() {
        Some(path) => root.pointer(path.trim_start_matches('#')).unwrap().clone(),
        None => schema.clone(),
    };
    let schema = &refers(schema);
    if let Some(kinds) = schema["oneOf"].as_array().filter(|_| value.is_object()) {
        // The kind whose constants are those of the value, and which requires no key that it lacks.
        let is_it = |kind: &&Value| {
            let kind = refers(kind);
            let mut properties = kind["properties"].as_object().into_iter().flatten();
            let mut required = kind["required"].as_array().into_iter().flatten();
            properties.all(|(key, of)| of.get("const").is_none_or(|it| *it == value[key]))
                && required.all(|key| value.get(key.as_str().unwrap()).is_some())
        };
        let kind = kinds.iter().find(is_it);
        let kind = kind.unwrap_or_else(|| panic!("{place}: {value} is of no kind"));
        return follows(kind, root, value, place);
    }
    if let (Some(fields), Some(properties)) = (value.as_object(), schema["properties"].as_object())
    {
        for (key, value) in fields {
            let of = properties.get(key);
            let of = of.unwrap_or_else(|| panic!("{place} has {key}, its schema has not"));
            follows(of, root, value, &format!("{place}.{key}"));
        }
        for key in schema["required"].as_array().into_iter().flatten() {
            assert!(fields.contains_key(key.as_str().unwrap()), "{place}: {key}");
        }
    }
    for value in value.as_array().into_iter().flatten() {
        follows(&schema["items"], root, value, place);
    }
}
