//! `hil panel`: a running session in a browser of this machine.
//!
//! 1. The [watch](super::monitor::watch) and the [asking](super::monitor::asking) of the monitor feed its
//!    [model](super::monitor::model); both are the monitor's.
//! 2. The [`server`] judges [`request`]s, and gives the [`page`] to whoever asks for it.
//! 3. A page that shows the secret is a [`client`]: it is sent [`message`]s made of the model and asks for what the
//!    [`board`] can do.
//! 4. The [`opener`] opens the page, if this machine has a screen.
//!
//! With `hil run --panel` it is a process beside the run, so that nothing of it can hold up or end the run. Passive
//! as the monitor: the run has the same digest with it and without it, unless a page changes the run.

pub(crate) mod board;
pub(crate) mod client;
pub mod message;
pub(crate) mod opener;
pub(crate) mod page;
pub mod request;
pub(crate) mod server;

use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::session::live;
use hil_facts::session::observer::Seen;
use hil_session::process::ProcessId;
use hil_session::session::{self, SessionInfo};
use hil_verification::arguments::run::RunArguments;
use serde_json::json;
use shared_types::live::{Request, Response};

use super::monitor::asking::Asking;
use super::monitor::keys::input_is_gone;
use super::monitor::model::Model;
use super::monitor::watch::Watch;
use super::monitor::{self, SharedModel, line, prepared};
use crate::arguments::panel::PanelArguments;
use board::{Board, Button};
use server::Server;

/// Interval between two looks at what goes on.
const LOOK: Duration = Duration::from_millis(20);
/// Time for which a session that has ended is shown to nobody: a page may come back.
const LINGER: Duration = Duration::from_secs(10);
/// Limit for the panel of a run to end after it.
const END_LIMIT: Duration = Duration::from_secs(8);
/// Time for which the panel of a run shows its end to a page.
const LAST_LOOK: Duration = Duration::from_millis(600);

/// Runs the command.
///
/// # Errors
/// If there is no session to show, it cannot be watched, or a prepared fault is none.
pub fn panel(arguments: &PanelArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let json = arguments.choice.json;
    let found = match arguments.run_of {
        Some(owner) => owned_by(owner, &interruption)?,
        None => Some(
            monitor::find(&arguments.choice, arguments.wait, &interruption)
                .map_err(|error| error.tell(json))?,
        ),
    };
    let Some(session) = found else {
        return Ok(Exit::Pass); // the run ended before it began
    };
    let notice = monitor::notice(&session, &interruption);
    if notice.is_err() && arguments.run_of.is_some() && !session.is_there() {
        return Ok(Exit::Pass); // as above, and the run tells why
    }
    let plan = notice?.plan()?;
    let faults = [&arguments.inject[..], &plan.panel.inject].concat();
    let prepared = prepared::all(&faults, &session, &plan);
    let prepared = prepared.map_err(|error| error.tell(json))?;
    let buttons = prepared.into_iter().map(|fault| Button {
        label: fault.words.clone(),
        fault,
    });
    let buttons: Vec<Button> = buttons.collect();

    let run_dir = session.run_dir.clone();
    let window_s = arguments.window.unwrap_or(plan.panel.window_s);
    let model = Model::new(&session.name, run_dir, plan, &arguments.signal);
    let model = SharedModel(Arc::new(Mutex::new(model)));
    let watch = Watch::start(session.clone(), model.clone(), None, true);
    watch.wait_for_first();
    watch.check()?;
    show_newest(&session, &model);
    let asking = Asking::start(session.clone(), model.clone());
    let board = Arc::new(Board::new(session, model.clone(), buttons, window_s));
    let server = Server::start(board)?;
    let url = server.url();
    let session = &model.lock().session.clone();
    if json {
        output::write(&live::to_json(&json!({ "session": session, "url": url }))?)?;
    } else if arguments.run_of.is_some() {
        tell!("panel: {url}");
    } else {
        output::write(&format!("panel of session `{session}`: {url}\n"))?;
    }
    let opened = (!arguments.no_open).then(|| opener::open(&url)).flatten();
    let exit = stay(arguments, &model, &watch, &server, &interruption)?;
    drop(server);
    drop((asking, opened));
    let model = model.lock();
    if let (Some(ending), None, false) = (model.ending(), arguments.run_of, json) {
        output::write(&format!("{}\n", line::ended(&model, ending)))?;
    }
    Ok(exit)
}

