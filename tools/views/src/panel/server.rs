//! HTTP server of the page, bound to the loopback interface, with limits on connections and time.
//!
//! Each connection has its own thread, which never delays the thread that watches the session: it reads the
//! [model](crate::monitor::model) only when its page can receive something. Unauthenticated connections are limited to
//! a few seconds and bytes; clients that know the secret are served by a [`Source`].

use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hil_console::terminal::exit::Failure;
use rustix::rand::{GetRandomFlags, getrandom};
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

use super::message::{self, Greeting};
use super::page;
use super::request::{self, HttpRequest, Verdict};

/// Maximum number of clients.
pub(super) const CLIENTS: usize = 8;
/// Maximum number of unauthenticated connections.
const STRANGERS: usize = 24;
/// Time limit for a request, for its response, and for the secret.
const LIMIT: Duration = Duration::from_secs(5);
/// Polling interval.
const LOOK: Duration = Duration::from_millis(10);
/// Maximum number of bytes buffered for a client.
const BUFFERED: usize = 4 << 20;

/// Returns random bytes of the operating system.
fn random() -> Result<[u8; 16], Failure> {
    let mut bytes = [0; 16];
    let mut filled = 0;
    while filled < bytes.len() {
        filled += getrandom(&mut bytes[filled..], GetRandomFlags::empty())
            .map_err(Failure::infrastructure)?;
    }
    Ok(bytes)
}

/// Content for the pages of a server.
pub(crate) trait Source: Send + Sync + 'static {
    /// Serves an authenticated page until it disconnects or the service ends.
    fn serve(self: Arc<Self>, socket: WebSocket<TcpStream>);

    /// Ends the service.
    fn end(&self);
}

/// Running server; dropping it ends the service.
pub(crate) struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
}

/// State shared by all connections.
struct Shared {
    source: Arc<dyn Source>,
    secret: String,
    clients: AtomicUsize,
    strangers: AtomicUsize,
    is_over: AtomicBool,
}

/// Slot of a limited resource; dropping it frees the slot.
struct Place<'a>(&'a AtomicUsize);

impl<'a> Place<'a> {
    /// Takes a slot, if one is free.
    fn take(count: &'a AtomicUsize, most: usize) -> Option<Self> {
        let increment = |count: usize| (count < most).then_some(count + 1);
        let order = Ordering::AcqRel;
        (count.fetch_update(order, Ordering::Acquire, increment))
            .is_ok()
            .then_some(Self(count))
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

impl Server {
    /// Starts the server, at a port that the system selects.
    ///
    /// # Errors
    /// If no port is available.
    pub(crate) fn start(source: Arc<dyn Source>) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::infrastructure(format!("error: the panel cannot be served: {error}"))
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(cannot)?;
        let address = listener.local_addr().map_err(cannot)?;
        let secret = random()?.map(|byte| format!("{byte:02x}")).concat();
        let shared = Arc::new(Shared {
            source,
            secret,
            clients: AtomicUsize::new(0),
            strangers: AtomicUsize::new(0),
            is_over: AtomicBool::new(false),
        });
        let theirs = Arc::clone(&shared);
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if theirs.is_over.load(Ordering::Acquire) {
                    return;
                }
                // Counted before a thread is started, so that a flood starts none.
                if theirs.strangers.load(Ordering::Acquire) < STRANGERS {
                    theirs.strangers.fetch_add(1, Ordering::AcqRel);
                    let shared = Arc::clone(&theirs);
                    std::thread::spawn(move || shared.serve(stream));
                }
            }
        });
        Ok(Self { shared, address })
    }

    /// Returns the address of the page, with the secret.
    pub(super) fn url(&self) -> String {
        format!("http://{}/#{}", self.address, self.shared.secret)
    }

    /// Returns the number of clients.
    pub(super) fn clients(&self) -> usize {
        self.shared.clients.load(Ordering::Acquire)
    }
}

impl Drop for Server {
    /// Notifies every client and waits a limited time for them.
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.shared.source.end();
        let _ = TcpStream::connect(self.address); // wakes the thread that listens
        let since = Instant::now();
        while self.clients() > 0 && since.elapsed() < LIMIT {
            std::thread::sleep(LOOK);
        }
    }
}

