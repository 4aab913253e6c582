//! `hil panel`: a running session, or a [recorded] run, in a web browser on this machine.
//!
//! 1. The [watch](super::monitor::watch) and the [queries](super::monitor::asking) of the monitor feed the
//!    monitor's [model](super::monitor::model).
//! 2. The [`server`] checks [`request`]s and serves the [`page`].
//! 3. A page that presents the secret becomes a [`client`]: it receives [`message`]s made from the model and sends
//!    requests to the [`board`].
//! 4. A page that looks back or measures gets answers from what is [`kept`] of a session, or from the [`archive`] of a
//!    recorded run.
//!    Behind the curves may be the [`backdrop`]: another run, or the band of a baseline.
//! 5. A page that searches for the steps at which a formula holds gets its
//!    [`occurrences`](crate::report::occurrences): in a session by a [`live_search`] of the [`kept_records`] and of
//!    every step that follows.
//! 6. A page may start [`branches`]: new runs that repeat this one up to a step and are held there.
//! 7. A page may have its plots, as arranged, written to the scenario's file by the [`keeper`].
//! 8. The [`opener`] opens the page, if this machine has a screen.
//!
//! `hil run --panel` starts the panel as a separate process, so that the panel can neither delay nor end the run. Like
//! the monitor, it is passive: the digest of the run is the same with and without a panel, unless a page changes the
//! run.

pub(crate) mod archive;
pub(crate) mod backdrop;
pub(crate) mod board;
pub(crate) mod branches;
pub(crate) mod client;
pub(crate) mod keeper;
pub(crate) mod kept;
pub(crate) mod kept_records;
pub(crate) mod live_search;
pub mod message;
pub(crate) mod opener;
pub(crate) mod page;
pub(crate) mod reading;
pub(crate) mod recorded;
pub mod request;
pub(crate) mod server;
pub(crate) mod wire;

use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::arguments::run::LinkKind;
use hil_facts::session::live;
use hil_facts::session::observer::{Notice, Seen};
use hil_recording::reader::Column;
use hil_session::process::ProcessId;
use hil_session::session::{self, SessionInfo};
use hil_verification::arguments::run::RunArguments;
use rustix::process::{Signal, getpid, kill_process};
use serde_json::json;
use shared_types::live::{Request, Response};

use super::monitor::asking::Asking;
use super::monitor::keys::input_is_gone;
use super::monitor::model::Model;
use super::monitor::watch::{Audience, Watch};
use super::monitor::{self, SharedModel, line, prepared};
use crate::arguments::panel::PanelArguments;
use crate::plots::columns_of;
use backdrop::Backdrop;
use board::{Board, Button};
use branches::Branches;
use kept_records::KeptRecords;
use server::Server;

/// Polling interval for the session and the clients.
const LOOK: Duration = Duration::from_millis(20);
/// Time for which a session that has ended stays available without clients: a page may reconnect.
const LINGER: Duration = Duration::from_secs(10);
/// Time limit for the panel of a run to end after the run.
const END_LIMIT: Duration = Duration::from_secs(8);
/// Time for which the panel of a run shows the end of the run to a page.
const LAST_LOOK: Duration = Duration::from_millis(600);

/// Runs the command.
///
/// # Errors
/// If there is no session to show, the session cannot be watched, or a prepared fault is invalid.
pub fn panel(arguments: &PanelArguments) -> Result<Exit, Failure> {
    if let Some(run) = &arguments.run {
        return recorded::open(arguments, run);
    }
    let interruption = Interruption::listen()?;
    let json = arguments.choice.json;
    let target = match arguments.run_of {
        Some(owner) => owned_by(owner, &interruption)?,
        None => Some(
            monitor::find(&arguments.choice, arguments.wait, &interruption)
                .map_err(|error| error.tell(json))?,
        ),
    };
    let Some(session) = target else {
        return Ok(Exit::Pass); // the run ended before it started a session
    };
    let notice = monitor::notice(&session, &interruption);
    if notice.is_err() && arguments.run_of.is_some() && !session.is_there() {
        return Ok(Exit::Pass); // as above; the run reports the reason
    }
    let notice = notice?;
    let plan = notice.plan()?;
    let faults = [&arguments.inject[..], &plan.panel.inject].concat();
    let prepared = prepared::all(&faults, &session, &plan);
    let prepared = prepared.map_err(|error| error.tell(json))?;
    let buttons = prepared.into_iter().map(|fault| Button {
        label: fault.words.clone(),
        fault,
    });
    let buttons: Vec<Button> = buttons.collect();

    let columns = signals(&notice, &plan);
    let backdrop = Backdrop::open(arguments, plan.run.rate.hz(), &columns)?;
    let run_dir = session.run_dir.clone();
    let window_s = arguments.window.unwrap_or(plan.panel.window_s);
    let kept = KeptRecords::new(plan.clone());
    let model = Model::new(&session.name, run_dir, plan, &arguments.signal);
    let model = SharedModel(Arc::new(Mutex::new(model)));
    let audience: Box<dyn Audience> = Box::new(kept.clone());
    let watch = Watch::start(session.clone(), model.clone(), Some(audience), true);
    watch.wait_for_first();
    watch.check()?;
    show_newest(&session, &model, &kept);
    let asking = Asking::start(session.clone(), model.clone());
    let board = Board::new(session, (model.clone(), kept), buttons, window_s, backdrop);
    let branches = Arc::clone(&board.branches);
    let server = Server::start(Arc::new(board))?;
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
    let exit = stay(
        arguments,
        &model,
        &watch,
        (&server, &branches),
        &interruption,
    );
    branches.end();
    let exit = exit?;
    drop(server);
    drop((asking, opened));
    let model = model.lock();
    if let (Some(ending), None, false) = (model.ending(), arguments.run_of, json) {
        output::write(&format!("{}\n", line::ended(&model, ending)))?;
    }
    Ok(exit)
}

