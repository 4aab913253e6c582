//! Greetings in progress: contacts with incomplete handshakes, concurrent and bounded.
//!
//! A contact that finds no free slot takes that of another contact: one of its own source or, if all slots are taken,
//! one of the source with the most slots. The oldest contact that has sent nothing valid is dropped. So an honest
//! contact, whose first message follows at once, gets through despite any number of silent contacts from its host.

use std::io;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use super::refusals::Source;
use crate::key::{PartialMessage, check_proof, prologue, put};
use crate::seal::{Key, Seal, answer};

/// Time limit for a greeting.
pub(super) const LIMIT: Duration = Duration::from_secs(2);
/// Maximum number of greetings at a time.
const MOST: usize = 256;
/// Maximum number of greetings at a time from one source.
const MOST_OF_SOURCE: usize = 64;

/// Greeting of one contact.
pub(super) struct Greeting {
    pub(super) connection: TcpStream,
    message: PartialMessage,
    stage: Stage,
}

/// Progress of a handshake.
enum Stage {
    /// Waiting for the first message, which requires the key but can be replayed.
    AwaitsFirst,
    /// First message answered; waiting for the proof that it was not a replay.
    AwaitsProof(Seal),
}

impl Greeting {
    /// Starts a greeting.
    ///
    /// # Errors
    /// If the connection has failed.
    pub(super) fn begin(connection: TcpStream) -> io::Result<Self> {
        connection.set_nodelay(true)?;
        connection.set_nonblocking(true)?;
        Ok(Self {
            connection,
            message: PartialMessage::default(),
            stage: Stage::AwaitsFirst,
        })
    }

