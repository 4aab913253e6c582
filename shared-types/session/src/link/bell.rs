//! Bells: each side of a session sleeps on its own bell, and everyone who sends to that side rings it.
//!
//! A bell is two words in shared memory. They carry no data and so cannot influence a result. No ring is lost, and a
//! ring costs a system call only if the owner sleeps:
//!
//! 1. The sleeper reads `rings`, sets `sleeping`, and polls once more for its message.
//! 2. The ringer sends, then reads `sleeping`. If it is set, the ringer increments `rings` and wakes the sleeper.
//! 3. The kernel lets the sleeper sleep only while `rings` still has the value read in 1.
//!
//! A full fence separates sending from reading on both sides, so at least one of the two sees the other.
//!
//! The kernel's timer adds 0.3 us to each sleep. A bell that [ticks](Bell::tick) rings every 50 ms while its owner
//! sleeps from time to time, so that longer sleeps need no timer. The ringing thread parks in between:
//!
//! 1. The owner sets `is_requested` before it sleeps, and wakes the thread if `parked` is set.
//! 2. The thread takes `is_requested`. If it was set, the thread rings 50 ms later; otherwise it sets `parked`, reads
//!    `is_requested` once more and parks.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::sync::{Arc, OnceLock, Weak};
use std::thread::{self, Thread};
use std::time::Duration;

use iceoryx2::prelude::{FileName, SemanticString, ZeroCopySend};
use iceoryx2_bb_concurrency::atomic::AtomicU32;
use iceoryx2_bb_posix::access_mode::AccessMode;
use iceoryx2_cal::dynamic_storage::posix_shared_memory::{
    Builder, Configuration, DynamicStorage, DynamicStorageBuilder, DynamicStorageCreateError,
    DynamicStorageOpenError, Storage,
};
use iceoryx2_cal::named_concept::{NamedConceptBuilder, NamedConceptConfiguration};
use rustix::thread::futex;
use rustix::time::Timespec;

use super::service::transport;
use crate::session::SessionInfo;
use shared_types::link::LinkError;
use shared_types::wait::Sleeper;

/// Owner of a bell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// The plant, for the whole session.
    Plant,
    /// The controller of this epoch.
    Controller(u32),
}

/// Time between two ticks.
const TICK: Duration = Duration::from_millis(50);
/// Stack size of the ticking thread, small because it may be locked in memory.
const STACK: usize = 1 << 16;

/// Bell of a session. Clones share the same bell.
#[derive(Clone)]
pub struct Bell(Arc<BellState>);

struct BellState {
    words: Storage<Words>,
    /// Ringing thread, if any.
    ticker: OnceLock<Ticker>,
}

struct Ticker {
    thread: Thread,
    flags: Arc<TickerFlags>,
}

#[derive(Default)]
struct TickerFlags {
    is_requested: AtomicBool,
    parked: AtomicBool,
}

#[derive(Debug, ZeroCopySend)]
#[repr(C)]
struct Words {
    rings: AtomicU32,
    sleeping: AtomicU32,
}

impl Owner {
    fn name(self) -> String {
        match self {
            Self::Plant => "bell_plant".into(),
            Self::Controller(epoch) => format!("bell_controller_{epoch}"),
        }
    }
}

impl Bell {
    /// Creates a bell. Its file is removed with the last clone in this process, or with the session.
    ///
    /// # Errors
    /// [`LinkError::Taken`] if the bell exists already, or an error if shared memory cannot be used.
    pub fn create(session: &SessionInfo, owner: Owner) -> Result<Self, LinkError> {
        let name = owner.name();
        let (file, configuration) = place(session, &name)?;
        Builder::new(&file)
            .config(&configuration)
            .initializer(|words, _| {
                words.write(Words {
                    rings: AtomicU32::new(0),
                    sleeping: AtomicU32::new(0),
                });
                true
            })
            .create()
            .map(Self::at)
            .map_err(|error| match error {
                DynamicStorageCreateError::AlreadyExists => LinkError::Taken {
                    service: name.clone(),
                    role: "plant",
                },
                error => transport(&name, error),
            })
    }

