//! Safe values of a port, its keeper and its watchdog, in the words of `hil describe`.

use std::fmt::Write;

use hil_config::port::{Carries, Port};
use hil_console::terminal::table::{Table, left};
use serde_json::{Value, json};
use shared_types::number::{counted, exact, exact_in};

use super::super::Written;

/// Commands of a port, each with its unit and safe value, if there is one.
fn commands(port: &Port) -> Vec<(String, String, Option<f64>)> {
    let table = port.table(Carries::Command);
    let value_of = |name: &str| {
        let mut safe = port.frames.iter().flat_map(|frame| &frame.safe);
        safe.find(|safe| safe.signal.name == name)
            .map(|safe| safe.value)
    };
    { table.0.iter() }
        .map(|signal| {
            let name = format!("{}.{}", signal.kind.prefix(), signal.field.name);
            (
                name,
                signal.field.unit.clone(),
                value_of(&signal.field.name),
            )
        })
        .collect()
}

/// Writes the safe values; nothing for a port that is no wire.
pub(super) fn write(text: &mut String, port: &Port) -> Written {
    let commands = commands(port);
    if port.media.is_empty() || commands.is_empty() {
        return Ok(());
    }
    let lacking: Vec<&str> = { commands.iter() }
        .filter(|(_, _, value)| value.is_none())
        .map(|(name, _, _)| &**name)
        .collect();
    if lacking.len() == commands.len() {
        writeln!(
            text,
            "\nsafe values: none, so that the port can be a controller only"
        )?;
        return Ok(());
    }
    let safety = &port.safety;
    writeln!(
        text,
        "\nsafe values: sent {}, {} apart, by the keeper when the port ends",
        counted(safety.repeats.into(), "time"),
        exact_in(safety.period_s, "s")
    )?;
    let mut table = Table::new(2, [left(0), left(0)]);
    for (name, unit, value) in &commands {
        if let Some(value) = value {
            table.row(&[name, &format!("{} {unit}", exact(*value))]);
        }
    }
    write!(text, "{table}")?;
    if !lacking.is_empty() {
        let names = lacking.join(", ");
        writeln!(
            text,
            "  none for {names}, so that the port can be a controller only"
        )?;
    }
    match &safety.watchdog {
        Some(device) => writeln!(
            text,
            "watchdog: {device}, fed by the keeper and disarmed at an orderly end only"
        ),
        None => writeln!(text, "watchdog: none"),
    }?;
    Ok(())
}

/// Returns the safe values as JSON.
pub(super) fn json(port: &Port) -> Value {
    let values = commands(port)
        .into_iter()
        .map(|(signal, unit, value)| json!({"signal": signal, "unit": unit, "value": value}));
    json!({
        "values": values.collect::<Vec<_>>(),
        "repeats": port.safety.repeats,
        "period_s": port.safety.period_s,
        "watchdog": port.safety.watchdog,
    })
}
