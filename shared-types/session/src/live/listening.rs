//! Server side: a socket of a session, served on its own thread, with one line of JSON in each direction.

use std::convert::Infallible;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use rustix::net::{Shutdown, shutdown};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::session::SessionInfo;
use shared_types::live::Refusal;

/// Time that a client may take to send its line or to read the response.
const CLIENT_LIMIT: Duration = Duration::from_secs(1);
/// Total time for the clients that connected before the end.
const END_LIMIT: Duration = Duration::from_secs(1);
/// Delay before the next attempt after a failed accept.
const RETRY: Duration = Duration::from_millis(10);
/// Maximum length of a request in bytes.
const LONGEST: u64 = 1 << 20;

/// Socket of a session, served until this value is dropped. Clients that connected earlier are still answered, within a
/// second.
#[derive(Debug)]
pub struct Listening {
    listener: Arc<UnixListener>,
    over: Arc<AtomicBool>,
    /// Disconnected at the end of the thread.
    served: Receiver<Infallible>,
}

/// Listens on a socket of a session, on a thread that serves one client after another.
///
/// # Errors
/// If the socket cannot be created.
pub fn listen(
    session: &SessionInfo,
    socket: &str,
    mut serve: impl FnMut(&UnixStream) + Send + 'static,
) -> Result<Listening, String> {
    let path = session.folder.join(socket);
    let listener = UnixListener::bind(&path)
        .map_err(|error| format!("cannot listen on {}: {error}", path.display()))?;
    let listening = Arc::new(listener);
    let over = Arc::new(AtomicBool::new(false));
    let (serving, served) = channel();
    let (listener, is_over) = (Arc::clone(&listening), Arc::clone(&over));
    std::thread::spawn(move || {
        let _serving: Sender<Infallible> = serving;
        loop {
            match listener.accept() {
                Ok((client, _)) => serve(&client),
                // No client is waiting, and none can connect any more.
                Err(_) if is_over.load(Ordering::Acquire) => return,
                Err(_) => std::thread::sleep(RETRY), // no descriptor was left
            }
        }
    });
    Ok(Listening {
        listener: listening,
        over,
        served,
    })
}

impl Drop for Listening {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
        // Wakes the thread after it has accepted the waiting clients; the kernel refuses all others.
        if shutdown(&*self.listener, Shutdown::Both).is_ok() {
            let _ = self.served.recv_timeout(END_LIMIT); // one who takes longer goes without an answer
        }
    }
}

/// Answers one client of a socket: one line of JSON in each direction. The client's line may be an invalid request.
///
/// # Errors
/// If the client has gone or is too slow.
pub fn answer<Q: DeserializeOwned, A: Serialize>(
    mut client: &UnixStream,
    respond: impl FnOnce(Result<Q, Refusal>) -> A,
) -> std::io::Result<()> {
    client.set_read_timeout(Some(CLIENT_LIMIT))?;
    client.set_write_timeout(Some(CLIENT_LIMIT))?;
    let mut line = String::new();
    BufReader::new(client.take(LONGEST)).read_line(&mut line)?;
    let request = serde_json::from_str(&line)
        .map_err(|error| Refusal::new(format!("not a request: {error}")));
    let mut answer = serde_json::to_vec(&respond(request))?;
    answer.push(b'\n');
    client.write_all(&answer)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU32;

    use super::*;
    use crate::session::Session;

    #[test]
    fn clients_that_connected_before_the_end_are_answered_and_later_ones_are_refused() {
        let session = Session::of_one_process(None).expect("a session");
        let (start, begins) = channel();
        let (go, may_go) = channel::<()>();
        let count = Arc::new(AtomicU32::new(0));
        let answers = Arc::clone(&count);
        let listening = listen(session.info(), "test", move |mut client| {
            let _ = start.send(());
            let _ = may_go.recv();
            client.write_all(b"yes\n").expect("a connected client");
            answers.fetch_add(1, Ordering::Relaxed);
        });
        let listening = listening.expect("listens");
        let path = session.info().folder.join("test");
        let connect = || UnixStream::connect(&path);
        let clients = [connect(), connect()];
        begins.recv().expect("the first is being served");
        let ending = std::thread::spawn(move || {
            drop(listening);
            count.load(Ordering::Relaxed)
        });
        // Closed at once, or each would be served too.
        while let Ok(late) = connect() {
            drop(late);
            std::thread::yield_now();
        }
        for _ in &clients {
            go.send(()).expect("it waits");
        }
        drop(go); // whoever else was accepted
        assert!(ending.join().expect("ends") >= 2);
        for client in clients {
            let mut answer = String::new();
            let mut client = client.expect("it listens");
            client.read_to_string(&mut answer).expect("an answer");
            assert_eq!(answer, "yes\n");
        }
    }

    #[test]
    fn a_silent_client_does_not_block_the_end() {
        let session = Session::of_one_process(None).expect("a session");
        let (start, begins) = channel();
        let (hold, released) = channel::<()>();
        let listening = listen(session.info(), "test", move |_| {
            let _ = start.send(());
            let _ = released.recv();
        });
        let listening = listening.expect("listens");
        let client = UnixStream::connect(session.info().folder.join("test"));
        begins.recv().expect("it is being served");
        drop(listening);
        drop((client, hold));
    }
}
