//! `hil monitor`: a live view of a running session, in another terminal.
//!
//! 1. [`watch`] attaches an [`observer`](hil_facts::session::observer) to the session's record stream, on a thread;
//!    [`asking`] queries its plant and its `hil`, on another.
//! 2. Both feed the [`model`]: the [`pace`] of the run, the [`history`] of the signals in the [`plots`], and the
//!    [`log`] of events, faults and requirements.
//! 3. The [`screen`] draws a [`view`] of the model on the [`terminal`] and turns keys into changes of the
//!    [`display`] or requests, among them [`prepared`] faults. Without a terminal, one [line](mod@line) summarises
//!    the model.
//!
//! Optionally serves the observed signals to Foxglove as well.
//!
//! A monitor is passive: the digest of the run is the same with and without a monitor, unless a key changes the run.

pub(crate) mod asking;
pub(crate) mod display;
pub(crate) mod foxglove;
pub(crate) mod history;
pub(crate) mod keys;
pub(crate) mod line;
pub(crate) mod log;
pub(crate) mod model;
pub(crate) mod pace;
pub(crate) mod plots;
pub(crate) mod prepared;
pub(crate) mod screen;
pub mod terminal;
pub(crate) mod view;
pub(crate) mod watch;

use std::any::Any;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::SessionChoice;
use hil_facts::session::live::{self, RequestError};
use hil_facts::session::observer::Notice;
use hil_session::clock::monotonic_ns;
use hil_session::session::{self, SessionInfo};

use crate::arguments::monitor::MonitorArguments;
use asking::Asking;
use display::{Abilities, Display};
use model::Model;
use watch::{Audience, Watch};

/// Polling interval while waiting for a session.
pub(super) const LOOK: Duration = Duration::from_millis(20);
/// Time limit for a session to publish its scenario.
const START_LIMIT: Duration = Duration::from_secs(20);
/// Time over which the one-line summary measures speed.
const GATHER: Duration = Duration::from_millis(600);

/// Model shared between threads behind a lock.
#[derive(Clone)]
pub(crate) struct SharedModel(pub(super) Arc<Mutex<Model>>);

