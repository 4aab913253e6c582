//! Text of browsers for the panel: the head of a request, and messages of a page.
//!
//! Bytes that begin with `{` are a message, all else is a request. A request that is taken names a host of this
//! machine, and to the WebSocket an origin that is the page's own; whatever way it comes in pieces, it is judged the
//! same. What a taken message asks for is on a short list, and its numbers are bounded.

use hil_views::panel::message::{Deed, Wish, wish};
use hil_views::panel::request::{Asked, Judged, LONGEST, judge};

/// Runs the target.
pub fn run(bytes: &[u8]) {
    match bytes {
        [b'{', ..] => message(bytes),
        _ => request(bytes),
    }
}

fn request(bytes: &[u8]) {
    let judged = judge(bytes);
    match &judged {
        Judged::Incomplete => assert!(bytes.len() < LONGEST, "it may not grow for ever"),
        Judged::Refused(refused) => {
            let code: u32 = refused.status[..3].parse().expect("a status");
            assert!((400..=505).contains(&code));
            super::assert_told(refused.reason);
        }
        Judged::Asked(asked, length) => {
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
            match asked {
                Asked::Page { host: named, .. } => {
                    assert_eq!(*named, host);
                    assert!(origin.is_none_or(|origin| origin == format!("http://{host}")));
                }
                Asked::Live { key } => {
                    assert_eq!(origin, Some(format!("http://{host}")));
                    assert_eq!(key.len(), 24);
                }
            }
        }
    }
    // In pieces it is the same request, and never another one before it is complete.
    for end in [
        bytes.len() / 3,
        bytes.len() / 2,
        bytes.len().saturating_sub(1),
    ] {
        match judge(&bytes[..end]) {
            Judged::Asked(..) => assert_eq!(judge(&bytes[..end]), judged),
            Judged::Refused(_) => assert!(matches!(judged, Judged::Refused(_))),
            Judged::Incomplete => {}
        }
    }
}

fn message(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match wish(text) {
        Err(reason) => assert!(!reason.is_empty()),
        Ok(Wish::View { window_s, .. }) => assert!(window_s.is_finite() && window_s > 0.0),
        Ok(Wish::Seen { .. }) => {}
        // Of a fault it takes words, which are those of another target.
        Ok(Wish::Do { deed, .. }) => {
            assert_eq!(
                deed.request().is_none(),
                matches!(deed, Deed::Inject { .. })
            );
        }
    }
}
