//! The service: answers requests from other terminals while the plant runs.
//!
//! The service's thread listens on the session's socket, checks requests against the plant as a scenario is checked,
//! prepares faults with all the memory they need, and puts requests into the [`request_queue`](crate::request_queue).
//! The service never touches the loop's state, and the loop never waits for the service.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};

use hil_config::expression::Columns;
use hil_config::live_requests::RequestContext;
use hil_config::plan::{Change, FaultEvent, PLANT_KEYS, Stimulus, driven, law_keys};
use hil_session::live::{self, Listening, OBJECTIONS, SOCKET};
use hil_session::session::SessionInfo;
use shared_types::describe::LawDescription;
use shared_types::live::{
    ChangeRequest, Changed, Injected, ParameterAnswer, ParameterQuestion, Possible, Refusal,
    Request, Response, Status, Tunables,
};
use shared_types::record::{LONGEST_MARK, RecordLayout};
use shared_types::table::Field;
use shared_types::text;
use shared_types::time::Step;

use crate::faults::{FaultBuilder, FaultKindEntry};
use crate::job::Job;
use crate::plant::PlantKind;
use crate::request_queue::{LoopRequest, RequestQueue};
use crate::tuning::Offered;

/// Time within which the loop must check the queue; the loop does so before each step.
const LOOP_LIMIT: Duration = Duration::from_secs(5);
/// Polling interval of the service for the loop's answer.
const LOOK: Duration = Duration::from_micros(200);
/// Time limit for the controller's program, which is started to validate parameters.
const OBJECTION_LIMIT: Duration = Duration::from_secs(30);
/// Maximum number of faults in one request, because the loop admits them all between two steps.
const MOST_FAULTS: usize = 16;

/// Context against which requests are checked.
#[derive(Clone)]
pub struct LiveContext {
    run: RequestContext,
    law: Option<LawDescription>,
    /// `true` if the state of every fault must be saveable.
    saves: bool,
}

impl LiveContext {
    /// Collects everything in a job to which a live fault may refer.
    #[must_use]
    pub fn new(plant: &PlantKind, faults: &[FaultKindEntry], job: &Job) -> Self {
        let mut run = RequestContext {
            plant: job.plant.commanded(&plant.description, &job.stimuli),
            kinds: faults.iter().map(|kind| kind.description.clone()).collect(),
            parameters: job.plant.parameters.clone(),
            stimuli: job.stimuli.clone(),
            constants: job.plant.inputs.clone(),
            taps: job.tap_fields(&plant.description),
            derived: job.derived.clone(),
            networks: job.bus.as_ref().map_or(1, |bus| bus.networks),
            rate: job.run.rate,
            steps: job.run.steps,
            names: Vec::new(),
            first_id: 1,
        };
        run.note(&job.faults);
        let saves = !job.checkpoints.steps.is_empty();
        Self {
            run,
            law: job.law.clone(),
            saves,
        }
    }
}

/// Validation of parameter combinations for the plant or the active law. Neither side is instantiated a second time in
/// this process, because a library may support only one instance.
pub type Objections = Box<dyn FnMut(&ParameterQuestion) -> Result<(), String> + Send>;

/// Returns the validation for a session whose `hil` runs the programs.
#[must_use]
pub fn objections_of(session: &SessionInfo) -> Objections {
    let session = session.clone();
    Box::new(move |question| {
        let answer =
            live::ask_at::<_, ParameterAnswer>(&session, OBJECTIONS, question, OBJECTION_LIMIT);
        let answer = answer.map_err(|error| {
            format!("cannot ask the program to validate the parameters: {error}")
        })?;
        answer.objection.map_or(Ok(()), Err)
    })
}

/// Listens on the session's socket until the returned value is dropped.
///
/// # Errors
/// If the socket cannot be created.
pub fn serve(
    session: &SessionInfo,
    context: LiveContext,
    queue: Arc<RequestQueue>,
    builder: Arc<FaultBuilder>,
    objections: Objections,
) -> Result<Listening, String> {
    let mut service = Service::new(context, queue, builder, objections);
    live::listen(session, SOCKET, move |client| {
        // A client that has gone needs no answer.
        let _ = live::answer(client, |request| match request {
            Ok(request) => service.respond(request, &mut || std::thread::sleep(LOOK)),
            Err(refusal) => refused(refusal),
        });
    })
}