impl Shared {
    /// Serves a connection to its end; a disconnected or misbehaving peer is not an error.
    fn serve(&self, mut stream: TcpStream) {
        let place = Place(&self.strangers);
        let until = Instant::now() + LIMIT;
        let Some((request, rest)) = hear(&mut stream, until) else {
            return;
        };
        match request {
            Ok(HttpRequest::Page { host, wants_body }) => {
                let Ok(nonce) = random() else { return };
                let page = page::response(&host, &STANDARD.encode(nonce), wants_body);
                say(&mut stream, &page, until + LIMIT);
                part(&mut stream, until + LIMIT);
            }
            Ok(HttpRequest::Live { key }) => {
                let accept = derive_accept_key(key.as_bytes());
                say(&mut stream, &page::switched(&accept), until);
                self.welcome(stream, rest, until, place);
            }
            Err(refused) => {
                say(&mut stream, &page::refusal(refused), until);
                part(&mut stream, until);
            }
        }
    }

    /// Authenticates a connection and serves it as a client.
    fn welcome(&self, stream: TcpStream, rest: Vec<u8>, until: Instant, place: Place<'_>) {
        let config = WebSocketConfig::default()
            .max_message_size(Some(message::LONGEST))
            .max_frame_size(Some(message::LONGEST))
            .max_write_buffer_size(BUFFERED);
        if stream.set_nodelay(true).is_err() || stream.set_nonblocking(true).is_err() {
            return;
        }
        let role = Role::Server;
        let mut socket = WebSocket::from_partially_read(stream, rest, role, Some(config));
        let first_message = loop {
            match socket.read() {
                Ok(Message::Text(text)) => break text,
                Ok(_) => return,
                Err(tungstenite::Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {}
                Err(_) => return,
            }
            if Instant::now() > until {
                return;
            }
            std::thread::sleep(LOOK);
        };
        let greeting: Result<Greeting, _> = serde_json::from_str(&first_message);
        if !greeting.is_ok_and(|greeting| is_same(&greeting.secret, &self.secret)) {
            let _ = socket.send(message::over("the secret is wrong").into()); // the peer may be gone
            let _ = socket.close(None);
            return;
        }
        let Some(_client) = Place::take(&self.clients, CLIENTS) else {
            let reason =
                format!("{CLIENTS} pages are already open, which is the maximum; close one");
            let _ = socket.send(message::over(&reason).into()); // the peer may be gone
            let _ = socket.close(None);
            return;
        };
        drop(place);
        Arc::clone(&self.source).serve(socket);
    }
}

/// Compares in constant time, wherever the first difference is.
fn is_same(text: &str, secret: &str) -> bool {
    let pairs = text.bytes().zip(secret.bytes());
    text.len() == secret.len() && pairs.fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Reads a request and the bytes after it; `None` if none arrived in time.
fn hear(
    stream: &mut TcpStream,
    until: Instant,
) -> Option<(Result<HttpRequest, request::Refused>, Vec<u8>)> {
    let mut received = Vec::new();
    let mut bytes = [0; 2048];
    loop {
        stream.set_read_timeout(remaining(until)).ok()?;
        let count = stream.read(&mut bytes).ok().filter(|count| *count > 0)?;
        received.extend_from_slice(&bytes[..count]);
        match request::judge(&received) {
            Verdict::Incomplete => {}
            Verdict::Refused(refused) => return Some((Err(refused), Vec::new())),
            Verdict::Accepted(request, length) => {
                return Some((Ok(request), received.split_off(length)));
            }
        }
    }
}

/// Returns the remaining time, if any.
fn remaining(until: Instant) -> Option<Duration> {
    let remaining = until.saturating_duration_since(Instant::now());
    Some(remaining + Duration::from_millis(1)) // zero would mean no timeout
}

/// Sends a short response within a time limit.
fn say(stream: &mut TcpStream, mut bytes: &[u8], until: Instant) {
    while !bytes.is_empty() && Instant::now() < until {
        let _ = stream.set_write_timeout(remaining(until)); // the write reports errors
        match stream.write(bytes) {
            Ok(count @ 1..) => bytes = &bytes[count..],
            _ => return,
        }
    }
}

/// Ends a connection; reads the client's remaining data for a while, because the client could otherwise lose the
/// response.
fn part(stream: &mut TcpStream, until: Instant) {
    let _ = stream.shutdown(std::net::Shutdown::Write); // the peer may be gone
    let mut bytes = [0; 2048];
    let mut most = 64;
    while most > 0 && Instant::now() < until && stream.set_read_timeout(remaining(until)).is_ok() {
        most -= 1;
        if !matches!(stream.read(&mut bytes), Ok(1..)) {
            return;
        }
    }
}
