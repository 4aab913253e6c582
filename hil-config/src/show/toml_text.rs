//! Values and keys as TOML text.

use serde_json::Value;

use crate::quantity::toml_float;

pub(super) fn toml_value(value: &Value) -> String {
    match value {
        Value::Array(values) => array(values.iter().map(toml_value)),
        Value::String(text) => string(text),
        Value::Bool(value) => value.to_string(),
        Value::Number(value) if value.is_u64() => value.to_string(),
        value => toml_float(value.as_f64().unwrap_or(f64::NAN)),
    }
}

/// Formats an inline table.
pub(super) fn inline(entries: impl IntoIterator<Item = String>) -> String {
    let entries: Vec<String> = entries.into_iter().collect();
    format!("{{ {} }}", entries.join(", "))
}

/// Formats a list of TOML values.
pub(super) fn array(values: impl Iterator<Item = String>) -> String {
    format!("[{}]", values.collect::<Vec<_>>().join(", "))
}

pub(super) fn list(values: &[f64]) -> String {
    array(values.iter().map(|value| toml_float(*value)))
}

pub(super) fn strings(texts: &[String]) -> String {
    array(texts.iter().map(|text| string(text)))
}

/// Formats a TOML string.
pub(super) fn string(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Formats a TOML key, quoted if necessary.
pub(super) fn key(name: &str) -> String {
    let bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    if !name.is_empty() && name.chars().all(bare) {
        name.into()
    } else {
        string(name)
    }
}

/// Formats a dotted name of several keys.
pub(super) fn dotted(name: &str) -> String {
    let keys: Vec<String> = name.split('.').map(key).collect();
    keys.join(".")
}

/// Formats the text of a `#` comment: one line, no control characters.
pub(super) fn comment(text: &str) -> String {
    text.split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace(char::is_control, "")
}
