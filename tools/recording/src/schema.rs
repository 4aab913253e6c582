//! Schemas of the messages of a recording.
//!
//! Used when a [recording](super) is created. Records are described in `ros2msg`, derived from the layout, and so are
//! events: the `ros2` profile of MCAP allows nothing else, and readers of ROS 2 files refuse other channels.
//! PlotJuggler refuses 64-bit integers that have no exact `f64`.

use std::fmt::Write as _;

use shared_types::layout::schema_name;
use shared_types::record::{GROUPS, RecordLayout, Timing};
use shared_types::table::Field;

/// Separator between the parts of a `ros2msg` schema.
pub(crate) const RULER: &str =
    "================================================================================";

/// CDR encapsulation header: little-endian, no options.
pub const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];
/// Topic of the records.
pub const RECORD_TOPIC: &str = "/record";
/// Message encoding of records and events.
pub const ENCODING: &str = "cdr";
/// Schema encoding of records and events.
pub const LANGUAGE: &str = "ros2msg";
/// Name of a record's schema.
pub const RECORD_NAME: &str = "hil_msgs/msg/Record";
/// Topic of the events.
pub const EVENT_TOPIC: &str = "/events";
/// Name of an event's schema.
pub const EVENT_NAME: &str = "hil_msgs/msg/Event";

/// Returns the name of a signal's column: its group, a dot, and its name in the schema.
#[must_use]
pub fn column_name(group: &str, signal: &str) -> String {
    format!("{group}.{}", schema_name(signal))
}

/// Returns the name of the column of a signal's full name, such as `sensor.lag_hz.angle_rad`.
#[must_use]
pub fn column_of(name: &str) -> String {
    name.split_once('.')
        .map_or_else(|| name.into(), |(group, signal)| column_name(group, signal))
}

/// Builds the schema of a record: a message of words with a nested message for each group of signals. An empty group
/// has no message, because an empty message takes a byte in CDR.
#[must_use]
pub fn record(layout: &RecordLayout) -> String {
    let (sample, command) = (
        layout.sample_validity_words(),
        layout.command_validity_words(),
    );
    of(sample, command, layout.groups())
}

/// Builds the schema for the given numbers of validity words of sample and command, and for these groups.
pub(super) fn of(
    sample_words: usize,
    command_words: usize,
    groups: [&[Field]; GROUPS.len()],
) -> String {
    let mut text = String::from("uint64 step\n");
    let mut nested = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "uint32[{}] sample_invalid", 2 * sample_words);
    let _ = writeln!(text, "uint32[{}] command_invalid", 2 * command_words);
    for (group, fields) in GROUPS.iter().zip(groups) {
        if fields.is_empty() {
            continue;
        }
        let (first, rest) = group.split_at(1);
        let message = format!("{}{rest}", first.to_uppercase());
        let _ = writeln!(text, "hil_msgs/{message} {group}");
        let _ = writeln!(nested, "{RULER}\nMSG: hil_msgs/{message}");
        for field in fields {
            let description = field.description.replace('\n', " ");
            let name = schema_name(&field.name);
            let _ = writeln!(nested, "float64 {name} # [{}] {description}", field.unit);
        }
    }
    for name in Timing::NAMES {
        let _ = match packed(name) {
            None => writeln!(text, "uint64 {name}"),
            Some(message) => writeln!(text, "hil_msgs/{message} {name}"),
        };
    }
    for (message, fields) in PACKED {
        let _ = writeln!(nested, "{RULER}\nMSG: hil_msgs/{message}\n{fields}");
    }
    text + &nested
}

/// Words that hold several numbers, or one that may exceed the exact range of an `f64`: messages of eight bytes,
/// lowest byte first.
const PACKED: [(&str, &str); 4] = [
    (
        "Answered",
        "uint32 last_steps # Steps before the sample that was answered last; 0 is never.
uint32 last_but_one_steps # And the one before that.",
    ),
    (
        "Directive",
        "uint32 busy_ns # How long the runner is busy before it answers.
uint32 late_steps # How much later its command takes effect; with 2^31 the sample was not seen.",
    ),
    (
        "Monotonic",
        "uint32 low # Nanoseconds: high 2^32 + low.
uint32 high",
    ),
    (
        "Surroundings",
        "uint8[3] page_faults # Of the thread so far, the lowest byte first.
uint8[3] context_switches
uint16 core",
    ),
];

