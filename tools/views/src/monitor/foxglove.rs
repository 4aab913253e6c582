//! `hil monitor --foxglove`: streams the session's signals to Foxglove and other clients of its protocol.
//!
//! Observed records and events go through an [`outlet`] to every client, each on a thread of its own; [`message`]
//! encodes the protocol. Channels and schemas equal those of `run.mcap`, so a layout made for the file works live.
//! Clients are read-only: nothing they send reaches the run.
//!
//! The server never waits for a client. A slow client gets fewer records and is told how many it missed.

pub(crate) mod message;
pub(crate) mod outlet;

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_session::session::SessionInfo;
use tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tungstenite::http::{HeaderValue, StatusCode, header};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, HandshakeError, Message, WebSocket, accept_hdr_with_config};

use message::{ClientMessage, Data, asked};
use outlet::{Hub, Outlet};

/// Accepted WebSocket subprotocols.
const SUBPROTOCOLS: [&str; 2] = ["foxglove.websocket.v1", "foxglove.sdk.v1"];
/// Maximum number of clients.
const CLIENTS: usize = 8;
/// Capacity of a client's queue in messages.
const WAITING: usize = 512;
/// Time limit for a client's handshake.
const HANDSHAKE_LIMIT: Duration = Duration::from_secs(5);
/// Time limit for a client to receive the remaining messages at the end.
const END_LIMIT: Duration = Duration::from_secs(2);
/// Polling interval for messages of a client.
const LISTEN: Duration = Duration::from_millis(20);
/// Interval between two warnings to a slow client.
const TELL: Duration = Duration::from_secs(1);
/// Maximum size of a client's message in bytes.
const LONGEST: usize = 64 << 10;
/// Maximum number of bytes buffered in a client's socket.
const BUFFERED: usize = 4 << 20;

/// Running server; dropping it ends the service.
pub(crate) struct Serving {
    hub: Arc<Hub>,
    address: SocketAddr,
}

impl Serving {
    /// Starts a server at an address.
    ///
    /// # Errors
    /// If the server cannot listen at the address.
    pub(crate) fn start(
        address: SocketAddr,
        session: &SessionInfo,
        plan: &Plan,
    ) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::infrastructure(format!("error: cannot serve at {address}: {error}"))
        };
        let listener = TcpListener::bind(address).map_err(cannot)?;
        let address = listener.local_addr().map_err(cannot)?;
        let hub = Arc::new(Hub::new(message::server_info(session, &plan.name)));
        let theirs = Arc::clone(&hub);
        // Ends with the process and holds nothing but a port.
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                if !theirs.is_over() && theirs.clients() < CLIENTS {
                    let hub = Arc::clone(&theirs);
                    let client = std::thread::spawn(move || {
                        let _ = serve(stream, &hub); // a disconnected client is not an error
                    });
                    theirs.keep(client);
                }
            }
        });
        Ok(Self { hub, address })
    }

    /// Returns the address of the server.
    pub(crate) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Creates the consumer of the monitor's records, limited to `rate` records per second.
    pub(crate) fn outlet(&self, plan: &Plan, records_per_s: f64) -> Outlet {
        Outlet::new(Arc::clone(&self.hub), plan.run.rate, records_per_s)
    }
}

impl Drop for Serving {
    /// Gives clients a limited time to receive the remaining messages.
    fn drop(&mut self) {
        self.hub.end(2 * END_LIMIT);
    }
}

/// Serves one client until it disconnects or the session ends.
fn serve(stream: TcpStream, hub: &Hub) -> Result<(), Error> {
    stream.set_read_timeout(Some(HANDSHAKE_LIMIT))?;
    stream.set_write_timeout(Some(HANDSHAKE_LIMIT))?;
    stream.set_nodelay(true)?;
    let config = WebSocketConfig::default()
        .max_message_size(Some(LONGEST))
        .max_frame_size(Some(LONGEST))
        .max_write_buffer_size(BUFFERED);
    let socket = accept_hdr_with_config(stream, agree, Some(config));
    let mut socket = socket.map_err(|error| match error {
        HandshakeError::Failure(error) => error,
        HandshakeError::Interrupted(_) => Error::Io(ErrorKind::TimedOut.into()),
    })?;
    socket.get_mut().set_nonblocking(true)?;
    let (sender, queue) = sync_channel(WAITING);
    let missed = hub.join(sender);
    let mut client = Client {
        socket,
        subscriptions: Vec::new(),
        left_out: 0,
    };
    client.say(hub.server_info().to_owned().into())?;
    let mut knows_channels = false;
    let mut told_at = Instant::now();
    loop {
        if let (false, Some(channels)) = (knows_channels, hub.channels()) {
            client.say(channels.to_owned().into())?;
            knows_channels = true;
        }
        client.listen(hub)?;
        let is_over = client.pass_on(&queue)?;
        client.left_out += missed.swap(0, Ordering::Relaxed);
        if client.left_out > 0 && told_at.elapsed() > TELL {
            let warning = message::left_out(std::mem::take(&mut client.left_out));
            client.say(warning.into())?;
            told_at = Instant::now();
        }
        client.flush()?;
        if is_over {
            return client.part(hub);
        }
    }
}