/// Returns the signals of a session that is only described yet.
fn signals(notice: &Notice, plan: &Plan) -> Vec<Column> {
    let plant = plan.plant_among(&notice.plant.plants);
    let law = plan.law_among(&notice.controller.laws);
    let layout = plant
        .zip(law)
        .map(|(plant, law)| plan.record_layout(&plant, &law));
    layout.map_or_else(Vec::new, |layout| columns_of(&layout, &plan.derived))
}

/// Gives the model and the searches the latest record of a paused run, because the stream delivers none until the run
/// resumes.
fn show_newest(session: &SessionInfo, model: &SharedModel, kept: &KeptRecords) {
    let response = hil_session::live::ask(session, &Request::Record, LOOK * 50);
    if let Ok(Response::Record { layout, words }) = response {
        let mut model = model.lock();
        let is_fit = words.len() == layout.words() && model.drawn().next().is_some();
        if is_fit && model.seen().is_none() {
            model.take(Seen::Record(layout.view(&words), &words));
            kept.keep(&words);
        }
    }
}

/// Waits until the session has ended, and neither a client nor a branch remains.
fn stay(
    arguments: &PanelArguments,
    model: &SharedModel,
    watch: &Watch,
    (server, branches): (&Server, &Branches),
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
            if server.clients() > 0 || branches.is_busy() {
                alone_since = now;
            }
            let is_alone = now > alone_since + LINGER && now > ended_at + LINGER;
            if is_seen || is_alone || (is_of_run && server.clients() == 0) {
                return Ok(Exit::Pass);
            }
        }
        // The panel of a run receives the signals of its terminal too, and shows how the run ends.
        if interruption.came() && !is_of_run {
            return match model.lock().ending() {
                Some(_) => Ok(Exit::Pass),
                None => Err(Failure::Interrupted),
            };
        }
        std::thread::sleep(LOOK);
    }
}

/// Waits for the session that a process will own; `None` if the process ends, or releases the panel, without one.
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

/// Panel process started with a run; dropping it ends the panel.
struct Beside(Child);

impl Drop for Beside {
    /// Waits for the panel, which ends by itself with the session, and kills it after a time limit.
    fn drop(&mut self) {
        drop(self.0.stdin.take()); // signals that no session will follow
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

/// Interrupts this process when another one ends.
fn end_with(owner: u32) {
    let owner = ProcessId::of(owner);
    std::thread::spawn(move || {
        while owner.is_some_and(|owner| owner.is_alive()) {
            std::thread::sleep(LOOK * 5);
        }
        let _ = kill_process(getpid(), Signal::INT); // cannot fail for its own process
    });
}

/// Executes a run together with its panel.
///
/// # Errors
/// If the panel cannot be started; also the errors of the run.
pub fn with_run(
    arguments: &RunArguments,
    run: impl FnOnce(&RunArguments) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    if !arguments.panel.panel {
        return run(arguments);
    }
    let is_single = arguments.scenarios.len() < 2 && arguments.repeat == 1 && !arguments.audit;
    if !is_single {
        return Err(Failure::usage(
            "--panel shows a single run; omit it, or run one scenario once",
        ));
    }
    if arguments.options.link == LinkKind::InProcess {
        return Err(Failure::usage(
            "--panel needs two processes: --link in-process has no records that others could read; omit --link in-process",
        ));
    }
    if let Some(owner) = arguments.panel.owner {
        end_with(owner);
    }
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    let mut panel = Command::new(own);
    panel.args(["panel", "--run-of", &std::process::id().to_string()]);
    panel.args(arguments.panel.no_open.then_some("--no-open"));
    panel.stdin(Stdio::piped()).stdout(Stdio::null());
    let _beside = Beside(panel.spawn().map_err(Failure::infrastructure)?);
    run(arguments)
}
