//! Choice between datagrams and the channel: a state machine for each end, without input, output or clock.
//!
//! Datagrams are faster, but a firewall may drop them, in one direction or both, or only large ones. The channel always
//! works. So the desk sends every packet as a datagram, and a copy through the channel while the datagram path is in
//! doubt. A frame of the target that arrives as a datagram ends the doubt, whichever copy arrived first; [`SILENCE_NS`]
//! without a datagram starts it again.
//!
//! The target must not end that doubt while the desk's own datagrams are lost. So the target sends a frame as a
//! datagram only while frames of the desk arrive as datagrams, and also sends a copy through the channel if the
//! answered frame arrived through the channel too.

use std::fmt;

/// Time without datagrams in ns after which the desk doubts the datagram path.
pub(crate) const SILENCE_NS: u64 = 1_000_000_000;
/// Time in ns for which the arrival of a datagram at the target proves that others arrive. Shorter than
/// [`SILENCE_NS`], because the proof must have expired when the desk begins to doubt.
const PROOF_NS: u64 = SILENCE_NS / 2;
/// Minimum time in ns between two notices about lost datagrams.
const NOTICE_NS: u64 = 60_000_000_000;

/// Carrier of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Carrier {
    /// Datagram.
    Datagram,
    /// Channel.
    Channel,
}

/// Carriers of a packet to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Carriers {
    /// `true` to send the packet as a datagram.
    pub datagram: bool,
    /// `true` to send the packet through the channel.
    pub channel: bool,
}

/// Number of answers passed to the plant, by carrier.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Answers {
    datagrams: u64,
    channel: u64,
}

impl Answers {
    /// Counts an answer.
    pub(crate) const fn note(&mut self, carrier: Carrier) {
        match carrier {
            Carrier::Datagram => self.datagrams += 1,
            Carrier::Channel => self.channel += 1,
        }
    }
}

impl fmt::Display for Answers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { datagrams, channel } = self;
        let all = datagrams + channel;
        write!(f, "{datagrams} of {all} answers arrived as datagrams")
    }
}

/// Change of the route to report to the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Notice {
    /// No datagrams arrive: the frames go through the channel.
    Lost,
    /// Datagrams arrive again.
    Restored,
}

/// Route of packets from the desk.
#[derive(Debug)]
pub(crate) struct DeskRoute {
    state: DeskState,
    /// Time of the last notice about lost datagrams in ns.
    noticed_ns: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DeskState {
    /// There is no socket.
    NoSocket,
    /// Nothing is known about datagrams, because no sample was sent.
    Unknown,
    /// No frame has arrived as a datagram since `since_ns`; copies go through the channel.
    Doubted { since_ns: u64, is_noticed: bool },
    /// Datagrams arrive, the last one at `last_ns`.
    Proven { last_ns: u64 },
}

impl DeskRoute {
    /// Creates the route of a run, with or without a socket for datagrams.
    pub(crate) const fn new(has_socket: bool) -> Self {
        let state = if has_socket {
            DeskState::Unknown
        } else {
            DeskState::NoSocket
        };
        Self {
            state,
            noticed_ns: None,
        }
    }

    /// Notes that a sample was sent.
    pub(crate) fn sent_sample(&mut self, now_ns: u64) {
        match self.state {
            DeskState::Unknown => self.doubt(now_ns),
            DeskState::NoSocket | DeskState::Doubted { .. } | DeskState::Proven { .. } => {}
        }
    }

    /// Notes a datagram of the target, with or without a frame. Small datagrams may arrive where frames do not, so a
    /// datagram without a frame does not end the doubt.
    pub(crate) fn received_datagram(&mut self, has_frame: bool, now_ns: u64) -> Option<Notice> {
        let is_noticed = match self.state {
            DeskState::Doubted { is_noticed, .. } => is_noticed,
            DeskState::NoSocket | DeskState::Unknown | DeskState::Proven { .. } => false,
        };
        if has_frame || matches!(self.state, DeskState::Proven { .. }) {
            self.state = DeskState::Proven { last_ns: now_ns };
            return is_noticed.then_some(Notice::Restored);
        }
        None
    }

