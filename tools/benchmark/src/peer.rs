//! The peer process: a second `hil`, as the controller of a measurement.
//!
//! Started by a hidden command in its own process group, so that Ctrl-C reaches only the measuring `hil`. The peer ends
//! when its standard input is closed.

use std::io::Read;
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use controller_process::job::{JOB_FILE, Job};
use controller_process::runner::{End, Runner};
use hil_console::terminal::exit::{Exit, Failure};
use hil_run::open_files;
use hil_session::link::bare::Blackboard;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::process::{end_group, reap};
use hil_session::realtime::{apply, waiter};
use hil_session::session::{Session, SessionInfo};
use hil_session::supervision::Supervision;
use shared_types::realtime::CONTROLLER_FILE;
use shared_types::side::Side;
use shared_types::wait::WaitLimit;

use super::exchange::{Trips, follow};
use super::null;
use crate::arguments::{LatencyPeerArguments, PeerWork};

/// Longest wait of a side for a live peer, in s.
pub(crate) const WAIT_LIMIT_S: f64 = 5.0;
/// Longest time that a finished peer may take to exit.
const GRACE: Duration = Duration::from_secs(2);

/// Handle of the peer process.
pub(super) struct Peer {
    process: Child,
    /// Kept open, because closing the input ends the process.
    input: Option<ChildStdin>,
    output_thread: Option<JoinHandle<String>>,
}

impl Peer {
    /// Starts the process and registers it with the supervision, which detects its end.
    pub(crate) fn start(
        session: &mut Session,
        work: PeerWork,
        supervision: &Supervision,
    ) -> Result<Self, Failure> {
        open_files::ensure()?;
        let own = std::env::current_exe().map_err(Failure::infrastructure)?;
        let mut process = Command::new(own)
            .arg("latency-peer")
            .arg(&session.info().folder)
            .args(work.arguments())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0)
            .spawn()
            .map_err(|error| {
                Failure::infrastructure(format!("cannot start the controller's process: {error}"))
            })?;
        let (input, output) = (process.stdin.take(), process.stderr.take());
        let supervision = supervision.clone();
        // Sleeps until the process exits, so that this thread stays idle during the measurement.
        let output_thread = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(mut output) = output {
                let _ = output.read_to_end(&mut bytes); // partial output suffices after an error
            }
            supervision.peer_gone(1);
            String::from_utf8_lossy(&bytes).trim().to_owned()
        });
        let peer = Self {
            process,
            input,
            output_thread: Some(output_thread),
        };
        (session.add_controller(1, peer.process.id())).map_err(Failure::infrastructure)?;
        Ok(peer)
    }

    /// Ends the process before its task is complete; returns its error output, if any.
    pub(crate) fn stop(mut self) -> Result<(), String> {
        drop(self.input.take());
        self.end()
    }

    /// Waits for the end of the process; returns its error output if it failed.
    pub(crate) fn end(mut self) -> Result<(), String> {
        let since = Instant::now();
        let status = loop {
            match reap(&mut self.process) {
                Ok(Some(status)) => break status,
                Ok(None) if since.elapsed() < GRACE => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                _ => {
                    return Err(format!(
                        "the controller's process did not exit within {} s",
                        GRACE.as_secs()
                    ));
                }
            }
        };
        let output = self
            .output_thread
            .take()
            .and_then(|thread| thread.join().ok());
        match output.unwrap_or_default() {
            _ if status.success() => Ok(()),
            output if output.is_empty() => {
                Err(format!("the controller's process failed: {status}"))
            }
            output => Err(format!("the controller's process failed: {output}")),
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        drop(self.input.take());
        if let Ok(None) = reap(&mut self.process) {
            end_group(&self.process);
            let _ = self.process.wait(); // it was killed
        }
    }
}

/// Runs the hidden command: acts as the controller of a measurement.
///
/// # Errors
/// If the measurement ended prematurely.
pub fn peer(arguments: &LatencyPeerArguments) -> Result<Exit, Failure> {
    let supervision = Supervision::from_stdin();
    let session = SessionInfo::read(&arguments.session).map_err(Failure::usage)?;
    let done = match arguments.work {
        PeerWork::Controller { signals } => control(&session, signals, &supervision),
        PeerWork::Answer { signals, trips } => answer(&session, signals, trips, &supervision),
    };
    done.map(|()| Exit::Pass).map_err(Failure::Infrastructure)
}

fn control(session: &SessionInfo, signals: usize, supervision: &Supervision) -> Result<(), String> {
    let job: Job = session.read_file(JOB_FILE).map_err(|e| e.to_string())?;
    let (limit, settings) = (WaitLimit::from_seconds(job.wait_limit_s), job.realtime);
    let link = IceoryxLink::open(session, 1).map_err(|e| e.to_string())?;
    let law = null::measured_law(signals);
    let mut runner = Runner::new(&law, job, link).map_err(|e| e.to_string())?;
    let report = apply(&settings);
    (session.write_file(CONTROLLER_FILE, &report)).map_err(|e| e.to_string())?;
    controller_process::program::drive(&mut runner, waiter(&report, limit), supervision)
        .map_err(|e| e.to_string())?;
    match runner.end() {
        Some(End::Completed { .. }) => Ok(()),
        Some(End::Aborted(abort)) => Err(abort.to_string()),
        None => Err("the run ended without a result".into()),
    }
}

fn answer(
    session: &SessionInfo,
    signals: usize,
    trips: u64,
    supervision: &Supervision,
) -> Result<(), String> {
    let back = null::answered_with(signals);
    let mut end = Blackboard::open(session, Side::Controller, signals, back)
        .map_err(|error| error.to_string())?;
    let job: Job = session.read_file(JOB_FILE).map_err(|e| e.to_string())?;
    let limit = WaitLimit::from_seconds(job.wait_limit_s);
    let waiter = waiter(&apply(&job.realtime), limit);
    let trips = Trips {
        warm_up: 0,
        measured: trips,
    };
    follow(&mut end, trips, waiter, || supervision.wants_stop()).map_err(|e| e.to_string())
}
