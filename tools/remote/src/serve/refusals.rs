//! Counts of failed contacts: a persistent stranger must not fill the log.
//!
//! The first refusal of a source is logged at once. After that, a source gets one line a minute, with the count. The
//! number of remembered sources is bounded; all other sources share one count.

use std::collections::BTreeMap;
use std::fmt;
use std::net::{IpAddr, Ipv6Addr};
use std::time::{Duration, Instant};

/// Interval between two lines about a source.
const INTERVAL: Duration = Duration::from_secs(60);
/// Maximum number of remembered sources.
const MOST_SOURCES: usize = 64;

/// Source of contacts: an IPv4 address, or the network of an IPv6 address, which may belong to a single host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Source(IpAddr);

impl Source {
    /// Number of bits of an IPv6 address that identify a host.
    const HOST_BITS: u32 = 64;

    pub(super) fn of(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            IpAddr::V6(address) => {
                let network = address.to_bits() >> Self::HOST_BITS << Self::HOST_BITS;
                Ipv6Addr::from_bits(network).into()
            }
            IpAddr::V4(address) => address.into(),
        })
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            IpAddr::V4(address) => address.fmt(f),
            IpAddr::V6(network) => write!(f, "{network}/{}", 128 - Self::HOST_BITS),
        }
    }
}

/// Counts of refused contacts.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    sources: BTreeMap<Source, Count>,
    /// Count of all other sources.
    others: Option<Count>,
}

/// Number of contacts since the last line about their source.
#[derive(Debug)]
struct Count {
    since: Instant,
    contacts: u64,
    /// Reason of the last refusal.
    reason: String,
}

impl Count {
    fn new(now: Instant) -> Self {
        Self {
            since: now,
            contacts: 0,
            reason: String::new(),
        }
    }

    fn add(&mut self, reason: &str) {
        self.contacts += 1;
        reason.clone_into(&mut self.reason);
    }

    /// Returns the line that is due, if any, and resets the count.
    fn line(&mut self, of: &dyn fmt::Display) -> String {
        let Self {
            contacts, reason, ..
        } = self;
        let seconds = INTERVAL.as_secs();
        format!("{of}: {contacts} more contacts refused in {seconds} s; the last: {reason}")
    }
}

impl Refusals {
    /// Counts a refused contact; returns the line to log at once, if any.
    pub(super) fn add(&mut self, source: Source, reason: &str, now: Instant) -> Option<String> {
        if let Some(count) = self.sources.get_mut(&source) {
            count.add(reason);
            return None;
        }
        if self.sources.len() < MOST_SOURCES {
            self.sources.insert(source, Count::new(now));
            return Some(format!("{source}: refused: {reason}"));
        }
        let others = self.others.get_or_insert_with(|| Count::new(now));
        others.add(reason);
        None
    }

    /// Returns the lines that are due. A source without refusals for one interval is forgotten.
    pub(super) fn due(&mut self, now: Instant) -> Vec<String> {
        let is_due = |count: &Count| now.duration_since(count.since) >= INTERVAL;
        let mut lines = Vec::new();
        self.sources.retain(|source, count| {
            if !is_due(count) {
                return true;
            }
            if count.contacts == 0 {
                return false;
            }
            lines.push(count.line(source));
            *count = Count::new(now);
            true
        });
        if let Some(mut others) = self.others.take_if(|others| is_due(others)) {
            lines.push(others.line(&"other addresses"));
        }
        lines
    }

    /// Returns the time of the next line.
    pub(super) fn next(&self) -> Option<Instant> {
        let counts = self.sources.values().chain(&self.others);
        counts.map(|count| count.since + INTERVAL).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(number: u32) -> Source {
        Source::of(IpAddr::from((0x0a00_0000 + number).to_be_bytes()))
    }

    #[test]
    fn a_source_is_logged_at_once_and_then_once_a_minute_with_the_count() {
        let start = Instant::now();
        let mut refusals = Refusals::default();
        let first = refusals.add(source(1), "no handshake", start);
        assert_eq!(first.as_deref(), Some("10.0.0.1: refused: no handshake"));
        for second in 0..180 {
            let now = start + Duration::from_secs(second);
            for _ in 0..1000 {
                assert_eq!(refusals.add(source(1), "another key", now), None);
            }
            let lines = refusals.due(now);
            let expected = match second {
                60 => vec!["10.0.0.1: 61000 more contacts refused in 60 s; the last: another key"],
                120 => vec!["10.0.0.1: 60000 more contacts refused in 60 s; the last: another key"],
                _ => Vec::new(),
            };
            assert_eq!(lines, expected, "{second}");
        }
        // The rest, and then it is forgotten: its next refusal is logged at once.
        let later = start + Duration::from_secs(180);
        assert_eq!(refusals.due(later).len(), 1);
        assert_eq!(refusals.next(), Some(later + INTERVAL));
        assert_eq!(refusals.due(later + INTERVAL), Vec::<String>::new());
        assert_eq!(refusals.next(), None);
        assert!(refusals.add(source(1), "again", later + INTERVAL).is_some());
    }

    #[test]
    fn sources_beyond_the_limit_share_one_line() {
        let start = Instant::now();
        let mut refusals = Refusals::default();
        let at_once = (0..100_000).filter_map(|one| refusals.add(source(one), "silence", start));
        assert_eq!(at_once.count(), MOST_SOURCES);
        assert_eq!(refusals.sources.len(), MOST_SOURCES);
        let others = 100_000 - MOST_SOURCES;
        let lines = refusals.due(start + INTERVAL);
        let line =
            format!("other addresses: {others} more contacts refused in 60 s; the last: silence");
        assert_eq!(lines, [line]);
        assert_eq!(refusals.next(), None);
    }

    #[test]
    fn addresses_of_one_host_are_one_source() {
        let of = |address: &str| Source::of(address.parse().expect("an address")).to_string();
        assert_eq!(of("192.0.2.7"), "192.0.2.7");
        assert_eq!(of("::ffff:192.0.2.7"), "192.0.2.7");
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::/64");
        assert_eq!(of("2001:db8:1:2:ffff::1"), "2001:db8:1:2::/64");
    }
}
