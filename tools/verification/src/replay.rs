//! `hil replay`: sends recorded samples to a controller and compares its answers with the recorded ones.
//!
//! This is the back-to-back test between two builds of a controller, or between desk and target: the controller runs
//! as in any run, over the same link and protocol, and `hil` plays the plant from the recording.
//!
//! 1. `original` extracts the participants and the layout of the records from the recording.
//! 2. `tape` reads samples and answers ahead on its own thread.
//! 3. `host` sends the samples and receives the answers.
//! 4. `comparison` compares each answer with the recorded one.
//! 5. `report` presents the result.

mod comparison;
mod host;
pub(crate) mod original;
mod report;
mod tape;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use controller_process::controller::LawKind;
use controller_process::job::{JOB_FILE, Job};
use controller_process::runner::{Runner, choose};
use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_console::terminal::progress::Progress;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::Binary;
use hil_facts::programs::binaries::named::{Named, Recorded};
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::results::recorded_run::RecordedRun;
use hil_recording::reader::{RunReader, UNVOUCHED};
use hil_run::jobs;
use hil_run::settings::refuse_in_process;
use hil_run::side::LOOK;
use hil_run::side::{GRACE, SideProcess};
use hil_session::asking;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::{Session, SessionError, SessionInfo};
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use serde_json::json;
use shared_types::hello::{Hello, agree};
use shared_types::link::in_process::{self, InProcessLink};
use shared_types::lockstep::{ControllerEvent, PlantEvent};
use shared_types::wait::WaitLimit;

use crate::arguments::replay::ReplayArguments;
use crate::arguments::tolerance::Tolerances;
use comparison::Comparison;
use host::{Host, ReplayEnd, Replayed};
use original::Original;
use report::Report;
use tape::Tape;

/// Replay that is ready to start.
struct PreparedReplay {
    original: Arc<Original>,
    plan: Plan,
    controller: Binary,
    tolerances: Tolerances,
    link: LinkKind,
    wait_limit_s: f64,
    interruption: Interruption,
}

/// Runs the command.
///
/// # Errors
/// If the run cannot be replayed with that controller, or the controller died before the end.
pub fn replay(arguments: &ReplayArguments) -> Result<Exit, Failure> {
    if arguments.wait_limit.is_nan() || arguments.wait_limit <= 0.0 {
        return Err(Failure::usage(
            "--wait-limit must be a number above 0, or inf",
        ));
    }
    asking::allow_seconds(arguments.wait_limit);
    let interruption = Interruption::listen()?;
    let open = || RunReader::open(&arguments.run);
    let reader = interruption.at_once(open)?.map_err(Failure::usage)?;
    reader.refuse_excerpt().map_err(Failure::usage)?;
    if let Some(unverified) = reader.fact(UNVOUCHED) {
        tell!(
            "note: {} was recovered: {unverified}",
            reader.path().display()
        );
    }
    let original = interruption.at_once(|| Original::of(&reader, &arguments.run))??;
    let recorded = Recorded::of(&reader, &arguments.run);
    let path = arguments.controller_bin.as_deref();
    let at = Reached::by(&arguments.target, arguments.wait_limit, &interruption)?;
    let controller = Binary::controller(
        path,
        &Named::Recorded(&recorded),
        at.as_ref(),
        &interruption,
    )?;
    refuse_in_process(arguments.link, &[&controller])?;
    let plan = original.plan_for(&controller)?;
    let prepared = PreparedReplay {
        original: Arc::new(original),
        plan,
        controller,
        tolerances: Tolerances::typed(&arguments.tolerance)
            .renamed(|name| RecordedRun::own_name(&reader, name)),
        link: arguments.link,
        wait_limit_s: arguments.wait_limit,
        interruption,
    };
    prepared.check()?;

    let session = Session::create(arguments.session.as_deref()).map_err(|error| match error {
        SessionError::Name(_) | SessionError::Group(_) | SessionError::Taken { .. } => {
            Failure::usage(error)
        }
        other => Failure::infrastructure(other),
    })?;
    let report = match prepared.run(session, reader) {
        Err(failure) if arguments.json => {
            let run = arguments.run.display().to_string();
            let reason = failure.reason();
            let aborted = json!({"verdict": "aborted", "reason": reason, "run": run});
            output::write(&format!("{aborted:#}\n"))?;
            return Err(failure);
        }
        report => report?,
    };
    output::result(arguments.json, &report, || report.describe())?;
    Ok(report.exit())
}

