//! The agent: owns a session on the target, starts the controller's file in it, and speaks to it as the plant.
//!
//! Serves one contact, with one run at most. At its end, by an order, a cut or a silent desk, program and session are gone; after `kill -9` the next agent removes them.

use std::io::{Read, Write};
use std::net::IpAddr;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rustix::process::{Pid, WaitId, WaitIdOptions, waitid};
use shared_types::clock::monotonic_ns;
use shared_types::frame::{FrameIdentity, FrameKind};
use shared_types::hello::Control;
use shared_types::link::bell::Bell;
use shared_types::link::iceoryx::IceoryxLink;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::process::{MARK, end_group, end_marked, reap};
use shared_types::program::CONTROLLER_JOB;
use shared_types::realtime::CONTROLLER_FILE;
use shared_types::session::{Session, SessionInfo, sweep};
use shared_types::wait::WaitLimit;

use crate::asking::ask;
use crate::cache::{Programs, Storing};
use crate::channel::{Ear, Heard, Mouth};
use crate::exchange::{BEAT_NS, TargetEnd};
use crate::machine::Findings;
use crate::message::{Missed, PROTOCOL, RunRequest, ToAgent, ToDesk, from_hex, prologue, to_hex};
use crate::packet::{Numbered, Packet};
use crate::path::{Wire, listen};
use crate::seal::{Key, answer};
use crate::sleep::{LateBell, waiter};

/// Longest time that a desk may say nothing before a run.
const IDLE: Duration = Duration::from_secs(60);
/// Longest standard error of an answer that is passed on, in characters.
const COMPLAINT: usize = 16 << 10;
/// Time between two looks at what changes seldom.
const LOOK_NS: u64 = 5_000_000;
/// Time that what a program wrote before its end may take.
const LAST_WORDS_NS: u64 = 100_000_000;
/// Time between two signs of life through the channel.
const SIGN_NS: u64 = 250_000_000;

/// Serves one desk: answers what it asks, and runs what it wants to be run. Returns when the channel is closed.
///
/// # Errors
/// The reason for which it ended before, which the desk was told if it could be.
pub fn run(
    from: impl Read + Send + 'static,
    into: impl Write + Send + 'static,
    seal: Option<Arc<crate::seal::Seal>>,
    programs: &Programs,
    address: Option<IpAddr>,
) -> Result<(), String> {
    let bell = LateBell::default();
    let rung = bell.clone();
    let ring = move || rung.ring();
    let mut agent = Agent {
        ear: Ear::listen(from, seal.clone(), ring),
        mouth: Mouth::speak(into, seal),
        bell,
        programs,
        address,
        program: None,
    };
    let _ = sweep(); // what cannot be removed now the next one tries again
    let served = agent.serve();
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

/// A reason to end, and whether the user can mend it where it was typed.
type Refusal = (bool, String);

struct Agent<'a> {
    ear: Ear<ToAgent>,
    mouth: Mouth,
    bell: LateBell,
    programs: &'a Programs,
    /// Address that the desk reached; without one there are no datagrams.
    address: Option<IpAddr>,
    program: Option<(String, PathBuf)>,
}

