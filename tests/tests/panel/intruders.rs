//! Clients that are no page of this panel: foreign names, foreign pages, no secret, too large, too slow, too many.

use std::io::{Read, Write};
use std::net::TcpStream;

use serde_json::json;

use super::stream::Client;
use super::{Panel, SCENARIO};
use crate::support::harness::{Rig, WATCHDOG};

/// Sends bytes and reads the answer until the connection closes.
fn answer(panel: &Panel, bytes: &[u8]) -> String {
    let mut stream = connected(panel);
    let _ = stream.write_all(bytes); // it may be closed before everything is sent
    rest(stream)
}

fn connected(panel: &Panel) -> TcpStream {
    let stream = TcpStream::connect(panel.address()).expect("it listens");
    stream.set_read_timeout(Some(WATCHDOG)).expect("a limit");
    stream
}

/// Reads the answer until the connection closes, cleanly or not.
fn rest(mut stream: TcpStream) -> String {
    let mut all = Vec::new();
    let mut bytes = [0; 4096];
    while let Ok(count @ 1..) = stream.read(&mut bytes) {
        all.extend_from_slice(&bytes[..count]);
    }
    String::from_utf8_lossy(&all).into_owned()
}

fn get(place: &str, lines: &[(&str, &str)]) -> Vec<u8> {
    let mut text = format!("GET {place} HTTP/1.1\r\n");
    for (name, value) in lines {
        text += &format!("{name}: {value}\r\n");
    }
    (text + "\r\n").into_bytes()
}

const UPGRADE: [(&str, &str); 4] = [
    ("Upgrade", "websocket"),
    ("Connection", "Upgrade"),
    ("Sec-WebSocket-Version", "13"),
    ("Sec-WebSocket-Key", "AAAAAAAAAAAAAAAAAAAAAA=="),
];

