//! The agent: owns a session on the target, starts the controller's program in that session, and acts as the plant for
//! it.
//!
//! Serves one contact, with at most one run. When the contact ends (by request, by a closed channel or by a silent
//! desk), program and session are gone; after `kill -9` the next agent removes them.

use std::io::{Read, Write};
use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use hil_session::asking::ask;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::program::CONTROLLER_JOB;
use hil_session::session::{Session, sweep};
use shared_types::link::Link;
use shared_types::wait::WaitLimit;

use crate::channel::{Ear, Heard, Mouth};
use crate::machine::Findings;
use crate::message::{PROTOCOL, Refusal, RunRequest, ToAgent, ToDesk, from_hex, prologue, to_hex};
use crate::path::{DatagramPath, listen};
use crate::programs::{AllowedPrograms, Storing};
use crate::seal::{Key, answer};
use crate::sleep::LateBell;
use beats::Beats;
use run::Run;
use started::Started;

/// Longest silence of a desk before a run.
const IDLE: Duration = Duration::from_secs(60);
/// Maximum length of the passed-on part of an answer's standard error, in characters.
const COMPLAINT: usize = 16 << 10;

/// Serves one desk: answers its requests, and runs the programs that it asks for. Returns when the channel is closed.
/// `admit` is called first, and may wait; `runs` is called with `true` when a run begins, and with `false` when it
/// should end.
pub fn run(
    (from, into): (impl Read + Send + 'static, impl Write + Send + 'static),
    seal: Option<Arc<crate::seal::Seal>>,
    programs: &AllowedPrograms,
    address: Option<IpAddr>,
    admit: impl FnOnce() -> Result<(), String>,
    runs: impl Fn(bool),
) -> Result<(), String> {
    let bell = LateBell::default();
    let rung = bell.clone();
    let ring = move || rung.ring();
    let mouth = Mouth::speak(into, seal.clone());
    let mut agent = Agent {
        ear: Ear::listen(from, seal.clone(), ring),
        beats: Some(Beats::start(&mouth)),
        mouth,
        bell,
        programs,
        address,
        runs: &runs,
        program: None,
    };
    let served = admit().map_err(failed).and_then(|()| {
        let _ = sweep(); // what cannot be removed now the next one tries again
        agent.serve()
    });
    if let Err((is_usage, reason)) = &served {
        // A desk that does not listen will not hear this either.
        agent.mouth.try_say(&ToDesk::Refused {
            is_usage: *is_usage,
            reason: reason.clone(),
        });
        // The desk closes the channel once it has read that.
        let since = Instant::now();
        while since.elapsed() < Duration::from_secs(2) {
            if let Some(Heard::Closed(_)) = agent.ear.wait(Duration::from_millis(50)) {
                break;
            }
        }
    }
    served.map_err(|(_, reason)| reason)
}

struct Agent<'a> {
    ear: Ear<ToAgent>,
    /// Signs of life until a run begins, whose loop sends its own. Declared before the sender, of which the thread has
    /// a copy.
    beats: Option<Beats>,
    mouth: Mouth,
    bell: LateBell,
    programs: &'a AllowedPrograms,
    /// Address through which the desk connected; without an address there are no datagrams.
    address: Option<IpAddr>,
    /// Receives `true` while a run is in progress.
    runs: &'a dyn Fn(bool),
    program: Option<(String, PathBuf)>,
}

