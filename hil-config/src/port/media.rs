//! Reader of the media of a port.

use std::net::SocketAddr;

use super::{Medium, MediumKind, Parity};
use crate::keys::MEDIA;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::title::{TITLE, is_title};

/// Reads all media; `None` if one of them is faulty.
pub(super) fn read(reader: &mut Reader, root: &Section<'_>) -> Option<Vec<Medium>> {
    let sections = reader.list(root, "media");
    let mut media: Vec<Option<Medium>> = Vec::new();
    for section in &sections {
        let medium = medium(reader, section);
        if let Some(medium) = &medium {
            let is_taken = |other: &Medium| other.name == medium.name;
            if media.iter().flatten().any(is_taken) {
                let message = format!("two media have the name `{}`", medium.name);
                reader
                    .report_at(section, "name", ProblemKind::Duplicate, message)
                    .help("give each a name, and name one of them in each frame");
            }
        }
        media.push(medium);
    }
    media.into_iter().collect()
}

fn medium(reader: &mut Reader, section: &Section<'_>) -> Option<Medium> {
    let kinds = MEDIA.iter().map(|kind| (kind.name, kind.keys));
    let (kind, own) = reader.of_kind(section, "medium", kinds)?;
    let name = reader.text(section, "name").unwrap_or(kind);
    if !is_title(name) {
        let message = format!("the medium's name is `{name}`");
        reader
            .report_at(section, "name", ProblemKind::OutOfRange, message)
            .expected(TITLE);
        return None;
    }
    let text = |reader: &mut Reader, key| reader.text(&own, key).map(String::from);
    let kind = match kind {
        "udp" => {
            let (to, listen) = addresses(reader, &own, "to")?;
            MediumKind::Udp { to, listen }
        }
        "cannelloni" => {
            let fd = reader.boolean(&own, "fd");
            let (to, listen) = addresses(reader, &own, "to")?;
            let fd = fd?;
            MediumKind::Cannelloni { to, listen, fd }
        }
        "tcp" => match addresses(reader, &own, "connect")? {
            (Some(_), Some(_)) => {
                let message = "a medium either connects or listens";
                reader.report_at(&own, "listen", ProblemKind::Mismatch, message);
                return None;
            }
            (connect, listen) => MediumKind::Tcp {
                address: connect.or(listen)?,
                listens: listen.is_some(),
            },
        },
        "unix" => {
            let path = text(reader, "path");
            let is_stream = reader.text(&own, "socket").map(|kind| kind == "stream");
            let listens = reader.boolean(&own, "listens");
            MediumKind::Unix {
                path: path?,
                is_stream: is_stream?,
                listens: listens?,
            }
        }
        "serial" => {
            let device = text(reader, "device");
            let parity = reader.text(&own, "parity").map(|parity| match parity {
                "even" => Parity::Even,
                "odd" => Parity::Odd,
                _ => Parity::None,
            });
            let baud = reader.integer(&own, "baud");
            let data_bits = reader.integer(&own, "data_bits");
            let stop_bits = reader.integer(&own, "stop_bits");
            MediumKind::Serial {
                device: device?,
                baud: u32::try_from(baud?).ok()?,
                parity: parity?,
                data_bits: u8::try_from(data_bits?).ok()?,
                stop_bits: u8::try_from(stop_bits?).ok()?,
            }
        }
        "can" => {
            let interface = text(reader, "interface");
            let fd = reader.boolean(&own, "fd");
            MediumKind::Can {
                interface: interface?,
                fd: fd?,
            }
        }
        _ => MediumKind::File {
            path: text(reader, "path")?,
        },
    };
    let name = name.into();
    Some(Medium { name, kind })
}

type Addresses = (Option<SocketAddr>, Option<SocketAddr>);

/// Reads the address of the peer under a key and the own one; at least one is needed.
fn addresses(reader: &mut Reader, own: &Section<'_>, peer: &'static str) -> Option<Addresses> {
    let mut address = |key| -> Option<Option<SocketAddr>> {
        let Some(text) = reader.text(own, key) else {
            return own.table.get(key).is_none().then_some(None);
        };
        let address = text.parse().ok();
        if address.is_none() {
            let expected = "an address and a port, as 127.0.0.1:9002 or [::1]:9002";
            reader.refuse(own, key, text, expected);
        }
        address.map(Some)
    };
    let (to, listen) = (address(peer), address("listen"));
    let (to, listen) = (to?, listen?);
    if to.is_none() && listen.is_none() {
        let path = own.path_of(peer);
        let expected = format!("an address and a port under `{peer}` or `listen`");
        reader.missing(own, &path, expected);
        return None;
    }
    Some((to, listen))
}

impl MediumKind {
    /// Returns `true` if frames have an identifier of CAN.
    #[must_use]
    pub const fn is_can(&self) -> bool {
        matches!(self, Self::Can { .. } | Self::Cannelloni { .. })
    }

    /// Returns `true` if bytes arrive without the ends of frames.
    #[must_use]
    pub const fn is_stream(&self) -> bool {
        matches!(
            self,
            Self::Tcp { .. }
                | Self::Serial { .. }
                | Self::Unix {
                    is_stream: true,
                    ..
                }
        )
    }

    /// Returns `true` if frames may have the lengths of CAN FD.
    #[must_use]
    pub const fn is_fd(&self) -> bool {
        matches!(
            self,
            Self::Can { fd: true, .. } | Self::Cannelloni { fd: true, .. }
        )
    }
}

/// Formats as `UDP to 127.0.0.1:9003, listening at 127.0.0.1:9002`.
impl std::fmt::Display for MediumKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ends = |to: &Option<SocketAddr>, listen: &Option<SocketAddr>| {
            let to = to.map(|to| format!("to {to}"));
            let listen = listen.map(|listen| format!("listening at {listen}"));
            let ends: Vec<String> = to.into_iter().chain(listen).collect();
            ends.join(", ")
        };
        let fd_text = |fd: &bool| if *fd { " FD" } else { "" };
        match self {
            Self::Udp { to, listen } => write!(f, "UDP {}", ends(to, listen)),
            Self::Tcp { address, listens } => match listens {
                true => write!(f, "TCP, listening at {address}"),
                false => write!(f, "TCP to {address}"),
            },
            Self::Unix {
                path,
                is_stream,
                listens,
            } => {
                let kind = if *is_stream { "stream" } else { "datagrams" };
                let role = if *listens {
                    "made by the port"
                } else {
                    "made by the peer"
                };
                write!(f, "UNIX socket {path}, {kind}, {role}")
            }
            Self::Serial {
                device,
                baud,
                parity,
                data_bits,
                stop_bits,
            } => {
                let parity = match parity {
                    Parity::None => 'N',
                    Parity::Even => 'E',
                    Parity::Odd => 'O',
                };
                write!(
                    f,
                    "serial line {device}, {baud} baud, {data_bits}{parity}{stop_bits}"
                )
            }
            Self::Can { interface, fd } => write!(f, "CAN{} on {interface}", fd_text(fd)),
            Self::Cannelloni { to, listen, fd } => {
                write!(f, "CAN{} by cannelloni {}", fd_text(fd), ends(to, listen))
            }
            Self::File { path } => write!(f, "file {path}"),
        }
    }
}
