//! Both sides of a run in one thread, alternating.
//!
//! Used by `hil run --link in-process` and by campaigns, for plants, fault kinds and laws that are built into `hil`, and
//! by sessions in Python, step by step.
//! Starts no process and never waits for one. A separate package, so that engine and runner of such a run are compiled
//! once and in one codegen unit.

use std::sync::{Arc, LazyLock};

use controller_process::controller::LawKind;
use controller_process::job::Job as ControllerJob;
use controller_process::runner::{End, Runner, choose};
use hil_session::waiter::Waiter;
use plant_process::engine::{Engine, Progress};
use plant_process::faults::{FaultBuilder, FaultKindEntry};
use plant_process::job::Job as PlantJob;
use plant_process::plant::PlantKind;
use plant_process::program::{self, HELD};
use plant_process::request_queue::RequestQueue;
use shared_types::describe::Invalid;
use shared_types::link::LinkError;
use shared_types::link::in_process::{InProcessLink, pair};
use shared_types::lockstep::{Abort, ControllerEvent, PlantEvent};
use shared_types::record::RunEnd;
use shared_types::state::State;
use shared_types::stream::RecordSink;

/// Plants that are built into `hil`.
pub static PLANTS: LazyLock<Vec<Arc<PlantKind>>> =
    LazyLock::new(|| shared(plant_process::models::all()));
/// Kinds of faults that are built into `hil`.
pub static FAULTS: LazyLock<Vec<FaultKindEntry>> = LazyLock::new(plant_process::faults::kinds::all);
/// Laws that are built into `hil`.
pub static LAWS: LazyLock<Vec<Arc<LawKind>>> =
    LazyLock::new(|| shared(controller_process::laws::all()));

fn shared<T>(kinds: Vec<T>) -> Vec<Arc<T>> {
    kinds.into_iter().map(Arc::new).collect()
}

/// Returns the plant of a job.
///
/// # Errors
/// If there is no plant of this name.
fn plant_of(job: &PlantJob) -> Result<&'static Arc<PlantKind>, String> {
    let model = &job.plant.model;
    let kind = PLANTS.iter().find(|kind| kind.description.name == *model);
    kind.ok_or_else(|| format!("hil has no plant `{model}`"))
}

/// Validates a plant's job as `--check` of its program does.
///
/// # Errors
/// If the plant objects to its job.
pub fn check_plant(job: PlantJob) -> Result<(), String> {
    program::check(plant_of(&job)?, &FAULTS, job)
}

/// Validates a controller's job as `--check` of its program does.
///
/// # Errors
/// If the controller objects to its job.
pub fn check_controller(job: ControllerJob) -> Result<(), String> {
    let law = Arc::clone(law_of(&job)?);
    let runner = Runner::new(law, job, pair().1);
    runner.map(|_| ()).map_err(|e| e.to_string())
}

fn law_of(job: &ControllerJob) -> Result<&'static Arc<LawKind>, String> {
    choose(&LAWS, &job.law, &job.plant).map_err(|e| e.to_string())
}

/// Plant and law of a run in this process.
#[derive(Clone)]
pub struct Kinds {
    /// Plant.
    pub plant: Arc<PlantKind>,
    /// Law.
    pub law: Arc<LawKind>,
}

impl Kinds {
    /// Returns the plant and the law of jobs that are built into `hil`.
    ///
    /// # Errors
    /// If there is no plant or no law of such a name.
    pub fn built_in(plant: &PlantJob, controller: &ControllerJob) -> Result<Self, String> {
        Ok(Self {
            plant: Arc::clone(plant_of(plant)?),
            law: Arc::clone(law_of(controller)?),
        })
    }

    /// Returns `true` if these are the same plant and law, not only others of the same names.
    #[must_use]
    pub fn are(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.plant, &other.plant) && Arc::ptr_eq(&self.law, &other.law)
    }

    /// Validates a plant's job as `--check` of its program does.
    ///
    /// # Errors
    /// If the plant objects to its job.
    pub fn check_plant(&self, job: PlantJob) -> Result<(), String> {
        program::check(&self.plant, &FAULTS, job)
    }

    /// Validates a controller's job as `--check` of its program does.
    ///
    /// # Errors
    /// If the controller objects to its job.
    pub fn check_controller(&self, job: ControllerJob) -> Result<(), String> {
        let runner = Runner::new(Arc::clone(&self.law), job, pair().1);
        runner.map(|_| ()).map_err(|e| e.to_string())
    }
}

