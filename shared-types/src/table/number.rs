//! Numbers in JSON, where `inf`, `-inf` and `nan` are written as text.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Number {
    Finite(f64),
    Text(String),
}

fn wrap(value: f64) -> Number {
    if value.is_finite() {
        Number::Finite(value)
    } else {
        Number::Text(value.to_string())
    }
}

fn unwrap<E: Error>(number: Number) -> Result<f64, E> {
    match number {
        Number::Finite(value) => Ok(value),
        Number::Text(text) => text.parse().map_err(E::custom),
    }
}

/// Writes a number.
#[expect(clippy::missing_errors_doc, reason = "serde's contract")]
pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    wrap(*value).serialize(serializer)
}

/// Reads a number.
#[expect(clippy::missing_errors_doc, reason = "serde's contract")]
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    unwrap(Number::deserialize(deserializer)?)
}

/// Optional numbers in the same form.
pub mod option {
    use super::{Deserialize, Deserializer, Number, Serialize, Serializer, unwrap, wrap};

    /// Writes a number or null.
    #[expect(clippy::missing_errors_doc, reason = "serde's contract")]
    pub fn serialize<S: Serializer>(value: &Option<f64>, s: S) -> Result<S::Ok, S::Error> {
        value.map(wrap).serialize(s)
    }

    /// Reads a number or null.
    #[expect(clippy::missing_errors_doc, reason = "serde's contract")]
    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Option<f64>, D::Error> {
        Option::<Number>::deserialize(d)?.map(unwrap).transpose()
    }
}

/// Lists of numbers in the same form.
pub mod list {
    use super::{Deserialize, Deserializer, Number, Serialize, Serializer, unwrap, wrap};

    /// Writes numbers.
    #[expect(clippy::missing_errors_doc, reason = "serde's contract")]
    pub fn serialize<S: Serializer>(values: &[f64], s: S) -> Result<S::Ok, S::Error> {
        let numbers: Vec<Number> = values.iter().map(|v| wrap(*v)).collect();
        numbers.serialize(s)
    }

    /// Reads numbers.
    #[expect(clippy::missing_errors_doc, reason = "serde's contract")]
    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Vec<f64>, D::Error> {
        Vec::<Number>::deserialize(d)?
            .into_iter()
            .map(unwrap)
            .collect()
    }
}
