//! What a recording says of the form of its messages.
//!
//! Used by the [recording](super) when it is created. Records are described in `ros2msg`, made from
//! the layout; events in JSON Schema. Both keep to what other programs take: PlotJuggler refuses a
//! file with a 64-bit integer that is no `f64`, Foxglove a schema with a property without a type.

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
            let told = field.description.replace('\n', " ");
            // Groups of parameters have a dot, which the names of this language may not.
            let name = field.name.replace('.', "_");
            let _ = writeln!(nested, "float64 {name} # [{}] {told}", field.unit);
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

/// Words that hold more than one number, or one that may be too large for an `f64`: messages of
/// eight bytes, the lowest first.
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

/// The message of a packed word.
fn packed(name: &str) -> Option<&'static str> {
    match name {
        "published_ns" => Some("Monotonic"),
        "answered" => Some("Answered"),
        "plant_surroundings" | "controller_surroundings" => Some("Surroundings"),
        "directive" => Some("Directive"),
        _ => None,
    }
}

/// Events are few and differ in form; the schema has what any of them may have.
pub(crate) const EVENT: &str = r#"{
  "$schema": "https://json-schema.org/draft/2020-12/schema",
  "title": "hil.Event",
  "type": "object",
  "properties": {
    "event": {
      "type": "string",
      "enum": ["accepted", "fault", "fault-ended", "controller", "end"],
      "description": "accepted: a live fault was accepted; fault: one took hold of a target; fault-ended: it let go; controller: it was lost, or another joined or was refused; end: the run ended"
    },
    "step": {"type": "integer", "minimum": 0, "description": "the next step, the first with the fault or the controller, the first without it"},
    "id": {"type": "integer", "minimum": 0, "description": "number of the fault event"},
    "effect": {"type": "integer", "minimum": 0, "description": "which effect of the fault event, from 0"},
    "kind": {"type": "string", "description": "kind of the fault"},
    "target": {"type": "string", "description": "what the fault takes hold of"},
    "parameter": {"type": "string", "description": "parameters or signal that the fault changes"},
    "canonical": {"type": "string", "description": "everything that decides the course of the fault"},
    "wall_only": {"type": "boolean", "description": "whether the fault costs time and changes nothing else"},
    "cleared": {"type": "boolean", "description": "whether somebody cleared the fault"},
    "fault": {"type": "object", "description": "the accepted fault event"},
    "epoch": {"type": "integer", "minimum": 1, "description": "which controller of the session"},
    "change": {"type": "string", "enum": ["lost", "joined", "refused"], "description": "what became of the controller"},
    "law": {"type": "string", "description": "law of the controller that joined"},
    "policy": {"type": "string", "description": "how the run goes on without a controller"},
    "reason": {"type": "string", "description": "why the run ended or the controller went"},
    "steps": {"type": "integer", "minimum": 0, "description": "steps that were executed"},
    "outcome": {"type": "string", "enum": ["completed", "diverged", "stopped", "failed"], "description": "in which way the run ended"},
    "rejected_frames": {"type": "integer", "minimum": 0, "description": "frames that failed a check"},
    "effects": {"type": "array", "items": {"type": "object"}, "description": "what became of each effect of each fault"},
    "overruns": {"type": "object", "description": "steps that were due too early"},
    "missed_commands": {"type": "object", "description": "steps whose command came too late"}
  },
  "required": ["event"]
}"#;

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use shared_types::record::Event;

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
    fn every_fact_of_every_event_is_in_the_schema_with_its_type() {
        let schema: Value = serde_json::from_str(EVENT).expect("JSON");
        let effect = json!({
            "id": 1, "effect": 0, "kind": "bias", "target": "x", "parameter": "x", "step": 3,
            "ended_step": null, "acted_steps": 1, "max_effect": 0.5, "unit": "m"
        });
        let events = [
            json!({"event": "accepted", "id": 1, "step": 2, "fault": {"kind": "bias"}}),
            json!({
                "event": "fault", "id": 1, "effect": 0, "step": 3, "kind": "bias", "target": "x",
                "parameter": "x", "canonical": "bias", "wall_only": true
            }),
            json!({"event": "fault-ended", "id": 1, "effect": 0, "step": 4, "cleared": true}),
            json!({
                "event": "controller", "epoch": 1, "step": 5, "change": "lost", "reason": "gone",
                "policy": "hold"
            }),
            json!({"event": "controller", "epoch": 2, "step": 6, "change": "joined", "law": "pid"}),
            json!({"event": "controller", "epoch": 3, "step": 7, "change": "refused", "reason": "late"}),
            json!({
                "event": "end", "steps": 9, "outcome": "failed", "reason": "gone",
                "rejected_frames": 0, "effects": [effect], "overruns": {"count": 0, "longest": 0,
                "first_step": null}, "missed_commands": {"count": 0, "longest": 0, "first_step": null}
            }),
            json!({
                "event": "end", "steps": 9, "outcome": "completed", "rejected_frames": 0,
                "effects": []
            }),
        ];
        for event in events {
            let event: Event = serde_json::from_value(event).expect("an event");
            // As it is recorded, with every fact that it has.
            let recorded = serde_json::to_value(&event).expect("JSON");
            for (name, value) in recorded.as_object().expect("an object") {
                let property = &schema["properties"][name];
                let is_of = |kind: &str| property["type"] == kind;
                let fits = match value {
                    Value::String(_) => is_of("string"),
                    Value::Bool(_) => is_of("boolean"),
                    Value::Object(_) => is_of("object"),
                    Value::Array(_) => is_of("array") && property["items"]["type"] == "object",
                    number => is_of("integer") && number.is_u64(),
                };
                assert!(fits, "{name}: {value} and {property}");
                let choice = property["enum"].as_array();
                assert!(
                    choice.is_none_or(|choice| choice.contains(value)),
                    "{value}"
                );
            }
        }
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
