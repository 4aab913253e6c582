//! Settings of an FMU.

use std::fmt::Write;

use shared_types::describe::ModelSettings;

use super::{Written, key, string, toml_float};

/// Returns the value of a numeric key, if given.
pub(super) fn number(settings: &ModelSettings, key: &str) -> Option<String> {
    let value = match key {
        "tolerance" => settings.tolerance,
        "start_time_s" => settings.start_time_s,
        _ => settings.stop_time_s,
    };
    value.map(toml_float)
}

/// Writes the tables of a side.
pub(super) fn tables(text: &mut String, side: &str, settings: &ModelSettings) -> Written {
    let ModelSettings {
        initial,
        texts,
        files,
        structural,
        ..
    } = settings;
    let named = |name: &String, value: String| (name.clone(), value);
    let strings = |(name, value): (&String, &String)| named(name, string(value));
    let tables: [(&str, Vec<(String, String)>); 4] = [
        (
            "initial",
            (initial.iter())
                .map(|(name, value)| named(name, toml_float(*value)))
                .collect(),
        ),
        ("texts", texts.iter().map(strings).collect()),
        ("files", files.iter().map(strings).collect()),
        (
            "structural",
            (structural.iter())
                .map(|(name, value)| named(name, value.to_string()))
                .collect(),
        ),
    ];
    for (table, values) in tables.iter().filter(|(_, values)| !values.is_empty()) {
        writeln!(text, "\n[{side}.{table}]")?;
        for (name, value) in values {
            writeln!(text, "{} = {value}", key(name))?;
        }
    }
    Ok(())
}