/// Service of the requests to one run.
pub struct Service {
    context: LiveContext,
    queue: Arc<RequestQueue>,
    builder: Arc<FaultBuilder>,
    objections: Objections,
}

/// Work while a request waits for the loop: a sleep, or a turn of a loop in the same thread.
type Pause<'a> = &'a mut dyn FnMut();

impl Service {
    /// Creates the service of a run.
    #[must_use]
    pub fn new(
        context: LiveContext,
        queue: Arc<RequestQueue>,
        builder: Arc<FaultBuilder>,
        objections: Objections,
    ) -> Self {
        Self {
            context,
            queue,
            builder,
            objections,
        }
    }

    /// Returns everything against which the next request is checked.
    #[must_use]
    pub const fn context(&self) -> &LiveContext {
        &self.context
    }

    /// Checks a request and passes it to the loop; calls `pause` until the loop has answered.
    pub fn respond(&mut self, request: Request, pause: Pause<'_>) -> Response {
        let result = match request {
            Request::Possible => Ok(self.possible()),
            Request::Status => Ok(self.status()),
            Request::Inject { toml } => return self.inject(&toml, pause),
            Request::Clear { id } => self.clear(id, pause),
            Request::Active => self.show(pause),
            Request::Pause => self
                .request(LoopRequest::Pause, pause)
                .map(|()| self.status()),
            Request::Resume => self
                .request(LoopRequest::Resume, pause)
                .map(|()| self.status()),
            Request::Advance { steps } => self.advance(steps, pause),
            Request::Record => self.record(pause),
            Request::Mark { text } => self.mark(&text, pause),
            Request::Set(request) => return self.set(&request, pause),
            Request::Tunable => self.tunable(pause),
        };
        result.unwrap_or_else(refused)
    }

    fn possible(&self) -> Response {
        let run = &self.context.run;
        let reference = |stimulus: &Stimulus| stimulus.fields();
        Response::Possible(Box::new(Possible {
            rate: run.rate,
            plant: run.plant.clone(),
            reference: run.stimuli.iter().flat_map(reference).collect(),
            inputs: driven(&run.stimuli),
            kinds: run.kinds.clone(),
            networks: run.networks,
        }))
    }

    fn status(&self) -> Response {
        Response::Status(self.progress())
    }

    fn progress(&self) -> Status {
        let run = &self.context.run;
        self.queue.status(run.rate, run.steps)
    }

    fn inject(&mut self, toml: &str, pause: Pause<'_>) -> Response {
        let layout = match self.layout(pause) {
            Ok(layout) => layout,
            Err(refusal) => return refused(refusal),
        };
        let events = match self.context.run.check(toml, &layout.internal) {
            Ok(events) => events,
            Err(problems) => {
                return Response::Refused {
                    problems: problems.0.iter().map(Refusal::from).collect(),
                };
            }
        };
        if let Some(kind) = self.unsaveable(&events) {
            let message = format!(
                "fault `{kind}` cannot save its state, and this run makes checkpoints; it needs `FaultKind::state`"
            );
            return refused(Refusal::new(message));
        }
        let columns = Columns::from(layout);
        if events.is_empty() || events.len() > MOST_FAULTS {
            let count = events.len();
            let message = format!("{count} faults in one request; 1 to {MOST_FAULTS} are accepted");
            return refused(Refusal::new(message));
        }
        let armed = (events.iter())
            .map(|event| self.builder.build(event.clone(), &columns).map(Box::new))
            .collect::<Result<Vec<_>, _>>();
        let armed = match armed {
            Ok(armed) => armed,
            Err(invalid) => return refused(Refusal::new(invalid.to_string())),
        };
        match self.request(|answer| LoopRequest::Admit(armed, answer), pause) {
            Ok(Ok(admitted)) => {
                self.context.run.note(&events);
                let rate = self.context.run.rate;
                let faults = (admitted.into_iter())
                    .map(|fault| Injected {
                        id: fault.id,
                        kind: fault.kind,
                        effective_step: fault.step.map(|step| step.0),
                        effective_at_s: fault.step.map(|step| rate.seconds(step)),
                        waits_for: fault.waits_for,
                    })
                    .collect();
                Response::Injected { faults }
            }
            Ok(Err(reason)) => refused(Refusal::new(reason)),
            Err(refusal) => refused(refusal),
        }
    }

