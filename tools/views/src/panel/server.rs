//! The server of the page, on this machine alone: who may connect, how many, and for how long.
//!
//! Each connection has a thread of its own, which never holds up the thread that watches the session: it looks at
//! the [model](crate::monitor::model) when its page can take something. Strangers have a few seconds and
//! some bytes; clients, who know the secret, are served by [`client`](super::client).

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

use super::board::Board;
use super::client::Client;
use super::message::{self, Greeting};
use super::page;
use super::request::{self, Asked, Judged};

/// Most clients at a time.
pub(super) const CLIENTS: usize = 8;
/// Most connections at a time of those who have not shown the secret.
const STRANGERS: usize = 24;
/// Limit for a request, for its answer, and for the secret.
const LIMIT: Duration = Duration::from_secs(5);
/// Interval between two looks for something that is awaited.
const LOOK: Duration = Duration::from_millis(10);
/// Most bytes that wait for a client.
const BUFFERED: usize = 4 << 20;

/// Random bytes of the system.
fn random() -> Result<[u8; 16], Failure> {
    let mut bytes = [0; 16];
    let mut filled = 0;
    while filled < bytes.len() {
        filled += getrandom(&mut bytes[filled..], GetRandomFlags::empty())
            .map_err(Failure::infrastructure)?;
    }
    Ok(bytes)
}

/// The server, as long as it is kept.
pub(crate) struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
}

/// State that all connections share.
struct Shared {
    board: Arc<Board>,
    secret: String,
    clients: AtomicUsize,
    strangers: AtomicUsize,
    is_over: AtomicBool,
}

/// A place among N, until it is dropped.
struct Place<'a>(&'a AtomicUsize);

impl<'a> Place<'a> {
    /// Takes a place, if there is one.
    fn take(count: &'a AtomicUsize, most: usize) -> Option<Self> {
        let taken = |count: usize| (count < most).then_some(count + 1);
        let order = Ordering::AcqRel;
        (count.fetch_update(order, Ordering::Acquire, taken))
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
    /// Serves from now on, at a port that the system chooses.
    ///
    /// # Errors
    /// If no port can be had.
    pub(crate) fn start(board: Arc<Board>) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::infrastructure(format!("error: the panel cannot be served: {error}"))
        };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(cannot)?;
        let address = listener.local_addr().map_err(cannot)?;
        let secret = random()?.map(|byte| format!("{byte:02x}")).concat();
        let shared = Arc::new(Shared {
            board,
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
                // Counted here, so that a flood starts no threads.
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
    /// Every client is told, and given a while to hear it.
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.shared.board.end();
        let _ = TcpStream::connect(self.address); // wakes the thread that listens
        let since = Instant::now();
        while self.clients() > 0 && since.elapsed() < LIMIT {
            std::thread::sleep(LOOK);
        }
    }
}

impl Shared {
    /// Serves a connection to its end; one that went away or broke the rules needs no word.
    fn serve(&self, mut stream: TcpStream) {
        let place = Place(&self.strangers);
        let until = Instant::now() + LIMIT;
        let Some((asked, rest)) = hear(&mut stream, until) else {
            return;
        };
        match asked {
            Ok(Asked::Page { host, wants_body }) => {
                let Ok(nonce) = random() else { return };
                let page = page::response(&host, &STANDARD.encode(nonce), wants_body);
                say(&mut stream, &page, until + LIMIT);
                part(&mut stream, until + LIMIT);
            }
            Ok(Asked::Live { key }) => {
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

    /// Makes a client of one who knows the secret.
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
        let said = loop {
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
        let greeting: Result<Greeting, _> = serde_json::from_str(&said);
        if !greeting.is_ok_and(|greeting| is_same(&greeting.secret, &self.secret)) {
            let _ = socket.send(message::over("the secret is wrong").into()); // it may be gone
            let _ = socket.close(None);
            return;
        }
        let Some(_client) = Place::take(&self.clients, CLIENTS) else {
            let told = format!("{CLIENTS} pages are open, which is as many as there may be");
            let _ = socket.send(message::over(&told).into()); // it may be gone
            let _ = socket.close(None);
            return;
        };
        drop(place);
        let _ = Client::new(socket, &self.board).serve(); // one that went away needs no word
    }
}

/// Compares in a time that says nothing of the place where they differ.
fn is_same(said: &str, secret: &str) -> bool {
    let pairs = said.bytes().zip(secret.bytes());
    said.len() == secret.len() && pairs.fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Hears a request, and what came behind it; `None` if none came in time.
fn hear(
    stream: &mut TcpStream,
    until: Instant,
) -> Option<(Result<Asked, request::Refused>, Vec<u8>)> {
    let mut heard = Vec::new();
    let mut bytes = [0; 2048];
    loop {
        stream.set_read_timeout(left(until)).ok()?;
        let count = stream.read(&mut bytes).ok().filter(|count| *count > 0)?;
        heard.extend_from_slice(&bytes[..count]);
        match request::judge(&heard) {
            Judged::Incomplete => {}
            Judged::Refused(refused) => return Some((Err(refused), Vec::new())),
            Judged::Asked(asked, length) => return Some((Ok(asked), heard.split_off(length))),
        }
    }
}

/// The time that is left, if any is.
fn left(until: Instant) -> Option<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    Some(left + Duration::from_millis(1)) // none would be no limit
}

/// Sends what is short, in a limited time.
fn say(stream: &mut TcpStream, mut bytes: &[u8], until: Instant) {
    while !bytes.is_empty() && Instant::now() < until {
        let _ = stream.set_write_timeout(left(until)); // told by the write
        match stream.write(bytes) {
            Ok(count @ 1..) => bytes = &bytes[count..],
            _ => return,
        }
    }
}

/// Ends a connection; what the client still says is read for a while, or it would lose the answer.
fn part(stream: &mut TcpStream, until: Instant) {
    let _ = stream.shutdown(std::net::Shutdown::Write); // it may be gone
    let mut bytes = [0; 2048];
    let mut most = 64;
    while most > 0 && Instant::now() < until && stream.set_read_timeout(left(until)).is_ok() {
        most -= 1;
        if !matches!(stream.read(&mut bytes), Ok(1..)) {
            return;
        }
    }
}