#[test]
fn only_pages_of_the_panel_get_data_and_the_run_is_unaffected() {
    let rig = Rig::new();
    let alone = rig.run(SCENARIO).expect(0).digest();
    let run = rig.held();
    let panel = Panel::start(&rig, &[]);
    let host = ("Host", panel.address());
    let own = format!("http://{}", panel.address());

    // The page is public on this machine, and contains no data of the run.
    let page = answer(&panel, &get("/", &[host]));
    let (head, body) = page.split_once("\r\n\r\n").expect("a head");
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    for rule in [
        "default-src 'none'",
        "frame-ancestors 'none'",
        "base-uri 'none'",
        "form-action 'none'",
        "Cache-Control: no-store",
        "Referrer-Policy: no-referrer",
        "X-Content-Type-Options: nosniff",
    ] {
        assert!(head.contains(rule), "{rule} is not in {head}");
    }
    assert!(
        !head.contains("unsafe") && !head.to_lowercase().contains("set-cookie"),
        "{head}"
    );
    for expected in [panel.secret(), rig.session(), "position_m", "spring"] {
        assert!(!body.contains(expected), "{expected} is in the page");
    }
    let again = answer(&panel, &get("/", &[host]));
    assert_ne!(page, again, "a number for each page");

    // Names that resolve to this machine, and pages from elsewhere.
    let refused = |place: &str, lines: &[(&str, &str)], status: &str| {
        let expected = answer(&panel, &get(place, lines));
        assert!(
            expected.starts_with(&format!("HTTP/1.1 {status} ")),
            "{place} {lines:?}: {expected}"
        );
        assert!(
            expected.len() < 600 && !expected.contains(panel.secret()),
            "{expected}"
        );
    };
    let port = panel.address().split_once(':').expect("a port").1;
    for name in [
        "evil.example",
        "127.0.0.1.evil.example",
        "192.168.1.1",
        "0.0.0.0",
    ] {
        let host = format!("{name}:{port}");
        let origin = format!("http://{host}");
        refused("/", &[("Host", &host)], "421");
        refused(
            "/live",
            &[&[("Host", &*host), ("Origin", &*origin)], &UPGRADE[..]].concat(),
            "421",
        );
    }
    for origin in [
        "http://evil.example",
        "https://localhost",
        "null",
        "file://",
        "http://localhost:1",
    ] {
        refused("/", &[host, ("Origin", origin)], "403");
        refused(
            "/live",
            &[&[host, ("Origin", origin)], &UPGRADE[..]].concat(),
            "403",
        );
    }
    refused("/live", &[&[host][..], &UPGRADE[..]].concat(), "403");
    refused("/live", &[host, ("Origin", &own)], "426");
    refused("/favicon.ico", &[host], "404");
    refused(&format!("/?{}", panel.secret()), &[host], "404");
    refused("/", &[host, ("Content-Length", "1000000")], "413");
    refused("/", &[], "400");

    // Too long or malformed.
    let long = "x".repeat(100_000);
    refused("/", &[host, ("Cookie", &long)], "431");
    for garbage in [
        &b"\0\xff\xfe\r\n\r\n"[..],
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ] {
        let expected = answer(&panel, garbage);
        assert!(
            expected.is_empty()
                || expected.starts_with("HTTP/1.1 4")
                || expected.starts_with("HTTP/1.1 505"),
            "{expected}"
        );
    }

    // A WebSocket without the secret receives nothing, and is closed soon.
    for greeting in [
        json!({ "secret": "0".repeat(32) }),
        json!({ "secret": "" }),
        json!({ "secret": &panel.secret()[..31] }),
        json!({ "secret": panel.secret(), "more": 1 }),
        json!({ "ask": "do", "number": 1, "action": { "kind": "resume" } }),
        json!([]),
    ] {
        let mut client = Client::connected(&panel.url);
        client.say(&greeting);
        let expected = client.until_closed();
        assert_eq!(
            expected,
            [json!({ "tell": "over", "text": "the secret is wrong" })],
            "{greeting}"
        );
    }
    assert!(
        Client::connected(&panel.url).until_closed().is_empty(),
        "who says nothing"
    );
    // A client with the secret that sends an invalid message is closed without effect.
    for nonsense in [
        json!({ "ask": "run" }),
        json!(null),
        json!("x".repeat(60_000)),
    ] {
        let mut client = Client::greeted(&panel.url);
        client.say(&nonsense);
        client.until_closed();
    }

    rig.in_session("inject --active --json")
        .prints(&["\"step\":2500"]);
    assert_eq!(panel.interrupt(), Some(130));
    rig.in_session("resume").expect(0);
    assert_eq!(run.finish().expect(0).digest(), alone);
}

#[test]
fn slow_and_silent_strangers_are_dropped_and_crowds_block_no_page_for_long() {
    let rig = Rig::new();
    let run = rig.held();
    let panel = Panel::start(&rig, &[]);
    // More than may wait at a time; those beyond are closed at once, the others when their time is over.
    let crowd: Vec<TcpStream> = (0..60).map(|_| connected(&panel)).collect();
    let mut slow = connected(&panel);
    for stream in crowd {
        assert_eq!(rest(stream), "", "nothing is told to who asks nothing");
    }
    // Byte by byte, endlessly.
    let request = get("/", &[("Host", panel.address()), ("X", &"y".repeat(6000))]);
    for byte in &request {
        if slow.write_all(&[*byte]).is_err() {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert_eq!(rest(slow), "");
    // Room again, for the maximum number of pages.
    let mut pages: Vec<Client> = (0..8).map(|_| Client::greeted(&panel.url)).collect();
    for page in &mut pages {
        page.until(|message| message["tell"] == "about");
    }
    let message = Client::greeted(&panel.url).until_closed();
    assert_eq!(
        message,
        [
            json!({ "tell": "over", "text": "8 pages are already open, which is the maximum; close one" })
        ]
    );
    pages.pop();
    crate::support::harness::until("there is room", || {
        let mut next = Client::greeted(&panel.url);
        let message = next.until(|_| true);
        message["tell"] != "over"
    });
    drop(pages);
    assert_eq!(panel.interrupt(), Some(130));
    rig.in_session("resume").expect(0);
    run.finish().expect(0);
}