impl PreparedReplay {
    /// Checks, before anything starts, that the controller will accept the run.
    fn check(&self) -> Result<(), Failure> {
        let path = self.controller.path.display();
        let laws = &self.controller.description.laws;
        let law = self
            .plan
            .law_among(laws)
            .ok_or_else(|| Failure::usage(format!("{path} has no law for this run")))?;
        let offer = self.original.offer(0);
        let welcome = agree(&Hello::of(&law, offer.session), &offer).map_err(|refused| {
            Failure::usage(format!("{path} does not fit this run: {refused}"))
        })?;
        Comparison::new(
            &self.original.places.answer,
            &welcome.command,
            &self.tolerances,
            welcome.sample.len(),
            offer.rate,
        )
        .map_err(Failure::usage)?;
        Ok(())
    }

    fn run(self, mut session: Session, reader: RunReader) -> Result<Report, Failure> {
        let info = session.info().clone();
        let job = jobs::controller(&self.plan, info.id, self.wait_limit_s);
        info.write_file(JOB_FILE, &job)
            .map_err(Failure::infrastructure)?;
        self.controller
            .check(&info.folder.join(JOB_FILE), &self.interruption)?;

        let answered = Arc::new(AtomicU64::new(0));
        let supervision = Supervision::new();
        let (places, run) = (self.original.places.clone(), self.original.plan.run);
        let tape = Tape::start(reader, places, run.steps, run.clock);
        let loops = Loop {
            session: info.clone(),
            original: Arc::clone(&self.original),
            tolerances: self.tolerances.clone(),
            batches: tape.batches,
            answered: Arc::clone(&answered),
            limit: WaitLimit::from_seconds(self.wait_limit_s),
            supervision: supervision.clone(),
        };
        let (host, mut child) = match self.link {
            LinkKind::InProcess => (std::thread::spawn(move || loops.in_one_thread(job)), None),
            LinkKind::Iceoryx2 => {
                let controller = &self.controller;
                let mut child = SideProcess::start(
                    "controller",
                    controller,
                    &info,
                    &info.folder,
                    "controller.log",
                )?;
                session
                    .add_child(child.process_id())
                    .map_err(Failure::infrastructure)?;
                while !controller.is_ready(&info, 1)
                    && !child.has_ended()
                    && !self.interruption.came()
                {
                    std::thread::sleep(LOOK);
                }
                (
                    std::thread::spawn(move || loops.with_a_process()),
                    Some(child),
                )
            }
        };
        let run = &self.plan.run;
        let mut progress = Progress::new(run.steps, run.rate, true);
        self.watch(&host, child.as_mut(), &supervision, || {
            progress.set(answered.load(Ordering::Relaxed));
        });
        drop(progress);
        let replayed = host
            .join()
            .map_err(|_| Failure::infrastructure("the replay panicked"))?;
        let length = tape
            .reader
            .join()
            .map_err(|_| Failure::infrastructure("the reader of the recording panicked"))?;
        self.interruption.check()?;
        let run_text = self.original.run.display();
        let length =
            length.map_err(|error| Failure::usage(format!("cannot replay {run_text}: {error}")))?;
        let replayed = replayed.map_err(Failure::infrastructure)?;
        let comparison = conclude(replayed.end, replayed.comparison, child.as_ref())?;
        if comparison.answers == 0 {
            return Err(Failure::usage(format!("{run_text} has no answered sample")));
        }
        Ok(Report::new(
            &self.original,
            &self.controller,
            &length,
            replayed.wall_time_s,
            &comparison,
        ))
    }

    /// Watches the controller's process until the replay is over and the process has ended.
    fn watch<T>(
        &self,
        host: &JoinHandle<T>,
        mut child: Option<&mut SideProcess>,
        supervision: &Supervision,
        mut look: impl FnMut(),
    ) {
        let mut ending_since: Option<Instant> = None;
        loop {
            if self.interruption.came() {
                supervision.stop("interrupted");
            }
            let is_over = host.is_finished();
            let has_ended = child.as_mut().is_none_or(|child| child.has_ended());
            if has_ended && child.is_some() {
                supervision.peer_gone(1);
            }
            if is_over && has_ended {
                return;
            }
            if is_over
                && ending_since.get_or_insert_with(Instant::now).elapsed() > GRACE
                && let Some(child) = &mut child
            {
                child.kill();
            }
            look();
            std::thread::sleep(LOOK);
        }
    }
}

