//! A run of one controller on a target: passes messages from the desk to its program, and from the program to the desk.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::SessionInfo;
use shared_types::describe::Settings;
use shared_types::frame::FrameKind;
use shared_types::hello::Control;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::realtime::CONTROLLER_FILE;
use shared_types::wait::WaitLimit;

use super::guard::{Event, Guard, Sample};
use super::output::Output;
use super::started::Started;
use crate::channel::{Ear, Heard, Mouth};
use crate::exchange::{BEAT_NS, TargetEnd};
use crate::message::{RunRequest, ToAgent, ToDesk};
use crate::packet::{Form, Numbered, Packet};
use crate::path::DatagramPath;
use crate::route::{Carrier, Carriers, TargetRoute};
use crate::sleep::waiter;

/// Interval between checks of rarely changing states.
const LOOK_NS: u64 = 5_000_000;
/// Time limit for output that a program wrote before its end.
const LAST_WORDS_NS: u64 = 100_000_000;
/// Interval between signs of life through the channel.
const SIGN_NS: u64 = 250_000_000;

/// The controller's program, as known to the desk.
#[derive(Clone, Copy)]
enum Program {
    Running,
    /// Ended; reported to the desk once all output has been passed on.
    Ended {
        status: ExitStatus,
        since_ns: u64,
    },
    /// End reported to the desk.
    Reported,
}

/// A run of one controller.
pub(super) struct Run<'a> {
    ear: &'a Ear<ToAgent>,
    mouth: &'a Mouth,
    link: IceoryxLink,
    started: Started,
    path: Option<DatagramPath>,
    session: SessionInfo,
    form: Option<Form>,
    end: TargetEnd,
    route: TargetRoute,
    /// Number of the plant's parameter messages that were passed to the controller.
    tuning: u64,
    /// Packet with a sample that such a message must precede.
    waiting: Option<(Packet, Carrier)>,
    /// `true` while the controller has a frame that it has not answered.
    is_at_work: bool,
    heard_ns: u64,
    output: Guard,
    safe: Settings,
    has_reported: bool,
    /// Control message for which the channel had no room.
    unsaid: Option<ToDesk>,
    program: Program,
    bytes: Vec<u8>,
    values: Vec<f64>,
}

