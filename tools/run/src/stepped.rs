//! Run in the calling thread that is held before any step, and saved and restored in memory.
//!
//! Used by sessions in Python. Engine, runner and evaluation are those of every other run, and so are faults, changes of
//! values, digest and verdicts. Starts no thread and no process, writes no file, and never waits.

mod recorder;

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;

use controller_process::job::Job as ControllerJob;
use hil_config::expression::Columns;
use hil_config::monitor::Verdict;
use hil_config::plan::{FaultEvent, Plan};
use hil_console::terminal::exit::Failure;
use hil_facts::results::recorded::Recorded;
use hil_facts::results::requirements::{Requirement, RunVerdict};
use hil_facts::results::summary::Metric;
use hil_in_process::{FAULTS, Kinds, Turns};
use hil_session::clock::monotonic_ns;
use plant_process::engine::Progress;
use plant_process::job::Job as PlantJob;
use plant_process::live::{LiveContext, Service};
use plant_process::request_queue::LoopRequest;
use shared_types::checkpoint::{Checkpoints, Resume};
use shared_types::describe::Description;
use shared_types::link::LinkError;
use shared_types::live::{Request, Response};
use shared_types::record::{GROUPS, Outcome, RecordLayout, RunEnd};
use shared_types::state::State;
use shared_types::table::Field;
use shared_types::time::Step;

use super::alone;
use super::jobs::objections;
use recorder::{SharedRecorder, StepRecorder};

/// Step beyond the end of any run.
const NEVER: Step = Step(u64::MAX);
/// Polls without progress after which one of the sides is broken: each answers at once.
const MOST_IDLE_POLLS: u32 = 1000;
/// Polls with progress between two looks at the clock.
const POLLS_BETWEEN_LOOKS: u32 = 32;

/// Place of a value in the newest record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Index of a word.
    Word(usize),
    /// Index of a derived signal.
    Derived(usize),
}

/// Run that is held before its next step.
pub struct SteppedRun {
    plan: Arc<Plan>,
    described: Arc<[Description; 2]>,
    kinds: Kinds,
    /// Jobs of both sides from the beginning of the run.
    jobs: (PlantJob, ControllerJob),
    layout: RecordLayout,
    columns: Columns,
    /// Recorder before the first record.
    fresh: StepRecorder,
    recorder: SharedRecorder,
    turns: Turns<'static>,
    /// Service of requests, once there was one.
    service: Option<Service>,
    /// Earlier requests of the restored state, if there were any.
    context: Option<Arc<LiveContext>>,
}

/// State of a run before a step, with the results of all earlier steps.
#[derive(Clone)]
pub struct SavedRun {
    plan: Arc<Plan>,
    kinds: Kinds,
    step: Step,
    states: [State; 2],
    recorder: StepRecorder,
    /// Context after the requests so far; `None` if there was none.
    context: Option<Arc<LiveContext>>,
}

impl SavedRun {
    /// Returns the step before which the run was saved.
    #[must_use]
    pub const fn step(&self) -> Step {
        self.step
    }
}

impl SteppedRun {
    /// Begins the run of a plan that was checked against these descriptions, and holds it before step 0. Without kinds,
    /// plant and law are those built into `hil`.
    ///
    /// # Errors
    /// If the result depends on the clock, or a side refuses its job.
    pub fn new(
        plan: Plan,
        described: Arc<[Description; 2]>,
        kinds: Option<Kinds>,
    ) -> Result<Self, Failure> {
        alone::refuse_clock(&plan)?;
        let (plant, controller, layout) = alone::jobs_of(&plan, &described)?;
        let kinds = match kinds {
            Some(kinds) => kinds,
            None => Kinds::built_in(&plant, &controller).map_err(Failure::usage)?,
        };
        let plant = PlantJob {
            pause_at_s: Some(0.0),
            ..plant
        };
        let fresh = StepRecorder::new(&plan, layout.clone());
        let recorder = SharedRecorder(Rc::new(RefCell::new(fresh.clone())));
        let jobs = (plant, controller);
        let turns = start(&kinds, jobs.clone(), &recorder)?;
        let mut run = Self {
            plan: Arc::new(plan),
            described,
            kinds,
            jobs,
            columns: Columns::from(&layout),
            layout,
            fresh,
            recorder,
            turns,
            service: None,
            context: None,
        };
        run.begin()?;
        Ok(run)
    }