/// Values that move into the loop's thread.
struct Loop {
    session: SessionInfo,
    original: Arc<Original>,
    tolerances: Tolerances,
    batches: tape::Batches,
    answered: Arc<AtomicU64>,
    limit: WaitLimit,
    supervision: Supervision,
}

impl Loop {
    fn host<L: shared_types::link::Link>(self, link: L) -> Host<L> {
        Host::new(
            link,
            self.session.id,
            self.original,
            self.tolerances,
            self.batches,
            self.answered,
        )
    }

    /// Replays to a controller in its own process.
    fn with_a_process(self) -> Result<Replayed, String> {
        let link = IceoryxLink::create(&self.session).map_err(|e| e.to_string())?;
        let (limit, supervision) = (self.limit, self.supervision.clone());
        supervision.ring_at_news(link.bell());
        link.bell().tick();
        let mut host = self.host(link);
        host::drive(&mut host, Waiter::new(limit), &supervision).map_err(|e| e.to_string())?;
        Ok(host.finish())
    }

    /// Replays to a law that is built into `hil`, by alternating with that law.
    fn in_one_thread(self, job: Job) -> Result<Replayed, String> {
        let laws = controller_process::laws::all();
        let law = choose(&laws, &job.law, &job.plant).map_err(|e| e.to_string())?;
        let (link, controller_link) = in_process::pair();
        let mut runner = Runner::new(law, job, controller_link).map_err(|e| e.to_string())?;
        let (waiter, supervision) = (Waiter::new(self.limit), self.supervision.clone());
        let mut host = self.host(link);
        turns(&mut host, &mut runner, waiter, &supervision).map_err(|e| e.to_string())?;
        Ok(host.finish())
    }
}

fn turns(
    host: &mut Host<InProcessLink>,
    runner: &mut Runner<&LawKind, InProcessLink>,
    mut waiter: Waiter,
    supervision: &Supervision,
) -> Result<(), shared_types::link::LinkError> {
    runner.begin()?;
    loop {
        if supervision.wants_stop() {
            host.interrupt(&PlantEvent::Stop)?;
            runner.interrupt(&ControllerEvent::Stop)?;
        }
        runner.poll()?;
        match host.poll()? {
            host::Progress::Over => return Ok(()),
            host::Progress::Busy => waiter.done(),
            // Each side has been polled; if still nothing comes, one of them is broken.
            host::Progress::Controller => {
                if waiter.pause() {
                    host.interrupt(&PlantEvent::Deadline(waiter.limit().ms()))?;
                }
            }
        }
    }
}

/// Returns the comparison of a completed replay, or the reason why the replay did not complete.
fn conclude(
    end: ReplayEnd,
    comparison: Option<Comparison>,
    child: Option<&SideProcess>,
) -> Result<Comparison, Failure> {
    let fate = child.and_then(SideProcess::death);
    let reason = match (end, comparison) {
        (ReplayEnd::Refused(reason), _) => return Err(Failure::usage(reason)),
        (ReplayEnd::Short, Some(comparison)) => return Ok(comparison),
        (ReplayEnd::Completed, Some(comparison)) => match fate {
            None => return Ok(comparison),
            // The controller failed although the replay had completed.
            Some(fate) => fate,
        },
        (ReplayEnd::Aborted(abort), comparison) => {
            let message = fate.map_or_else(|| abort.to_string(), |fate| format!("{fate}; {abort}"));
            let first = comparison.as_ref().and_then(Comparison::first);
            match first {
                Some(first) => format!("{message}; {first}"),
                None => message,
            }
        }
        (_, None) => "the replay ended before it began".into(),
    };
    let excerpt = child.map(SideProcess::excerpt).unwrap_or_default();
    if !excerpt.is_empty() {
        output::tell(&format!("controller:\n{excerpt}\n"));
    }
    Err(Failure::infrastructure(reason))
}