/// Selects the first subprotocol of the client's list that the server supports.
#[expect(
    clippy::result_large_err,
    reason = "the form that the library asks for"
)]
fn agree(request: &Request, mut response: Response) -> Result<Response, ErrorResponse> {
    let offers = request.headers().get_all(header::SEC_WEBSOCKET_PROTOCOL);
    let mut offers = offers.iter().filter_map(|value| value.to_str().ok());
    let spoken = offers.find_map(|list| {
        let mut names = list.split(',').map(str::trim);
        names.find_map(|name| SUBPROTOCOLS.into_iter().find(|spoken| *spoken == name))
    });
    match spoken {
        Some(spoken) => {
            let value = HeaderValue::from_static(spoken);
            let headers = response.headers_mut();
            headers.insert(header::SEC_WEBSOCKET_PROTOCOL, value);
            Ok(response)
        }
        None => {
            let reason = format!("the subprotocols are {}\n", SUBPROTOCOLS.join(", "));
            let mut error = ErrorResponse::new(Some(reason));
            *error.status_mut() = StatusCode::BAD_REQUEST;
            Err(error)
        }
    }
}

/// Connected client.
struct Client {
    socket: WebSocket<TcpStream>,
    /// Subscription and channel numbers.
    subscriptions: Vec<(u32, u64)>,
    /// Messages dropped because the client was too slow.
    left_out: u64,
}

impl Client {
    /// Sends a message now or as soon as the socket accepts it; drops it if too much is buffered.
    fn say(&mut self, message: Message) -> Result<(), Error> {
        match self.socket.write(message) {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            Err(Error::WriteBufferFull(_)) => {
                self.left_out += 1;
                Ok(())
            }
            other => other,
        }
    }

    fn flush(&mut self) -> Result<(), Error> {
        match self.socket.flush() {
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => Ok(()),
            other => other,
        }
    }

    /// Handles the client's messages.
    fn listen(&mut self, hub: &Hub) -> Result<(), Error> {
        loop {
            let text = match self.socket.read() {
                Ok(Message::Text(text)) => text,
                Ok(_) => continue,
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            };
            match asked(&text) {
                ClientMessage::Subscribe(subscriptions) => self.subscribe(subscriptions, hub)?,
                ClientMessage::Unsubscribe(ids) => {
                    self.subscriptions.retain(|(id, _)| !ids.contains(id));
                }
                ClientMessage::Other(what) => self.say(message::refused(&what).into())?,
            }
        }
    }

    fn subscribe(&mut self, subscriptions: Vec<(u32, u64)>, hub: &Hub) -> Result<(), Error> {
        for (id, channel) in subscriptions {
            let is_new = self
                .subscriptions
                .iter()
                .all(|(existing, _)| *existing != id);
            if is_new && hub.channels().is_some() && message::is_channel(channel) {
                self.subscriptions.push((id, channel));
            } else {
                let request = format!("subscription {id} of channel {channel}");
                self.say(message::refused(&request).into())?;
            }
        }
        Ok(())
    }

    /// Forwards queued messages until the queue is empty. Returns `true` at the end of the stream.
    fn pass_on(&mut self, queue: &Receiver<Arc<Data>>) -> Result<bool, Error> {
        let mut next = match queue.recv_timeout(LISTEN) {
            Ok(data) => Some(data),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return Ok(true),
        };
        // Bounded, so that the client's messages are read too.
        let mut budget = WAITING;
        while let Some(data) = next {
            for at in 0..self.subscriptions.len() {
                let (id, channel) = self.subscriptions[at];
                if channel == data.channel {
                    self.say(message::data(id, &data).into())?;
                }
            }
            budget -= 1;
            next = if budget > 0 {
                queue.try_recv().ok()
            } else {
                None
            };
        }
        Ok(false)
    }

    /// Announces the end and waits a limited time for the client to receive it.
    fn part(&mut self, hub: &Hub) -> Result<(), Error> {
        self.say(message::ended(&hub.last_word()).into())?;
        let _ = self.socket.close(None); // the rest is flushed below
        let since = Instant::now();
        while since.elapsed() < END_LIMIT {
            self.flush()?;
            self.listen(hub)?;
            std::thread::sleep(LISTEN);
        }
        Ok(())
    }
}
