//! Listening agent for boards without `ssh`: any desk with the key may run one of the listed programs, one session
//! at a time.
//!
//! A single thread greets all contacts concurrently, even during a session. A contact that has proved that it has the key
//! gets a thread, on which it waits for its turn.

mod greetings;
mod refusals;
mod turn;

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use rustix::time::Timespec;

use crate::agent;
use crate::key::{no_handshake, read_key};
use crate::programs::AllowedPrograms;
use crate::seal::{Key, Seal};
use greetings::{Greeting, Places, Refused};
use refusals::{Refusals, Source};
use turn::Turn;

/// Maximum number of contacts accepted before those in progress are read: far fewer than there are slots, so that each
/// contact is read several times before others can replace it.
const MOST_AT_ONCE: usize = 16;
/// Time to wait before accepting again, after a failure to open a file.
const RETRY: Duration = Duration::from_millis(100);

/// Serves one desk after another, forever.
///
/// # Errors
/// If the agent cannot listen at the address, the key is invalid, or a listed program cannot be read or is not
/// executable.
pub fn serve(
    listen: SocketAddr,
    key_file: &Path,
    allowed: &[PathBuf],
    say: impl Fn(&str) + Sync,
) -> Result<(), String> {
    let key = read_key(key_file).map_err(|error| error.to_string())?;
    let programs = AllowedPrograms::listed(allowed)?;
    let cannot = |error: io::Error| format!("cannot listen on {listen}: {error}");
    let listener = TcpListener::bind(listen).map_err(cannot)?;
    listener.set_nonblocking(true).map_err(cannot)?;
    let at = listener.local_addr().map_err(cannot)?;
    say(&format!("listening on {at}"));
    let turn = Turn::default();
    let mut reception = Reception {
        listener,
        key,
        places: Places::default(),
        refusals: Refusals::default(),
        retry: None,
    };
    std::thread::scope(|scope| {
        loop {
            reception.sleep();
            let (greeted, lines) = reception.receive(Instant::now());
            for line in lines {
                say(&line);
            }
            for (connection, seal) in greeted {
                let (turn, say, programs) = (&turn, &say, &programs);
                let session = move || session(connection, seal, programs, turn, say);
                let thread = std::thread::Builder::new().spawn_scoped(scope, session);
                if let Err(error) = thread {
                    say(&format!("cannot start a session: {error}"));
                }
            }
        }
    })
}

/// Acceptance and greeting of contacts.
struct Reception {
    listener: TcpListener,
    key: Key,
    places: Places<Greeting>,
    refusals: Refusals,
    /// Time of the next attempt, after a failure to accept.
    retry: Option<Instant>,
}

impl Reception {
    /// Sleeps until a contact sends something or a deadline is due.
    fn sleep(&self) {
        let due = [self.places.next(), self.refusals.next(), self.retry];
        let due = due.into_iter().flatten().min();
        let limit = due.map(|due| due.saturating_duration_since(Instant::now()));
        // Slightly longer, so that everything due at that time is over.
        let limit = limit.map(|limit| limit + Duration::from_millis(1));
        let limit = limit.and_then(|limit| Timespec::try_from(limit).ok());
        // Data, a timeout and a signal are all handled by polling again.
        let _ = poll(&mut self.watched(), limit.as_ref());
    }

    /// Returns the connections in order, followed by the listener.
    fn watched(&self) -> Vec<PollFd<'_>> {
        let connections = self.places.connections();
        let watched = connections.map(|connection| PollFd::new(connection, PollFlags::IN));
        let listener = self.retry.is_none().then_some(&self.listener);
        let listener = listener.map(|listener| PollFd::new(listener, PollFlags::IN));
        watched.chain(listener).collect()
    }

    /// Reads and accepts contacts; returns those that have the key, and lines for the log.
    fn receive(&mut self, now: Instant) -> (Vec<(TcpStream, Seal)>, Vec<String>) {
        let mut lines = self.refusals.due(now);
        self.retry.take_if(|retry| *retry <= now);
        // Existing contacts are read before others can take their slots.
        let mut greeted = self.hear(now, &mut lines);
        for _ in 0..MOST_AT_ONCE {
            let (connection, address) = match self.listener.accept() {
                Ok(contact) => contact,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => continue,
                Err(_) => {
                    self.retry = Some(now + RETRY);
                    break;
                }
            };
            let source = Source::of(address.ip());
            let refused = match Greeting::begin(connection) {
                Ok(greeting) => self.places.greet((source, greeting), now),
                Err(error) => Some((source, error)),
            };
            lines.extend(refused.and_then(|refused| self.refuse(&refused, now)));
        }
        // Data that a contact sent at once has arrived by now.
        greeted.extend(self.hear(now, &mut lines));
        (greeted, lines)
    }

    fn hear(&mut self, now: Instant, lines: &mut Vec<String>) -> Vec<(TcpStream, Seal)> {
        let at_once = Timespec::default();
        let mut watched = self.watched();
        let count = poll(&mut watched, Some(&at_once)).unwrap_or(0);
        let news: Vec<bool> = (watched.iter())
            .map(|one| count > 0 && !one.revents().is_empty())
            .collect();
        let has_news = |number: usize| news.get(number).copied().unwrap_or(false);
        let (greeted, refused) = self.places.hear(has_news, &self.key, now);
        lines.extend(refused.iter().filter_map(|one| self.refuse(one, now)));
        greeted
    }

    fn refuse(&mut self, (source, error): &Refused, now: Instant) -> Option<String> {
        let reason = match error.kind() {
            io::ErrorKind::ResourceBusy => error.to_string(),
            _ => no_handshake(error, greetings::LIMIT, ""),
        };
        self.refusals.add(*source, &reason, now)
    }
}

/// Serves a desk that has the key, once it is the desk's turn.
fn session(
    connection: TcpStream,
    seal: Seal,
    programs: &AllowedPrograms,
    turn: &Turn,
    say: &(impl Fn(&str) + Sync),
) {
    let serve = || -> Result<(), String> {
        let described = |error: io::Error| error.to_string();
        let from = connection.peer_addr().map_err(described)?;
        let address = connection.local_addr().map_err(described)?.ip();
        let reader = connection.try_clone().map_err(described)?;
        let writer = connection.try_clone().map_err(described)?;
        // Held until the end of the session is logged.
        let mut turn_guard = None;
        let admit = || {
            turn_guard = Some(turn.take(from)?);
            say(&format!("{from}: a session begins"));
            Ok(())
        };
        let seal = Some(Arc::new(seal));
        let runs = |is_run| turn.runs(is_run);
        let ended = agent::run((reader, writer), seal, programs, Some(address), admit, runs);
        say(&match ended {
            Ok(()) => format!("{from}: the session has ended"),
            Err(reason) => format!("{from}: the session has ended: {reason}"),
        });
        Ok(())
    };
    if let Err(reason) = serve() {
        say(&format!("a session failed: {reason}"));
    }
    let _ = connection.shutdown(std::net::Shutdown::Both); // it may be closed already
}
