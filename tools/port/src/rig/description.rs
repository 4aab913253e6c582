//! Tables of a port as a plant: measured signals and commands, and no truth.

use std::path::Path;

use hil_config::port::{Carries, Port};
use shared_types::describe::{PlantDescription, PortPlant};
use shared_types::layout::SignalKind;
use shared_types::table::Field;

use super::simulated::simulated;

/// Ending of the name of a signal that has the age of another.
const AGE: &str = "_age_steps";

/// Describes a port, whose paths are relative to a folder, as a plant.
///
/// # Errors
/// If the port cannot be a plant: a command has no safe value, or a sample has a reference signal.
pub fn describe(port: &Port, folder: &Path) -> Result<PlantDescription, String> {
    if port.media.is_empty() {
        return Err("a port in front of a plant needs [[media]]".into());
    }
    let safe = port.safe_row()?;
    let sample = port.table(Carries::Sample);
    if sample.is_empty() {
        return Err("the port carries no sample, so nothing of the plant is measured".into());
    }
    if let Some(signal) = { sample.0.iter() }.find(|one| one.kind == SignalKind::Reference) {
        return Err(format!(
            "a plant does not send `reference.{}`; reference signals of a rig are [[stimuli]] of the scenario, omit the field",
            signal.field.name
        ));
    }
    let readings = sample.0.iter().map(|signal| Field {
        description: "Received on the wire.".into(),
        ..Field::signal(&signal.field.name, &signal.field.unit, "")
    });
    let ages = aged(port).map(|name| {
        let text = "Age of the received value.";
        Field::signal(&format!("{name}{AGE}"), "steps", text)
    });
    let commands = port.table(Carries::Command);
    let commands = commands.0.iter().zip(safe).map(|(signal, safe)| Field {
        description: "Sent on the wire.".into(),
        default: Some(safe),
        ..Field::signal(&signal.field.name, &signal.field.unit, "")
    });
    Ok(PlantDescription {
        name: port.name.clone(),
        summary: match port.description.as_str() {
            "" => "A plant behind a port.".into(),
            text => text.into(),
        },
        parameters: Vec::new(),
        truth: Vec::new(),
        measured: readings.chain(ages).collect(),
        commands: commands.collect(),
        faults: Vec::new(),
        saves: false,
        state: None,
        port: Some(PortPlant {
            simulated: simulated(port, folder),
        }),
    })
}

/// Lists the signals whose age is given to the controller: those that have a limit of it.
pub(super) fn aged(port: &Port) -> impl Iterator<Item = &str> {
    { port.frames.iter() }
        .filter(|one| one.carries == Carries::Sample && one.stale_s.is_some())
        .flat_map(|one| one.frame.signals())
        .map(|(signal, _)| signal.name.as_str())
}
