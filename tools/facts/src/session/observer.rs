//! Watching a session from outside: its records and events as they come.
//!
//! Used by `hil monitor`, `panel` and `watch`. Passive: it gives no credit, so the loop never waits for
//! it; what it is too slow for it loses, and it counts that. It attaches beside the recorder, never in
//! its place, and leaves nothing in shared memory. Asks nobody anything.

use std::time::Duration;

use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_recording::clean::clean;
use hil_session::session::{SessionError, SessionInfo};
use hil_session::stream::{BUFFER, IceoryxSource, WATCHERS};
use serde::{Deserialize, Serialize};
use shared_types::describe::Description;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout, RecordView};
use shared_types::stream::{Item, RecordSource};

use crate::programs::binaries::{Binaries, Binary};
use crate::programs::checked::checked;

/// File of the session's folder that tells what is run.
const FILE: &str = "run.json";
/// File of the session's folder that lets others watch, with what records hold.
const ADMITTED: &str = "admitted.json";
/// Shortest and longest sleep between two looks at the stream. The shortest empties it often enough
/// for the fastest loop; one that is longer is not seen on a screen.
const NAPS: [Duration; 2] = [Duration::from_millis(4), Duration::from_millis(32)];
/// With N items at one look, which takes no more, it looks again at once and then more often;
/// with fewer than an eighth less often.
const MANY: usize = BUFFER / 8;

/// Notice of a session for its observers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Notice {
    /// Both sides run in one process, whose records nobody else can see.
    pub is_in_process: bool,
    /// The complete scenario.
    pub scenario: String,
    /// Description of the plant; of one process only its name.
    pub plant: Description,
    /// Description of the controller; of one process only its name.
    pub controller: Description,
}

impl Notice {
    /// Tells it, before the processes are started.
    ///
    /// # Errors
    /// If the session's folder cannot be written.
    pub fn write(
        session: &SessionInfo,
        scenario: &str,
        binaries: &Binaries,
        is_in_process: bool,
    ) -> Result<(), Failure> {
        // They are for those who watch records.
        let description = |binary: &Binary| match &binary.description {
            all if is_in_process => Description::new(&all.program, &all.version),
            all => all.clone(),
        };
        let notice = Self {
            is_in_process,
            scenario: scenario.into(),
            plant: description(&binaries.plant),
            controller: description(&binaries.controller),
        };
        (session.write_file(FILE, &notice)).map_err(Failure::infrastructure)
    }

    /// Reads it; `None` as long as it is not there.
    #[must_use]
    pub fn read(session: &SessionInfo) -> Option<Self> {
        session.read_file(FILE).ok()
    }

    /// The name of the scenario.
    pub fn scenario_name(&self) -> Option<String> {
        let scenario: toml_edit::DocumentMut = self.scenario.parse().ok()?;
        Some(scenario.get("name")?.as_str()?.to_owned())
    }

    /// Computes the age of the notice; `None` if it is missing, or the clock was set back.
    pub fn age(session: &SessionInfo) -> Option<Duration> {
        let written = std::fs::metadata(session.folder.join(FILE))
            .ok()?
            .modified();
        written.ok()?.elapsed().ok()
    }

    /// The scenario, checked.
    ///
    /// # Errors
    /// If it does not suit what plant and controller say of themselves.
    pub fn plan(&self) -> Result<Plan, Failure> {
        let origin = "the running scenario".as_ref();
        checked(&self.scenario, origin, &self.plant, &self.controller)
    }
}

/// Lets others watch a session: the recorder is there, and what it looked at was closed to other users.
/// Not before, because what iceoryx2 makes for one who attaches is open for a moment.
///
/// # Errors
/// If the session's folder cannot be written.
pub fn admit(session: &SessionInfo, layout: &RecordLayout) -> Result<(), SessionError> {
    session.write_file(ADMITTED, layout)
}

/// Observation of a run.
#[derive(Debug)]
pub enum Seen<'a> {
    /// A record, and its words.
    Record(RecordView<'a>, &'a [u64]),
    /// Something happened.
    Event(Event),
    /// Number of records and events that were lost before the next one.
    Lost(u64),
    /// Something could not be read, and why.
    Broken(String),
}

/// Watcher of a session, until it is dropped.
pub struct Observer {
    session: SessionInfo,
    source: Option<IceoryxSource>,
    layout: RecordLayout,
    has_joined: bool,
    /// There may be more than was taken at the last look.
    has_more: bool,
    nap: Duration,
}

impl Observer {
    /// Attaches to a session; `None` as long as it exchanges no samples yet.
    ///
    /// # Errors
    /// If enough others watch it, or shared memory cannot be used.
    pub fn attach(session: &SessionInfo) -> Result<Option<Self>, Failure> {
        let Ok(layout) = session.read_file(ADMITTED) else {
            return Ok(None);
        };
        let mut observer = Self {
            session: session.clone(),
            source: None,
            layout,
            has_joined: false,
            has_more: false,
            nap: NAPS[0],
        };
        match IceoryxSource::watch(session) {
            Ok(source) => observer.source = Some(source),
            Err(LinkError::Taken { .. }) => {
                return Err(Failure::usage(format!(
                    "session `{}` is watched by {WATCHERS} others, which is as many as it takes",
                    session.name
                )));
            }
            Err(LinkError::Absent { .. }) => return Ok(None),
            // What ends while one attaches to it fails in many ways.
            Err(_) if !session.is_there() => return Ok(None),
            Err(error) => return Err(Failure::infrastructure(error)),
        }
        session.tighten();
        Ok(Some(observer))
    }

    /// Returns the layout of the records.
    #[must_use]
    pub const fn layout(&self) -> &RecordLayout {
        &self.layout
    }

    /// Takes what is there, and returns how many items that were.
    ///
    /// # Errors
    /// If the stream failed.
    pub fn look(&mut self, mut take: impl FnMut(Seen<'_>)) -> Result<usize, Failure> {
        let Some(source) = &mut self.source else {
            return Ok(0);
        };
        let (layout, has_joined) = (&self.layout, &mut self.has_joined);
        let taken = source.drain(&mut |item| match item {
            Item::Record(words) if words.len() == layout.words() => {
                *has_joined = true;
                take(Seen::Record(layout.view(words), words));
            }
            Item::Record(words) => {
                let (got, wanted) = (words.len(), layout.words());
                take(Seen::Broken(format!(
                    "a record of {got} words, not {wanted}"
                )));
            }
            Item::Event(event) => {
                *has_joined = true;
                take(Seen::Event(clean(event)));
            }
            // What was before it came is not lost to it.
            Item::Lost(_) if !*has_joined => {}
            Item::Lost(count) => take(Seen::Lost(count)),
            // The rest of an event whose begin was before that.
            Item::Broken(_) if !*has_joined => {}
            Item::Broken(what) => take(Seen::Broken(what)),
        });
        let taken = taken.map_err(Failure::infrastructure)?;
        let [shortest, longest] = NAPS;
        self.has_more = taken >= MANY;
        if self.has_more {
            self.nap = (self.nap / 2).clamp(shortest, longest);
        } else if taken < MANY / 8 {
            self.nap = (self.nap * 2).clamp(shortest, longest);
        }
        Ok(taken)
    }

    /// Computes the sleep until the next look from the yield of the last ones.
    #[must_use]
    pub const fn nap(&self) -> Duration {
        if self.has_more {
            Duration::ZERO
        } else {
            self.nap
        }
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        self.source = None;
        self.session.clear_after();
    }
}