    /// Polls both sides until they are held before their first step.
    fn begin(&mut self) -> Result<(), Failure> {
        self.turns.begin().map_err(Failure::infrastructure)?;
        self.advance(NEVER, u64::MAX)?;
        match (&self.recorder.0.borrow().error, self.turns.end()) {
            (Some(error), _) => Err(Failure::infrastructure(error)),
            (None, Some(_)) => Err(Failure::infrastructure(
                self.turns.reason().unwrap_or("the run ended at once"),
            )),
            (None, None) => Ok(()),
        }
    }

    /// Begins again at step 0, with another seed if one is given.
    ///
    /// # Errors
    /// If a side refuses its job.
    pub fn reset(&mut self, seed: Option<u64>) -> Result<(), Failure> {
        let mut jobs = self.jobs.clone();
        let seed = seed.unwrap_or(self.plan.run.seed);
        jobs.0.run.seed = seed;
        self.replace(jobs, self.fresh.clone(), None)?;
        if seed != self.plan.run.seed {
            Arc::make_mut(&mut self.plan).run.seed = seed;
            self.jobs.0.run.seed = seed;
        }
        Ok(())
    }

    /// Replaces the run by another one, which is held before its first step; keeps the present one if that fails.
    fn replace(
        &mut self,
        jobs: (PlantJob, ControllerJob),
        recorder: StepRecorder,
        context: Option<Arc<LiveContext>>,
    ) -> Result<(), Failure> {
        let recorder = SharedRecorder(Rc::new(RefCell::new(recorder)));
        let turns = start(&self.kinds, jobs, &recorder)?;
        let present = (
            std::mem::replace(&mut self.turns, turns),
            std::mem::replace(&mut self.recorder, recorder),
            self.service.take(),
            std::mem::replace(&mut self.context, context),
        );
        let begun = self.begin();
        if begun.is_err() {
            (self.turns, self.recorder, self.service, self.context) = present;
        }
        begun
    }

    /// Saves the run before its next step.
    ///
    /// # Errors
    /// If the run is over, or the plant, the law or a fault cannot save its state.
    pub fn save(&mut self) -> Result<SavedRun, Failure> {
        if self.is_over() {
            return Err(Failure::usage(
                "the run is over, and has no step to save before",
            ));
        }
        let states = self.turns.states().map_err(Failure::usage)?;
        Ok(SavedRun {
            plan: Arc::clone(&self.plan),
            kinds: self.kinds.clone(),
            step: self.step(),
            states,
            recorder: self.recorder.0.borrow().clone(),
            context: match &self.service {
                Some(service) => Some(Arc::new(service.context().clone())),
                None => self.context.clone(),
            },
        })
    }

    /// Continues from a saved state of a run of the same plan.
    ///
    /// # Errors
    /// If the state is one of another plan, or a side refuses it.
    pub fn restore(&mut self, saved: &SavedRun) -> Result<(), Failure> {
        if !Arc::ptr_eq(&saved.plan, &self.plan) && saved.plan != self.plan {
            return Err(Failure::usage(
                "the state is one of another scenario, or of another seed",
            ));
        }
        if !saved.kinds.are(&self.kinds) {
            return Err(Failure::usage(
                "the state is one of another plant or law of the same name",
            ));
        }
        let resume = |state: &State| Checkpoints {
            resume: Some(Resume {
                step: saved.step,
                state: Default::default(),
                memory: Some(state.clone()),
            }),
            ..Checkpoints::default()
        };
        let (mut plant, mut controller) = self.jobs.clone();
        let accepted = &saved.recorder.collector.recorded.faults.accepted;
        let live = accepted.iter().map(|live| &live.event);
        plant.faults.extend(live.map(FaultEvent::clone));
        plant.checkpoints = resume(&saved.states[0]);
        controller.checkpoints = resume(&saved.states[1]);
        let jobs = (plant, controller);
        self.replace(jobs, saved.recorder.clone(), saved.context.clone())
    }

