//! Requests of a browser, judged before anything is answered: one page and one WebSocket, for pages of this
//! machine alone.
//!
//! A pure function of the bytes that came. [`Host`](Asked) must be an address of this machine, which keeps out a
//! foreign name that was made to lead here; `Origin` must be the page's own, which keeps out foreign pages. No
//! browser sends `Origin` when it opens a page, so there a missing one passes, and what the browser says of the
//! request must be that it opens a page. The page holds nothing of the run.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Longest head of a request.
pub const LONGEST: usize = 8 << 10;
/// Most lines of a head.
const LINES: usize = 64;
/// Place of the page.
const PAGE: &str = "/";
/// Place of the WebSocket.
const LIVE: &str = "/live";

/// A request that may be answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The page, at a host; without its body for a `HEAD`.
    Page {
        /// Host as the browser names it, with its port.
        host: String,
        /// The body is wanted.
        wants_body: bool,
    },
    /// The WebSocket.
    Live {
        /// Key that the answer is computed from.
        key: String,
    },
}

/// Reason for which a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Status and its name.
    pub status: &'static str,
    /// Reason, for a person.
    pub reason: &'static str,
}

/// Judgement of the bytes that came so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Judged {
    /// The head is not complete.
    Incomplete,
    /// Request, and the length of its head.
    Asked(Asked, usize),
    /// No.
    Refused(Refused),
}

const fn refused(status: &'static str, reason: &'static str) -> Judged {
    Judged::Refused(Refused { status, reason })
}

/// Judges the beginning of what a client sent.
#[must_use]
pub fn judge(bytes: &[u8]) -> Judged {
    let mut lines = [httparse::EMPTY_HEADER; LINES];
    let mut head = httparse::Request::new(&mut lines);
    let seen = &bytes[..bytes.len().min(LONGEST)];
    let length = match head.parse(seen) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) if seen.len() < LONGEST => return Judged::Incomplete,
        Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
            return refused(
                "431 Request Header Fields Too Large",
                "the head is too long",
            );
        }
        Err(_) => return refused("400 Bad Request", "no request"),
    };
    match judge_head(&head) {
        Ok(asked) => Judged::Asked(asked, length),
        Err(refused) => Judged::Refused(refused),
    }
}

fn judge_head(head: &httparse::Request<'_, '_>) -> Result<Asked, Refused> {
    let no = |status, reason| Err(Refused { status, reason });
    let bad = |reason| Refused {
        status: "400 Bad Request",
        reason,
    };
    if head.version != Some(1) {
        return no("505 HTTP Version Not Supported", "HTTP/1.1 is spoken here");
    }
    let one = |name: &'static str| one(head, name);
    let host = one("host")?.ok_or(bad("no host is named"))?;
    if !is_loopback(host) {
        return no("421 Misdirected Request", "the host is not this machine");
    }
    let origin = one("origin")?;
    if origin.is_some_and(|origin| !is_of(origin, host)) {
        return no("403 Forbidden", "another page asks");
    }
    if one("content-length")?.is_some_and(|length| length != "0")
        || one("transfer-encoding")?.is_some()
    {
        return no("413 Content Too Large", "nothing is taken");
    }
    let method = head.method.unwrap_or_default();
    match head.path.unwrap_or_default() {
        PAGE => {
            if !matches!(method, "GET" | "HEAD") {
                return no("405 Method Not Allowed", "GET is answered");
            }
            // A browser that tells at all: a page that is opened, and neither a frame nor a part of another.
            let opens = one("sec-fetch-dest")?.is_none_or(|what| what == "document")
                && one("sec-fetch-mode")?.is_none_or(|how| how == "navigate");
            if !opens {
                return no("403 Forbidden", "another page asks");
            }
            Ok(Asked::Page {
                host: host.to_ascii_lowercase(),
                wants_body: method == "GET",
            })
        }
        LIVE => {
            if method != "GET" {
                return no("405 Method Not Allowed", "GET is answered");
            }
            if origin.is_none() {
                return no("403 Forbidden", "no page asks");
            }
            let says = |name, word: &str| {
                let said = one(name)?.unwrap_or_default();
                let mut words = said.split(',').map(str::trim);
                Ok::<_, Refused>(words.any(|one| one.eq_ignore_ascii_case(word)))
            };
            if !says("upgrade", "websocket")? || !says("connection", "upgrade")? {
                return no("426 Upgrade Required", "a WebSocket is here");
            }
            if one("sec-websocket-version")? != Some("13") {
                return no("426 Upgrade Required", "version 13 is spoken here");
            }
            let key = one("sec-websocket-key")?.unwrap_or_default();
            if !STANDARD.decode(key).is_ok_and(|key| key.len() == 16) {
                return Err(bad("no key"));
            }
            Ok(Asked::Live {
                key: key.to_owned(),
            })
        }
        _ => no("404 Not Found", "nothing is here"),
    }
}

/// The value of a line that may stand there once.
fn one<'a>(head: &httparse::Request<'_, 'a>, name: &str) -> Result<Option<&'a str>, Refused> {
    let bad = |reason| Refused {
        status: "400 Bad Request",
        reason,
    };
    let is_it = |line: &&httparse::Header<'_>| line.name.eq_ignore_ascii_case(name);
    let mut found = head.headers.iter().filter(is_it);
    let Some(line) = found.next() else {
        return Ok(None);
    };
    if found.next().is_some() {
        return Err(bad("a line stands there twice"));
    }
    match std::str::from_utf8(line.value) {
        Ok(value) if value.is_ascii() => Ok(Some(value.trim())),
        _ => Err(bad("a line is no text")),
    }
}

