//! Packets: the content of a datagram, with one end's latest frame and the number it received from the other end.

use shared_types::frame::{FrameIdentity, Header, MAX_SIGNALS};
use shared_types::zerocopy::{FromBytes, IntoBytes};

/// Frame of one end, with its number.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbered {
    /// Sequence number, assigned by the sender, starting at 1.
    pub number: u64,
    /// Header as received from the link.
    pub header: Header,
    /// Values, as many as the header states.
    pub values: Vec<f64>,
}

/// Content of a datagram.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packet {
    /// Highest number of the other end's frames that were passed to the peer; 0 for none.
    pub received: u64,
    /// Latest frame of this end, if the other end has not received it.
    pub frame: Option<Numbered>,
}

impl Packet {
    /// Parses a packet.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (received, rest) = number(bytes)?;
        let (own, rest) = number(rest)?;
        if own == 0 {
            return rest.is_empty().then_some(Self {
                received,
                frame: None,
            });
        }
        let (header, rest) = Header::read_from_prefix(rest).ok()?;
        let count = usize::from(header.count);
        if count > MAX_SIGNALS || rest.len() != 8 * count || header.kind().is_none() {
            return None;
        }
        let values = rest.chunks_exact(8).map(f64::read_from_bytes);
        let values: Result<Vec<f64>, _> = values.collect();
        let frame = Some(Numbered {
            number: own,
            header,
            values: values.ok()?,
        });
        Some(Self { received, frame })
    }
}

/// Form of the frames of a run, once plant and controller agree on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Form {
    /// Identity that every frame carries.
    pub(crate) identity: FrameIdentity,
    /// Number of values from the other end.
    pub(crate) count: usize,
    /// `true` if the plant does not wait for commands.
    pub(crate) against_clock: bool,
}

impl Form {
    /// Returns `true` if a frame of the other end has this form. Both ends are authentic, so an end that sends another
    /// form is of another version.
    pub(crate) fn fits(&self, frame: &Numbered) -> bool {
        self.identity.check(&frame.header, self.count).is_ok()
    }
}

/// Writes a packet.
pub(crate) fn write(received: u64, frame: Option<&Numbered>, bytes: &mut Vec<u8>) {
    bytes.clear();
    bytes.extend(received.to_le_bytes());
    bytes.extend(frame.map_or(0, |frame| frame.number).to_le_bytes());
    if let Some(frame) = frame {
        bytes.extend(frame.header.as_bytes());
        bytes.extend(frame.values.as_bytes());
    }
}

fn number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

#[cfg(test)]
mod tests {
    use shared_types::frame::FrameKind;
    use shared_types::time::Step;

    use super::*;

    fn written(packet: &Packet) -> Vec<u8> {
        let mut bytes = vec![7];
        write(packet.received, packet.frame.as_ref(), &mut bytes);
        bytes
    }

    fn full() -> Packet {
        Packet {
            received: 3,
            frame: Some(Numbered {
                number: 9,
                header: Header {
                    count: 2,
                    age_steps: 4,
                    ..Header::new(FrameKind::Command, Step(41))
                },
                values: vec![-0.5, f64::MAX],
            }),
        }
    }

    #[test]
    fn a_packet_survives_a_round_trip() {
        for packet in [
            full(),
            Packet {
                received: u64::MAX,
                frame: None,
            },
        ] {
            assert_eq!(Packet::read(&written(&packet)), Some(packet));
        }
    }

    #[test]
    fn truncated_and_overlong_packets_are_refused() {
        for packet in [full(), Packet::default()] {
            let mut bytes = written(&packet);
            for length in 0..bytes.len() {
                assert_eq!(Packet::read(&bytes[..length]), None, "{length}");
            }
            bytes.push(0);
            assert_eq!(Packet::read(&bytes), None);
        }
        let mut unknown = full();
        if let Some(frame) = &mut unknown.frame {
            frame.header.kind = 99;
        }
        assert_eq!(Packet::read(&written(&unknown)), None);
    }
}
