//! The bridge: takes the controller's place in a run's session at the desk, and repeats there what the controller on
//! the target says.
//!
//! To `hil` the bridge is the controller: it is started, addressed, logged and ended like one.

use std::collections::VecDeque;
use std::io::Write;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use hil_session::clock::monotonic_ns;
use hil_session::file::hash;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::live::ask;
use hil_session::program::{self, CONTROLLER_JOB, FAILED, PLANT_JOB};
use hil_session::session::SessionInfo;
use hil_session::supervision::{PEER_GONE, STOP, Supervision};
use hil_session::waiter::Waiter;
use serde_json::Value;
use shared_types::describe::Settings;
use shared_types::frame::FrameKind;
use shared_types::hello::Control;
use shared_types::link::{FrameSpec, Link, LinkError};
use shared_types::live::Request;
use shared_types::realtime::CONTROLLER_FILE;
use shared_types::record::LONGEST_MARK;
use shared_types::text;
use shared_types::wait::WaitLimit;

use crate::channel::Heard;
use crate::contact::Contact;
use crate::exchange::{BEAT_NS, DeskEnd};
use crate::machine::Findings;
use crate::message::{Missed, RunRequest, ToAgent, ToDesk, from_hex, prologue, to_hex};
use crate::packet::{Form, Packet};
use crate::path::DatagramPath;
use crate::route::{Answers, Carrier, DeskRoute, Notice};
use crate::seal::{Key, begin};
use crate::sleep::{Awaited, LateBell, waiter};
use crate::way::Way;

mod files;
mod life;

use files::{Job, PlantJob, SWITCHES_FILE};
pub use files::{ready_file, switches};
use life::{Action, Event, Exit, Life};

/// Share of the wait limit after which a silent target is given up, before the plant, which does not know the target,
/// gives up.
const SHARE: f64 = 0.9;
/// Sample periods without a sample after which the output of a target switches to the safe command.
pub(crate) const MISSED_PERIODS: u32 = 20;
/// Interval between signs of life through the channel, and between checks of rarely changing states.
const SIGN_NS: u64 = 250_000_000;
/// Time limit for a controller to stop.
const STOPPING_NS: u64 = 3_000_000_000;
/// Time limit for the last frames of a controller that has ended.
const PARTING_NS: u64 = 1_000_000_000;

/// Time limit for the plant to accept a note.
const MARKING: Duration = Duration::from_secs(2);

/// Runs the controller of a session on a target; returns the exit code of a controller.
///
/// # Errors
/// The reason why the controller could not be run, or was lost.
pub fn run(way: &Way, (file, blake3): (&Path, &str), folder: &Path) -> Result<u8, String> {
    let supervision = Supervision::from_stdin();
    let session = SessionInfo::read(folder).map_err(described)?;
    let job: Value = session.read_file(CONTROLLER_JOB).map_err(described)?;
    let known: Job = serde_json::from_value(job.clone()).map_err(described)?;
    let job = job.to_string();
    // The controller's job has the plant's limit and a step of a paced run; where there is no plant's, as in a
    // replay, its own is that.
    let plant: Result<PlantJob, _> = session.read_file(PLANT_JOB);
    let limit_s = (plant.as_ref()).map_or(known.wait_limit_s, |plant| plant.wait_limit_s);
    let safe = plant.map_or_else(|_| Settings::default(), |plant| plant.plant.safe_command);
    let limit = WaitLimit::from_seconds(SHARE * limit_s);

    let bell = LateBell::default();
    let rung = bell.clone();
    let ring = move || rung.ring();
    let is_interrupted = || supervision.wants_stop() || supervision.is_peer_gone();
    let actual = hash(file).map_err(|error| format!("cannot read {}: {error}", file.display()))?;
    if actual != blake3 {
        let file = file.display();
        return Err(format!(
            "{file} was changed after the check, so it is not run; start again"
        ));
    }
    let way = &way.clone().with_silence(limit_s);
    let contact = Contact::open(way, ring, &is_interrupted).map_err(described)?;
    contact
        .provide(file, blake3, &is_interrupted)
        .map_err(described)?;
    let key = Key::random().map_err(described)?;
    let (begun, first) = begin(&key, &prologue(blake3, &job, known.epoch)).map_err(described)?;
    // Only the plant knows whether it waits; the rule is for those that do not, and harmless for others.
    let missed = Missed {
        period_s: known.rate.period_s(),
        periods: MISSED_PERIODS,
    };
    let boot_id = Findings::own().boot_id;
    contact.mouth.say(&ToAgent::Run(Box::new(RunRequest {
        job,
        epoch: known.epoch,
        limit_s: limit_s.is_finite().then_some(limit_s),
        key: key.to_hex(),
        handshake: to_hex(&first),
        missed,
        safe,
        boot_id: boot_id.clone(),
    })));
    let running = contact
        .wait_to_run(&is_interrupted, log)
        .map_err(described)?;
    let handshake = from_hex(&running.handshake).unwrap_or_default();
    let seal = begun
        .end(&handshake)
        .map_err(|e| format!("target {}: {e}", way.target))?;
    let address: Option<SocketAddr> = running.address.and_then(|address| address.parse().ok());
    let path = address.and_then(|address| DatagramPath::desk(address, seal).ok());
    let result = session.write_file(&ready_file(known.epoch), &way.target.to_string());
    result.map_err(described)?;
    let link = program::attach(&session, known.epoch, limit, &supervision)?;
    bell.is(link.bell());
    supervision.ring_at_news(link.bell());
    let both_here = contact.findings().boot_id == boot_id;
    let sleeper = waiter(both_here, link.bell(), path.as_ref());
    Bridge {
        contact,
        link,
        switches_before: switches(&session).unwrap_or(0),
        session,
        route: DeskRoute::new(path.is_some()),
        path,
        address,
        desk: DeskEnd::new(false, BEAT_NS),
        beat_ns: BEAT_NS.min(limit.ns() / 4),
        form: None,
        values: Vec::new(),
        bytes: Vec::new(),
        sampled: None,
        tuning: 0,
        heard_ns: monotonic_ns(),
        unsent: VecDeque::new(),
        answers: Answers::default(),
        life: Life::Running,
        has_reported_loss: false,
    }
    .drive(sleeper, limit, &supervision)
}

