//! Instruments as `[[sensors]]` and `[[actuators]]`, with every value in the unit of its signal.

use std::fmt::Write;

use super::{Written, inline, key, list, section, string};
use crate::keys::Key;
use crate::plan::Instrument;
use crate::quantity::toml_float;

pub(super) fn instrument(
    text: &mut String,
    instrument: &Instrument,
    table: &str,
    keys: &[Key],
) -> Written {
    writeln!(text, "\n[[{table}]]")?;
    section(text, keys, |name| match name {
        "signal" => Some(string(&instrument.signal)),
        "range" => (instrument.range()).map(|(min, max)| list(&[min, max])),
        "bits" | "phase_steps" => instrument.get(name).map(|value| value.to_string()),
        name => instrument.get(name).map(toml_float),
    })?;
    if !instrument.cross.is_empty() {
        let shares = instrument.cross.iter();
        let shares = shares.map(|(name, share)| format!("{} = {}", key(name), toml_float(*share)));
        writeln!(text, "cross = {}", inline(shares))?;
    }
    Ok(())
}