    /// Checks for elapsed times; to be called several times a second.
    pub(crate) fn look(&mut self, now_ns: u64) -> Option<Notice> {
        let is_late = |since_ns: u64| now_ns.saturating_sub(since_ns) > SILENCE_NS;
        match self.state {
            DeskState::Proven { last_ns } if is_late(last_ns) => self.doubt(last_ns),
            _ => {}
        }
        let is_due = match self.state {
            DeskState::NoSocket => self.noticed_ns.is_none(),
            DeskState::Doubted {
                since_ns,
                is_noticed,
            } => {
                let was_noticed = self.noticed_ns;
                let is_rare = was_noticed.is_none_or(|at| now_ns.saturating_sub(at) > NOTICE_NS);
                !is_noticed && is_rare && is_late(since_ns)
            }
            DeskState::Unknown | DeskState::Proven { .. } => false,
        };
        if !is_due {
            return None;
        }
        self.noticed_ns = Some(now_ns);
        if let DeskState::Doubted { is_noticed, .. } = &mut self.state {
            *is_noticed = true;
        }
        Some(Notice::Lost)
    }

    const fn doubt(&mut self, since_ns: u64) {
        self.state = DeskState::Doubted {
            since_ns,
            is_noticed: false,
        };
    }

    /// Returns the carriers of the next packet.
    pub(crate) const fn carriers(&self) -> Carriers {
        Carriers {
            datagram: !matches!(self.state, DeskState::NoSocket),
            channel: !matches!(self.state, DeskState::Proven { .. }),
        }
    }
}

/// Route of packets from the target.
#[derive(Debug, Default)]
pub(crate) struct TargetRoute {
    /// Time of the last datagram that proves that frames arrive as datagrams.
    proof_ns: Option<u64>,
    /// Number of the latest frame that arrived through the channel.
    copied: Option<u64>,
}

impl TargetRoute {
    /// Creates the route of a run.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// Notes a packet of the desk, with the number of its frame.
    pub(crate) fn received(&mut self, carrier: Carrier, frame: Option<u64>, now_ns: u64) {
        match carrier {
            Carrier::Channel => self.copied = self.copied.max(frame),
            // Small datagrams may arrive where frames do not: they prove nothing by themselves.
            Carrier::Datagram if frame.is_some() || self.hears_datagrams(now_ns) => {
                self.proof_ns = Some(now_ns);
            }
            Carrier::Datagram => {}
        }
    }

    /// Returns `true` if frames of the desk arrive as datagrams.
    pub(crate) fn hears_datagrams(&self, now_ns: u64) -> bool {
        let is_fresh = |proof_ns| now_ns.saturating_sub(proof_ns) <= PROOF_NS;
        self.proof_ns.is_some_and(is_fresh)
    }

    /// Returns the carriers of the reply to a packet without news for the controller; `has_frame` if the reply repeats
    /// the controller's latest frame.
    pub(crate) fn of_reply(&self, to: Carrier, has_frame: bool, now_ns: u64) -> Carriers {
        let is_proven = self.hears_datagrams(now_ns);
        Carriers {
            // Without a frame it ends no doubt of the desk.
            datagram: is_proven || (to == Carrier::Datagram && !has_frame),
            channel: !is_proven || to == Carrier::Channel,
        }
    }

    /// Returns the carriers of the controller's answer to the frame with this number.
    pub(crate) fn of_answer(&self, received: u64, now_ns: u64) -> Carriers {
        let is_proven = self.hears_datagrams(now_ns);
        Carriers {
            datagram: is_proven,
            channel: !is_proven || self.copied >= Some(received),
        }
    }
}

#[cfg(test)]
mod tests;