impl Agent<'_> {
    fn serve(&mut self) -> Result<(), Refusal> {
        self.mouth.say(&ToDesk::Here {
            protocol: PROTOCOL,
            findings: Findings::own(),
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
                        let reason =
                            format!("the desk speaks protocol {protocol}, the agent {PROTOCOL}");
                        return Err((true, reason));
                    }
                    storing = None;
                    match self.programs.find(&blake3) {
                        Some(path) => self.have(blake3, path),
                        None => {
                            let begun = self
                                .programs
                                .store(&blake3, bytes)
                                .map_err(|reason| (true, reason))?;
                            storing = Some((blake3, begun));
                            self.mouth.say(&ToDesk::Send);
                        }
                    }
                }
                Some(Heard::Part(part)) => {
                    let Some((blake3, begun)) = &mut storing else {
                        return Err((false, "a part of no file came".into()));
                    };
                    if !begun.take(&part).map_err(|reason| (false, reason))? {
                        self.mouth.say(&ToDesk::Taken);
                    } else {
                        let path = self.programs.find(blake3);
                        let path = path.ok_or((false, "the program is gone again".to_owned()))?;
                        let blake3 = blake3.clone();
                        storing = None;
                        self.have(blake3, path);
                    }
                }
                Some(Heard::Message(ToAgent::Describe)) => self.ask(&["--describe".into()])?,
                Some(Heard::Message(ToAgent::Check { job })) => {
                    // Its folder goes with it, whatever happens.
                    let session = Session::of_one_process(None)
                        .map_err(|error| (false, error.to_string()))?;
                    let file = session.info().folder.join("job.json");
                    std::fs::write(&file, job).map_err(|error| (false, error.to_string()))?;
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
                    return Err((false, "something of a run came before the run".into()));
                }
                Some(Heard::Closed(_)) => return Ok(()),
                None => return Err((false, "the desk says nothing".into())),
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
            .ok_or((false, "no program was named".into()))
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

    /// Makes a session for a program and runs it there.
    fn begin(&self, request: &RunRequest) -> Result<(), Refusal> {
        let failed = |error: &dyn std::fmt::Display| (false, error.to_string());
        let (blake3, program) = self.program()?;
        let key = Key::from_hex(&request.key).ok_or((false, "that is no key".to_owned()))?;
        let first = from_hex(&request.handshake).unwrap_or_default();
        let believed = prologue(blake3, &request.job, request.epoch);
        let (seal, second) = answer(&key, &believed, &first).map_err(|e| failed(&e))?;
        // Without a socket the frames go through the channel.
        let socket = self.address.and_then(|address| listen(address).ok());
        let at = socket.as_ref().and_then(|socket| socket.local_addr().ok());
        let mut session = Session::create(None).map_err(|e| failed(&e))?;
        let info = session.info().clone();
        let job: serde_json::Value = serde_json::from_str(&request.job).map_err(|e| failed(&e))?;
        info.write_file(CONTROLLER_JOB, &job)
            .map_err(|e| failed(&e))?;
        let mut link = IceoryxLink::create(&info).map_err(|e| failed(&e))?;
        if request.epoch != 1 {
            link.expect(request.epoch).map_err(|e| failed(&e))?;
        }
        self.bell.is(link.bell());
        let started = Started::start(program, &info, &self.mouth, link.bell())
            .map_err(|e| (true, cannot_run(&e)))?;
        session
            .add_controller(request.epoch, started.child.id())
            .map_err(|e| failed(&e))?;
        self.mouth.say(&ToDesk::Running {
            address: at.map(|at| at.to_string()),
            handshake: to_hex(&second),
        });
        let limit = request.limit_s.unwrap_or(f64::INFINITY);
        Run::new(
            self,
            link,
            started,
            socket.map(|socket| Wire::target(socket, seal)),
            &info,
            request,
        )
        .serve(WaitLimit::from_seconds(limit))
        .map_err(|reason| (false, reason))
    }
}

fn cannot_run(error: &dyn std::fmt::Display) -> String {
    format!("cannot run the program there: {error}")
}

/// The program, in a group of its own. Dropped, it ends with all that it started.
struct Started {
    child: Child,
    stdin: Option<ChildStdin>,
    has_ended: Arc<AtomicBool>,
    /// Held by each thread that passes on what the program writes.
    passing_on: Arc<()>,
    prefix: String,
}

