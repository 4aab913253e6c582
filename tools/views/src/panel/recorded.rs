//! `hil panel RUN`: the panel's page for a recorded run, without a session.
//!
//! Serves an [`Archive`] by the same server, and so to the same visitors, as a session. A page cannot act on a
//! recording, but can start a new run that [branches](super::branches) from it.

use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_facts::session::live;
use serde_json::json;
use shared_types::time::Step;
use tungstenite::{Error, WebSocket};

use super::archive::Archive;
use super::backdrop::Backdrop;
use super::branches::{Branches, Trunk};
use super::keeper::Keeper;
use super::message::{self, ClientMessage};
use super::server::{Server, Source};
use super::wire::{LISTEN, Wire};
use super::{LINGER, LOOK, opener};
use crate::arguments::panel::PanelArguments;
use crate::monitor::log::Log;

/// Interval between two messages to a page that asks nothing.
const ALIVE: Duration = Duration::from_secs(5);
/// Maximum number of a page's messages handled at a time.
const AT_ONCE: usize = 32;

/// Opens the page of a recorded run.
///
/// # Errors
/// If the run cannot be read or is not complete, an option needs a session, or the page cannot be served.
pub(super) fn open(arguments: &PanelArguments, run: &Path) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    if !arguments.inject.is_empty() {
        return Err(Failure::usage(
            "--inject prepares a fault for a session; a recorded run takes none",
        ));
    }
    let archive = Archive::open(run, &arguments.signal)?;
    let backdrop = Backdrop::open(arguments, archive.hz(), archive.columns())?;
    interruption.check()?;
    let branches = Branches::of(Trunk {
        recording: Some(run.to_owned()),
        is_live: false,
    });
    let server = Server::start(Arc::new(Recorded {
        archive,
        backdrop,
        branches: Arc::clone(&branches),
        keeper: Keeper::of(Some(run.to_owned())),
        window_s: arguments.window,
        is_over: AtomicBool::new(false),
    }))?;
    let url = server.url();
    let run = run.display();
    if arguments.choice.json {
        output::write(&live::to_json(
            &json!({ "run": run.to_string(), "url": url }),
        )?)?;
    } else {
        output::write(&format!("panel of {run}: {url}\n"))?;
    }
    let opened = (!arguments.no_open).then(|| opener::open(&url)).flatten();
    stay(&server, &branches, &interruption);
    branches.end();
    drop(server);
    drop(opened);
    Ok(Exit::Pass)
}

/// Waits for Ctrl-C, or until every page has been closed for a while and no branch is alive.
fn stay(server: &Server, branches: &Branches, interruption: &Interruption) {
    let mut open_at = None;
    while !interruption.came() {
        let now = Instant::now();
        if server.clients() > 0 || branches.is_busy() {
            open_at = Some(now);
        }
        if open_at.is_some_and(|open_at| now > open_at + LINGER) {
            return;
        }
        std::thread::sleep(LOOK);
    }
}

/// Recorded run with its pages.
struct Recorded {
    archive: Archive,
    backdrop: Option<Backdrop>,
    branches: Arc<Branches>,
    keeper: Keeper,
    /// Width of the time axis to begin with in s, if it is not the whole run.
    window_s: Option<f64>,
    is_over: AtomicBool,
}

impl Source for Recorded {
    fn serve(self: Arc<Self>, socket: WebSocket<TcpStream>) {
        let _ = self.converse(Wire::new(socket)); // a disconnected page is not an error
    }

    fn end(&self) {
        self.is_over.store(true, Ordering::Release);
    }
}

impl Recorded {
    /// Describes the run to a page, then answers its requests.
    fn converse(&self, mut wire: Wire) -> Result<(), Error> {
        let names = self.archive.names();
        let mut about = self.archive.about(self.window_s);
        if let Some(backdrop) = &self.backdrop {
            backdrop.describe(&names, &mut about);
        }
        wire.say(about.to_string().into())?;
        let mut state_at = Instant::now();
        let mut log = Log::default();
        log.hear(self.archive.log().to_vec());
        let (mut sent, mut branched) = ((0, 0), 0);
        while !self.is_over.load(Ordering::Acquire) {
            wire.tend()?;
            if !wire.is_full() {
                // Repeated as a sign of life for the page.
                let now = Instant::now();
                if now >= state_at {
                    wire.say(self.archive.state().to_string().into())?;
                    state_at = now + ALIVE;
                }
                if let Some(events) = message::log(&log, &mut sent) {
                    wire.say(events.to_string().into())?;
                }
                if let Some(branches) = self.branches.news(&mut branched) {
                    wire.say(branches.to_string().into())?;
                }
                for request in requests(&mut wire)? {
                    if let ClientMessage::Branch { step } = request {
                        self.branches.start(Step(step));
                    }
                    if let Some(answer) = self.keeper.answer(&request, &about) {
                        wire.say(answer.to_string().into())?;
                    }
                    let answer = match &self.backdrop {
                        Some(backdrop) if request.is_of_other_run() => {
                            backdrop.answer(&request, &names)
                        }
                        _ => self.archive.answer(&request, &names),
                    };
                    if let Some(answer) = answer {
                        wire.say(answer)?;
                    }
                }
            }
            std::thread::sleep(LISTEN);
        }
        wire.part("the panel was closed")
    }
}

/// Returns the waiting requests of a page: of those for signals over a part of the run only the newest for each run,
/// because a page that zooms has no use for the others.
fn requests(wire: &mut Wire) -> Result<Vec<ClientMessage>, Error> {
    let is_read = |one: &ClientMessage| matches!(one, ClientMessage::Read { .. });
    let mut waiting: Vec<ClientMessage> = Vec::new();
    while let Some(message) = wire.next()? {
        if is_read(&message) {
            let is_other = message.is_of_other_run();
            waiting.retain(|one| !is_read(one) || one.is_of_other_run() != is_other);
        }
        waiting.push(message);
        if waiting.len() >= AT_ONCE {
            break;
        }
    }
    Ok(waiting)
}
