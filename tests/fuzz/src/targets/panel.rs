//! Input of the panel from browsers: heads of requests, and messages of a page.
//!
//! Bytes that begin with `{` are a message, all others a request. An accepted request names a loopback host and, for
//! the WebSocket, the origin of the page; the verdict does not depend on how the bytes are split. An accepted message
//! requests one of the listed actions, with bounded numbers.

use hil_views::panel::message::{Action, ClientMessage, parse};
use hil_views::panel::request::{HttpRequest, LONGEST, Verdict, judge};

/// Runs the target.
pub fn run(bytes: &[u8]) {
    match bytes {
        [b'{', ..] => message(bytes),
        _ => request(bytes),
    }
}

fn request(bytes: &[u8]) {
    let verdict = judge(bytes);
    match &verdict {
        Verdict::Incomplete => assert!(bytes.len() < LONGEST, "it may not grow for ever"),
        Verdict::Refused(refused) => {
            let code: u32 = refused.status[..3].parse().expect("a status");
            assert!((400..=505).contains(&code));
            super::assert_told(refused.reason);
        }
        Verdict::Accepted(request, length) => {
            assert!(*length <= bytes.len() && *length <= LONGEST);
            let head = String::from_utf8_lossy(&bytes[..*length]).to_lowercase();
            let value = |name: &str| {
                let mut lines = head.lines().filter_map(|line| line.split_once(':'));
                let line = lines.find(|(key, _)| *key == name);
                line.map(|(_, value)| value.trim().to_owned())
            };
            let host = value("host").expect("a host");
            assert!(
                ["127.", "localhost", "[::1]"]
                    .iter()
                    .any(|own| host.starts_with(own)),
                "{host}"
            );
            assert!(
                host.chars()
                    .all(|c| c.is_ascii_alphanumeric() || ".:[]".contains(c)),
                "{host:?} becomes part of a header"
            );
            let origin = value("origin");
            match request {
                HttpRequest::Page { host: named, .. } => {
                    assert_eq!(*named, host);
                    assert!(origin.is_none_or(|origin| origin == format!("http://{host}")));
                }
                HttpRequest::Live { key } => {
                    assert_eq!(origin, Some(format!("http://{host}")));
                    assert_eq!(key.len(), 24);
                }
            }
        }
    }
    // Split into pieces it is the same request, and never another one before it is complete.
    for end in [
        bytes.len() / 3,
        bytes.len() / 2,
        bytes.len().saturating_sub(1),
    ] {
        match judge(&bytes[..end]) {
            Verdict::Accepted(..) => assert_eq!(judge(&bytes[..end]), verdict),
            Verdict::Refused(_) => assert!(matches!(verdict, Verdict::Refused(_))),
            Verdict::Incomplete => {}
        }
    }
}

fn message(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match parse(text) {
        Err(reason) => assert!(!reason.is_empty()),
        Ok(ClientMessage::View { window_s, .. }) => assert!(window_s.is_finite() && window_s > 0.0),
        Ok(ClientMessage::Seen { .. } | ClientMessage::Where { .. }) => {}
        Ok(ClientMessage::Read {
            from,
            to,
            most,
            signals,
            ..
        }) => assert!(
            from <= to && to <= 1 << 40 && (1..=2048).contains(&most) && signals.len() <= 64
        ),
        Ok(ClientMessage::Measure {
            from, to, signals, ..
        }) => assert!(from <= to && to <= 1 << 40 && signals.len() <= 64),
        Ok(ClientMessage::Keep { plots, .. }) => {
            assert!(plots.len() <= 200 && plots.iter().all(|one| one.signals.len() <= 64));
        }
        Ok(ClientMessage::Branch { step }) => assert!(step <= 1 << 40),
        // The words of a fault are the subject of another target.
        Ok(ClientMessage::Do { action, .. }) => {
            assert_eq!(
                action.request().is_none(),
                matches!(action, Action::Inject { .. })
            );
        }
    }
}
