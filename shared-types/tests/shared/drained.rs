//! Layout and draining shared by the tests of both record streams, in memory and in shared memory.

use shared_types::record::RecordLayout;
use shared_types::stream::{Item, RecordSource};
use shared_types::table::Field;

pub(crate) fn layout() -> RecordLayout {
    let field = Field::signal("angle_rad", "rad", "x");
    RecordLayout {
        truth: vec![field.clone()],
        measured: vec![field],
        command_signals: 1,
        ..RecordLayout::default()
    }
}

/// Drains a source into text.
pub(crate) fn drained(source: &mut dyn RecordSource) -> Vec<String> {
    let mut items = Vec::new();
    loop {
        let count = source.drain(&mut |item| {
            items.push(match item {
                Item::Record(words) => format!("record {}", words[0]),
                other => format!("{other:?}"),
            });
        });
        if count.expect("drains") == 0 {
            return items;
        }
    }
}