impl Agent<'_> {
    fn serve(&mut self) -> Result<(), Refusal> {
        self.mouth.say(&ToDesk::Here {
            protocol: PROTOCOL,
            findings: Findings::of_agent(self.programs.folder()),
        });
        let mut storing: Option<(String, Storing)> = None;
        loop {
            match self.ear.wait(IDLE) {
                Some(Heard::Message(ToAgent::Program {
                    protocol,
                    blake3,
                    bytes,
                })) => {
                    if protocol != PROTOCOL {
                        let reason = format!(
                            "the desk speaks protocol {protocol}, but the agent speaks {PROTOCOL}; use programs of the same version"
                        );
                        return Err((true, reason));
                    }
                    storing = None;
                    match self.programs.find(&blake3) {
                        Some(path) => self.have(blake3, path),
                        None => {
                            let begun = self.programs.store(&blake3, bytes)?;
                            storing = Some((blake3, begun));
                            self.mouth.say(&ToDesk::Send);
                        }
                    }
                }
                Some(Heard::Part(part)) => {
                    let Some((blake3, begun)) = &mut storing else {
                        return Err((
                            false,
                            "received a part of a file that was not announced".into(),
                        ));
                    };
                    if !begun.take(&part).map_err(failed)? {
                        self.mouth.say(&ToDesk::Taken);
                    } else {
                        let path = self.programs.find(blake3);
                        let path =
                            path.ok_or((false, "the program is no longer available".to_owned()))?;
                        let blake3 = blake3.clone();
                        storing = None;
                        self.have(blake3, path);
                    }
                }
                Some(Heard::Message(ToAgent::Describe)) => self.ask(&["--describe".into()])?,
                Some(Heard::Message(ToAgent::Check { job })) => {
                    // Its folder goes with it, whatever happens.
                    let session = Session::of_one_process(None).map_err(failed)?;
                    let file = session.info().folder.join("job.json");
                    std::fs::write(&file, job).map_err(failed)?;
                    self.ask(&["--check".into(), file.into_os_string()])?;
                }
                Some(Heard::Message(ToAgent::Clean)) => {
                    let files = self.programs.clean();
                    self.mouth.say(&ToDesk::Cleaned { files });
                }
                Some(Heard::Message(ToAgent::Echo)) => self.mouth.say(&ToDesk::Echo),
                Some(Heard::Message(ToAgent::Run(request))) => return self.begin(&request),
                Some(Heard::Message(ToAgent::Beat)) => {}
                Some(Heard::Message(_) | Heard::Packet(_)) => {
                    return Err((
                        false,
                        "received a message of a run before the run began".into(),
                    ));
                }
                Some(Heard::Closed(_)) => return Ok(()),
                None => return Err((false, "the desk sent nothing for too long".into())),
            }
        }
    }

    fn have(&mut self, blake3: String, path: PathBuf) {
        self.program = Some((blake3, path));
        self.mouth.say(&ToDesk::Have);
    }

    fn program(&self) -> Result<&(String, PathBuf), Refusal> {
        self.program
            .as_ref()
            .ok_or((false, "the first message did not name a program".into()))
    }

    fn ask(&self, arguments: &[std::ffi::OsString]) -> Result<(), Refusal> {
        let (_, program) = self.program()?;
        let answer =
            ask(program, arguments, &|| false).map_err(|error| (true, cannot_run(&error)))?;
        let stderr = String::from_utf8_lossy(&answer.stderr);
        self.mouth.say(&ToDesk::Answer {
            code: answer.status.code(),
            stdout: String::from_utf8_lossy(&answer.stdout).into_owned(),
            stderr: stderr.chars().take(COMPLAINT).collect(),
        });
        Ok(())
    }

    /// Creates a session for a program and runs the program there.
    fn begin(&mut self, request: &RunRequest) -> Result<(), Refusal> {
        let beats = self.beats.take();
        let (blake3, program) = self.program()?;
        let key = Key::from_hex(&request.key).ok_or((false, "the key is malformed".to_owned()))?;
        let first = from_hex(&request.handshake).unwrap_or_default();
        let believed = prologue(blake3, &request.job, request.epoch);
        let (seal, second) = answer(&key, &believed, &first).map_err(failed)?;
        // Without a socket the frames go through the channel.
        let socket = self.address.and_then(|address| listen(address).ok());
        let at = socket.as_ref().and_then(|socket| socket.local_addr().ok());
        let mut session = Session::create(None).map_err(failed)?;
        let info = session.info().clone();
        let job: serde_json::Value = serde_json::from_str(&request.job).map_err(failed)?;
        info.write_file(CONTROLLER_JOB, &job).map_err(failed)?;
        let mut link = IceoryxLink::create(&info).map_err(failed)?;
        if request.epoch != 1 {
            link.expect(request.epoch).map_err(failed)?;
        }
        self.bell.is(link.bell());
        let started = Started::start(program, &info, &self.mouth, link.bell())
            .map_err(|e| (true, cannot_run(&e)))?;
        session
            .add_controller(request.epoch, started.process_id())
            .map_err(failed)?;
        self.mouth.say(&ToDesk::Running {
            address: at.map(|at| at.to_string()),
            handshake: to_hex(&second),
        });
        let limit = request.limit_s.unwrap_or(f64::INFINITY);
        drop(beats);
        (self.runs)(true);
        let mut run = Run::new(
            (&self.ear, &self.mouth),
            link,
            started,
            socket.map(|socket| DatagramPath::target(socket, seal)),
            &info,
            request,
        );
        let both_here = Findings::own().boot_id == request.boot_id;
        let served = run.serve(WaitLimit::from_seconds(limit), both_here);
        (self.runs)(false);
        served.map_err(failed)
    }
}

/// Creates a refusal that the user cannot fix on the command line.
fn failed(error: impl std::fmt::Display) -> Refusal {
    (false, error.to_string())
}

fn cannot_run(error: &dyn std::fmt::Display) -> String {
    format!("cannot run the program on the target: {error}")
}

mod beats;
mod guard;
mod output;
mod run;
mod started;
