//! Checks of HTTP requests before they are answered: one page and one WebSocket, for pages of this machine alone.
//!
//! A pure function of the received bytes. [`Host`](HttpRequest) must be a loopback address, which defeats DNS
//! rebinding; `Origin` must be the origin of the page, which keeps out foreign pages. Browsers send no `Origin` when
//! they navigate to a page, so the header may be missing there, but then the fetch metadata must describe a navigation.
//! The page itself contains no data of the run.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Maximum length of a request head in bytes.
pub const LONGEST: usize = 8 << 10;
/// Maximum number of header lines.
const LINES: usize = 64;
/// Path of the page.
const PAGE: &str = "/";
/// Path of the WebSocket.
const LIVE: &str = "/live";

/// Accepted request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HttpRequest {
    /// Page; without its body for a `HEAD` request.
    Page {
        /// Host and port as named by the browser.
        host: String,
        /// `true` if the body is requested.
        wants_body: bool,
    },
    /// WebSocket upgrade.
    Live {
        /// Key from which the accept value is computed.
        key: String,
    },
}

/// Refusal of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Status code and reason phrase.
    pub status: &'static str,
    /// Explanation for the user.
    pub reason: &'static str,
}

/// Verdict on the bytes received so far.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Incomplete head.
    Incomplete,
    /// Accepted request, and the length of its head.
    Accepted(HttpRequest, usize),
    /// Refusal.
    Refused(Refused),
}

const fn refused(status: &'static str, reason: &'static str) -> Verdict {
    Verdict::Refused(Refused { status, reason })
}

/// Checks the first bytes sent by a client.
#[must_use]
pub fn judge(bytes: &[u8]) -> Verdict {
    let mut lines = [httparse::EMPTY_HEADER; LINES];
    let mut head = httparse::Request::new(&mut lines);
    let head_bytes = &bytes[..bytes.len().min(LONGEST)];
    let length = match head.parse(head_bytes) {
        Ok(httparse::Status::Complete(length)) => length,
        Ok(httparse::Status::Partial) if head_bytes.len() < LONGEST => return Verdict::Incomplete,
        Ok(httparse::Status::Partial) | Err(httparse::Error::TooManyHeaders) => {
            return refused(
                "431 Request Header Fields Too Large",
                "request head too large",
            );
        }
        Err(_) => return refused("400 Bad Request", "malformed request"),
    };
    match judge_head(&head) {
        Ok(request) => Verdict::Accepted(request, length),
        Err(refused) => Verdict::Refused(refused),
    }
}

fn judge_head(head: &httparse::Request<'_, '_>) -> Result<HttpRequest, Refused> {
    let no = |status, reason| Err(Refused { status, reason });
    let bad = |reason| Refused {
        status: "400 Bad Request",
        reason,
    };
    if head.version != Some(1) {
        return no(
            "505 HTTP Version Not Supported",
            "only HTTP/1.1 is supported",
        );
    }
    let one = |name: &'static str| one(head, name);
    let host = one("host")?.ok_or(bad("missing Host header"))?;
    if !is_loopback(host) {
        return no("421 Misdirected Request", "Host is not a loopback address");
    }
    let origin = one("origin")?;
    if origin.is_some_and(|origin| !is_of(origin, host)) {
        return no("403 Forbidden", "cross-origin request");
    }
    if one("content-length")?.is_some_and(|length| length != "0")
        || one("transfer-encoding")?.is_some()
    {
        return no("413 Content Too Large", "request body not allowed");
    }
    let method = head.method.unwrap_or_default();
    match head.path.unwrap_or_default() {
        PAGE => {
            if !matches!(method, "GET" | "HEAD") {
                return no("405 Method Not Allowed", "only GET and HEAD are allowed");
            }
            // For browsers that send fetch metadata: a top-level navigation, neither a frame nor a subresource.
            let opens = one("sec-fetch-dest")?.is_none_or(|dest| dest == "document")
                && one("sec-fetch-mode")?.is_none_or(|mode| mode == "navigate");
            if !opens {
                return no("403 Forbidden", "cross-site request");
            }
            Ok(HttpRequest::Page {
                host: host.to_ascii_lowercase(),
                wants_body: method == "GET",
            })
        }
        LIVE => {
            if method != "GET" {
                return no("405 Method Not Allowed", "only GET is allowed");
            }
            if origin.is_none() {
                return no("403 Forbidden", "missing Origin header");
            }
            let says = |name, word: &str| {
                let value = one(name)?.unwrap_or_default();
                let mut words = value.split(',').map(str::trim);
                Ok::<_, Refused>(words.any(|one| one.eq_ignore_ascii_case(word)))
            };
            if !says("upgrade", "websocket")? || !says("connection", "upgrade")? {
                return no("426 Upgrade Required", "WebSocket upgrade required");
            }
            if one("sec-websocket-version")? != Some("13") {
                return no("426 Upgrade Required", "WebSocket version 13 required");
            }
            let key = one("sec-websocket-key")?.unwrap_or_default();
            if !STANDARD.decode(key).is_ok_and(|key| key.len() == 16) {
                return Err(bad("invalid Sec-WebSocket-Key header"));
            }
            Ok(HttpRequest::Live {
                key: key.to_owned(),
            })
        }
        _ => no("404 Not Found", "not found"),
    }
}

