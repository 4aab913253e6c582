//! What a recording says of the form of its messages.
//!
//! Used by the [recording](super) when it is created. Records are described in `ros2msg`, made from
//! the layout; events in JSON Schema.

use std::fmt::Write as _;

use shared_types::record::{GROUPS, RecordLayout, Timing};
use shared_types::table::Field;

/// Line between the parts of a `ros2msg` schema.
pub(crate) const RULER: &str =
    "================================================================================";

/// CDR, little-endian, no options.
pub(crate) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Topic of the records.
pub(crate) const RECORD_TOPIC: &str = "/record";
/// How a record is written.
pub(crate) const RECORD_ENCODING: &str = "cdr";
/// Name of a record's schema.
pub(crate) const RECORD_NAME: &str = "hil_msgs/msg/Record";
/// In what it is written.
pub(crate) const RECORD_LANGUAGE: &str = "ros2msg";
/// Topic of the events.
pub(crate) const EVENT_TOPIC: &str = "/events";
/// How an event is written.
pub(crate) const EVENT_ENCODING: &str = "json";
/// Name of an event's schema.
pub(crate) const EVENT_NAME: &str = "hil.Event";
/// In what it is written.
pub(crate) const EVENT_LANGUAGE: &str = "jsonschema";

/// The schema of a record: a message of words with one nested message for each group of signals.
/// An empty group has no message, because an empty message takes a byte in CDR.
pub(crate) fn record(layout: &RecordLayout) -> String {
    let (sample, command) = (
        layout.sample_validity_words(),
        layout.command_validity_words(),
    );
    of(sample, command, layout.groups())
}

/// The same of so many words of validity bits of sample and command, and of these groups.
pub(super) fn of(
    sample_words: usize,
    command_words: usize,
    groups: [&[Field]; GROUPS.len()],
) -> String {
    let mut text = String::from("uint64 step\n");
    let mut nested = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "uint64[{sample_words}] sample_invalid");
    let _ = writeln!(text, "uint64[{command_words}] command_invalid");
    for (group, fields) in GROUPS.iter().zip(groups) {
        if fields.is_empty() {
            continue;
        }
        let (first, rest) = group.split_at(1);
        let message = format!("{}{rest}", first.to_uppercase());
        let _ = writeln!(text, "hil_msgs/{message} {group}");
        let _ = writeln!(nested, "{RULER}\nMSG: hil_msgs/{message}");
        for field in fields {
            let told = field.description.replace('\n', " ");
            // Groups of parameters have a dot, which the names of this language may not.
            let name = field.name.replace('.', "_");
            let _ = writeln!(nested, "float64 {name} # [{}] {told}", field.unit);
        }
    }
    for name in Timing::NAMES {
        let _ = writeln!(text, "uint64 {name}");
    }
    text + &nested
}

/// Events are few and differ in form; the schema says what all have.
pub(crate) const EVENT: &str = r#"{
  "$schema": "https://json-schema.org/draft/2020-12/schema",
  "title": "hil.Event",
  "type": "object",
  "properties": {
    "event": {
      "enum": ["accepted", "fault", "fault-ended", "end"],
      "description": "accepted: a live fault was accepted; fault: one took hold of a target; fault-ended: it let go; end: the run ended"
    },
    "step": {"type": "integer", "description": "the next step, the first with the fault, the first without it"}
  },
  "required": ["event"]
}"#;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schema_has_a_message_for_each_group_that_has_signals() {
        let angle = Field::signal("angle_rad", "rad", "The angle.");
        let layout = RecordLayout {
            truth: vec![angle.clone()],
            command: vec![angle],
            command_signals: 1,
            ..RecordLayout::default()
        };
        let text = record(&layout);
        let (head, nested) = text.split_once(RULER).expect("nested messages");
        let fields: Vec<&str> = head.lines().take(6).collect();
        assert_eq!(
            fields,
            [
                "uint64 step",
                "uint64[1] sample_invalid",
                "uint64[1] command_invalid",
                "hil_msgs/Truth truth",
                "hil_msgs/Command command",
                "hil_msgs/Applied applied",
            ]
        );
        assert!(nested.contains("MSG: hil_msgs/Truth\nfloat64 angle_rad # [rad] The angle.\n"));
        assert!(!text.contains("Internal"));
    }
}