    /// Opens a bell that another process made. Call it only once a service exists that is created after the bell,
    /// because the wait for a file without a size is unlimited.
    ///
    /// # Errors
    /// [`LinkError::Absent`] while the bell does not exist.
    pub fn open(session: &SessionInfo, owner: Owner) -> Result<Self, LinkError> {
        let name = owner.name();
        let (file, configuration) = place(session, &name)?;
        Builder::new(&file)
            .config(&configuration)
            .has_ownership(false)
            .open(AccessMode::ReadWrite)
            .map(Self::at)
            .map_err(|error| match error {
                DynamicStorageOpenError::DoesNotExist
                | DynamicStorageOpenError::InitializationNotYetFinalized => LinkError::Absent {
                    service: name.clone(),
                    reason: "the plant has not created the bell".into(),
                },
                error => transport(&name, error),
            })
    }

    fn at(words: Storage<Words>) -> Self {
        let ticker = OnceLock::new();
        Self(Arc::new(BellState { words, ticker }))
    }

    fn words(&self) -> &Words {
        self.0.words.get()
    }

    /// Rings every 50 ms from now on while the owner sleeps, on a separate thread that ends with the last clone in this
    /// process. Called by the owner; if no thread can be started, the owner keeps sleeping with a timer.
    pub fn tick(&self) {
        if self.0.ticker.get().is_some() {
            return;
        }
        let (bell, flags) = (Arc::downgrade(&self.0), Arc::<TickerFlags>::default());
        let shared = Arc::clone(&flags);
        let thread = (thread::Builder::new()
            .name("ticks".into())
            .stack_size(STACK))
        .spawn(move || ring_while_wanted(&bell, &shared));
        if let Ok(thread) = thread {
            let thread = thread.thread().clone();
            let _ = self.0.ticker.set(Ticker { thread, flags }); // called once
        }
    }

    /// Wakes the owner if it sleeps or is about to sleep. Call it after sending.
    #[inline]
    pub fn ring(&self) {
        let words = self.words();
        fence(Ordering::SeqCst);
        if words.sleeping.load(Ordering::Relaxed) != 0 {
            words.wake();
        }
    }
}

impl Words {
    #[cold]
    fn wake(&self) {
        self.rings.fetch_add(1, Ordering::Release);
        let _ = futex::wake(&self.rings, futex::Flags::empty(), 1); // nobody there is no failure
    }
}

impl Sleeper for Bell {
    fn announce(&self) -> u32 {
        let words = self.words();
        let rings = words.rings.load(Ordering::Acquire);
        words.sleeping.store(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        rings
    }

    fn sleep(&self, rings: u32, ns: u64) {
        let limit = match self.0.ticker.get() {
            Some(ticker) if has_no_timer(ns) => {
                ticker.want();
                None
            }
            _ => Some(Timespec::try_from(Duration::from_nanos(ns)).unwrap_or_default()),
        };
        // A ring, a timeout and a signal all mean the same: poll again.
        let _ = futex::wait(
            &self.words().rings,
            futex::Flags::empty(),
            rings,
            limit.as_ref(),
        );
    }

    fn retire(&self) {
        self.words().sleeping.store(0, Ordering::Relaxed);
    }
}

/// Returns `true` if ticks end a sleep of at most `ns` soon enough, even a sleep that lasts twice as long.
const fn has_no_timer(ns: u64) -> bool {
    ns as u128 >= 2 * TICK.as_nanos()
}

impl Ticker {
    /// Requests a tick, because the owner is about to sleep.
    fn want(&self) {
        self.flags.is_requested.store(true, Ordering::SeqCst);
        if self.flags.parked.load(Ordering::SeqCst) {
            self.thread.unpark();
        }
    }
}

impl Drop for Ticker {
    fn drop(&mut self) {
        self.thread.unpark(); // the bell is gone
    }
}

/// Rings a bell while it exists and its owner requests ticks.
fn ring_while_wanted(bell: &Weak<BellState>, flags: &TickerFlags) {
    while bell.strong_count() > 0 {
        if flags.is_requested.swap(false, Ordering::SeqCst) {
            thread::park_timeout(TICK);
            if let Some(bell) = bell.upgrade() {
                Bell(bell).ring();
            }
            continue;
        }
        flags.parked.store(true, Ordering::SeqCst);
        if !flags.is_requested.load(Ordering::SeqCst) {
            thread::park();
        }
        flags.parked.store(false, Ordering::SeqCst);
    }
}

impl fmt::Debug for Bell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.words().fmt(f)
    }
}

