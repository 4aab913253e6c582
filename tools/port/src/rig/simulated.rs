//! Parts of a wire that may be simulated on this machine, which decides on the evidence of a run.

use std::net::{IpAddr, UdpSocket};
use std::path::Path;

use hil_config::port::{MediumKind, Port};

/// Name under which a program stands that the port starts.
const START: &str = "start";

/// Lists the media of a port, whose paths are relative to a folder, of which the other end may be a program on this
/// machine, and `start` if the port starts one.
#[must_use]
pub fn simulated(port: &Port, folder: &Path) -> Vec<String> {
    let media = port.media.iter();
    let media = media.filter(|medium| may_be_simulated(&medium.kind, folder));
    let start = (!port.start.command.is_empty()).then_some(START);
    media
        .map(|medium| medium.name.clone())
        .chain(start.map(str::to_owned))
        .collect()
}

fn may_be_simulated(kind: &MediumKind, folder: &Path) -> bool {
    let real = |path: &str| std::fs::canonicalize(folder.join(path)).ok();
    match kind {
        MediumKind::Udp { to, .. } | MediumKind::Cannelloni { to, .. } => {
            to.is_none_or(|to| is_here(to.ip()))
        }
        MediumKind::Tcp { address, listens } => *listens || is_here(address.ip()),
        MediumKind::Unix { .. } => true,
        // A pair of pseudo-terminals is a program.
        MediumKind::Serial { device, .. } => {
            real(device).is_none_or(|path| path.starts_with("/dev/pts"))
        }
        // Only a card has a device.
        MediumKind::Can { interface, .. } => {
            !Path::new(&format!("/sys/class/net/{interface}/device")).exists()
        }
        MediumKind::File { path } => real(path)
            .is_none_or(|path| !["/sys", "/dev"].iter().any(|root| path.starts_with(root))),
    }
}

/// Returns `true` if an address belongs to this machine: only then a socket can have it.
fn is_here(address: IpAddr) -> bool {
    address.is_loopback() || UdpSocket::bind((address, 0)).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lists the simulated parts of a port with one medium.
    fn of(medium: &str) -> Vec<String> {
        let text = format!(
            "port = 1\n{medium}\n[[frames]]\nname = \"a\"\ncarries = \"sample\"\nfields = [{{ signal = \"measured.x\", type = \"f64\" }}]\n"
        );
        let port = Port::parse(&text, Path::new("a.port.toml"), None).expect("a port");
        simulated(&port, Path::new("/dev"))
    }

    #[test]
    fn a_peer_on_this_machine_counts_as_simulated_and_another_one_does_not() {
        let udp = |keys: &str| of(&format!("[[media]]\nkind = \"udp\"\n{keys}"));
        for local in [
            "to = \"127.0.0.1:9000\"",
            "listen = \"0.0.0.0:0\"",
            "to = \"[::1]:9\"",
        ] {
            assert_eq!(udp(local), ["udp"], "{local}");
        }
        // Addresses of documentation (RFC 5737) belong to nobody.
        assert!(udp("to = \"192.0.2.7:9000\"").is_empty());
        let tcp = |keys: &str| of(&format!("[[media]]\nkind = \"tcp\"\n{keys}"));
        assert_eq!(tcp("listen = \"0.0.0.0:9000\""), ["tcp"]);
        assert!(tcp("connect = \"192.0.2.7:9000\"").is_empty());
        assert_eq!(of("[[media]]\nkind = \"unix\"\npath = \"a\""), ["unix"]);
        assert!(of("[[media]]\nkind = \"file\"\npath = \"null\"").is_empty());
        assert_eq!(
            of("[[media]]\nkind = \"file\"\npath = \"absent\""),
            ["file"]
        );
    }

    #[test]
    fn a_far_end_that_the_port_starts_counts_as_simulated() {
        let started = "start = [\"./rig\"]\n[[media]]\nkind = \"udp\"\nto = \"192.0.2.7:9000\"";
        assert_eq!(of(started), ["start"]);
    }
}