    /// Returns a fault kind that cannot be saved, if the run makes checkpoints.
    fn unsaveable<'a>(&self, events: &'a [FaultEvent]) -> Option<&'a str> {
        let saves = |event: &FaultEvent| {
            let kind = (self.context.run.kinds.iter()).find(|kind| kind.kind == event.kind);
            kind.is_none_or(|kind| kind.saves) // one of the plant's own moves parameters
        };
        let unsaveable = events.iter().find(|event| !saves(event));
        unsaveable
            .filter(|_| self.context.saves)
            .map(|event| event.kind.as_str())
    }

    fn clear(&self, id: Option<u32>, pause: Pause<'_>) -> Result<Response, Refusal> {
        let (ids, step) = self.request(|answer| LoopRequest::Clear(id, answer), pause)?;
        if let (Some(id), true) = (id, ids.is_empty()) {
            return Err(Refusal {
                expected: Some("the number of a fault that waits or acts".into()),
                ..Refusal::new(format!(
                    "there is no fault {id} to clear; list the faults with `hil inject --active`"
                ))
            });
        }
        Ok(Response::Cleared { ids, step: step.0 })
    }

    fn show(&self, pause: Pause<'_>) -> Result<Response, Refusal> {
        let faults = self.request(LoopRequest::Show, pause)?;
        let status = self.progress();
        Ok(Response::Active { status, faults })
    }

    /// Responds when the run is held again or, if that takes too long, with its current position.
    fn advance(&self, steps: u64, pause: Pause<'_>) -> Result<Response, Refusal> {
        if steps == 0 {
            return Err(Refusal::new("0 steps were requested; at least 1 is needed"));
        }
        let until = self.request(|answer| LoopRequest::Advance(steps, answer), pause)?;
        let until = until.map_err(Refusal::new)?;
        let since = Instant::now();
        loop {
            let status = self.progress();
            let there = status.paused && Step(status.step) >= until;
            if there || self.queue.is_closed() || since.elapsed() > LOOP_LIMIT {
                return Ok(Response::Status(status));
            }
            pause();
        }
    }

    fn record(&self, pause: Pause<'_>) -> Result<Response, Refusal> {
        let layout = Box::new(self.layout(pause)?.clone());
        let words = self.request(LoopRequest::Record, pause)?;
        let none = || Refusal {
            expected: Some("a run that has executed a step; `hil step` executes one".into()),
            ..Refusal::new("there is no record yet: no step was executed")
        };
        Ok(Response::Record {
            layout,
            words: words.ok_or_else(none)?,
        })
    }

    fn mark(&self, text: &str, pause: Pause<'_>) -> Result<Response, Refusal> {
        let text = text::line(text.trim());
        let count = text.chars().count();
        if count == 0 || count > LONGEST_MARK {
            let message = format!("a mark of {count} characters; 1 to {LONGEST_MARK} are accepted");
            return Err(Refusal::new(message));
        }
        let step = self.request(|answer| LoopRequest::Mark(text, answer), pause)?;
        let step = step.map_err(Refusal::new)?;
        Ok(Response::Marked {
            step: step.0,
            at_s: self.context.run.rate.seconds(step),
        })
    }

    fn set(&mut self, request: &ChangeRequest, pause: Pause<'_>) -> Response {
        let changed = self.change(request, pause);
        changed.unwrap_or_else(|problems| Response::Refused { problems })
    }

    fn change(
        &mut self,
        request: &ChangeRequest,
        pause: Pause<'_>,
    ) -> Result<Response, Vec<Refusal>> {
        let one = |refusal: Refusal| vec![refusal];
        for (place, new) in request.set.iter().enumerate() {
            if request.set[..place]
                .iter()
                .any(|other| other.key == new.key)
            {
                let message = format!("`{}` is given twice; give it once", new.key);
                return Err(one(Refusal::new(message)));
            }
        }
        let tunable =
            (self.request(|answer| LoopRequest::Tunable(None, answer), pause)).map_err(one)?;
        let offered = &tunable.offered;
        let fields = self.fields_of(offered);
        let checked = (self.context.run).check_change(request, (&offered.law, &fields), 0);
        let change = checked.map_err(|problems| -> Vec<Refusal> {
            problems.0.iter().map(Refusal::from).collect()
        })?;
        let epoch = offered.epoch;
        let own = law_keys(&offered.law);
        if epoch == 0 && change.set.iter().any(|one| one.key.starts_with(&own)) {
            let message = "there is no controller to tune";
            return Err(one(Refusal::new(message)));
        }
        let proposal = Some(Box::new(change.clone()));
        let after =
            (self.request(|answer| LoopRequest::Tunable(proposal, answer), pause)).map_err(one)?;
        for parameters in after.plant_after {
            let question = ParameterQuestion {
                epoch: 0,
                parameters,
            };
            (self.objections)(&question)
                .map_err(|objection| one(Refusal::new(format!("the plant: {objection}"))))?;
        }
        for parameters in after.law_after {
            let question = ParameterQuestion { epoch, parameters };
            (self.objections)(&question)
                .map_err(|objection| one(Refusal::new(format!("the controller: {objection}"))))?;
        }
        let proposal = Box::new(change.clone());
        let result = self.request(|answer| LoopRequest::Change(proposal, epoch, answer), pause);
        let (id, step) = (result.map_err(one)?).map_err(|reason| one(Refusal::new(reason)))?;
        for new in &change.set {
            if let Some(name) = new.key.strip_prefix(PLANT_KEYS) {
                self.context.run.parameters.set(name, new.value);
            }
        }
        let change = Change {
            id,
            step: Some(step),
            ..change
        };
        Ok(Response::Changed(self.changed(&change)))
    }

    /// Returns the parameters of the active law: as described if the description matches, otherwise those of its hello.
    fn fields_of(&self, offered: &Offered) -> Vec<Field> {
        match &self.context.law {
            Some(law) if law.name == offered.law => law.parameters.clone(),
            _ => (offered.parameters.iter())
                .map(|one| Field {
                    tunable: true,
                    ..one.field.clone()
                })
                .collect(),
        }
    }

    fn changed(&self, change: &Change) -> Changed {
        let step = change.step.unwrap_or(Step(0));
        Changed {
            id: change.id,
            step: step.0,
            at_s: self.context.run.rate.seconds(step),
            ramp_steps: change.ramp_steps,
            set: change.set.clone(),
            clear: change.clear.clone(),
        }
    }

    fn tunable(&self, pause: Pause<'_>) -> Result<Response, Refusal> {
        let tunables = self.request(|answer| LoopRequest::Tunable(None, answer), pause)?;
        let law = &self.context.law;
        let is_active = |law: &&LawDescription| law.name == tunables.offered.law;
        Ok(Response::Tunable(Box::new(Tunables {
            status: self.progress(),
            waiting: tunables
                .waiting
                .iter()
                .map(|one| self.changed(one))
                .collect(),
            law_does: (law.as_ref().filter(is_active))
                .map_or_else(String::new, |law| law.tuning.clone()),
            left: u32::try_from(tunables.left).unwrap_or(u32::MAX),
            values: tunables.values,
        })))
    }

    /// Returns the layout of the records; waits for hello, up to a limit.
    fn layout(&self, pause: Pause<'_>) -> Result<&RecordLayout, Refusal> {
        let since = Instant::now();
        loop {
            if let Some(layout) = self.queue.layout() {
                return Ok(layout);
            }
            if self.queue.is_closed() || since.elapsed() > LOOP_LIMIT {
                return Err(Refusal::new(
                    "the run has not begun: plant and controller are not connected",
                ));
            }
            pause();
        }
    }

    /// Sends a request to the loop.
    fn request<T>(
        &self,
        request: impl FnOnce(std::sync::mpsc::Sender<T>) -> LoopRequest,
        pause: Pause<'_>,
    ) -> Result<T, Refusal> {
        self.layout(pause)?;
        wait(&self.queue.push(request), pause)
    }
}

/// Waits by polling, so that the loop needs no system call to wake anybody.
fn wait<T>(receiver: &Receiver<T>, pause: Pause<'_>) -> Result<T, Refusal> {
    let since = Instant::now();
    loop {
        match receiver.try_recv() {
            Ok(answer) => return Ok(answer),
            Err(TryRecvError::Disconnected) => return Err(Refusal::new("the run is over")),
            Err(TryRecvError::Empty) if since.elapsed() > LOOP_LIMIT => {
                let limit_s = LOOP_LIMIT.as_secs();
                let message = format!(
                    "the plant began no step for {limit_s} s; the request may still be executed: check with `hil inject --active`"
                );
                return Err(Refusal::new(message));
            }
            Err(TryRecvError::Empty) => pause(),
        }
    }
}

fn refused(refusal: Refusal) -> Response {
    Response::Refused {
        problems: vec![refusal],
    }
}