    /// Reads available data; returns `true` once the contact has proved that it has the key.
    ///
    /// # Errors
    /// If the proof fails, or the connection has failed.
    fn advance(&mut self, key: &Key) -> io::Result<bool> {
        while let Some(message) = self.message.read(&mut &self.connection)? {
            match &self.stage {
                Stage::AwaitsFirst => {
                    let answered = answer(key, &prologue(), &message);
                    let (seal, second) = answered.map_err(io::Error::other)?;
                    put(&mut &self.connection, &second)?;
                    self.stage = Stage::AwaitsProof(seal);
                }
                Stage::AwaitsProof(seal) => {
                    check_proof(&message, seal)?;
                    self.connection.set_nonblocking(false)?;
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }
}

/// Contact in a slot.
#[derive(Debug)]
struct Place<C> {
    source: Source,
    since: Instant,
    contact: C,
}

/// Greetings in progress, oldest first.
#[derive(Debug)]
pub(super) struct Places<C>(Vec<Place<C>>);

impl<C> Default for Places<C> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<C> Places<C> {
    /// Adds a contact; returns the contact dropped for it, if any. `is_known` returns `true` if a contact has sent
    /// something valid.
    fn add(
        &mut self,
        (source, contact): (Source, C),
        now: Instant,
        is_known: impl Fn(&C) -> bool,
    ) -> Option<(Source, C)> {
        let count = |of: Source| self.0.iter().filter(|place| place.source == of).count();
        let crowded = if count(source) >= MOST_OF_SOURCE {
            Some(source)
        } else if self.0.len() >= MOST {
            let sources = self.0.iter().map(|place| place.source);
            sources.max_by_key(|source| count(*source))
        } else {
            None
        };
        let leaving = crowded.and_then(|crowded| {
            let of_source = (self.0.iter().enumerate()).filter(|(_, one)| one.source == crowded);
            let leaving = of_source.min_by_key(|(number, one)| (is_known(&one.contact), *number));
            leaving.map(|(number, _)| number)
        });
        let dropped = leaving.map(|number| self.0.remove(number));
        self.0.push(Place {
            source,
            since: now,
            contact,
        });
        dropped.map(|place| (place.source, place.contact))
    }

    /// Removes expired greetings.
    fn late(&mut self, now: Instant) -> impl Iterator<Item = (Source, C)> {
        let is_late = |place: &Place<C>| now.duration_since(place.since) >= LIMIT;
        let count = self.0.iter().take_while(|place| is_late(place)).count();
        let late = self.0.drain(..count);
        late.map(|place| (place.source, place.contact))
    }

    /// Returns the time at which the oldest greeting expires.
    pub(super) fn next(&self) -> Option<Instant> {
        self.0.first().map(|place| place.since + LIMIT)
    }
}

/// Refused contact, with the reason.
pub(super) type Refused = (Source, io::Error);

impl Places<Greeting> {
    /// Returns the connections in order.
    pub(super) fn connections(&self) -> impl Iterator<Item = &TcpStream> {
        self.0.iter().map(|place| &place.contact.connection)
    }

    /// Adds a contact; returns the contact dropped for it, if any.
    pub(super) fn greet(&mut self, of: (Source, Greeting), now: Instant) -> Option<Refused> {
        let is_known = |one: &Greeting| matches!(one.stage, Stage::AwaitsProof(_));
        let (source, _) = self.add(of, now, is_known)?;
        let reason = "it sent nothing, and another contact took its slot";
        Some((source, io::Error::new(io::ErrorKind::ResourceBusy, reason)))
    }

    /// Reads the contacts with new data, given by their index in [order](Self::connections); returns those that have
    /// the key, and those that are refused.
    pub(super) fn hear(
        &mut self,
        has_news: impl Fn(usize) -> bool,
        key: &Key,
        now: Instant,
    ) -> (Vec<(TcpStream, Seal)>, Vec<Refused>) {
        let (mut greeted, mut refused) = (Vec::new(), Vec::new());
        let places = std::mem::take(&mut self.0);
        for (number, mut place) in places.into_iter().enumerate() {
            let advanced = if has_news(number) {
                place.contact.advance(key)
            } else {
                Ok(false)
            };
            match (advanced, place.contact.stage) {
                (Ok(true), Stage::AwaitsProof(seal)) => {
                    greeted.push((place.contact.connection, seal));
                }
                (Ok(_), stage) => {
                    place.contact.stage = stage;
                    self.0.push(place);
                }
                (Err(error), _) => refused.push((place.source, error)),
            }
        }
        let late = self.late(now);
        refused.extend(late.map(|(source, _)| (source, io::ErrorKind::TimedOut.into())));
        (greeted, refused)
    }
}

#[cfg(test)]
mod tests {
    use std::net::IpAddr;

    use super::*;

    /// Contact of a source, with `true` if it has sent something valid.
    type Contact = (u8, bool);

    fn source(number: u8) -> Source {
        Source::of(IpAddr::from([10, 0, 0, number]))
    }

    fn add(places: &mut Places<Contact>, of: u8, contact: Contact) -> Option<Contact> {
        let is_known = |contact: &Contact| contact.1;
        let dropped = places.add((source(of), contact), Instant::now(), is_known);
        dropped.map(|(_, contact)| contact)
    }

    #[test]
    fn a_new_contact_replaces_only_the_oldest_silent_one_of_its_source() {
        let mut places = Places::default();
        assert_eq!(add(&mut places, 1, (200, false)), None);
        for number in 0..MOST_OF_SOURCE as u8 {
            assert_eq!(add(&mut places, 2, (number, false)), None);
        }
        for number in 0..100 {
            let dropped = add(&mut places, 2, (MOST_OF_SOURCE as u8 + number, false));
            assert_eq!(dropped, Some((number, false)));
        }
        assert_eq!(places.0.len(), MOST_OF_SOURCE + 1);
    }

    #[test]
    fn a_contact_that_sent_a_valid_message_outlasts_silent_ones() {
        let mut places = Places::default();
        add(&mut places, 1, (0, true));
        for number in 1..200 {
            add(&mut places, 1, (number, false));
        }
        assert!(places.0.iter().any(|place| place.contact == (0, true)));
        // Messages replayed by a stranger hold no slot either.
        for number in 1..200 {
            add(&mut places, 1, (number, true));
        }
        assert!(places.0.iter().all(|place| place.contact != (0, true)));
        assert_eq!(places.0.len(), MOST_OF_SOURCE);
    }

    #[test]
    fn the_total_is_bounded_and_the_source_with_most_slots_gives_way() {
        let mut places = Places::default();
        for number in 0..MOST_OF_SOURCE as u8 {
            add(&mut places, 1, (number, false));
        }
        for other in 2..2 + (MOST - MOST_OF_SOURCE) as u8 {
            assert_eq!(add(&mut places, other, (0, false)), None);
        }
        for (number, other) in (200..220).enumerate() {
            assert_eq!(
                add(&mut places, other, (0, false)),
                Some((number as u8, false))
            );
        }
        assert_eq!(places.0.len(), MOST);
    }

    #[test]
    fn an_unfinished_greeting_expires() {
        let mut places = Places::default();
        let start = Instant::now();
        for number in 0..3 {
            let now = start + Duration::from_millis(100 * u64::from(number));
            places.add((source(number), (number, false)), now, |_| false);
        }
        assert_eq!(places.next(), Some(start + LIMIT));
        let mut late = |ms| {
            let now = start + LIMIT + Duration::from_millis(ms);
            let late = places.late(now);
            late.map(|(_, (number, _))| number).collect::<Vec<u8>>()
        };
        assert_eq!(late(0), [0]);
        assert!(late(50).is_empty());
        assert_eq!(late(200), [1, 2]);
    }
}