impl Started {
    fn start(
        program: &Path,
        session: &SessionInfo,
        mouth: &Mouth,
        bell: Bell,
    ) -> std::io::Result<Self> {
        let mut child = Command::new(program)
            .arg("--session")
            .arg(&session.folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .env(MARK, &session.prefix)
            .process_group(0)
            .spawn()?;
        let passing_on = Arc::new(());
        if let Some(output) = child.stdout.take() {
            pass_on(output, mouth.clone(), Arc::clone(&passing_on));
        }
        if let Some(output) = child.stderr.take() {
            pass_on(output, mouth.clone(), Arc::clone(&passing_on));
        }
        let has_ended = Arc::new(AtomicBool::new(false));
        let (ended, pid) = (Arc::clone(&has_ended), Pid::from_child(&child));
        std::thread::spawn(move || {
            // It is not reaped here: until then its number is nobody else's.
            let _ = waitid(
                WaitId::Pid(pid),
                WaitIdOptions::EXITED | WaitIdOptions::NOWAIT,
            );
            ended.store(true, Ordering::Release);
            bell.ring();
        });
        Ok(Self {
            stdin: child.stdin.take(),
            child,
            has_ended,
            passing_on,
            prefix: session.prefix.clone(),
        })
    }

    fn tell(&mut self, line: &str) {
        if let Some(stdin) = &mut self.stdin {
            let _ = writeln!(stdin, "{line}").and_then(|()| stdin.flush()); // its end shows elsewhere
        }
    }

    /// Returns true once all that it wrote was passed on.
    fn is_silent(&self) -> bool {
        Arc::strong_count(&self.passing_on) == 1
    }

    /// Returns its exit status, once it has ended; all that it started in its group ends with it.
    fn status(&mut self) -> Option<ExitStatus> {
        if !self.has_ended.load(Ordering::Acquire) {
            return None;
        }
        Some(match reap(&mut self.child) {
            Ok(status) => status?,
            Err(_) => self
                .child
                .wait()
                .unwrap_or_else(|_| ExitStatus::from_raw(0xff00)),
        })
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        self.stdin = None;
        end_group(&self.child);
        let _ = self.child.wait(); // it was killed, or had ended before
        end_marked(&self.prefix);
    }
}

/// Passes on what a program writes, as far as the channel has room.
fn pass_on(mut from: impl Read + Send + 'static, mouth: Mouth, held: Arc<()>) {
    std::thread::spawn(move || {
        let _held = held;
        let mut buffer = [0; 4096];
        let mut lost = 0;
        while let Ok(count @ 1..) = from.read(&mut buffer) {
            let mut text = String::from_utf8_lossy(&buffer[..count]).into_owned();
            if lost > 0 {
                text.insert_str(
                    0,
                    &format!("\n[{lost} bytes were written faster than they could be passed on]\n"),
                );
            }
            if mouth.try_say(&ToDesk::Log { text }) {
                lost = 0;
            } else {
                lost += count;
            }
        }
    });
}

/// Way that a packet came.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    Datagram,
    Channel,
}

