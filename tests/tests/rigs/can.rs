//! A rig on CAN: an interface of the kernel, or frames in datagrams of cannelloni.

use std::io::{self, ErrorKind, Read, Write};
use std::net::UdpSocket;
use std::path::Path;

use socketcan::{CanFdSocket, Socket};

use super::media::is_controlled_and_gets_the_safe_value;
use super::peer::{COMMAND, Peer, free};
use crate::support::programs::skip;

/// Interface that exists only for tests.
const INTERFACE: &str = "vcan0";
/// Identifiers of a state and of a command.
const STATE_ID: u32 = 0x101;
const DRIVE_ID: u32 = 0x102;
/// Lengths of their frames, which CAN FD has: 18 and 10 bytes, and what is left free.
const STATE_LENGTH: usize = 20;
const DRIVE_LENGTH: usize = 12;
/// Bytes of a frame of CAN FD in front of its data, as the kernel has it: identifier, length, flags and two of nothing.
const KERNEL_HEAD: usize = 8;
/// Bytes in front of the data of the only frame in a datagram: version, code, sequence number, number of frames,
/// identifier, length and flags.
const DATAGRAM_HEAD: usize = 11;

/// Own end of a CAN bus; nothing blocks.
pub(super) enum CanLine {
    Interface(CanFdSocket),
    /// Socket, address of the port and next sequence number.
    Datagrams(UdpSocket, String, u8),
}

impl CanLine {
    /// Reads a command, without the bytes that are free.
    pub(super) fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut frame = [0; 128];
        let (id, length, data) = match self {
            Self::Interface(socket) => {
                let count = socket.read(&mut frame)?;
                assert_eq!(count, KERNEL_HEAD + 64, "a frame of CAN FD");
                let id = u32::from_ne_bytes([frame[0], frame[1], frame[2], frame[3]]);
                (id, usize::from(frame[4]), &frame[KERNEL_HEAD..])
            }
            Self::Datagrams(socket, ..) => {
                let count = socket.recv(&mut frame)?;
                assert_eq!(count, DATAGRAM_HEAD + DRIVE_LENGTH);
                assert_eq!((frame[..2].as_ref(), frame[4]), (&[2, 0][..], 1));
                let id = u32::from_be_bytes([frame[5], frame[6], frame[7], frame[8]]);
                (id, usize::from(frame[9] ^ 0x80), &frame[DATAGRAM_HEAD..])
            }
        };
        if id != DRIVE_ID {
            return Err(ErrorKind::WouldBlock.into());
        }
        assert_eq!(length, DRIVE_LENGTH);
        buffer[..COMMAND].copy_from_slice(&data[..COMMAND]);
        Ok(COMMAND)
    }

    pub(super) fn write(&mut self, state: &[u8]) -> io::Result<()> {
        let mut data = state.to_vec();
        data.resize(STATE_LENGTH, 0);
        match self {
            Self::Interface(socket) => {
                let mut frame = [0; KERNEL_HEAD + 64];
                frame[..4].copy_from_slice(&STATE_ID.to_ne_bytes());
                frame[4] = STATE_LENGTH as u8;
                frame[KERNEL_HEAD..][..STATE_LENGTH].copy_from_slice(&data);
                socket.write(&frame).map(|_| ())
            }
            Self::Datagrams(socket, to, sequence) => {
                let mut datagram = vec![2, 0, *sequence, 0, 1];
                datagram.extend(STATE_ID.to_be_bytes());
                datagram.extend([STATE_LENGTH as u8 | 0x80, 0]);
                datagram.extend(data);
                *sequence = sequence.wrapping_add(1);
                socket.send_to(&datagram, &*to).map(|_| ())
            }
        }
    }
}

/// Returns the keys of the frames of a state and a command that only CAN has.
pub(super) fn keys(medium: &str) -> [String; 2] {
    let is_can = ["can", "cannelloni"].map(|kind| medium.contains(&format!("kind = \"{kind}\"")));
    let frames = [(STATE_ID, STATE_LENGTH), (DRIVE_ID, DRIVE_LENGTH)];
    match is_can.contains(&true) {
        true => frames.map(|(id, length)| format!("id = {id}\nlength = {length}\n")),
        false => Default::default(),
    }
}

#[test]
fn a_rig_behind_cannelloni_is_controlled_and_gets_the_safe_value() {
    is_controlled_and_gets_the_safe_value(|_| {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_nonblocking(true).expect("a socket");
        let (own, port) = (socket.local_addr().expect("an address"), free());
        let medium =
            format!("kind = \"cannelloni\"\nto = \"{own}\"\nlisten = \"{port}\"\nfd = true");
        Peer::on_can(CanLine::Datagrams(socket, port, 0), medium)
    });
}

#[test]
fn a_rig_on_a_can_interface_is_controlled_and_gets_the_safe_value() {
    if !Path::new("/sys/class/net").join(INTERFACE).exists() {
        let why = format!(
            "there is no interface {INTERFACE}; `ip link add dev {INTERFACE} type vcan` makes one"
        );
        return skip(&why, "HIL_TEST_VCAN");
    }
    is_controlled_and_gets_the_safe_value(|_| {
        let socket = CanFdSocket::open(INTERFACE).expect("an interface");
        socket.set_nonblocking(true).expect("an interface");
        let medium = format!("kind = \"can\"\ninterface = \"{INTERFACE}\"\nfd = true");
        Peer::on_can(CanLine::Interface(socket), medium)
    });
}
