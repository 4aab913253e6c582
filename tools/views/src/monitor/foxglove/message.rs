//! The messages of the Foxglove WebSocket protocol, as far as a server that only shows needs them
//! (github.com/foxglove/ws-protocol, docs/spec.md).
//!
//! Text messages are JSON with an `op`, binary ones begin with a byte that says what they are.

use hil_recording::schema;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::record::RecordLayout;

/// Channel of the records.
pub(crate) const RECORDS: u64 = 1;
/// Channel of the events.
pub(crate) const EVENTS: u64 = 2;
/// First byte of a message with data.
const MESSAGE_DATA: u8 = 1;

/// Request of a client.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Asked {
    /// Subscriptions by number, each of a channel.
    Subscribe(Vec<(u32, u64)>),
    /// Subscriptions that it wants no more.
    Unsubscribe(Vec<u32>),
    /// Something that is not met, by its name.
    Other(String),
}

/// Parses a message of a client.
#[must_use]
pub(crate) fn asked(text: &str) -> Asked {
    let said: Value = serde_json::from_str(text).unwrap_or_default();
    let list = |key: &str| said[key].as_array().map_or(&[][..], Vec::as_slice);
    let number = |value: &Value| u32::try_from(value.as_u64()?).ok();
    match said["op"].as_str() {
        Some("subscribe") => Asked::Subscribe(
            (list("subscriptions").iter())
                .filter_map(|one| Some((number(&one["id"])?, one["channelId"].as_u64()?)))
                .collect(),
        ),
        Some("unsubscribe") => {
            Asked::Unsubscribe(list("subscriptionIds").iter().filter_map(number).collect())
        }
        Some(other) => Asked::Other(format!("`{other}`")),
        None => Asked::Other("a message without `op`".into()),
    }
}

/// Reports a channel that exists.
#[must_use]
pub(crate) const fn is_channel(channel: u64) -> bool {
    matches!(channel, RECORDS | EVENTS)
}

/// Names the server: the first message to every client.
#[must_use]
pub(crate) fn server_info(session: &SessionInfo, scenario: &str) -> String {
    json!({
        "op": "serverInfo",
        "name": format!("hil: {scenario}"),
        "capabilities": [],
        "metadata": {"session": session.name, "scenario": scenario},
        "sessionId": format!("{:016x}", session.id),
    })
    .to_string()
}

/// The channels, with the names, encodings and schemas of a recording.
#[must_use]
pub(crate) fn advertise(layout: &RecordLayout) -> String {
    json!({
        "op": "advertise",
        "channels": [
            {
                "id": RECORDS,
                "topic": schema::RECORD_TOPIC,
                "encoding": schema::ENCODING,
                "schemaName": schema::RECORD_NAME,
                "schema": schema::record(layout),
                "schemaEncoding": schema::LANGUAGE,
            },
            {
                "id": EVENTS,
                "topic": schema::EVENT_TOPIC,
                "encoding": schema::ENCODING,
                "schemaName": schema::EVENT_NAME,
                "schema": schema::event(),
                "schemaEncoding": schema::LANGUAGE,
            },
        ],
    })
    .to_string()
}

/// A message for those who subscribed to its channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Data {
    /// The channel.
    pub channel: u64,
    /// Simulated time.
    pub time_ns: u64,
    /// Bytes of the message, as in a recording.
    pub payload: Vec<u8>,
}

/// A record or an event for a subscription, at its simulated time.
#[must_use]
pub(crate) fn data(subscription: u32, data: &Data) -> Vec<u8> {
    let mut message = Vec::with_capacity(13 + data.payload.len());
    message.push(MESSAGE_DATA);
    message.extend(subscription.to_le_bytes());
    message.extend(data.time_ns.to_le_bytes());
    message.extend(&data.payload);
    message
}

/// A level of a status message.
#[derive(Clone, Copy)]
enum Level {
    Info = 0,
    Warning = 1,
}

fn status(level: Level, message: &str, id: &str) -> String {
    json!({"op": "status", "level": level as u8, "message": message, "id": id}).to_string()
}

/// Something was asked for that is not met.
#[must_use]
pub(crate) fn refused(what: &str) -> String {
    let told = format!("{what} is not met: a run can be watched here and not changed");
    status(Level::Warning, &told, "refused")
}

/// Messages were left out.
#[must_use]
pub(crate) fn left_out(count: u64) -> String {
    let told = format!("{count} messages were left out: this connection is too slow for them");
    status(Level::Warning, &told, "slow")
}

/// The session is over.
#[must_use]
pub(crate) fn ended(last_word: &str) -> String {
    status(Level::Info, last_word, "ended")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_clients_say_is_understood_or_named() {
        for (text, expected) in [
            (
                r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":1},{"id":7,"channelId":2}]}"#,
                Asked::Subscribe(vec![(0, 1), (7, 2)]),
            ),
            (
                r#"{"op":"unsubscribe","subscriptionIds":[7,0]}"#,
                Asked::Unsubscribe(vec![7, 0]),
            ),
            (
                r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}, 3]}"#,
                Asked::Subscribe(vec![]),
            ),
            (r#"{"op":"subscribe"}"#, Asked::Subscribe(vec![])),
            (
                r#"{"op":"getParameters"}"#,
                Asked::Other("`getParameters`".into()),
            ),
            ("[1", Asked::Other("a message without `op`".into())),
        ] {
            assert_eq!(asked(text), expected, "{text}");
        }
    }

    #[test]
    fn a_message_with_data_has_the_bytes_of_the_specification() {
        let record = Data {
            channel: RECORDS,
            time_ns: 0x0102_0304_0506_0708,
            payload: vec![0, 1, 0, 0, 9],
        };
        assert_eq!(
            data(0x0a0b_0c0d, &record),
            [1, 13, 12, 11, 10, 8, 7, 6, 5, 4, 3, 2, 1, 0, 1, 0, 0, 9]
        );
    }
}