/// Gives the model the newest record of a run that is held: no other comes until it goes on.
fn show_newest(session: &SessionInfo, model: &SharedModel) {
    let asked = hil_session::live::ask(session, &Request::Record, LOOK * 50);
    if let Ok(Response::Record { layout, words }) = asked {
        let mut model = model.lock();
        let is_fit = words.len() == layout.words() && model.drawn().next().is_some();
        if is_fit && model.seen().is_none() {
            model.take(Seen::Record(layout.view(&words), &words));
        }
    }
}

/// Stays as long as there is something to be shown to somebody.
fn stay(
    arguments: &PanelArguments,
    model: &SharedModel,
    watch: &Watch,
    server: &Server,
    interruption: &Interruption,
) -> Result<Exit, Failure> {
    let is_of_run = arguments.run_of.is_some();
    let mut alone_since = Instant::now();
    let mut ended_at = None;
    loop {
        watch.check()?;
        let now = Instant::now();
        if watch.has_ended() {
            let ended_at = *ended_at.get_or_insert(now);
            let is_seen = is_of_run && now > ended_at + LAST_LOOK;
            if server.clients() > 0 {
                alone_since = now;
            }
            let is_alone = now > alone_since + LINGER && now > ended_at + LINGER;
            if is_seen || is_alone || (is_of_run && server.clients() == 0) {
                return Ok(Exit::Pass);
            }
        }
        // That of a run gets the signals of its terminal too, and shows how the run ends.
        if interruption.came() && !is_of_run {
            return match model.lock().ending() {
                Some(_) => Ok(Exit::Pass),
                None => Err(Failure::Interrupted),
            };
        }
        std::thread::sleep(LOOK);
    }
}

/// The session that a process will own; `None` if the process ends, or lets go of the panel, without one.
fn owned_by(owner: u32, interruption: &Interruption) -> Result<Option<SessionInfo>, Failure> {
    let Some(owner) = ProcessId::of(owner) else {
        return Ok(None);
    };
    while owner.is_alive() && !interruption.came() {
        let running = session::list().map_err(Failure::infrastructure)?;
        if let Some(session) = running.into_iter().find(|one| one.owner == owner) {
            return Ok(Some(session));
        }
        if input_is_gone() {
            break;
        }
        std::thread::sleep(LOOK);
    }
    Ok(None)
}

/// A panel beside a run, until it is dropped.
struct Beside(Child);

impl Drop for Beside {
    /// Waits for the panel, which ends by itself with the session, and kills it otherwise.
    fn drop(&mut self) {
        drop(self.0.stdin.take()); // tells it that no session comes any more
        let since = Instant::now();
        while since.elapsed() < END_LIMIT {
            if !matches!(self.0.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(LOOK);
        }
        let _ = self.0.kill(); // it may have ended by itself
        let _ = self.0.wait();
    }
}

/// Does a run with its panel beside it.
///
/// # Errors
/// If there can be no panel, or as the run.
pub fn with_run(
    arguments: &RunArguments,
    run: impl FnOnce(&RunArguments) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    if !arguments.panel.panel {
        return run(arguments);
    }
    let is_single = arguments.scenarios.len() < 2 && arguments.repeat == 1 && !arguments.audit;
    if !is_single {
        return Err(Failure::usage("--panel shows a single run"));
    }
    if arguments.options.link == LinkKind::InProcess {
        return Err(Failure::usage(
            "--panel needs two processes: --link in-process has no records that others could see",
        ));
    }
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    let mut panel = Command::new(own);
    panel.args(["panel", "--run-of", &std::process::id().to_string()]);
    panel.args(arguments.panel.no_open.then_some("--no-open"));
    panel.stdin(Stdio::piped()).stdout(Stdio::null());
    let _beside = Beside(panel.spawn().map_err(Failure::infrastructure)?);
    run(arguments)
}
