//! Observation of a session from outside: its records and events as they arrive.
//!
//! Used by `hil monitor`, `panel` and `watch`. An observer is passive: it gives no credit, so the loop never waits for
//! it, and if it is too slow it loses records and counts them. It attaches in addition to the recorder, never in its
//! place, leaves nothing in shared memory, and sends no requests.

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

/// File in the session's folder that describes the run.
const FILE: &str = "run.json";
/// File in the session's folder that admits observers, with the layout of the records.
const ADMITTED: &str = "admitted.json";
/// Minimum and maximum sleep between two reads of the stream. The minimum empties the stream often enough for the
/// fastest loop; the maximum is still imperceptible on a screen.
const NAPS: [Duration; 2] = [Duration::from_millis(4), Duration::from_millis(32)];
/// Maximum number of items per read. After a full read the next one follows at once and reads become more frequent;
/// with fewer than an eighth of this number, reads become less frequent.
const MANY: usize = BUFFER / 8;

/// Notice of a session for its observers.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Notice {
    /// `true` if both sides run in one process, whose records no other process can read.
    pub is_in_process: bool,
    /// Complete scenario.
    pub scenario: String,
    /// Description of the plant; only its name for a run in one process.
    pub plant: Description,
    /// Description of the controller; only its name for a run in one process.
    pub controller: Description,
}

impl Notice {
    /// Writes the notice, before the processes are started.
    ///
    /// # Errors
    /// If the session's folder cannot be written.
    pub fn write(
        session: &SessionInfo,
        scenario: &str,
        binaries: &Binaries,
        is_in_process: bool,
    ) -> Result<(), Failure> {
        // Descriptions serve only observers of records.
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

    /// Reads the notice; `None` until it exists.
    #[must_use]
    pub fn read(session: &SessionInfo) -> Option<Self> {
        session.read_file(FILE).ok()
    }

    /// Returns the name of the scenario.
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

    /// Returns the checked scenario.
    ///
    /// # Errors
    /// If the scenario does not fit the descriptions of plant and controller.
    pub fn plan(&self) -> Result<Plan, Failure> {
        let origin = "the running scenario".as_ref();
        checked(&self.scenario, origin, &self.plant, &self.controller)
    }
}

/// Admits observers to a session after the recorder is attached and the stream is closed to other users. Admission
/// cannot be earlier, because iceoryx2 creates files for an attaching process that are briefly open.
///
/// # Errors
/// If the session's folder cannot be written.
pub fn admit(session: &SessionInfo, layout: &RecordLayout) -> Result<(), SessionError> {
    session.write_file(ADMITTED, layout)
}

/// Observation of a run.
#[derive(Debug)]
pub enum Seen<'a> {
    /// Record, with its words.
    Record(RecordView<'a>, &'a [u64]),
    /// Event.
    Event(Event),
    /// Number of records and events lost before the next one.
    Lost(u64),
    /// Unreadable item, with the reason.
    Broken(String),
}

/// Observer of a session; detaches when dropped.
pub struct Observer {
    session: SessionInfo,
    source: Option<IceoryxSource>,
    layout: RecordLayout,
    has_joined: bool,
    /// `true` if the last read may have left items.
    has_more: bool,
    nap: Duration,
}

impl Observer {
    /// Attaches to a session; `None` until the session exchanges samples.
    ///
    /// # Errors
    /// If the session has the maximum number of observers, or shared memory cannot be used.
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
                    "session `{}` already has {WATCHERS} observers, which is the maximum; close one of them",
                    session.name
                )));
            }
            Err(LinkError::Absent { .. }) => return Ok(None),
            // Attaching to a session that ends meanwhile fails in many ways.
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

    /// Reads available items and returns their number.
    ///
    /// # Errors
    /// If the stream failed.
    pub fn look(&mut self, mut take: impl FnMut(Seen<'_>)) -> Result<usize, Failure> {
        let Some(source) = &mut self.source else {
            return Ok(0);
        };
        let (layout, has_joined) = (&self.layout, &mut self.has_joined);
        let drained = source.drain(&mut |item| match item {
            Item::Record(words) if words.len() == layout.words() => {
                *has_joined = true;
                take(Seen::Record(layout.view(words), words));
            }
            Item::Record(words) => {
                let (got, expected) = (words.len(), layout.words());
                take(Seen::Broken(format!(
                    "a record of {got} words, not {expected}"
                )));
            }
            Item::Event(event) => {
                *has_joined = true;
                take(Seen::Event(clean(event)));
            }
            // Items from before it attached are not lost.
            Item::Lost(_) if !*has_joined => {}
            Item::Lost(count) => take(Seen::Lost(count)),
            // The rest of an event that began before it attached.
            Item::Broken(_) if !*has_joined => {}
            Item::Broken(what) => take(Seen::Broken(what)),
        });
        let drained = drained.map_err(Failure::infrastructure)?;
        let [shortest, longest] = NAPS;
        self.has_more = drained >= MANY;
        if self.has_more {
            self.nap = (self.nap / 2).clamp(shortest, longest);
        } else if drained < MANY / 8 {
            self.nap = (self.nap * 2).clamp(shortest, longest);
        }
        Ok(drained)
    }

    /// Returns the sleep until the next read, adapted to the yield of the last reads.
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