    /// Executes all steps before `target`, or the whole run if the target is not before its end. Returns `false` if
    /// the monotonic clock reached `until_ns` first: then the next call must have the same target, or
    /// [`hold`](Self::hold) must follow.
    ///
    /// # Errors
    /// If a side failed; a run that diverged is over and no error.
    pub fn advance_to(&mut self, target: Step, until_ns: u64) -> Result<bool, Failure> {
        if self.is_over() {
            return Ok(true);
        }
        let is_end = target.0 >= self.plan.run.steps;
        let queue = self.turns.queue();
        queue.hold_at(if is_end { NEVER } else { target });
        let has_arrived = self.advance(target, until_ns)?;
        if let Some(RunEnd {
            outcome: Outcome::Failed | Outcome::Stopped,
            ..
        }) = self.turns.end()
        {
            let reason = self.turns.reason();
            return Err(Failure::infrastructure(
                reason.unwrap_or("the run gave no reason"),
            ));
        }
        if let Some(error) = &self.recorder.0.borrow().error {
            return Err(Failure::infrastructure(error));
        }
        Ok(has_arrived)
    }

    /// Holds the run before its next step, after an advance that did not arrive.
    ///
    /// # Errors
    /// If a side failed.
    pub fn hold(&mut self) -> Result<(), Failure> {
        let queue = self.turns.queue();
        let _answer = queue.push(LoopRequest::Pause);
        self.advance(NEVER, u64::MAX).map(|_| ())
    }

    fn advance(&mut self, target: Step, until_ns: u64) -> Result<bool, Failure> {
        let failed = |error: LinkError| Failure::infrastructure(error);
        let (mut idle, mut busy) = (0, 0);
        loop {
            match self.turns.turn().map_err(failed)? {
                Progress::Over | Progress::Held => return Ok(true),
                Progress::Busy => {
                    (idle, busy) = (0, busy + 1);
                    if busy % POLLS_BETWEEN_LOOKS == 0 && monotonic_ns() >= until_ns {
                        return Ok(false);
                    }
                }
                _ if idle < MOST_IDLE_POLLS => idle += 1,
                _ => {
                    return Err(Failure::infrastructure(format!(
                        "neither plant nor controller goes on before step {target}"
                    )));
                }
            }
        }
    }

    /// Passes a request of a session to the run, which is held.
    pub fn request(&mut self, request: Request) -> Response {
        let (turns, kinds, (plant, controller)) = (&mut self.turns, &self.kinds, &self.jobs);
        let service = self.service.get_or_insert_with(|| {
            let context = match &self.context {
                Some(context) => (**context).clone(),
                None => LiveContext::new(&kinds.plant, &FAULTS, plant),
            };
            let objections = objections(kinds.clone(), plant.clone(), controller.clone());
            Service::new(context, turns.queue(), turns.builder(), objections)
        });
        // A link that failed ends the run, which the next advance reports.
        service.respond(request, &mut || drop(turns.turn()))
    }

    /// Returns `true` if the run is over.
    #[must_use]
    pub const fn is_over(&self) -> bool {
        self.turns.end().is_some()
    }

    /// Returns the next step; after the end, the number of executed steps.
    #[must_use]
    pub fn step(&self) -> Step {
        match self.turns.end() {
            Some(end) => Step(end.steps),
            None => {
                let run = self.plan.run;
                Step(self.turns.queue().status(run.rate, run.steps).step)
            }
        }
    }

    /// Returns the plan, without live faults and changes.
    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Returns the descriptions of the plant's and the controller's side.
    #[must_use]
    pub fn described(&self) -> &[Description; 2] {
        &self.described
    }

