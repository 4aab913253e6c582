//! Tables of a port as a plant: measured signals and commands, and no truth.

use hil_codec::pack::Packer;
use hil_config::port::{Carries, Port};
use shared_types::describe::{PlantDescription, PortPlant};
use shared_types::layout::SignalKind;
use shared_types::table::Field;

use crate::media::simulated;

/// Ending of the name of a signal that has the age of another.
const AGE: &str = "_age_steps";

/// Describes a port as a plant.
///
/// # Errors
/// If a command has no safe value, or a sample has a reference signal.
pub fn describe(port: &Port) -> Result<PlantDescription, String> {
    if port.media.is_empty() {
        return Err("a port in front of a plant needs [[media]]".into());
    }
    let safe = port.safe_row()?;
    let sample = port.table(Carries::Sample);
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
    let simulated = simulated(port);
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
        port: Some(PortPlant { simulated }),
    })
}

/// Lists the signals whose age is given to the controller: those that have a limit of it.
pub(crate) fn aged(port: &Port) -> impl Iterator<Item = &str> {
    (port.frames.iter())
        .filter(|one| one.carries == Carries::Sample && one.stale_s.is_some())
        .flat_map(|one| one.frame.signals())
        .map(|(signal, _)| signal.name.as_str())
}

/// Binds the frames that are sent, in the order of the port file.
pub(crate) fn packers(port: &Port) -> Result<Vec<(Packer, usize)>, String> {
    let commands = port.table(Carries::Command);
    let frames = { port.frames.iter() }.filter(|one| one.carries == Carries::Command);
    let bound = frames.map(|one| {
        let packer = Packer::new(&one.frame, &commands).map_err(|error| error.to_string())?;
        Ok((packer, one.medium.unwrap_or_default()))
    });
    bound.collect()
}
