//! An agent that listens, for boards without `ssh`: whoever has the key may have one of the listed programs run,
//! one session at a time.

use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::agent;
use crate::key::{Until, get, no_handshake, prologue, put, read_key, see_proof};
use crate::programs::AllowedPrograms;
use crate::seal::{Key, Seal, answer};

/// Longest time that a handshake may take: a stranger who says nothing holds the place no longer.
const HANDSHAKE: Duration = Duration::from_secs(2);

/// Serves one desk after another, for ever.
///
/// # Errors
/// If the address cannot be listened on, the key is none, or a listed program cannot be read or is none.
pub fn serve(
    listen: SocketAddr,
    key_file: &Path,
    allowed: &[PathBuf],
    say: impl Fn(&str),
) -> Result<(), String> {
    let key = read_key(key_file).map_err(|error| error.to_string())?;
    let programs = AllowedPrograms::listed(allowed)?;
    let listener =
        TcpListener::bind(listen).map_err(|error| format!("cannot listen on {listen}: {error}"))?;
    let at = listener.local_addr().map_err(|error| error.to_string())?;
    say(&format!("listening on {at}"));
    for connection in listener.incoming() {
        let Ok(connection) = connection else {
            std::thread::sleep(Duration::from_millis(100)); // no file to be had, and nobody else to wait for
            continue;
        };
        let from = connection
            .peer_addr()
            .map_or_else(|_| "somebody".into(), |address| address.to_string());
        match greet(&connection, &key) {
            Ok(seal) => {
                say(&format!("{from}: a session begins"));
                let seal = Arc::new(seal);
                let ended = session(connection, &seal, &programs);
                say(&match ended {
                    Ok(()) => format!("{from}: the session has ended"),
                    Err(why) => format!("{from}: the session has ended: {why}"),
                });
            }
            Err(error) => say(&format!(
                "{from}: refused: {}",
                no_handshake(&error, HANDSHAKE, "")
            )),
        }
    }
    Ok(())
}

fn greet(mut connection: &TcpStream, key: &Key) -> io::Result<Seal> {
    connection.set_nodelay(true)?;
    let mut from = Until(connection, Instant::now() + HANDSHAKE);
    connection.set_write_timeout(Some(HANDSHAKE))?;
    let first = get(&mut from)?;
    let (seal, second) = answer(key, &prologue(), &first).map_err(io::Error::other)?;
    put(&mut connection, &second)?;
    see_proof(&mut from, &seal)?;
    connection.set_read_timeout(None)?;
    connection.set_write_timeout(None)?;
    Ok(seal)
}

fn session(
    connection: TcpStream,
    seal: &Arc<Seal>,
    programs: &AllowedPrograms,
) -> Result<(), String> {
    let told = |error: io::Error| error.to_string();
    let address = connection.local_addr().map_err(told)?.ip();
    let reader = connection.try_clone().map_err(told)?;
    let writer = connection.try_clone().map_err(told)?;
    let ended = agent::run(reader, writer, Some(seal.clone()), programs, Some(address));
    let _ = connection.shutdown(std::net::Shutdown::Both); // it may be closed by now
    ended
}
