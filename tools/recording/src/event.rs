//! Encoding of events as messages: CDR by the schema of [`schema::event`], or JSON in files of earlier versions.
//!
//! Used by the [recording](super), by the live stream and by readers. Readers use only the JSON part, which comes first
//! so that fields can be added after it.

use shared_types::record::Event;

use super::schema::{self, ENCAPSULATION};

/// Encoding of events in earlier versions.
const EARLIER: &str = "json";

/// Encodes an event as a message.
///
/// # Errors
/// If the event cannot be serialised.
pub fn message(event: &Event) -> serde_json::Result<Vec<u8>> {
    let facts = serde_json::to_value(event)?;
    let mut message = ENCAPSULATION.to_vec();
    text(&mut message, &serde_json::to_string(event)?);
    for (kind, name, _) in schema::FACTS {
        let fact = &facts[name];
        match kind {
            "string" => text(&mut message, fact.as_str().unwrap_or_default()),
            "bool" => message.push(fact.as_bool().unwrap_or_default().into()),
            _ => number(&mut message, fact.as_u64().unwrap_or_default()),
        }
    }
    Ok(message)
}

/// Decodes an event from a message with this encoding.
///
/// # Errors
/// If the message is invalid; the text states the reason.
pub(crate) fn read(encoding: &str, message: &[u8]) -> Result<Event, String> {
    let json = if encoding == EARLIER {
        Some(message)
    } else {
        first_text(message)
    };
    let json = json.ok_or("the text of an event exceeds its message")?;
    serde_json::from_slice(json).map_err(|error| error.to_string())
}

/// Returns the text at the beginning of a message, without its terminating zero.
fn first_text(message: &[u8]) -> Option<&[u8]> {
    let (length, rest) = (message.get(ENCAPSULATION.len()..)?).split_first_chunk()?;
    let length = usize::try_from(u32::from_le_bytes(*length)).ok()?;
    rest.get(..length.checked_sub(1)?)
}

/// Pads the message to a multiple of `to` bytes after the encapsulation.
fn align(message: &mut Vec<u8>, to: usize) {
    let length = message.len() - ENCAPSULATION.len();
    message.resize(ENCAPSULATION.len() + length.next_multiple_of(to), 0);
}

fn text(message: &mut Vec<u8>, text: &str) {
    align(message, size_of::<u32>());
    message.extend((text.len() as u32 + 1).to_le_bytes());
    message.extend(text.as_bytes());
    message.push(0);
}

fn number(message: &mut Vec<u8>, number: u64) {
    align(message, size_of::<u64>());
    message.extend(number.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};
    use shared_types::record::FaultEnded;

    use super::*;

    fn ended() -> Event {
        Event::FaultEnded(FaultEnded {
            id: 3,
            effect: 1,
            step: 70_000,
            cleared: true,
        })
    }

    #[test]
    fn an_event_is_encoded_as_its_json_followed_by_each_fact_in_cdr() {
        let json = serde_json::to_string(&ended()).expect("JSON");
        // By the rules of CDR: texts with length and terminating zero, numbers aligned to their size.
        let mut expected = vec![0, 1, 0, 0];
        let mut put = |size: usize, bytes: &[u8]| {
            while (expected.len() - 4) % size > 0 {
                expected.push(0);
            }
            expected.extend(bytes);
        };
        let texts = |text: &str| {
            let length = (text.len() as u32 + 1).to_le_bytes();
            [&length, text.as_bytes(), &[0]].concat()
        };
        put(4, &texts(&json));
        put(4, &texts("fault-ended"));
        put(8, &70_000_u64.to_le_bytes());
        put(8, &3_u64.to_le_bytes());
        put(8, &1_u64.to_le_bytes());
        for _ in ["kind", "target", "parameter", "canonical"] {
            put(4, &texts(""));
        }
        put(1, &[0, 1]);
        put(8, &0_u64.to_le_bytes());
        for _ in ["change", "law", "policy", "reason"] {
            put(4, &texts(""));
        }
        put(8, &0_u64.to_le_bytes());
        put(8, &0_u64.to_le_bytes());
        for _ in ["outcome", "text"] {
            put(4, &texts(""));
        }
        assert_eq!(message(&ended()).expect("a message"), expected);
    }

    #[test]
    fn events_of_this_and_of_earlier_versions_are_decoded() {
        let now = message(&ended()).expect("a message");
        assert_eq!(read("cdr", &now), Ok(ended()));
        let earlier = serde_json::to_vec(&ended()).expect("JSON");
        assert_eq!(read("json", &earlier), Ok(ended()));
    }

    #[test]
    fn an_event_truncated_within_its_json_is_refused() {
        let whole = message(&ended()).expect("a message");
        let json = serde_json::to_string(&ended()).expect("JSON").len();
        for length in 0..8 + json {
            assert!(read("cdr", &whole[..length]).is_err(), "{length} bytes");
        }
        let mut huge = whole.clone();
        huge[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(read("cdr", &huge).is_err());
        huge[4..8].copy_from_slice(&0_u32.to_le_bytes());
        assert!(read("cdr", &huge).is_err());
    }

    #[test]
    fn every_scalar_fact_is_a_field_of_its_type() {
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
                "rejected_frames": 0, "effects": [], "overruns": {"count": 0, "longest": 0,
                "first_step": null}, "missed_commands": {"count": 0, "longest": 0, "first_step": null}
            }),
        ];
        for event in events {
            let event: Event = serde_json::from_value(event).expect("an event");
            // Serialised as in a recording, with every fact.
            let recorded = serde_json::to_value(&event).expect("JSON");
            for (name, value) in recorded.as_object().expect("an object") {
                let field = schema::FACTS.iter().find(|(_, field, _)| field == name);
                let kind = field.map(|(kind, ..)| *kind);
                let expected = match value {
                    Value::String(_) => Some("string"),
                    Value::Bool(_) => Some("bool"),
                    Value::Number(_) => Some("uint64"),
                    _ => None,
                };
                assert_eq!(kind, expected, "{name}");
            }
        }
    }
}