struct Bridge {
    contact: Contact,
    link: IceoryxLink,
    session: SessionInfo,
    path: Option<DatagramPath>,
    address: Option<SocketAddr>,
    route: DeskRoute,
    answers: Answers,
    desk: DeskEnd,
    form: Option<Form>,
    /// Values of a sample.
    values: Vec<f64>,
    bytes: Vec<u8>,
    /// Step of the last sample.
    sampled: Option<u64>,
    /// Control messages for which the channel has no room yet.
    unsent: VecDeque<ToAgent>,
    /// Number of the plant's parameter messages that were passed on.
    tuning: u64,
    /// Time at which anything last arrived from the target.
    heard_ns: u64,
    beat_ns: u64,
    life: Life,
    /// `true` once the controller was told that the plant is lost.
    has_reported_loss: bool,
    /// Switches of outputs to the safe command under earlier controllers.
    switches_before: u32,
}

impl Bridge {
    fn drive(
        mut self,
        sleeper: (Waiter, Awaited),
        limit: WaitLimit,
        supervision: &Supervision,
    ) -> Result<u8, String> {
        let code = self.serve(sleeper, limit, supervision);
        program::say(&self.of_target(&self.answers.to_string()));
        code
    }

    fn serve(
        &mut self,
        (mut waiter, awaited): (Waiter, Awaited),
        limit: WaitLimit,
        supervision: &Supervision,
    ) -> Result<u8, String> {
        let mut sign_ns = 0;
        loop {
            self.pass_on(supervision);
            let mut busy = self.hear_plant().map_err(described)?;
            busy |= self.hear_path().map_err(described)?;
            busy |= self.hear_channel()?;
            let now_ns = monotonic_ns();
            self.speak(now_ns);
            let passed = Event::Passed {
                now_ns,
                is_silent: now_ns.saturating_sub(self.heard_ns) > limit.ns(),
                delivered: self.form.map(|_| self.desk.received()),
            };
            match self.note(passed) {
                Action::Finish(exit) => return self.finish(exit),
                Action::GiveUpStop => {
                    return Err(self.of_target("it was asked to stop but did not respond"));
                }
                Action::GiveUpSilent => {
                    let limit_s = limit.ms() as f64 / 1e3;
                    let place = self.place();
                    let reason = format!("nothing received since {place} for {limit_s} s");
                    return Err(self.of_target(&reason));
                }
                Action::Nothing | Action::SendStop => {}
            }
            if busy {
                waiter.done();
                continue;
            }
            if now_ns >= sign_ns {
                sign_ns = now_ns + SIGN_NS;
                self.contact.mouth.try_say(&ToAgent::Beat);
                if let Some(notice) = self.route.look(now_ns) {
                    self.tell(notice);
                }
            }
            let is_on_wire = !self.route.carriers().channel;
            let against_clock = self.form.is_some_and(|form| form.against_clock);
            awaited.set(self.desk.awaits_answer() && is_on_wire, against_clock);
            let _ = waiter.pause_until(self.desk.due_ns().min(sign_ns)); // the limit is looked at above
        }
    }