/// Both sides of a run.
pub struct Turns<'a> {
    engine: Engine<InProcessLink, Box<dyn RecordSink + 'a>>,
    runner: Runner<Arc<LawKind>, InProcessLink>,
}

impl<'a> Turns<'a> {
    /// Creates both sides of a run of a plant and a law that are built into `hil`; records go to `sink`.
    ///
    /// # Errors
    /// If a side objects to its job.
    pub fn new(
        plant: PlantJob,
        controller: ControllerJob,
        sink: impl RecordSink + 'a,
    ) -> Result<Self, String> {
        let kinds = Kinds::built_in(&plant, &controller)?;
        Self::of(kinds, plant, controller, Box::new(sink))
    }

    /// Creates both sides of a run; records go to `sink`.
    ///
    /// # Errors
    /// If a side objects to its job.
    pub fn of(
        kinds: Kinds,
        plant: PlantJob,
        controller: ControllerJob,
        sink: Box<dyn RecordSink + 'a>,
    ) -> Result<Self, String> {
        let (plant_link, controller_link) = pair();
        let engine = Engine::new(&kinds.plant, &FAULTS, plant, plant_link, sink);
        let runner = Runner::new(kinds.law, controller, controller_link);
        Ok(Self {
            engine: engine.map_err(|e| e.to_string())?.without_log(),
            runner: runner.map_err(|e| e.to_string())?,
        })
    }

    /// Sends the controller's hello; call once, before the first [`turn`](Self::turn).
    ///
    /// # Errors
    /// If the link failed.
    pub fn begin(&mut self) -> Result<(), LinkError> {
        self.runner.begin()
    }

    /// Polls each side once, and returns the progress of the plant.
    ///
    /// # Errors
    /// If the link or the record stream failed.
    #[inline]
    pub fn turn(&mut self) -> Result<Progress, LinkError> {
        let was_running = self.runner.end().is_none();
        self.runner.poll()?;
        if was_running && let Some(End::Aborted(Abort::Failed(reason))) = self.runner.end() {
            self.engine.controller_failed(reason.clone());
        }
        self.engine.poll()
    }

    /// Returns the end of the run; `None` until then.
    #[must_use]
    pub const fn end(&self) -> Option<&RunEnd> {
        self.engine.end()
    }

    /// Returns the reason for the end of the run, if there is one.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        self.end()?.reason.as_deref()
    }

    /// Returns the state of plant and controller in a run that is held before a step.
    ///
    /// # Errors
    /// If a side cannot save its state.
    pub fn states(&mut self) -> Result<[State; 2], Invalid> {
        Ok([self.engine.state()?, self.runner.state()?])
    }

    /// Returns the queue of requests to this run.
    #[must_use]
    pub fn queue(&self) -> Arc<RequestQueue> {
        self.engine.queue()
    }

    /// Returns the fault builder of this run.
    #[must_use]
    pub fn builder(&self) -> Arc<FaultBuilder> {
        self.engine.builder()
    }

    /// Polls both sides alternately until the run is over; returns its end.
    ///
    /// # Errors
    /// If a side failed.
    pub fn run(
        mut self,
        mut waiter: Waiter,
        wants_stop: &dyn Fn() -> bool,
    ) -> Result<RunEnd, String> {
        self.poll_to_end(&mut waiter, wants_stop)
            .map_err(|e| e.to_string())?;
        let end = self.engine.end().cloned();
        end.ok_or_else(|| "the run ended without a result".into())
    }

    fn poll_to_end(
        &mut self,
        waiter: &mut Waiter,
        wants_stop: &dyn Fn() -> bool,
    ) -> Result<(), LinkError> {
        let queue = self.queue();
        self.begin()?;
        loop {
            if wants_stop() {
                self.engine.interrupt(&PlantEvent::Stop)?;
                self.runner.interrupt(&ControllerEvent::Stop)?;
            }
            match self.turn()? {
                Progress::Over => return Ok(()),
                Progress::Busy => waiter.done(),
                Progress::Until(target_ns) => {
                    waiter.until_ns(target_ns, || wants_stop() || queue.wants_attention());
                }
                Progress::Held => {
                    std::thread::sleep(HELD);
                    waiter.done();
                }
                Progress::Recorder => {
                    if waiter.sleep() {
                        self.engine.recorder_late()?;
                    }
                }
                Progress::Controller | Progress::ControllerUntil(_) => {
                    // Each side has been polled; if still nothing comes, one of them is broken.
                    if waiter.pause() {
                        self.engine
                            .interrupt(&PlantEvent::Deadline(waiter.limit().ms()))?;
                    }
                }
            }
        }
    }
}
