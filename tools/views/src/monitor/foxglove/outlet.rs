//! Distribution of observed records and events to the subscribed clients.
//!
//! Records are decimated to a bounded rate, never averaged. Sending never waits; messages that do not fit into a
//! client's queue are counted.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, TrySendError};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use hil_facts::session::observer::Seen;
use hil_recording::event;
use hil_recording::schema::ENCAPSULATION;
use shared_types::record::{Event, RecordLayout};
use shared_types::time::{Rate, Step};
use shared_types::zerocopy::IntoBytes;

use super::message::{self, Data, EVENTS, RECORDS};
use crate::monitor::watch::Audience;

/// Polling interval while clients receive their remaining messages.
const LOOK: Duration = Duration::from_millis(10);

/// Queue of a client, and the number of messages for which the queue had no room.
struct Queue {
    sender: SyncSender<Arc<Data>>,
    missed: Arc<AtomicU64>,
}

/// State shared by all clients.
pub(crate) struct Hub {
    server_info: String,
    channels: OnceLock<String>,
    /// Client queues; `None` after the end.
    queues: Mutex<Option<Vec<Queue>>>,
    threads: Mutex<Vec<JoinHandle<()>>>,
    is_over: AtomicBool,
    last_word: Mutex<String>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Hub {
    pub(crate) fn new(server_info: String) -> Self {
        Self {
            server_info,
            channels: OnceLock::new(),
            queues: Mutex::new(Some(Vec::new())),
            threads: Mutex::default(),
            is_over: AtomicBool::new(false),
            last_word: Mutex::new("the session is not watched any more".into()),
        }
    }

    pub(super) fn server_info(&self) -> &str {
        &self.server_info
    }

    /// Returns the channel announcement once the layout is known.
    pub(super) fn channels(&self) -> Option<&str> {
        self.channels.get().map(String::as_str)
    }

    /// Adds a client; returns the counter of messages dropped from its queue.
    pub(crate) fn join(&self, sender: SyncSender<Arc<Data>>) -> Arc<AtomicU64> {
        let missed = Arc::new(AtomicU64::new(0));
        if let Some(queues) = locked(&self.queues).as_mut() {
            queues.push(Queue {
                sender,
                missed: Arc::clone(&missed),
            });
        }
        missed
    }

    /// Returns the number of clients being served.
    pub(super) fn clients(&self) -> usize {
        let mut threads = locked(&self.threads);
        threads.retain(|thread| !thread.is_finished());
        threads.len()
    }

    pub(super) fn keep(&self, client: JoinHandle<()>) {
        locked(&self.threads).push(client);
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    pub(super) fn last_word(&self) -> String {
        locked(&self.last_word).clone()
    }

    /// Ends the service and waits up to `limit` until the clients have received everything.
    pub(crate) fn end(&self, limit: Duration) {
        self.is_over.store(true, Ordering::Release);
        *locked(&self.queues) = None;
        let since = Instant::now();
        while self.clients() > 0 && since.elapsed() < limit {
            std::thread::sleep(LOOK);
        }
    }

    fn has_clients(&self) -> bool {
        locked(&self.queues)
            .as_ref()
            .is_some_and(|queues| !queues.is_empty())
    }

    fn send(&self, data: Data) {
        let data = Arc::new(data);
        if let Some(queues) = locked(&self.queues).as_mut() {
            queues.retain(|queue| match queue.sender.try_send(Arc::clone(&data)) {
                Ok(()) => true,
                Err(TrySendError::Full(_)) => {
                    queue.missed.fetch_add(1, Ordering::Relaxed);
                    true
                }
                Err(TrySendError::Disconnected(_)) => false,
            });
        }
    }
}

/// Decimator that passes records, and every event, to the clients.
pub(crate) struct Outlet {
    hub: Arc<Hub>,
    rate: Rate,
    /// Minimum time between two records, by the records' clock.
    period_ns: f64,
    /// Time from which the next record is due.
    next_ns: f64,
    /// Simulated time of the newest record.
    time_ns: u64,
}

impl Outlet {
    pub(crate) fn new(hub: Arc<Hub>, rate: Rate, records_per_s: f64) -> Self {
        Self {
            hub,
            rate,
            period_ns: 1e9 / records_per_s,
            next_ns: 0.0,
            time_ns: 0,
        }
    }

    /// Returns `true` if a record published at this time is sent.
    fn picks(&mut self, published_ns: u64) -> bool {
        let now_ns = published_ns as f64;
        if now_ns < self.next_ns {
            return false;
        }
        // Keeps the phase of the rate, but does not catch up after a pause.
        let due_ns = self.next_ns + self.period_ns;
        self.next_ns = if due_ns < now_ns {
            now_ns + self.period_ns
        } else {
            due_ns
        };
        true
    }

    fn event(&self, change: &Event) {
        let step = change.step().map(Step);
        let time_ns = step.map_or(self.time_ns, |step| self.rate.nanoseconds(step));
        self.hub.send(Data {
            channel: EVENTS,
            time_ns,
            payload: event::message(change).unwrap_or_default(),
        });
    }
}

impl Audience for Outlet {
    fn attach(&mut self, layout: &RecordLayout) {
        let _ = self.hub.channels.set(message::advertise(layout)); // set once: the layout never changes
    }

    fn take(&mut self, seen: &Seen<'_>) {
        match seen {
            Seen::Record(record, words) => {
                self.time_ns = record.timing.time_ns;
                if !self.picks(record.timing.published_ns) || !self.hub.has_clients() {
                    return;
                }
                let mut payload = ENCAPSULATION.to_vec();
                payload.extend(words.as_bytes());
                self.hub.send(Data {
                    channel: RECORDS,
                    time_ns: self.time_ns,
                    payload,
                });
            }
            Seen::Event(event) => self.event(event),
            Seen::Lost(_) | Seen::Broken(_) => {}
        }
    }

    fn end(&mut self, last_word: &str) {
        *locked(&self.hub.last_word) = last_word.to_owned();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use super::*;

    fn outlet(records_per_s: f64) -> Outlet {
        let hub = Arc::new(Hub::new(String::new()));
        Outlet::new(hub, Rate::new(10_000.0).expect("a rate"), records_per_s)
    }

    #[test]
    fn records_are_decimated_to_the_requested_rate_even_after_a_pause() {
        let mut outlet = outlet(200.0);
        let mut picked = |from_s: u64, steps: u64, step_ns: u64| {
            let times = (0..steps).map(|step| from_s * 1_000_000_000 + step * step_ns);
            times.filter(|&ns| outlet.picks(ns)).count()
        };
        // A second at 300 kHz, one at 150 Hz, one at 10 kHz after a minute.
        assert!((199..=201).contains(&picked(100, 300_000, 3_333)));
        assert_eq!(picked(102, 150, 6_666_666), 150);
        assert!((199..=201).contains(&picked(160, 10_000, 100_000)));
        let mut all = self::outlet(f64::INFINITY);
        assert!((0..1000).all(|ns| all.picks(ns)));
    }

    #[test]
    fn a_stalled_client_blocks_nobody_and_learns_how_much_it_missed() {
        let outlet = outlet(1.0);
        let (slow, slow_queue) = sync_channel(2);
        let (quick, quick_queue) = sync_channel(100);
        let (orphan, _) = sync_channel(1);
        let missed = outlet.hub.join(slow);
        outlet.hub.join(quick);
        outlet.hub.join(orphan);
        for time_ns in 0..50 {
            outlet.hub.send(Data {
                channel: RECORDS,
                time_ns,
                payload: Vec::new(),
            });
        }
        assert_eq!(missed.load(Ordering::Relaxed), 48);
        assert_eq!(slow_queue.try_iter().count(), 2);
        assert_eq!(quick_queue.try_iter().count(), 50);
        assert_eq!(locked(&outlet.hub.queues).as_ref().expect("open").len(), 2);
    }
}