    /// Returns the position of the run for a message; only samples advance it.
    fn place(&self) -> String {
        self.sampled
            .map_or_else(|| "the start".into(), |step| format!("step {step}"))
    }

    /// Sends the control messages of the plant, as far as the channel has room.
    fn send_control(&mut self) {
        while let Some(message) = self.unsent.front()
            && self.contact.mouth.try_say(message)
        {
            self.unsent.pop_front();
        }
    }

    /// Records an event in the life of the controller; returns its consequence.
    fn note(&mut self, event: Event) -> Action {
        let (life, action) = std::mem::replace(&mut self.life, Life::Running).after(event);
        self.life = life;
        action
    }

    /// Sends a line for the controller's standard input; returns `false` if the channel has no room.
    fn send_word(&self, line: &str) -> bool {
        let line = line.into();
        self.contact.mouth.try_say(&ToAgent::Word { line })
    }

    /// Passes on requests from `hil`.
    fn pass_on(&mut self, supervision: &Supervision) {
        self.send_control();
        if supervision.wants_stop() {
            let now_ns = monotonic_ns();
            let action = self.note(Event::StopWanted { now_ns });
            if action == Action::SendStop && self.send_word(STOP) {
                self.note(Event::StopSent);
            }
        }
        if !self.has_reported_loss && supervision.is_peer_gone() {
            self.has_reported_loss = self.send_word(PEER_GONE);
        }
    }

    fn hear_plant(&mut self) -> Result<bool, LinkError> {
        let mut came = false;
        // Once samples flow, the plant has nothing more to say there.
        if self.sampled.is_none() {
            while let Some(content) = self.link.receive_control()? {
                came = true;
                self.control(&content)?;
            }
        }
        if self.form.is_some()
            && let Some(header) = self.link.receive(&mut self.values)?
        {
            came = true;
            if header.kind() == Some(FrameKind::Sample) {
                self.sampled = Some(header.step);
                self.route.sent_sample(monotonic_ns());
            }
            // What the plant said of parameters before the sample goes ahead of it.
            if header.tuning > self.tuning {
                while let Some(content) = self.link.receive_control()? {
                    self.control(&content)?;
                }
                self.tuning = header.tuning;
            }
            self.desk.say(&header, &self.values);
        }
        Ok(came)
    }

    /// Passes on a control message, and opens the frames that it agrees on.
    fn control(&mut self, content: &[u8]) -> Result<(), LinkError> {
        if let Ok(Control::Welcome(welcome)) = Control::from_bytes(content) {
            let spec = FrameSpec {
                identity: welcome.frame_identity(),
                outgoing: welcome.command.len(),
                incoming: welcome.sample.len(),
            };
            self.link.open_frames(&spec)?;
            self.values = vec![0.0; spec.incoming];
            self.desk = DeskEnd::new(welcome.against_clock, self.beat_ns);
            self.form = Some(Form {
                identity: spec.identity,
                count: spec.outgoing,
                against_clock: welcome.against_clock,
            });
        }
        let content = String::from_utf8_lossy(content).into_owned();
        self.unsent.push_back(ToAgent::Control { content }); // few, and most of them before the first step
        self.send_control();
        Ok(())
    }

    fn hear_path(&mut self) -> Result<bool, LinkError> {
        let Some(packet) = self.path.as_mut().and_then(DatagramPath::receive) else {
            return Ok(false);
        };
        let has_frame = packet.frame.is_some();
        if let Some(notice) = self.route.received_datagram(has_frame, monotonic_ns()) {
            self.tell(notice);
        }
        self.take(packet, Carrier::Datagram)?;
        Ok(true)
    }

