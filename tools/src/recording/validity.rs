//! Which bits of a recording tell the validity of which signal.
//!
//! Used by whoever judges or exports recorded rows. Live records have a layout, which tells the same
//! ([`RecordLayout::validity`](shared_types::record::RecordLayout::validity)).

use hil_config::plan::Plan;
use shared_types::describe::{Description, LawDescription, PlantDescription};
use shared_types::record::Validity;

use crate::recording::reader::RunReader;

/// The commands of a command frame, in order, as a recording names them: those of the law, of which the
/// plant may take only some and in another order.
pub(crate) fn sent_commands(plant: &PlantDescription, law: &LawDescription) -> Vec<String> {
    let name = |name: &str| format!("command.{}", name.replace('.', "_"));
    let sent = law.sent_commands(plant).iter();
    sent.map(|field| name(&field.name)).collect()
}

/// The word from which the bit of a recorded signal is counted, and the bit; `None` of a signal that is
/// never marked. `sent` are the commands of a command frame.
pub(crate) fn place(reader: &RunReader, sent: &[String], name: &str) -> Option<(usize, usize)> {
    let recorded = reader.columns();
    let number_in = |groups: &[&str]| {
        let is_of = |name: &str| groups.iter().any(|group| name.starts_with(group));
        let names = recorded.iter().map(|column| column.name.as_str());
        let mut of_groups = names.filter(|name| is_of(name));
        is_of(name).then(|| of_groups.position(|one| one == name))?
    };
    // An excerpt numbers the bits of what it keeps.
    let is_kept = |name: &&String| {
        !reader.is_excerpt() || recorded.iter().any(|column| column.name == **name)
    };
    let (word, bit) = if let Some(number) = number_in(&["measured.", "reference."]) {
        ("sample_invalid[0]", number)
    } else if let Some(number) = number_in(&["internal."]) {
        let commands = sent.iter().filter(is_kept).count();
        ("command_invalid[0]", commands + number)
    } else {
        let mut commands = sent.iter().filter(is_kept);
        let number = commands.position(|command| command == name)?;
        ("command_invalid[0]", number)
    };
    let word = recorded.iter().position(|column| column.name == word)?;
    Some((word, bit))
}

/// Where the validity of the signals of a recording is told, counted from the first signal.
pub(crate) fn of(reader: &RunReader, plan: &Plan) -> Validity {
    let sent = || {
        let plant: Description = reader.enclosed("plant-description.json").ok()?;
        let controller: Description = reader.enclosed("controller-description.json").ok()?;
        let plant = plan.plant_among(&plant.plants)?;
        let law = plan.law_among(&controller.laws)?;
        Some(sent_commands(plant, law))
    };
    let sent = sent();
    let columns = reader.columns();
    let signals = || columns.iter().filter(|column| column.is_signal());
    Validity::new((0..).zip(signals()).filter_map(|(number, column)| {
        let is_sent = column.name.starts_with("command.") || column.name.starts_with("internal.");
        let sent = match &sent {
            // Without it their bits are not known.
            None if is_sent => return None,
            sent => sent.as_deref().unwrap_or_default(),
        };
        let (word, bit) = place(reader, sent, &column.name)?;
        Some((word, bit, number))
    }))
}
