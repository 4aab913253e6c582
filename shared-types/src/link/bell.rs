//! Bells: each side of a session sleeps on its own, and whoever sends to it rings.
//!
//! A bell is two words in shared memory. They carry no data, so they never touch a result. No ring is lost,
//! and none costs a system call while nobody sleeps:
//!
//! 1. The sleeper reads `rings`, sets `sleeping`, and looks once more for what it awaits.
//! 2. The ringer sends, and looks at `sleeping`. If it is set, it counts up `rings` and wakes.
//! 3. The kernel lets the sleeper sleep only as long as `rings` is what was read in 1.
//!
//! Between sending and looking on both sides stands a full fence, so at least one of the two sees the other.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{Ordering, fence};

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

use super::LinkError;
use super::iceoryx::transport;
use crate::session::SessionInfo;
use crate::wait::Sleeper;

/// Owner of a bell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    /// The plant, for the whole session.
    Plant,
    /// The controller of this epoch.
    Controller(u32),
}

/// A bell of a session. Clones are the same bell.
#[derive(Clone)]
pub struct Bell(Arc<Storage<Words>>);

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
    /// Makes a bell. Its file goes with the last clone here, or else with the session.
    ///
    /// # Errors
    /// [`LinkError::Taken`] if it is there already; or shared memory cannot be used.
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
            .map(|storage| Self(Arc::new(storage)))
            .map_err(|error| match error {
                DynamicStorageCreateError::AlreadyExists => LinkError::Taken {
                    service: name.clone(),
                    role: "plant",
                },
                error => transport(&name, error),
            })
    }

    /// Opens a bell that another process made, once a service that it makes afterwards is there: a file
    /// without a size yet is waited for without a limit.
    ///
    /// # Errors
    /// [`LinkError::Absent`] as long as it is not there.
    pub fn open(session: &SessionInfo, owner: Owner) -> Result<Self, LinkError> {
        let name = owner.name();
        let (file, configuration) = place(session, &name)?;
        Builder::new(&file)
            .config(&configuration)
            .has_ownership(false)
            .open(AccessMode::ReadWrite)
            .map(|storage| Self(Arc::new(storage)))
            .map_err(|error| match error {
                DynamicStorageOpenError::DoesNotExist
                | DynamicStorageOpenError::InitializationNotYetFinalized => LinkError::Absent {
                    service: name.clone(),
                    reason: "the plant has not made it".into(),
                },
                error => transport(&name, error),
            })
    }

    /// Wakes the owner if it sleeps or is about to. To be called after what it awaits was sent.
    #[inline]
    pub fn ring(&self) {
        let words = self.0.get();
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
        let words = self.0.get();
        let rings = words.rings.load(Ordering::Acquire);
        words.sleeping.store(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        rings
    }

    fn sleep(&self, rings: u32, ns: u64) {
        let limit = Timespec {
            tv_sec: (ns / 1_000_000_000) as i64,
            tv_nsec: (ns % 1_000_000_000) as _,
        };
        let words = self.0.get();
        // A ring, the end of the time and a signal all mean the same: look again.
        let _ = futex::wait(&words.rings, futex::Flags::empty(), rings, Some(&limit));
    }

    fn retire(&self) {
        self.0.get().sleeping.store(0, Ordering::Relaxed);
    }
}

impl fmt::Debug for Bell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.get().fmt(f)
    }
}

/// Returns the name and prefix of a bell's file.
fn place(session: &SessionInfo, name: &str) -> Result<(FileName, Configuration<Words>), LinkError> {
    let file = |text: &str| FileName::new(text.as_bytes()).map_err(|e| transport(name, e));
    let configuration = Configuration::default().prefix(&file(&session.prefix)?);
    Ok((file(name)?, configuration))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicU64;
    use std::time::{Duration, Instant};

    use super::*;
    use crate::session::Session;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_bell_is_there_once_private_and_gone_with_its_maker() {
        let session = Session::create(None).expect("a session");
        let info = session.info();
        let absent = Bell::open(info, Owner::Plant);
        assert!(
            matches!(absent, Err(LinkError::Absent { .. })),
            "{absent:?}"
        );
        let bell = Bell::create(info, Owner::Plant).expect("creates");
        let taken = Bell::create(info, Owner::Plant);
        assert!(matches!(taken, Err(LinkError::Taken { .. })), "{taken:?}");
        let other = Bell::create(info, Owner::Controller(1)).expect("another");
        Bell::open(info, Owner::Plant).expect("opens");
        assert_eq!(info.open_to_others(), Vec::<std::path::PathBuf>::new());
        let there = info.segments().len();
        drop((bell, other));
        assert_eq!(info.segments().len(), there - 2);
    }

    #[test]
    fn a_killed_makers_bell_is_swept_away_with_its_session() {
        let session = Session::create(None).expect("a session");
        let info = session.info().clone();
        std::mem::forget(Bell::create(&info, Owner::Plant).expect("creates"));
        assert!(!info.segments().is_empty());
        drop(session);
        assert!(info.segments().is_empty());
    }

    #[test]
    fn nobody_is_woken_who_does_not_sleep() {
        let session = Session::create(None).expect("a session");
        let bell = Bell::create(session.info(), Owner::Plant).expect("creates");
        let rings = bell.announce();
        bell.retire();
        bell.ring();
        assert_eq!(bell.announce(), rings);
        bell.ring();
        assert_eq!(bell.announce(), rings + 1);
    }

    /// Two threads hand a number to and fro and sleep as soon as they see nothing new. A lost ring shows as a
    /// sleep of a minute.
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