/// Returns the message type of a packed word.
fn packed(name: &str) -> Option<&'static str> {
    match name {
        "published_ns" => Some("Monotonic"),
        "answered" => Some("Answered"),
        "plant_surroundings" | "controller_surroundings" => Some("Surroundings"),
        "directive" => Some("Directive"),
        _ => None,
    }
}

/// Builds the schema of an event: the complete event as JSON, and each scalar fact also as a field.
#[must_use]
pub fn event() -> String {
    let mut text = String::from("string json # All facts of the event, as JSON.\n");
    text += "# What the JSON has of these; 0, false or empty without it.\n";
    for (kind, name, description) in FACTS {
        let _ = writeln!(text, "{kind} {name} # {description}");
    }
    text
}

/// Facts of events that become fields: type, name and meaning.
pub(super) const FACTS: [(&str, &str, &str); 19] = [
    (
        "string",
        "event",
        "accepted: a live fault was accepted; fault: one took hold of a target; fault-ended: it let go; controller: it was lost, or another joined or was refused; change: values were changed, as the JSON lists; mark: a note of somebody who watched; end: the run ended",
    ),
    (
        "uint64",
        "step",
        "The next step, the first with the fault or the controller, the first without it.",
    ),
    ("uint64", "id", "Number of the fault event."),
    (
        "uint64",
        "effect",
        "Which effect of the fault event, from 0.",
    ),
    ("string", "kind", "Kind of the fault."),
    ("string", "target", "What the fault takes hold of."),
    (
        "string",
        "parameter",
        "Parameters or signal that the fault changes.",
    ),
    (
        "string",
        "canonical",
        "Everything that decides the course of the fault.",
    ),
    (
        "bool",
        "wall_only",
        "The fault costs time and changes nothing else.",
    ),
    ("bool", "cleared", "Somebody cleared the fault."),
    (
        "uint64",
        "epoch",
        "Which controller of the session, from 1.",
    ),
    (
        "string",
        "change",
        "What became of the controller: lost, joined, refused.",
    ),
    ("string", "law", "Law of the controller that joined."),
    (
        "string",
        "policy",
        "How the run goes on without a controller.",
    ),
    (
        "string",
        "reason",
        "Why the run ended or the controller went.",
    ),
    ("uint64", "steps", "Steps that were executed."),
    ("uint64", "rejected_frames", "Frames that failed a check."),
    (
        "string",
        "outcome",
        "How the run ended: completed, diverged, stopped, failed.",
    ),
    ("string", "text", "Note of somebody who watched."),
];

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
                "uint32[2] sample_invalid",
                "uint32[2] command_invalid",
                "hil_msgs/Truth truth",
                "hil_msgs/Command command",
                "hil_msgs/Applied applied",
            ]
        );
        assert!(nested.contains("MSG: hil_msgs/Truth\nfloat64 angle_rad # [rad] The angle.\n"));
        assert!(!text.contains("Internal"));
    }

    #[test]
    fn packed_words_are_messages_of_eight_bytes() {
        let layout = RecordLayout {
            command_signals: 1,
            ..RecordLayout::default()
        };
        let text = record(&layout);
        for name in [
            "published_ns",
            "answered",
            "plant_surroundings",
            "directive",
        ] {
            let message = packed(name).expect("packed");
            assert!(
                text.contains(&format!("\nhil_msgs/{message} {name}\n")),
                "{text}"
            );
            assert!(
                text.contains(&format!("{RULER}\nMSG: hil_msgs/{message}\n")),
                "{text}"
            );
        }
        assert_eq!(text.matches("MSG: hil_msgs/Surroundings\n").count(), 1);
    }
}