impl<'a> Run<'a> {
    pub(super) fn new(
        (ear, mouth): (&'a Ear<ToAgent>, &'a Mouth),
        link: IceoryxLink,
        started: Started,
        path: Option<DatagramPath>,
        session: &SessionInfo,
        request: &RunRequest,
    ) -> Self {
        Self {
            ear,
            mouth,
            link,
            started,
            path,
            session: session.clone(),
            form: None,
            end: TargetEnd::new(false),
            route: TargetRoute::new(),
            tuning: 0,
            waiting: None,
            is_at_work: false,
            heard_ns: monotonic_ns(),
            output: Guard::new(request.missed),
            safe: request.safe.clone(),
            has_reported: false,
            unsaid: None,
            program: Program::Running,
            bytes: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Serves until the channel closes or the desk is silent for the limit; `both_here` if both ends are on this
    /// machine.
    pub(super) fn serve(&mut self, limit: WaitLimit, both_here: bool) -> Result<(), String> {
        let (mut waiter, awaited) = waiter(both_here, self.link.bell(), self.path.as_ref());
        let (mut look_ns, mut sign_ns) = (0, 0);
        loop {
            let mut busy = self.hear_path().map_err(described)?;
            match self.hear_channel()? {
                Some(came) => busy |= came,
                None => return Ok(()),
            }
            busy |= self.hear_controller().map_err(described)?;
            let now_ns = monotonic_ns();
            if now_ns >= look_ns {
                look_ns = now_ns + LOOK_NS;
                self.look(now_ns).map_err(described)?;
                if now_ns.saturating_sub(self.heard_ns) > limit.ns() {
                    let limit_s = limit.ms() as f64 / 1e3;
                    return Err(format!("received nothing from the desk for {limit_s} s"));
                }
                if now_ns >= sign_ns {
                    sign_ns = now_ns + SIGN_NS.min(limit.ns() / 4);
                    self.mouth.try_say(&ToDesk::Beat);
                    if let Peer::Stranger(what) = self.link.peer().map_err(described)? {
                        return Err(what);
                    }
                }
            }
            if busy {
                waiter.done();
                continue;
            }
            let on_wire = !self.is_at_work && self.route.hears_datagrams(now_ns);
            awaited.set(on_wire, self.is_against_clock());
            let _ = waiter.pause_until(now_ns + BEAT_NS); // the limit is looked at above
        }
    }

    fn hear_path(&mut self) -> Result<bool, LinkError> {
        let Some(packet) = self.path.as_mut().and_then(DatagramPath::receive) else {
            return Ok(false);
        };
        self.take(packet, Carrier::Datagram)?;
        Ok(true)
    }

    /// Returns `true` if a message arrived; `None` at the end of the channel.
    fn hear_channel(&mut self) -> Result<Option<bool>, String> {
        let Some(incoming) = self.ear.next() else {
            return Ok(Some(false));
        };
        self.heard_ns = monotonic_ns();
        match incoming {
            Heard::Closed(_) => return Ok(None),
            Heard::Packet(bytes) => {
                if let Some(packet) = Packet::read(&bytes) {
                    self.take(packet, Carrier::Channel).map_err(described)?;
                }
            }
            Heard::Message(ToAgent::Control { content }) => self.control(&content)?,
            Heard::Message(ToAgent::Word { line }) => self.started.tell(&line),
            Heard::Message(_) | Heard::Part(_) => {}
        }
        Ok(Some(true))
    }

    /// Passes on a control message of the plant; the frames are opened before the controller receives the message.
    fn control(&mut self, content: &str) -> Result<(), String> {
        let control = Control::from_bytes(content.as_bytes());
        if let Ok(Control::Welcome(welcome)) = &control {
            let spec = FrameSpec {
                identity: welcome.frame_identity(),
                outgoing: welcome.sample.len(),
                incoming: welcome.command.len(),
            };
            self.link.open_frames(&spec).map_err(described)?;
            self.end = TargetEnd::new(welcome.against_clock);
            if welcome.against_clock {
                let output = Output::create(&self.session, welcome, &self.safe)?;
                self.output.open(output);
            }
            self.values = vec![0.0; spec.incoming];
            self.form = Some(Form {
                identity: spec.identity,
                count: spec.outgoing,
                against_clock: welcome.against_clock,
            });
        }
        self.link
            .send_control(content.as_bytes())
            .map_err(described)?;
        if let Ok(Control::Tuned(tuned)) = control {
            self.tuning = self.tuning.max(tuned.number);
            if let Some((packet, carrier)) = self.waiting.take() {
                return self.take(packet, carrier).map_err(described);
            }
        }
        Ok(())
    }

    fn take(&mut self, packet: Packet, carrier: Carrier) -> Result<(), LinkError> {
        self.heard_ns = monotonic_ns();
        let number = packet.frame.as_ref().map(|frame| frame.number);
        self.route.received(carrier, number, self.heard_ns);
        // Datagrams and the channel have no common order: the sample waits for what was said before it.
        let is_early = |frame: &Numbered| {
            frame.header.kind() == Some(FrameKind::Sample) && frame.header.tuning > self.tuning
        };
        if packet.frame.as_ref().is_some_and(is_early) {
            self.waiting = Some((packet, carrier));
            return Ok(());
        }
        // What is given to the controller depends on what it has answered by now.
        if self.is_against_clock() {
            self.hear_controller()?;
        }
        let frame = packet.frame.as_ref();
        let newest = frame.filter(|frame| self.end.is_news(frame));
        if let Some(Numbered { header, .. }) = newest
            && header.kind() == Some(FrameKind::Sample)
        {
            let (step, at_ns) = (header.step, self.heard_ns);
            self.note(Event::Sampled(Sample { step, at_ns }));
        }
        let Some(frame) = self.end.take(packet) else {
            let has_frame = self.end.has_unheard();
            self.send(self.route.of_reply(carrier, has_frame, self.heard_ns));
            return Ok(());
        };
        match &self.form {
            Some(form) if form.fits(&frame) => self.give(&frame),
            _ => Ok(()),
        }
    }

    /// Returns `true` if the plant does not wait for commands.
    fn is_against_clock(&self) -> bool {
        self.form.is_some_and(|form| form.against_clock)
    }

    fn give(&mut self, frame: &Numbered) -> Result<(), LinkError> {
        self.link.send(&frame.header, &frame.values)?;
        match frame.header.kind() {
            Some(FrameKind::Sample) => self.is_at_work = true,
            Some(FrameKind::End) => {
                self.is_at_work = true;
                self.note(Event::Ended);
            }
            // Nothing answers a hold or an abort: the desk hears that it came.
            kind => {
                let is_abort = kind == Some(FrameKind::Abort);
                self.note(if is_abort { Event::Ended } else { Event::Held });
                self.answer();
            }
        }
        Ok(())
    }

    fn answer(&mut self) {
        let carriers = self.route.of_answer(self.end.received(), monotonic_ns());
        self.send(carriers);
    }

    fn send(&mut self, carriers: Carriers) {
        self.end.packet(&mut self.bytes);
        if carriers.datagram
            && let Some(path) = &mut self.path
        {
            path.send(&self.bytes);
        }
        if carriers.channel {
            self.mouth.packet(&self.bytes);
        }
    }

    fn hear_controller(&mut self) -> Result<bool, LinkError> {
        let mut came = false;
        if self.form.is_some()
            && let Some(header) = self.link.receive(&mut self.values)?
        {
            self.is_at_work = false;
            if header.kind() == Some(FrameKind::Command) {
                let report = self.output.answer(header.step, &self.values);
                self.report(report);
            }
            self.end.say(&header, &self.values);
            self.answer();
            came = true;
        }
        Ok(came)
    }

    /// Passes on messages of the controller; a message for which there is no room waits, because the loop must go on.
    fn hear_control(&mut self) -> Result<(), LinkError> {
        loop {
            if self.unsaid.is_none() {
                let content = self.link.receive_control()?;
                self.unsaid = content.map(|content| ToDesk::Control {
                    content: String::from_utf8_lossy(&content).into_owned(),
                });
            }
            let Some(message) = &self.unsaid else {
                return Ok(());
            };
            if !self.mouth.try_say(message) {
                return Ok(());
            }
            self.unsaid = None;
        }
    }

    /// Checks rarely changing states.
    fn look(&mut self, now_ns: u64) -> Result<(), LinkError> {
        self.hear_control()?;
        if !self.has_reported
            && let Ok(report) = self.session.read_file::<serde_json::Value>(CONTROLLER_FILE)
        {
            self.has_reported = self.mouth.try_say(&ToDesk::Realtime {
                report: report.to_string(),
            });
        }
        self.note(Event::Passed { now_ns });
        if let Program::Running = self.program
            && let Some(status) = self.started.status()
        {
            let since_ns = now_ns;
            self.program = Program::Ended { status, since_ns };
            // An answer that was under way must not replace the safe command.
            self.note(Event::Ended);
        }
        let Program::Ended { status, since_ns } = self.program else {
            return Ok(());
        };
        // What it wrote and sent before it ended still counts.
        let is_silent = self.started.is_silent() || now_ns.saturating_sub(since_ns) > LAST_WORDS_NS;
        if is_silent && self.unsaid.is_none() {
            while self.hear_controller()? {}
            let signal = status.signal();
            let is_sent = self.mouth.try_say(&ToDesk::Ended {
                code: status.code(),
                fate: signal.map(|signal| format!("was killed by signal {signal}")),
                said: self.end.said(),
            });
            if is_sent {
                self.program = Program::Reported;
            }
        }
        Ok(())
    }

    /// Passes an event to the output, and the resulting report to the desk.
    fn note(&mut self, event: Event) {
        let report = self.output.note(event);
        self.report(report);
    }

    fn report(&self, report: Option<ToDesk>) {
        report.map(|report| self.mouth.try_say(&report));
    }
}

fn described(error: LinkError) -> String {
    error.to_string()
}