/// Returns the value of a header that may occur once.
fn one<'a>(head: &httparse::Request<'_, 'a>, name: &str) -> Result<Option<&'a str>, Refused> {
    let bad = |reason| Refused {
        status: "400 Bad Request",
        reason,
    };
    let is_it = |line: &&httparse::Header<'_>| line.name.eq_ignore_ascii_case(name);
    let mut matching = head.headers.iter().filter(is_it);
    let Some(line) = matching.next() else {
        return Ok(None);
    };
    if matching.next().is_some() {
        return Err(bad("duplicate header"));
    }
    match std::str::from_utf8(line.value) {
        Ok(value) if value.is_ascii() => Ok(Some(value.trim())),
        _ => Err(bad("header value is not ASCII")),
    }
}

/// Returns `true` for a loopback host with any port: `ssh -L` forwards from a port of its own.
fn is_loopback(host: &str) -> bool {
    let (name, port) = match host.rsplit_once(':') {
        // Within the brackets of an IPv6 address.
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

/// Returns `true` if the origin is a page of the host.
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

    fn page(lines: &[(&str, &str)]) -> Verdict {
        judge(&head("GET /", lines))
    }

    fn live(lines: &[(&str, &str)]) -> Verdict {
        let all = [
            ("Upgrade", "websocket"),
            ("Connection", "keep-alive, Upgrade"),
            ("Sec-WebSocket-Version", "13"),
            ("Sec-WebSocket-Key", KEY),
        ];
        judge(&head("GET /live", &[lines, &all].concat()))
    }

    fn status(verdict: &Verdict) -> &str {
        match verdict {
            Verdict::Incomplete => "incomplete",
            Verdict::Accepted(..) => "200",
            Verdict::Refused(refused) => &refused.status[..3],
        }
    }

    #[test]
    fn only_loopback_hosts_are_accepted_with_any_port() {
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
            let verdict = page(&[("Host", host)]);
            // An empty port is not a number.
            assert_eq!(status(&verdict), "421", "{host}: {verdict:?}");
        }
        assert_eq!(status(&page(&[])), "400");
        let twice = [("Host", "localhost:1"), ("host", "localhost:1")];
        assert_eq!(status(&page(&twice)), "400");
    }

    #[test]
    fn a_foreign_page_gets_neither_page_nor_socket() {
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
            let verdict = judge(&head(first, &lines));
            assert_eq!(status(&verdict), expected, "{first}: {verdict:?}");
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
        assert_eq!(judge(b"GET / HTTP/1.1\r\nHost: loc"), Verdict::Incomplete);
    }
}
