//! Messages of the Foxglove WebSocket protocol, as far as a read-only server needs them
//! (github.com/foxglove/ws-protocol, docs/spec.md).
//!
//! Text messages are JSON with an `op` field; binary messages begin with a byte that identifies their type.

use hil_recording::schema;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::record::RecordLayout;

/// Channel of the records.
pub(crate) const RECORDS: u64 = 1;
/// Channel of the events.
pub(crate) const EVENTS: u64 = 2;
/// First byte of a data message.
const MESSAGE_DATA: u8 = 1;

/// Client message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ClientMessage {
    /// New subscriptions, as pairs of subscription and channel numbers.
    Subscribe(Vec<(u32, u64)>),
    /// Subscriptions to cancel.
    Unsubscribe(Vec<u32>),
    /// Unsupported operation, by name.
    Other(String),
}

/// Parses a message of a client.
pub(crate) fn asked(text: &str) -> ClientMessage {
    let message: Value = serde_json::from_str(text).unwrap_or_default();
    let list = |key: &str| message[key].as_array().map_or(&[][..], Vec::as_slice);
    let number = |value: &Value| u32::try_from(value.as_u64()?).ok();
    match message["op"].as_str() {
        Some("subscribe") => ClientMessage::Subscribe(
            (list("subscriptions").iter())
                .filter_map(|one| Some((number(&one["id"])?, one["channelId"].as_u64()?)))
                .collect(),
        ),
        Some("unsubscribe") => {
            ClientMessage::Unsubscribe(list("subscriptionIds").iter().filter_map(number).collect())
        }
        Some(other) => ClientMessage::Other(format!("`{other}`")),
        None => ClientMessage::Other("a message without `op`".into()),
    }
}

/// Returns `true` for an existing channel.
pub(crate) const fn is_channel(channel: u64) -> bool {
    matches!(channel, RECORDS | EVENTS)
}

/// Returns the first message to every client, which identifies the server.
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

/// Returns the announcement of the channels, with the names, encodings and schemas of a recording.
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

/// Message for the subscribers of its channel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Data {
    /// The channel.
    pub channel: u64,
    /// Simulated time.
    pub time_ns: u64,
    /// Bytes of the message, as in a recording.
    pub payload: Vec<u8>,
}

/// Encodes a record or an event for a subscription, at its simulated time.
pub(crate) fn data(subscription: u32, data: &Data) -> Vec<u8> {
    let mut message = Vec::with_capacity(13 + data.payload.len());
    message.push(MESSAGE_DATA);
    message.extend(subscription.to_le_bytes());
    message.extend(data.time_ns.to_le_bytes());
    message.extend(&data.payload);
    message
}

/// Level of a status message.
#[derive(Clone, Copy)]
enum Level {
    Info = 0,
    Warning = 1,
}

fn status(level: Level, message: &str, id: &str) -> String {
    json!({"op": "status", "level": level as u8, "message": message, "id": id}).to_string()
}

/// Returns the status message for an unsupported request.
pub(crate) fn refused(what: &str) -> String {
    let text = format!("{what} is not supported: this server is read-only");
    status(Level::Warning, &text, "refused")
}

/// Returns the warning about dropped messages.
pub(crate) fn left_out(count: u64) -> String {
    let text = format!("{count} messages were dropped: the connection is too slow");
    status(Level::Warning, &text, "slow")
}

/// Returns the status message for the end of the session.
pub(crate) fn ended(last_word: &str) -> String {
    status(Level::Info, last_word, "ended")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn client_messages_are_parsed_or_reported_by_name() {
        for (text, expected) in [
            (
                r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":1},{"id":7,"channelId":2}]}"#,
                ClientMessage::Subscribe(vec![(0, 1), (7, 2)]),
            ),
            (
                r#"{"op":"unsubscribe","subscriptionIds":[7,0]}"#,
                ClientMessage::Unsubscribe(vec![7, 0]),
            ),
            (
                r#"{"op":"subscribe","subscriptions":[{"id":-1,"channelId":1}, 3]}"#,
                ClientMessage::Subscribe(vec![]),
            ),
            (r#"{"op":"subscribe"}"#, ClientMessage::Subscribe(vec![])),
            (
                r#"{"op":"getParameters"}"#,
                ClientMessage::Other("`getParameters`".into()),
            ),
            ("[1", ClientMessage::Other("a message without `op`".into())),
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
