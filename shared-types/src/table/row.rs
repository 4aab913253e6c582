//! Row of a table as a field of a serialised type.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::Table;

/// Writes the row.
#[expect(clippy::missing_errors_doc, reason = "serde's contract")]
pub fn serialize<T: Table, S: Serializer>(table: &T, serializer: S) -> Result<S::Ok, S::Error> {
    table.row().serialize(serializer)
}

/// Reads the row.
#[expect(clippy::missing_errors_doc, reason = "serde's contract")]
pub fn deserialize<'de, T: Table, D: Deserializer<'de>>(d: D) -> Result<T, D::Error> {
    let row = Vec::<f64>::deserialize(d)?;
    if row.len() == T::LEN {
        Ok(T::from_row(&row))
    } else {
        Err(D::Error::invalid_length(
            row.len(),
            &"a number for each column",
        ))
    }
}
