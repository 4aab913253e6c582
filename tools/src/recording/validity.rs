//! Which bits of a recording tell the validity of which signal.
//!
//! Used by whoever judges or exports recorded rows. Live records have a layout, which tells the same
//! ([`RecordLayout::validity`](shared_types::record::RecordLayout::validity)).

use crate::recording::reader::RunReader;

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