/// Reports a host of this machine, with any port: `ssh -L` has one of its own.
fn is_loopback(host: &str) -> bool {
    let (name, port) = match host.rsplit_once(':') {
        // Within the brackets of a version 6 address.
        Some((_, port)) if port.ends_with(']') => (host, None),
        Some((name, port)) => (name, Some(port)),
        None => (host, None),
    };
    let is_port = |port: &str| {
        let digits = port.bytes().all(|byte| byte.is_ascii_digit());
        digits && port.parse::<u16>().is_ok()
    };
    if !port.is_none_or(is_port) {
        return false;
    }
    let v6 = name
        .strip_prefix('[')
        .and_then(|name| name.strip_suffix(']'));
    match v6 {
        Some(address) => address.parse() == Ok(Ipv6Addr::LOCALHOST),
        None => {
            let address = name.parse::<Ipv4Addr>().map(IpAddr::V4);
            name.eq_ignore_ascii_case("localhost") || address.is_ok_and(|one| one.is_loopback())
        }
    }
}

/// Reports an origin that is a page of the host.
fn is_of(origin: &str, host: &str) -> bool {
    let of = origin.strip_prefix("http://");
    of.is_some_and(|of| of.eq_ignore_ascii_case(host))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: &str = "AAAAAAAAAAAAAAAAAAAAAA==";

    fn head(first: &str, lines: &[(&str, &str)]) -> Vec<u8> {
        let mut text = format!("{first} HTTP/1.1\r\n");
        for (name, value) in lines {
            text += &format!("{name}: {value}\r\n");
        }
        (text + "\r\n").into_bytes()
    }

    fn page(lines: &[(&str, &str)]) -> Judged {
        judge(&head("GET /", lines))
    }

    fn live(lines: &[(&str, &str)]) -> Judged {
        let all = [
            ("Upgrade", "websocket"),
            ("Connection", "keep-alive, Upgrade"),
            ("Sec-WebSocket-Version", "13"),
            ("Sec-WebSocket-Key", KEY),
        ];
        judge(&head("GET /live", &[lines, &all].concat()))
    }

    fn status(judged: &Judged) -> &str {
        match judged {
            Judged::Incomplete => "incomplete",
            Judged::Asked(..) => "200",
            Judged::Refused(refused) => &refused.status[..3],
        }
    }

    #[test]
    fn hosts_of_this_machine_pass_with_any_port_and_no_others() {
        for host in [
            "127.0.0.1:4711",
            "localhost:8080",
            "LOCALHOST",
            "[::1]:5",
            "[::1]",
            "127.0.0.2:80",
        ] {
            assert_eq!(status(&page(&[("Host", host)])), "200", "{host}");
        }
        for host in [
            "evil.example:4711",
            "localhost.evil.example",
            "127.0.0.1.evil.example:80",
            "0.0.0.0:80",
            "192.168.0.1:80",
            "[::]:80",
            "[::1",
            "::1",
            "localhost:",
            "localhost:+80",
            "localhost:99999",
            "localhost:80:80",
            "user@localhost:80",
            "127.1:80",
            "",
        ] {
            let judged = page(&[("Host", host)]);
            // A port that is empty is no number.
            assert_eq!(status(&judged), "421", "{host}: {judged:?}");
        }
        assert_eq!(status(&page(&[])), "400");
        let twice = [("Host", "localhost:1"), ("host", "localhost:1")];
        assert_eq!(status(&page(&twice)), "400");
    }

    #[test]
    fn a_page_of_elsewhere_gets_neither_page_nor_socket() {
        let host = ("Host", "127.0.0.1:4711");
        let own = ("Origin", "http://127.0.0.1:4711");
        assert_eq!(status(&page(&[host, own])), "200");
        assert_eq!(status(&live(&[host, own])), "200");
        assert_eq!(status(&live(&[host])), "403", "a missing origin");
        for origin in [
            "http://evil.example",
            "https://127.0.0.1:4711",
            "http://127.0.0.1:4712",
            "http://localhost:4711",
            "null",
            "file://",
            "",
        ] {
            let foreign = [host, ("Origin", origin)];
            assert_eq!(status(&page(&foreign)), "403", "{origin}");
            assert_eq!(status(&live(&foreign)), "403", "{origin}");
        }
        for [name, value] in [
            ["Sec-Fetch-Dest", "iframe"],
            ["Sec-Fetch-Dest", "script"],
            ["Sec-Fetch-Mode", "no-cors"],
        ] {
            assert_eq!(
                status(&page(&[host, (name, value)])),
                "403",
                "{name} {value}"
            );
        }
    }

    #[test]
    fn anything_else_is_refused_with_its_status() {
        let host = ("Host", "localhost:1");
        for (first, lines, expected) in [
            ("GET /x", vec![host], "404"),
            ("GET /live?secret=1", vec![host], "404"),
            ("POST /", vec![host], "405"),
            ("GET /", vec![host, ("Content-Length", "5")], "413"),
            ("GET /", vec![host, ("Transfer-Encoding", "chunked")], "413"),
            (
                "GET /live",
                vec![host, ("Origin", "http://localhost:1")],
                "426",
            ),
        ] {
            let judged = judge(&head(first, &lines));
            assert_eq!(status(&judged), expected, "{first}: {judged:?}");
        }
        assert_eq!(
            status(&judge(b"GET / HTTP/1.0\r\nHost: localhost\r\n\r\n")),
            "505"
        );
        assert_eq!(status(&judge(b"\0\xff\r\n\r\n")), "400");
        let many: Vec<_> = (0..80).map(|_| ("X", "y")).collect();
        assert_eq!(status(&page(&many)), "431");
        let long = "x".repeat(LONGEST);
        assert_eq!(status(&page(&[host, ("X", &long)])), "431");
        assert_eq!(judge(b"GET / HTTP/1.1\r\nHost: loc"), Judged::Incomplete);
    }
}