/// A run of one controller.
struct Run<'a> {
    ear: &'a Ear<ToAgent>,
    mouth: &'a Mouth,
    link: IceoryxLink,
    started: Started,
    wire: Option<Wire>,
    session: SessionInfo,
    missed: Missed,
    /// Both ends are on this machine.
    both_here: bool,
    /// The plant waits for nobody.
    against_clock: bool,
    /// Identity that the frames must carry, and the number of values from the desk.
    open: Option<(FrameIdentity, usize)>,
    end: TargetEnd,
    way: Way,
    /// A frame was given to the controller, and it has not answered.
    is_at_work: bool,
    heard_ns: u64,
    /// Time at which the last sample came; 0 before the first and while the run is held.
    sample_ns: u64,
    is_safe: bool,
    has_reported: bool,
    has_told_end: bool,
    /// Exit status of the program, and the time at which it was seen.
    ended: Option<(ExitStatus, u64)>,
    bytes: Vec<u8>,
    values: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(
        agent: &'a Agent<'_>,
        link: IceoryxLink,
        started: Started,
        wire: Option<Wire>,
        session: &SessionInfo,
        request: &RunRequest,
    ) -> Self {
        Self {
            ear: &agent.ear,
            mouth: &agent.mouth,
            link,
            started,
            wire,
            session: session.clone(),
            missed: request.missed,
            both_here: Findings::own().boot_id == request.boot_id,
            against_clock: false,
            open: None,
            end: TargetEnd::new(false),
            way: Way::Channel,
            is_at_work: false,
            heard_ns: monotonic_ns(),
            sample_ns: 0,
            is_safe: false,
            has_reported: false,
            has_told_end: false,
            ended: None,
            bytes: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Serves until the channel closes or the desk is silent for the limit.
    fn serve(&mut self, limit: WaitLimit) -> Result<(), String> {
        let (mut waiter, awaited) = waiter(self.both_here, self.link.bell(), self.wire.as_ref());
        let (mut look_ns, mut sign_ns) = (0, 0);
        loop {
            let mut busy = self.hear_wire().map_err(told)?;
            match self.hear_channel().map_err(told)? {
                Some(came) => busy |= came,
                None => return Ok(()),
            }
            busy |= self.hear_controller().map_err(told)?;
            let now_ns = monotonic_ns();
            if now_ns >= look_ns {
                look_ns = now_ns + LOOK_NS;
                self.look(now_ns).map_err(told)?;
                if now_ns.saturating_sub(self.heard_ns) > limit.ns() {
                    let limit_s = limit.ms() as f64 / 1e3;
                    return Err(format!("nothing was heard of the desk for {limit_s} s"));
                }
                if now_ns >= sign_ns {
                    sign_ns = now_ns + SIGN_NS.min(limit.ns() / 4);
                    self.mouth.try_say(&ToDesk::Beat);
                    if let Peer::Stranger(what) = self.link.peer().map_err(told)? {
                        return Err(what);
                    }
                }
            }
            if busy {
                waiter.done();
                continue;
            }
            let on_wire = !self.is_at_work && self.way == Way::Datagram;
            awaited.set(on_wire, self.against_clock);
            let _ = waiter.pause_until(now_ns + BEAT_NS); // the limit is looked at above
        }
    }

    fn hear_wire(&mut self) -> Result<bool, LinkError> {
        let Some(packet) = self.wire.as_mut().and_then(Wire::receive) else {
            return Ok(false);
        };
        self.take(packet, Way::Datagram)?;
        Ok(true)
    }

    /// True if something came; nothing at the end of the channel.
    fn hear_channel(&mut self) -> Result<Option<bool>, LinkError> {
        let Some(heard) = self.ear.next() else {
            return Ok(Some(false));
        };
        self.heard_ns = monotonic_ns();
        match heard {
            Heard::Closed(_) => return Ok(None),
            Heard::Packet(bytes) => {
                if let Some(packet) = Packet::read(&bytes) {
                    self.take(packet, Way::Channel)?;
                }
            }
            Heard::Message(ToAgent::Control { content }) => self.control(&content)?,
            Heard::Message(ToAgent::Word { line }) => self.started.tell(&line),
            Heard::Message(_) | Heard::Part(_) => {}
        }
        Ok(Some(true))
    }

    /// Passes a control message of the plant on; the frames are open before the controller hears of them.
    fn control(&mut self, content: &str) -> Result<(), LinkError> {
        if let Ok(Control::Welcome(welcome)) = Control::from_bytes(content.as_bytes()) {
            let spec = FrameSpec {
                identity: welcome.frame_identity(),
                outgoing: welcome.sample.len(),
                incoming: welcome.command.len(),
            };
            self.link.open_frames(&spec)?;
            self.end = TargetEnd::new(welcome.against_clock);
            self.against_clock = welcome.against_clock;
            self.values = vec![0.0; spec.incoming];
            self.open = Some((spec.identity, spec.outgoing));
        }
        self.link.send_control(content.as_bytes())
    }

    fn take(&mut self, packet: Packet, way: Way) -> Result<(), LinkError> {
        self.heard_ns = monotonic_ns();
        self.way = way;
        let sample = packet
            .frame
            .as_ref()
            .filter(|frame| self.end.is_news(frame));
        if let Some(sample) = sample.filter(|frame| frame.header.kind() == Some(FrameKind::Sample))
        {
            self.sample_ns = self.heard_ns;
            if std::mem::take(&mut self.is_safe) {
                let step = sample.header.step;
                let what = format!("step {step}: samples come again");
                self.mouth.try_say(&ToDesk::Output { what });
            }
        }
        let Some(frame) = self.end.take(packet) else {
            self.answer();
            return Ok(());
        };
        let Some((identity, count)) = self.open else {
            return Ok(());
        };
        if identity.check(&frame.header, count).is_err() {
            return Ok(()); // the desk is authentic, so it is of another version
        }
        self.give(&frame)
    }

    fn give(&mut self, frame: &Numbered) -> Result<(), LinkError> {
        self.link.send(&frame.header, &frame.values)?;
        match frame.header.kind() {
            Some(FrameKind::Sample) => self.is_at_work = true,
            Some(FrameKind::End) => (self.is_at_work, self.sample_ns) = (true, 0),
            // Nothing answers a hold or an abort: the desk hears that it came.
            _ => {
                self.sample_ns = 0;
                self.answer();
            }
        }
        Ok(())
    }

    fn answer(&mut self) {
        self.end.packet(&mut self.bytes);
        match (&mut self.wire, self.way) {
            (Some(wire), Way::Datagram) => wire.send(&self.bytes),
            _ => self.mouth.packet(&self.bytes),
        }
    }

    fn hear_controller(&mut self) -> Result<bool, LinkError> {
        let mut came = false;
        if self.open.is_some()
            && let Some(header) = self.link.receive(&mut self.values)?
        {
            self.is_at_work = false;
            self.end.say(&header, &self.values);
            self.answer();
            came = true;
        }
        Ok(came)
    }

    /// Looks at what changes seldom.
    fn look(&mut self, now_ns: u64) -> Result<(), LinkError> {
        while let Some(content) = self.link.receive_control()? {
            let content = String::from_utf8_lossy(&content).into_owned();
            self.mouth.say(&ToDesk::Control { content });
        }
        if !self.has_reported
            && let Ok(report) = self.session.read_file::<serde_json::Value>(CONTROLLER_FILE)
        {
            self.has_reported = true;
            self.mouth.say(&ToDesk::Realtime {
                report: report.to_string(),
            });
        }
        self.look_for_samples(now_ns);
        if self.ended.is_none() {
            self.ended = self.started.status().map(|status| (status, now_ns));
        }
        let Some((status, since_ns)) = self.ended else {
            return Ok(());
        };
        // What it wrote and sent before it ended still counts.
        let is_silent = self.started.is_silent() || now_ns.saturating_sub(since_ns) > LAST_WORDS_NS;
        if !self.has_told_end && is_silent {
            while self.hear_controller()? {}
            let signal = status.signal();
            self.has_told_end = self.mouth.try_say(&ToDesk::Ended {
                code: status.code(),
                fate: signal.map(|signal| format!("was killed by signal {signal}")),
                said: self.end.said(),
            });
        }
        Ok(())
    }

    /// Announces the safe command once samples have been missing for long, by this machine's clock.
    fn look_for_samples(&mut self, now_ns: u64) {
        let Missed { period_s, periods } = self.missed;
        if !self.against_clock {
            return;
        }
        let limit_ns = (period_s * f64::from(periods) * 1e9) as u64;
        if self.sample_ns > 0 && !self.is_safe && now_ns.saturating_sub(self.sample_ns) > limit_ns {
            self.is_safe = true;
            let what = format!(
                "no sample for {periods} periods: outputs of the target should be the safe command; this agent drives none"
            );
            self.mouth.try_say(&ToDesk::Output { what });
        }
    }
}

fn told(error: LinkError) -> String {
    error.to_string()
}
