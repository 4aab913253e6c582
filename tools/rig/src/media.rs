//! Media of a port: the sockets on which frames travel. Nothing here knows a signal.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use hil_config::port::{Medium, MediumKind, Port};

/// Socket of a medium.
#[derive(Debug)]
pub struct Socket {
    /// Name of the medium.
    pub name: String,
    /// Socket.
    pub socket: UdpSocket,
    /// Address of the peer; `None` until the peer has sent something.
    pub peer: Option<SocketAddr>,
    /// `true` if frames of another sender than the peer are refused.
    is_bound_to_peer: bool,
}

impl Socket {
    /// Opens a medium.
    ///
    /// # Errors
    /// If the medium is of another kind, or the address is taken or not of this machine.
    pub fn open(medium: &Medium) -> Result<Self, String> {
        let name = medium.name.clone();
        let MediumKind::Udp { to, listen } = medium.kind else {
            return Err(format!(
                "medium `{name}` is {}, and a port in front of a plant has UDP only in this version; put a relay in front of it",
                medium.kind
            ));
        };
        let any = match to {
            Some(SocketAddr::V6(_)) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
            _ => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
        };
        let own = listen.unwrap_or(any);
        let cannot = |error: io::Error| match error.kind() {
            ErrorKind::AddrInUse => format!(
                "medium `{name}`: {own} is in use by another program; end it, or change `listen`"
            ),
            _ => format!("medium `{name}`: cannot listen at {own}: {error}"),
        };
        let socket = UdpSocket::bind(own).map_err(cannot)?;
        socket.set_nonblocking(true).map_err(cannot)?;
        Ok(Self {
            name,
            socket,
            peer: to,
            is_bound_to_peer: false,
        })
    }

    /// Receives one datagram; `None` if there is none. The flag is `true` if the peer sent it, which is by address, or
    /// for an unknown peer the first sender.
    pub fn receive(&mut self, buffer: &mut [u8]) -> Option<(usize, bool)> {
        // A refused connection of an earlier send is reported here; the peer is silent then, and nothing else.
        for _ in 0..2 {
            match self.socket.recv_from(buffer) {
                Ok((length, from)) => {
                    let is_peer = match self.peer {
                        None => true,
                        Some(peer) if self.is_bound_to_peer => peer == from,
                        Some(peer) => peer.ip() == from.ip(),
                    };
                    if self.peer.is_none() {
                        (self.peer, self.is_bound_to_peer) = (Some(from), true);
                    }
                    return Some((length, is_peer));
                }
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => {}
                Err(_) => return None,
            }
        }
        None
    }

    /// Sends a frame. A failure is the silence of the peer, which the run sees by its signals.
    pub fn send(&self, bytes: &[u8]) {
        if let Some(peer) = self.peer {
            let _ = self.socket.send_to(bytes, peer);
        }
    }
}

/// Lists the media whose other end may be a program on this machine.
#[must_use]
pub fn simulated(port: &Port) -> Vec<String> {
    let media = port.media.iter();
    let here = media.filter(|medium| match &medium.kind {
        MediumKind::Udp { to, .. } | MediumKind::Cannelloni { to, .. } => {
            to.is_none_or(|to| is_here(to.ip()))
        }
        MediumKind::Tcp { address, listens } => *listens || is_here(address.ip()),
        MediumKind::Unix { .. } => true,
        // A pair of pseudo-terminals is a program.
        MediumKind::Serial { device, .. } => {
            std::fs::canonicalize(device).map_or(true, |device| device.starts_with("/dev/pts"))
        }
        // Only a card has a device.
        MediumKind::Can { interface, .. } => {
            !std::path::Path::new(&format!("/sys/class/net/{interface}/device")).exists()
        }
        MediumKind::File { path } => std::fs::canonicalize(path).map_or(true, |path| {
            !["/sys", "/dev"].iter().any(|root| path.starts_with(root))
        }),
    });
    here.map(|medium| medium.name.clone()).collect()
}

/// Returns `true` if an address belongs to this machine: only then a socket can have it.
fn is_here(address: IpAddr) -> bool {
    address.is_loopback() || UdpSocket::bind((address, 0)).is_ok()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn port(media: &str) -> Port {
        let text = format!(
            "port = 1\n{media}\n[[frames]]\nname = \"a\"\ncarries = \"sample\"\nfields = [{{ signal = \"measured.x\", type = \"f64\" }}]\n"
        );
        Port::parse(&text, Path::new("a.port.toml"), None).expect("a port")
    }

    #[test]
    fn a_peer_on_this_machine_counts_as_simulated_and_another_one_does_not() {
        let udp = |keys: &str| port(&format!("[[media]]\nkind = \"udp\"\n{keys}"));
        for local in [
            "to = \"127.0.0.1:9000\"",
            "listen = \"0.0.0.0:0\"",
            "to = \"[::1]:9\"",
        ] {
            assert_eq!(simulated(&udp(local)), ["udp"], "{local}");
        }
        // Addresses of documentation (RFC 5737) belong to nobody.
        assert!(simulated(&udp("to = \"192.0.2.7:9000\"")).is_empty());
        let unix = port("[[media]]\nkind = \"unix\"\npath = \"/tmp/a\"");
        assert_eq!(simulated(&unix), ["unix"]);
    }

    #[test]
    fn a_second_sender_is_not_the_peer() {
        let port = port("[[media]]\nkind = \"udp\"\nlisten = \"127.0.0.1:0\"");
        let mut socket = Socket::open(&port.media[0]).expect("open");
        let own = socket.socket.local_addr().expect("an address");
        let [first, second] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").expect("a socket"));
        let mut buffer = [0; 16];
        for (sender, is_peer) in [(&first, true), (&second, false), (&first, true)] {
            sender.send_to(b"abc", own).expect("sent");
            assert_eq!(socket.receive(&mut buffer), Some((3, is_peer)));
        }
        socket.send(b"back");
        assert_eq!(first.recv(&mut buffer).expect("received"), 4);
    }

    #[test]
    fn an_address_in_use_is_named() {
        let taken = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let address = taken.local_addr().expect("an address");
        let port = port(&format!(
            "[[media]]\nkind = \"udp\"\nlisten = \"{address}\""
        ));
        let error = Socket::open(&port.media[0]).expect_err("in use");
        assert!(
            error.contains(&address.to_string()) && error.contains("in use"),
            "{error}"
        );
    }
}