    fn take(&mut self, packet: Packet, carrier: Carrier) -> Result<(), LinkError> {
        let now_ns = monotonic_ns();
        self.heard_ns = now_ns;
        let Some(form) = self.form else {
            return Ok(());
        };
        match self.desk.take(packet, now_ns) {
            Some(frame) if form.fits(&frame) => {
                self.answers.note(carrier);
                self.link.send(&frame.header, &frame.values)
            }
            _ => Ok(()),
        }
    }

    fn hear_channel(&mut self) -> Result<bool, String> {
        let Some(incoming) = self.contact.ear.next() else {
            return Ok(false);
        };
        self.heard_ns = monotonic_ns();
        match incoming {
            Heard::Packet(bytes) => {
                if let Some(packet) = Packet::read(&bytes) {
                    self.take(packet, Carrier::Channel).map_err(described)?;
                }
            }
            Heard::Message(message) => self.hear(message)?,
            Heard::Part(_) => {}
            // After the end of the controller nothing more is to come.
            Heard::Closed(_) if matches!(self.life, Life::Ended { .. }) => {}
            Heard::Closed(why) => {
                log(&self.contact.leash.said());
                let lost = self.contact.lost(&why);
                return Err(format!("{lost}, at {}", self.place()));
            }
        }
        Ok(true)
    }

    fn hear(&mut self, message: ToDesk) -> Result<(), String> {
        match message {
            ToDesk::Control { content } => self
                .link
                .send_control(content.as_bytes())
                .map_err(described)?,
            ToDesk::Log { text } => log(&text),
            ToDesk::Realtime { report } => {
                if let Ok(report) = serde_json::from_str::<Value>(&report) {
                    self.session
                        .write_file(CONTROLLER_FILE, &report)
                        .map_err(described)?;
                }
            }
            ToDesk::Output {
                what,
                switches,
                is_back,
            } => self.output(&what, switches, is_back)?,
            ToDesk::Ended { code, fate, said } => {
                let (now_ns, exit) = (monotonic_ns(), Exit { code, fate, said });
                self.note(Event::Exited { now_ns, exit });
            }
            ToDesk::Refused { reason, .. } => {
                return Err(self.of_target(&reason));
            }
            _ => {}
        }
        Ok(())
    }

    /// Records a switch of the target's output; once the switch is over, also as a note at the plant's current step.
    fn output(&self, what: &str, switches: u32, is_back: bool) -> Result<(), String> {
        let text = self.of_target(what);
        program::say(&text);
        let all = self.switches_before.saturating_add(switches);
        let written = self.session.write_file(SWITCHES_FILE, &all);
        written.map_err(described)?;
        if is_back {
            let session = self.session.clone();
            let text = text.chars().take(LONGEST_MARK).collect();
            // Beside the loop; a plant that has ended takes no more notes.
            std::thread::spawn(move || ask(&session, &Request::Mark { text }, MARKING));
        }
        Ok(())
    }

    /// Sends the packet that is due.
    fn speak(&mut self, now_ns: u64) {
        if now_ns < self.desk.due_ns() {
            return;
        }
        self.desk.packet(now_ns, &mut self.bytes);
        let carriers = self.route.carriers();
        if carriers.datagram
            && let Some(path) = &mut self.path
        {
            path.send(&self.bytes);
        }
        if carriers.channel {
            self.contact.mouth.packet(&self.bytes);
        }
    }

    fn tell(&self, notice: Notice) {
        let to = self
            .address
            .map_or_else(String::new, |address| format!(" to {address}"));
        let text = match notice {
            Notice::Lost => {
                format!("no datagrams get through{to}, so the frames use the slower connection")
            }
            Notice::Restored => format!("datagrams get through{to} again"),
        };
        program::say(&self.of_target(&text));
    }

    /// Returns the controller's exit code, or its fate.
    fn finish(&self, exit: Exit) -> Result<u8, String> {
        if let Some(fate) = exit.fate {
            let place = self.place();
            return Err(self.of_target(&format!("the controller {fate} at {place}")));
        }
        let code = exit.code.and_then(|code| u8::try_from(code).ok());
        Ok(code.unwrap_or(FAILED))
    }

    /// Writes a sentence about the target.
    fn of_target(&self, text: &str) -> String {
        format!("target {}: {text}", self.contact.way.target)
    }
}

/// Writes the controller's output. A failing log must not end the run.
fn log(text: &str) {
    let _ = std::io::stderr().write_all(text::printable(text).as_bytes());
}

fn described(error: impl std::fmt::Display) -> String {
    error.to_string()
}