/// Returns the name of a bell's file and its configuration with the session's prefix.
fn place(session: &SessionInfo, name: &str) -> Result<(FileName, Configuration<Words>), LinkError> {
    let file = |text: &str| FileName::new(text.as_bytes()).map_err(|e| transport(name, e));
    let configuration = Configuration::default().prefix(&file(&session.prefix)?);
    Ok((file(name)?, configuration))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU64;
    use std::time::Instant;

    use super::*;
    use crate::session::Session;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_bell_is_unique_private_and_removed_with_its_maker() {
        let session = Session::create(None).expect("a session");
        let info = session.info();
        let absent = Bell::open(info, Owner::Plant);
        assert!(
            matches!(absent, Err(LinkError::Absent { .. })),
            "{absent:?}"
        );
        let bell = Bell::create(info, Owner::Plant).expect("creates");
        let result = Bell::create(info, Owner::Plant);
        assert!(matches!(result, Err(LinkError::Taken { .. })), "{result:?}");
        let other = Bell::create(info, Owner::Controller(1)).expect("another");
        Bell::open(info, Owner::Plant).expect("opens");
        assert_eq!(info.open_to_others(), Vec::<std::path::PathBuf>::new());
        let there = info.segments().len();
        drop((bell, other));
        assert_eq!(info.segments().len(), there - 2);
    }

    #[test]
    fn the_bell_of_a_killed_maker_is_removed_with_its_session() {
        let session = Session::create(None).expect("a session");
        let info = session.info().clone();
        std::mem::forget(Bell::create(&info, Owner::Plant).expect("creates"));
        assert!(!info.segments().is_empty());
        drop(session);
        assert!(info.segments().is_empty());
    }

    #[test]
    fn a_ring_without_a_sleeper_wakes_nobody() {
        let session = Session::create(None).expect("a session");
        let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
        let rings = bell.announce();
        bell.retire();
        bell.ring();
        assert_eq!(bell.announce(), rings);
        bell.ring();
        assert_eq!(bell.announce(), rings + 1);
    }

    #[test]
    fn only_sleeps_of_two_ticks_or_more_need_no_timer() {
        assert!(has_no_timer(100_000_000));
        assert!(!has_no_timer(99_999_999));
    }

    #[test]
    fn a_ticking_bell_wakes_its_owner_and_ends_with_its_last_clone() {
        let session = Session::create(None).expect("a session");
        let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
        bell.tick();
        let (naps, napped) = std::sync::mpsc::channel();
        let owner = bell.clone();
        thread::spawn(move || {
            for (longest, pause) in [(LONG, 0), (LONG, 0), (2 * TICK, 0), (LONG, 120), (TICK, 0)] {
                thread::sleep(Duration::from_millis(pause)); // it parks meanwhile
                owner.sleep(owner.announce(), longest.as_nanos() as u64);
                owner.retire();
                naps.send(longest).expect("is heard");
            }
        });
        for _ in 0..5 {
            napped
                .recv_timeout(LONG / 2)
                .expect("nobody wakes the owner");
        }
        let weak = Arc::downgrade(&bell.0);
        drop(bell);
        let since = Instant::now();
        while weak.strong_count() > 0 {
            assert!(since.elapsed() < LONG, "the thread keeps the bell");
            thread::sleep(Duration::from_millis(1));
        }
    }

    /// Two threads pass a number back and forth and sleep whenever they see nothing new. A lost ring shows as a sleep
    /// of one minute.
    #[test]
    fn no_ring_is_lost() {
        const TURNS: u64 = 1_000_000;
        let session = Session::create(None).expect("a session");
        let make = |owner| Bell::create(session.info(), owner).expect("creates");
        let bells = [make(Owner::Plant), make(Owner::Controller(1))];
        let turn = AtomicU64::new(0);
        let play = |own: usize| {
            let (bell, other) = (&bells[own], &bells[1 - own]);
            for mine in (own as u64..TURNS).step_by(2) {
                let is_mine = || turn.load(Ordering::Relaxed) == mine;
                while !is_mine() {
                    let announced = bell.announce();
                    let since = Instant::now();
                    if !is_mine() {
                        bell.sleep(announced, LONG.as_nanos() as u64);
                    }
                    bell.retire();
                    assert!(
                        since.elapsed() < LONG / 2,
                        "the ring of turn {mine} is lost"
                    );
                }
                turn.store(mine + 1, Ordering::Relaxed);
                other.ring();
            }
        };
        std::thread::scope(|scope| {
            scope.spawn(|| play(1));
            play(0);
        });
        assert_eq!(turn.into_inner(), TURNS);
    }
}
