//! `hil monitor`: a running session, watched from another terminal.
//!
//! 1. [`watch`] attaches an [`observer`](crate::observer) to the session's record stream, on a thread;
//!    [`asking`] asks its plant and its `hil`, on another.
//! 2. Both feed the [`model`]: the [`pace`] of the run, the [`history`] of the signals that the
//!    [`plots`] show, faults, requirements.
//! 3. The [`screen`] draws a [`view`] of it on the [`terminal`] and reads keys into the [`display`];
//!    [`prepared`] faults are among what keys can ask for. Without a terminal one [`line`] tells it.
//!
//! Passive: the run has the same digest with and without it, unless a key changes the run.

pub mod asking;
pub mod display;
pub mod history;
pub mod line;
pub mod model;
pub mod pace;
pub mod plots;
pub mod prepared;
pub mod screen;
pub mod terminal;
pub mod view;
pub mod watch;

use std::io::IsTerminal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use shared_types::clock::monotonic_ns;
use shared_types::session::{self, SessionInfo};

use crate::cli::monitor::MonitorArguments;
use crate::exit::{Exit, Failure};
use crate::interruption::Interruption;
use crate::live::{self, Unmet};
use crate::observer::Notice;
use crate::output;
use asking::Asking;
use display::{Abilities, Display};
use model::Model;
use watch::Watch;

/// How often it is looked for a session.
const LOOK: Duration = Duration::from_millis(20);
/// How long a session may take to say what it runs.
const START_LIMIT: Duration = Duration::from_secs(20);
/// How long figures are gathered for one line.
const GATHER: Duration = Duration::from_millis(600);

/// The model, of which one thread at a time has a hold.
#[derive(Clone)]
pub struct SharedModel(Arc<Mutex<Model>>);

impl SharedModel {
    /// The model, held still.
    pub fn lock(&self) -> MutexGuard<'_, Model> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs the command.
///
/// # Errors
/// If there is no session to watch, it cannot be watched, or a prepared fault is none.
pub fn monitor(arguments: &MonitorArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let session = find(arguments, &interruption).map_err(|unmet| unmet.tell(false))?;
    let plan = notice(&session, &interruption)?.plan()?;
    let prepared = prepared::all(&arguments.inject, &session, &plan);
    let prepared = prepared.map_err(|unmet| unmet.tell(false))?;
    let run_dir = session.run_dir.clone();
    let model = Model::new(&session.name, run_dir, plan, &arguments.signal);
    let model = SharedModel(Arc::new(Mutex::new(model)));

    let watch = Watch::start(session.clone(), model.clone());
    watch.wait_for_first();
    if let Some(failure) = watch.failure() {
        return Err(failure);
    }
    let asking = Asking::start(session, model.clone());
    let is_shown = std::io::stdout().is_terminal() && std::io::stdin().is_terminal();
    if arguments.once || arguments.choice.json || !is_shown {
        gather(&model, &watch, &interruption)?;
        return tell(&model.lock(), arguments.choice.json);
    }
    let display = Display::new(Abilities::of_environment(), arguments.window, prepared);
    screen::show(&model, &watch, &asking, display, &interruption)?;
    drop(watch);
    let model = model.lock();
    if let Some(ending) = model.ending() {
        output::write(&format!("{}\n", line::ended(&model, ending)))?;
    }
    Ok(Exit::Pass)
}

/// The session that is meant, which may be awaited.
fn find(arguments: &MonitorArguments, interruption: &Interruption) -> Result<SessionInfo, Unmet> {
    let since = Instant::now();
    let mut has_told = false;
    loop {
        let found = live::find(&arguments.choice);
        let left = arguments
            .wait
            .filter(|wait_s| since.elapsed().as_secs_f64() < *wait_s);
        let is_several = arguments.choice.session.is_none()
            && session::list().is_ok_and(|running| running.len() > 1);
        if found.is_ok() || left.is_none() || is_several {
            return found;
        }
        if interruption.came() {
            return Err(Failure::Interrupted.into());
        }
        if let (false, Some(wait_s)) = (has_told, left) {
            eprintln!("waiting up to {wait_s} s for a session");
            has_told = true;
        }
        std::thread::sleep(LOOK);
    }
}

/// What the session says of itself.
fn notice(session: &SessionInfo, interruption: &Interruption) -> Result<Notice, Failure> {
    let name = &session.name;
    let since = Instant::now();
    loop {
        if let Some(notice) = Notice::read(session) {
            if notice.is_in_process {
                return Err(Failure::usage(format!(
                    "session `{name}` runs in one process (--link in-process), where nobody else can watch"
                )));
            }
            return Ok(notice);
        }
        if interruption.came() {
            return Err(Failure::Interrupted);
        }
        if !session.is_there() {
            return Err(Failure::usage(format!("session `{name}` has ended")));
        }
        if since.elapsed() > START_LIMIT {
            return Err(Failure::usage(format!(
                "session `{name}` is no run that can be watched: a replay or a measurement"
            )));
        }
        std::thread::sleep(LOOK);
    }
}

/// Watches long enough to tell how fast it goes.
fn gather(model: &SharedModel, watch: &Watch, interruption: &Interruption) -> Result<(), Failure> {
    let since = Instant::now();
    while since.elapsed() < GATHER && !watch.has_ended() {
        if interruption.came() {
            return Err(Failure::Interrupted);
        }
        std::thread::sleep(LOOK);
    }
    match watch.failure() {
        Some(failure) => Err(failure),
        None if model.lock().state() == "starting" && watch.has_ended() => Err(
            Failure::infrastructure("error: the session ended before it could be watched"),
        ),
        None => Ok(()),
    }
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