impl SharedModel {
    /// Locks the model.
    pub(crate) fn lock(&self) -> MutexGuard<'_, Model> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs the command.
///
/// # Errors
/// If there is no session to watch, the session cannot be watched, or a prepared fault is invalid.
pub fn monitor(arguments: &MonitorArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let session = find(&arguments.choice, arguments.wait, &interruption);
    let session = session.map_err(|error| error.tell(false))?;
    let plan = notice(&session, &interruption)?.plan()?;
    let prepared = prepared::all(&arguments.inject, &session, &plan);
    let prepared = prepared.map_err(|error| error.tell(false))?;
    let mut served = serve(arguments, &session, &plan)?;
    let audience = served.as_mut().and_then(|served| served.audience.take());
    let run_dir = session.run_dir.clone();
    let model = Model::new(&session.name, run_dir, plan, &arguments.signal);
    let model = SharedModel(Arc::new(Mutex::new(model)));

    let watch = Watch::start(session.clone(), model.clone(), audience, false);
    watch.wait_for_first();
    watch.check()?;
    let is_dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    let is_shown = std::io::stdout().is_terminal() && std::io::stdin().is_terminal() && !is_dumb;
    if let (Some(served), false) = (&served, is_shown) {
        tell!("{}", served.description);
        wait_for_end(&watch, &interruption)?;
        return tell(&model.lock(), false);
    }
    let asking = Asking::start(session, model.clone());
    if arguments.once || arguments.choice.json || !is_shown {
        gather(&model, &watch, &interruption)?;
        return tell(&model.lock(), arguments.choice.json);
    }
    let mut display = Display::new(Abilities::of_environment(), arguments.window, prepared);
    display.answer = served.as_ref().map(|served| served.description.clone());
    screen::show(&model, &watch, &asking, display, &interruption)?;
    drop(watch);
    drop(served);
    let model = model.lock();
    if let Some(ending) = model.ending() {
        output::write(&format!("{}\n", line::ended(&model, ending)))?;
    }
    Ok(Exit::Pass)
}

/// Server of the session's signals to other programs; dropping it ends the service.
struct Served {
    /// Address, formatted for the user.
    description: String,
    /// Consumer of the observed records, until the watch takes it over.
    audience: Option<Box<dyn Audience>>,
    _server: Box<dyn Any>,
}

/// Starts the server if the command line requests it.
fn serve(
    arguments: &MonitorArguments,
    session: &SessionInfo,
    plan: &Plan,
) -> Result<Option<Served>, Failure> {
    let Some(address) = arguments.foxglove else {
        return Ok(None);
    };
    let serving = foxglove::Serving::start(address, session, plan)?;
    let outlet = serving.outlet(plan, arguments.rate);
    let description = format!(
        "serving ws://{} for Foxglove, at most {} records a second",
        serving.address(),
        arguments.rate
    );
    Ok(Some(Served {
        description,
        audience: Some(Box::new(outlet)),
        _server: Box::new(serving),
    }))
}

/// Waits for the end of the session.
fn wait_for_end(watch: &Watch, interruption: &Interruption) -> Result<(), Failure> {
    while !watch.has_ended() {
        interruption.check()?;
        std::thread::sleep(LOOK);
    }
    watch.check()
}

/// Finds the selected session, waiting up to `wait_s` for it to start.
pub(super) fn find(
    choice: &SessionChoice,
    wait_s: Option<f64>,
    interruption: &Interruption,
) -> Result<SessionInfo, RequestError> {
    let since = Instant::now();
    let mut has_told = false;
    loop {
        let result = live::find(choice);
        let remaining_s = wait_s.filter(|wait_s| since.elapsed().as_secs_f64() < *wait_s);
        let is_several =
            choice.session.is_none() && session::list().is_ok_and(|running| running.len() > 1);
        if result.is_ok() || remaining_s.is_none() || is_several {
            return result;
        }
        interruption.check()?;
        if let (false, Some(wait_s)) = (has_told, remaining_s) {
            tell!("waiting up to {wait_s} s for a session");
            has_told = true;
        }
        std::thread::sleep(LOOK);
    }
}

/// Waits until a session publishes its notice.
pub(super) fn notice(
    session: &SessionInfo,
    interruption: &Interruption,
) -> Result<Notice, Failure> {
    let name = &session.name;
    let since = Instant::now();
    loop {
        if let Some(notice) = Notice::read(session) {
            if notice.is_in_process {
                return Err(Failure::usage(format!(
                    "session `{name}` runs in one process (--link in-process) and cannot be watched"
                )));
            }
            return Ok(notice);
        }
        interruption.check()?;
        if !session.is_there() {
            return Err(Failure::usage(format!("session `{name}` has ended")));
        }
        if since.elapsed() > START_LIMIT {
            return Err(Failure::usage(format!(
                "session `{name}` cannot be watched, because it is a replay or a measurement"
            )));
        }
        std::thread::sleep(LOOK);
    }
}

/// Watches long enough to measure the speed of the run.
fn gather(model: &SharedModel, watch: &Watch, interruption: &Interruption) -> Result<(), Failure> {
    let since = Instant::now();
    while since.elapsed() < GATHER && !watch.has_ended() {
        interruption.check()?;
        std::thread::sleep(LOOK);
    }
    watch.check()?;
    if model.lock().state() == "starting" && watch.has_ended() {
        return Err(Failure::infrastructure(
            "error: the session ended before it could be watched",
        ));
    }
    Ok(())
}

fn tell(model: &Model, json: bool) -> Result<Exit, Failure> {
    let now_ns = monotonic_ns();
    output::write(&if json {
        live::to_json(&line::json(model, now_ns))?
    } else {
        format!("{}\n", line::text(model, now_ns))
    })?;
    Ok(Exit::Pass)
}
