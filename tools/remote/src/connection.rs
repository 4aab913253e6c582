//! Connection to a listening agent.

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::channel::{Ear, Mouth};
use crate::key::{Until, get, no_handshake, prologue, prove, put, read_key};
use crate::leash::Leash;
use crate::message::ToDesk;
use crate::seal::{Seal, begin};
use crate::way::{TargetError, Way};

/// Time limit for a connection.
const CONNECT: Duration = Duration::from_secs(10);

/// Connects to a listening agent.
pub(crate) fn connect(
    way: &Way,
    address: &str,
    ring: Box<dyn Fn() + Send>,
) -> Result<(Ear<ToDesk>, Mouth, Leash), TargetError> {
    let Some(key_file) = &way.key_file else {
        return Err(way.usage("a listening agent needs its key; pass it with --key-file FILE"));
    };
    let key = read_key(key_file).map_err(|error| way.usage(error))?;
    // Before the connection is made: an agent under many contacts gives a silent one little time.
    let begun = begin(&key, &prologue()).map_err(|error| way.infrastructure(error));
    let (begun, first) = begun?;
    let addresses =
        (address.to_socket_addrs()).map_err(|error| way.usage(format!("unknown host: {error}")))?;
    let mut connection = Err(way.usage("unknown host"));
    // A name may have IPv4 and IPv6 addresses, and the agent listens on one.
    for address in addresses {
        connection = TcpStream::connect_timeout(&address, CONNECT)
            .map_err(|error| way.infrastructure(error));
        if connection.is_ok() {
            break;
        }
    }
    let connection = connection?;
    let limit = CONNECT.min(way.silence);
    let hands = || -> io::Result<Seal> {
        let mut connection = &connection;
        let deadline = Instant::now() + limit;
        connection.set_nodelay(true)?;
        connection.set_write_timeout(Some(limit))?;
        put(&mut connection, &first)?;
        let seal = begun
            .end(&get(&mut Until(connection, deadline))?)
            .map_err(io::Error::other)?;
        prove(&mut connection, &seal)?;
        connection.set_read_timeout(None)?;
        connection.set_write_timeout(None)?;
        Ok(seal)
    };
    let seal = hands().map_err(|error| {
        let silence = ": no agent answers at this address";
        way.infrastructure(no_handshake(&error, limit, silence))
    })?;
    let seal = Arc::new(seal);
    let cannot = |error: io::Error| way.infrastructure(error);
    let ear = Ear::listen(
        connection.try_clone().map_err(cannot)?,
        Some(seal.clone()),
        ring,
    );
    let mouth = Mouth::speak(connection.try_clone().map_err(cannot)?, Some(seal));
    Ok((ear, mouth, Leash::Connection(connection)))
}
