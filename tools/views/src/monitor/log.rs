//! Event log of the watched session: every event of the run, once and in order.
//!
//! The stream delivers events at once, but only those after the observer joined, and a slow observer loses some. The
//! recorder's [list of events](hil_facts::session::happening) is complete, but may arrive before or after the stream.
//! If the two differ, that list is authoritative.

use hil_facts::session::happening::Happening;

/// Events of a run, merged from the stream and the recorder's account.
#[derive(Debug, Default)]
pub(crate) struct Log {
    /// Events of the account received so far, followed by those that only the stream has delivered.
    list: Vec<Happening>,
    known: usize,
    /// Index in the account after the last event that the stream has also delivered.
    seen: usize,
    edition: u32,
}

impl Log {
    /// Returns all events in order.
    pub(crate) fn list(&self) -> &[Happening] {
        &self.list
    }

    /// Returns the number of events received from the account.
    pub(crate) const fn known(&self) -> usize {
        self.known
    }

    /// Returns a counter that changes when an event is inserted before existing ones, so that readers start over.
    pub(crate) const fn edition(&self) -> u32 {
        self.edition
    }

    /// Adds an event of the stream.
    pub(crate) fn see(&mut self, happening: Happening) {
        let ahead = &self.list[self.seen..self.known];
        match ahead.iter().position(|event| *event == happening) {
            Some(place) => self.seen += place + 1,
            None => self.list.push(happening),
        }
    }

    /// Adds events of the account that follow those already received.
    pub(crate) fn hear(&mut self, account: Vec<Happening>) {
        let begin = self.known;
        let streamed = self.list.split_off(begin);
        let (mut place, mut covered) = (0, 0);
        for (number, one) in streamed.iter().enumerate() {
            if let Some(skipped) = account[place..].iter().position(|event| event == one) {
                place += skipped + 1;
                covered = number + 1;
            }
        }
        self.known += account.len();
        if covered > 0 {
            self.seen = begin + place;
        }
        self.list.extend(account);
        self.list.extend_from_slice(&streamed[covered..]);
        if !self.list[begin..].starts_with(&streamed) {
            self.edition += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(step: u64) -> Happening {
        Happening {
            step,
            text: format!("mark at step {step}"),
            label: None,
            key: None,
        }
    }

    fn steps(log: &Log) -> Vec<u64> {
        log.list().iter().map(|one| one.step).collect()
    }

    #[test]
    fn an_event_in_both_stream_and_account_is_listed_once() {
        for stream_is_first in [true, false] {
            let mut log = Log::default();
            for step in [3, 3, 5] {
                if stream_is_first {
                    log.see(event(step));
                    log.hear(vec![event(step)]);
                } else {
                    log.hear(vec![event(step)]);
                    log.see(event(step));
                }
            }
            assert_eq!((steps(&log), log.known()), (vec![3, 3, 5], 3));
            assert_eq!(log.edition(), 0, "nobody has to begin anew");
        }
    }

    #[test]
    fn the_account_supplies_events_from_before_the_observer_joined() {
        let mut log = Log::default();
        log.see(event(40));
        log.see(event(50));
        log.hear(vec![event(10), event(20), event(40)]);
        assert_eq!((steps(&log), log.edition()), (vec![10, 20, 40, 50], 1));
        log.hear(vec![event(50), event(60)]);
        log.see(event(60));
        log.see(event(70));
        assert_eq!(
            (steps(&log), log.edition()),
            (vec![10, 20, 40, 50, 60, 70], 1)
        );
    }

    #[test]
    fn an_event_lost_by_the_stream_is_inserted_at_its_place() {
        let mut log = Log::default();
        log.see(event(1));
        log.see(event(4));
        log.hear((1..=4).map(event).collect());
        assert_eq!((steps(&log), log.edition()), (vec![1, 2, 3, 4], 1));
    }

    #[test]
    fn an_account_received_in_parts_equals_a_complete_one() {
        let mut log = Log::default();
        (0..10).for_each(|step| log.see(event(step)));
        for part in [0..3, 3..4, 4..10] {
            log.hear(part.map(event).collect());
        }
        log.hear(Vec::new());
        assert_eq!((steps(&log), log.edition()), ((0..10).collect(), 0));
        assert_eq!(log.known(), 10);
    }
}