    /// Lists the signals of a record by full name and unit, in order.
    pub fn signals(&self) -> impl Iterator<Item = (String, &str)> {
        signals(&self.layout)
    }

    /// Returns the place of a signal, recorded or derived; `None` if there is none of this name.
    #[must_use]
    pub fn place(&self, name: &str) -> Option<Place> {
        let word = self.columns.index_of(name);
        let word = word.map(|index| Place::Word(self.layout.values_start() + index));
        let derived = || self.plan.derived.iter().position(|one| one.name == name);
        word.or_else(|| derived().map(Place::Derived))
    }

    /// Returns a value of the newest record; `None` before the first.
    #[inline]
    #[must_use]
    pub fn value(&self, place: Place) -> Option<f64> {
        self.recorder.0.borrow().value(place)
    }

    /// Returns the digest of the records so far; `None` before the first.
    #[must_use]
    pub fn digest(&self) -> Option<String> {
        self.recorder.0.borrow().digest()
    }

    /// Returns the requirements with their verdicts so far. The robustness of a decided one is the bound that the steps
    /// so far have set until its value is known: a failed one has at most this, a passed one at least.
    #[must_use]
    pub fn requirements(&self) -> Vec<Requirement> {
        let recorder = self.recorder.0.borrow();
        let Some(evaluation) = recorder.collector.evaluation.as_ref() else {
            return Vec::new();
        };
        let mut values = evaluation.so_far().requirements();
        if !self.is_over() {
            for (value, [least, most]) in values.iter_mut().zip(evaluation.so_far().bounds()) {
                let bound = match value.verdict {
                    Verdict::Pass => Some(least),
                    Verdict::Fail => Some(most),
                    Verdict::Undecided => None,
                };
                value.robustness = value.robustness.or(bound);
            }
        }
        values.iter().map(Requirement::from).collect()
    }

    /// Returns bounds on the final robustness of each requirement, in the plan's order.
    #[must_use]
    pub fn bounds(&self) -> Vec<[f64; 2]> {
        let recorder = self.recorder.0.borrow();
        let evaluation = recorder.collector.evaluation.as_ref();
        evaluation.map_or_else(Vec::new, |evaluation| evaluation.so_far().bounds())
    }

    /// Returns the metrics so far.
    #[must_use]
    pub fn metrics(&self) -> Vec<Metric> {
        let recorder = self.recorder.0.borrow();
        let evaluation = recorder.collector.evaluation.as_ref();
        let values = evaluation.map(|evaluation| evaluation.so_far().results());
        values.iter().flatten().map(Metric::from).collect()
    }

    /// Returns the verdict of the run, and the reason for an early end; `None` until the run is over.
    #[must_use]
    pub fn end(&self) -> Option<(RunVerdict, Option<&str>)> {
        let verdict = RunVerdict::of(self.turns.end()?.outcome, &self.requirements());
        Some((verdict, self.turns.reason()))
    }

    /// Returns the events of the run so far.
    #[must_use]
    pub fn recorded(&self) -> Recorded {
        self.recorder.0.borrow().collector.recorded.clone()
    }
}

/// Lists the signals of a layout by full name and unit, in the order of their words.
pub fn signals(layout: &RecordLayout) -> impl Iterator<Item = (String, &str)> {
    let groups = GROUPS.into_iter().zip(layout.groups());
    groups.flat_map(|(group, fields)| {
        let full = move |field: &Field| format!("{group}.{}", field.name);
        fields.iter().map(move |field| (full(field), &*field.unit))
    })
}

/// Creates both sides of a run, which are held before their first step.
fn start(
    kinds: &Kinds,
    (plant, controller): (PlantJob, ControllerJob),
    recorder: &SharedRecorder,
) -> Result<Turns<'static>, Failure> {
    let turns = Turns::of(kinds.clone(), plant, controller, Box::new(recorder.clone()));
    turns.map_err(Failure::usage)
}
