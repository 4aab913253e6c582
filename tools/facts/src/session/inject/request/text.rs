//! Parts of the request's text: keys of the event, numbers, lists, profiles.

use std::path::Path;

use hil_config::table_file;
use hil_console::terminal::duration::in_unit;
use shared_types::describe::ListDescription;
use shared_types::live::Refusal;
use shared_types::number::unit_shown;
use shared_types::table::Field;

use crate::arguments::inject::InjectArguments;
use crate::session::live::refusal;
use crate::tables::FORMATS;

/// Formats the event's own keys.
pub(super) fn head(kind: &str, arguments: &InjectArguments) -> String {
    let seconds = |key: &str, value: Option<f64>| Some(format!("{key} = {}\n", float(value?)));
    let text = |key: &str, value: Option<&String>| Some(format!("{key} = {}\n", string(value?)));
    let count = |key: &str, value: Option<u64>| Some(format!("{key} = {}\n", value?));
    let after = arguments
        .after
        .as_ref()
        .map(|after| match after.parse::<u32>() {
            Ok(id) => format!("after = {id}\n"),
            Err(_) => format!("after = {}\n", string(after)),
        });
    let lines = [
        text("name", arguments.name.as_ref()),
        Some(format!("kind = {}\n", string(kind))),
        seconds("at_s", arguments.at),
        count("at_step", arguments.at_step),
        text("when", arguments.when.as_ref()),
        seconds("for_s", arguments.hold),
        after,
        seconds("delay_s", arguments.delay),
        seconds("duration_s", arguments.duration),
        seconds("end_s", arguments.end),
        text("until", arguments.until.as_ref()),
        seconds("until_for_s", arguments.until_for),
        count("occurrences", arguments.occurrences),
    ];
    "[[faults]]\n".to_owned() + &lines.into_iter().flatten().collect::<String>()
}

/// Parses values separated by commas to TOML.
pub(super) fn values(field: &Field, text: &str) -> Result<Vec<String>, Refusal> {
    text.split(',')
        .map(|value| number(&field.name, value, &field.unit))
        .collect()
}

/// Parses rows separated by commas, with colons between the numbers of a row, to TOML.
pub(super) fn rows(list: &ListDescription, text: &str) -> Result<String, Refusal> {
    let mut rows = Vec::new();
    for row in text.split(',') {
        let numbers = row.split(':').map(|value| number(&list.key, value, ""));
        let numbers = numbers.collect::<Result<Vec<_>, _>>()?;
        if numbers.len() != list.columns {
            let row_of = vec!["NUMBER"; list.columns].join(":");
            let message = format!("`{row}` is not a row of `{}`", list.key);
            let expected = format!("{row_of},{row_of},..: {}", list.description);
            return Err(refusal(&list.key, message, expected));
        }
        rows.push(if list.columns == 1 {
            numbers.concat()
        } else {
            format!("[{}]", numbers.join(", "))
        });
    }
    Ok(format!("[{}]", rows.join(", ")))
}

/// Parses a number to TOML.
fn number(key: &str, text: &str, unit: &str) -> Result<String, Refusal> {
    in_unit(text, unit).map(float).ok_or_else(|| {
        let expected = match unit_shown(unit) {
            "" => "a number".to_owned(),
            "target" => "a number in the unit of the target".into(),
            _ => format!("a number in {unit}"),
        };
        refusal(
            key,
            format!("`{text}` is not a number for `{key}`"),
            expected,
        )
    })
}

/// Formats the requested profile as TOML.
pub(super) fn profile(arguments: &InjectArguments) -> Result<Option<String>, Refusal> {
    let body = if let Some(duration_s) = arguments.ramp {
        format!("kind = \"ramp\", duration_s = {}", float(duration_s))
    } else if let Some(speed_per_s) = arguments.exponential {
        format!(
            "kind = \"exponential\", speed_per_s = {}",
            float(speed_per_s)
        )
    } else if let Some(duration_s) = arguments.pulse {
        format!("kind = \"pulse\", duration_s = {}", float(duration_s))
    } else if let Some((period_s, duty)) = arguments.intermittent {
        let (period_s, duty) = (float(period_s), float(duty));
        format!("kind = \"intermittent\", period_s = {period_s}, duty = {duty}")
    } else if let Some((frequency_hz, phase_rad)) = arguments.sine {
        let (frequency_hz, phase_rad) = (float(frequency_hz), float(phase_rad));
        format!("kind = \"sine\", frequency_hz = {frequency_hz}, phase_rad = {phase_rad}")
    } else if let Some(file) = &arguments.table {
        let (time_s, values) = points(file)?;
        let (time_s, values) = (floats(&time_s), floats(&values));
        format!("kind = \"table\", time_s = {time_s}, values = {values}")
    } else {
        return Ok(None);
    };
    Ok(Some(format!("{{ {body} }}")))
}

/// Reads the points of a file here, because the plant may run on another machine.
fn points(file: &Path) -> Result<(Vec<f64>, Vec<f64>), Refusal> {
    table_file::points(file, FORMATS).map_err(|bad| {
        let line = bad
            .line
            .map(|(number, text)| format!("line {number} `{text}`: "));
        let message = format!(
            "{}: {}{}",
            file.display(),
            line.unwrap_or_default(),
            bad.message
        );
        refusal("table", message, bad.expected)
    })
}

/// Formats a number as TOML.
pub(super) fn float(value: f64) -> String {
    if value.is_nan() {
        "nan".into() // Rust writes NaN
    } else {
        format!("{value:?}")
    }
}

fn floats(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(|value| float(*value)).collect();
    format!("[{}]", values.join(", "))
}

/// Formats a TOML string: JSON's format is valid, except for the last control character.
pub(super) fn string(text: &str) -> String {
    let json = serde_json::Value::from(text).to_string();
    json.replace('\u{7f}', "\\u007f")
}
