//! Packets: the content of one datagram, a newest frame and what is known of the other end's.

use shared_types::frame::{FrameIdentity, Header, MAX_SIGNALS};
use shared_types::zerocopy::{FromBytes, IntoBytes};

/// A frame of one end, by its number there.
#[derive(Clone, Debug, PartialEq)]
pub struct Numbered {
    /// Counts the frames of its end from 1.
    pub number: u64,
    /// The header, as the link gave it.
    pub header: Header,
    /// The values, as many as the header says.
    pub values: Vec<f64>,
}

/// Content of one datagram.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packet {
    /// Highest number of the frames of the other end that were given to its peer; 0 for none.
    pub heard: u64,
    /// The newest frame of this end, if the other has not heard it.
    pub frame: Option<Numbered>,
}

impl Packet {
    /// Reads one.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (heard, rest) = number(bytes)?;
        let (own, rest) = number(rest)?;
        if own == 0 {
            return rest.is_empty().then_some(Self { heard, frame: None });
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
        Some(Self { heard, frame })
    }
}

/// Form of the frames of a run, once plant and controller agree on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Form {
    /// Identity that every frame carries.
    pub(crate) identity: FrameIdentity,
    /// Number of values from the other end.
    pub(crate) count: usize,
    /// The plant waits for nobody.
    pub(crate) against_clock: bool,
}

impl Form {
    /// Returns `true` if a frame of the other end has this form. Both ends are authentic, so one that sends another form is of
    /// another version.
    pub(crate) fn fits(&self, frame: &Numbered) -> bool {
        self.identity.check(&frame.header, self.count).is_ok()
    }
}

/// Writes the packet of these.
pub(crate) fn write(heard: u64, frame: Option<&Numbered>, bytes: &mut Vec<u8>) {
    bytes.clear();
    bytes.extend(heard.to_le_bytes());
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
        write(packet.heard, packet.frame.as_ref(), &mut bytes);
        bytes
    }

    fn full() -> Packet {
        Packet {
            heard: 3,
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
    fn a_packet_is_read_as_it_was_written() {
        for packet in [
            full(),
            Packet {
                heard: u64::MAX,
                frame: None,
            },
        ] {
            assert_eq!(Packet::read(&written(&packet)), Some(packet));
        }
    }

    #[test]
    fn what_is_cut_or_longer_than_it_says_is_none() {
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
