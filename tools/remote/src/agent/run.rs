//! A run of one controller on a target: what the desk says goes to its program, and what that says to the desk.

use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::SessionInfo;
use shared_types::describe::Settings;
use shared_types::frame::{FrameIdentity, FrameKind};
use shared_types::hello::Control;
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::realtime::CONTROLLER_FILE;
use shared_types::wait::WaitLimit;

use super::output::Output;
use super::started::Started;
use crate::channel::{Ear, Heard, Mouth};
use crate::exchange::{BEAT_NS, TargetEnd};
use crate::machine::Findings;
use crate::message::{Missed, RunRequest, ToAgent, ToDesk};
use crate::packet::{Numbered, Packet};
use crate::path::DatagramPath;
use crate::route::{Carrier, Carriers, TargetRoute};
use crate::sleep::waiter;

/// Time between two looks at what changes seldom.
const LOOK_NS: u64 = 5_000_000;
/// Time that what a program wrote before its end may take.
const LAST_WORDS_NS: u64 = 100_000_000;
/// Time between two signs of life through the channel.
const SIGN_NS: u64 = 250_000_000;

/// The newest sample that came.
#[derive(Clone, Copy)]
struct Sampled {
    step: u64,
    at_ns: u64,
}

/// Output that is the safe command because samples are missing.
#[derive(Clone, Copy)]
struct Missing {
    since_ns: u64,
    /// Step of the last sample before.
    after: u64,
    /// Step of the first sample since then.
    back: Option<u64>,
}

/// A run of one controller.
pub(super) struct Run<'a> {
    ear: &'a Ear<ToAgent>,
    mouth: &'a Mouth,
    link: IceoryxLink,
    started: Started,
    path: Option<DatagramPath>,
    session: SessionInfo,
    missed: Missed,
    /// Both ends are on this machine.
    both_here: bool,
    /// The plant waits for nobody.
    against_clock: bool,
    /// Identity that the frames must carry, and the number of values from the desk.
    open: Option<(FrameIdentity, usize)>,
    end: TargetEnd,
    route: TargetRoute,
    /// Number of the plant's messages about parameters that were given to the controller.
    tuning: u64,
    /// Packet with a sample that such a message comes before.
    waiting: Option<(Packet, Carrier)>,
    /// A frame was given to the controller, and it has not answered.
    is_at_work: bool,
    heard_ns: u64,
    /// The last sample, while another must follow: not before the first, while the run is held and after its end.
    sampled: Option<Sampled>,
    /// The output, once its signals are known; in real time alone.
    output: Option<Output>,
    safe: Settings,
    /// Samples are missing, and the output is the safe command for that.
    missing: Option<Missing>,
    switches: u32,
    has_reported: bool,
    /// Control message for which the channel had no room.
    unsaid: Option<ToDesk>,
    has_told_end: bool,
    /// Exit status of the program, and the time at which it was seen.
    ended: Option<(ExitStatus, u64)>,
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
            missed: request.missed,
            both_here: Findings::own().boot_id == request.boot_id,
            against_clock: false,
            open: None,
            end: TargetEnd::new(false),
            route: TargetRoute::new(),
            tuning: 0,
            waiting: None,
            is_at_work: false,
            heard_ns: monotonic_ns(),
            sampled: None,
            output: None,
            safe: request.safe.clone(),
            missing: None,
            switches: 0,
            has_reported: false,
            unsaid: None,
            has_told_end: false,
            ended: None,
            bytes: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Serves until the channel closes or the desk is silent for the limit.
    pub(super) fn serve(&mut self, limit: WaitLimit) -> Result<(), String> {
        let (mut waiter, awaited) = waiter(self.both_here, self.link.bell(), self.path.as_ref());
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
                    return Err(format!("nothing was heard of the desk for {limit_s} s"));
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
            awaited.set(on_wire, self.against_clock);
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

    /// True if something came; nothing at the end of the channel.
    fn hear_channel(&mut self) -> Result<Option<bool>, String> {
        let Some(heard) = self.ear.next() else {
            return Ok(Some(false));
        };
        self.heard_ns = monotonic_ns();
        match heard {
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

    /// Passes a control message of the plant on; the frames are open before the controller hears of them.
    fn control(&mut self, content: &str) -> Result<(), String> {
        let said = Control::from_bytes(content.as_bytes());
        if let Ok(Control::Welcome(welcome)) = &said {
            let spec = FrameSpec {
                identity: welcome.frame_identity(),
                outgoing: welcome.sample.len(),
                incoming: welcome.command.len(),
            };
            self.link.open_frames(&spec).map_err(described)?;
            self.end = TargetEnd::new(welcome.against_clock);
            self.against_clock = welcome.against_clock;
            if welcome.against_clock {
                self.output = Some(Output::create(&self.session, welcome, &self.safe)?);
            }
            self.values = vec![0.0; spec.incoming];
            self.open = Some((spec.identity, spec.outgoing));
        }
        self.link
            .send_control(content.as_bytes())
            .map_err(described)?;
        if let Ok(Control::Tuned(tuned)) = said {
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
        if self.against_clock {
            self.hear_controller()?;
        }
        let sample = packet
            .frame
            .as_ref()
            .filter(|frame| self.end.is_news(frame));
        let sample = sample.filter(|frame| frame.header.kind() == Some(FrameKind::Sample));
        if let Some(sample) = sample {
            self.sampled = Some(Sampled {
                step: sample.header.step,
                at_ns: self.heard_ns,
            });
            if let Some(missing) = &mut self.missing {
                missing.back.get_or_insert(sample.header.step);
            }
        }
        let Some(frame) = self.end.take(packet) else {
            let has_frame = self.end.has_unheard();
            self.send(self.route.of_reply(carrier, has_frame, self.heard_ns));
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
            Some(FrameKind::End) => {
                (self.is_at_work, self.sampled) = (true, None);
                self.end_output();
            }
            // Nothing answers a hold or an abort: the desk hears that it came.
            kind => {
                self.sampled = None;
                if kind == Some(FrameKind::Abort) {
                    self.end_output();
                }
                self.answer();
            }
        }
        Ok(())
    }

    fn answer(&mut self) {
        let carriers = self.route.of_answer(self.end.heard(), monotonic_ns());
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
        if self.open.is_some()
            && let Some(header) = self.link.receive(&mut self.values)?
        {
            self.is_at_work = false;
            if header.kind() == Some(FrameKind::Command) {
                self.put(header.step);
            }
            self.end.say(&header, &self.values);
            self.answer();
            came = true;
        }
        Ok(came)
    }

    /// Passes on what the controller says; what finds no room waits, since the loop must go on.
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

    /// Looks at what changes seldom.
    fn look(&mut self, now_ns: u64) -> Result<(), LinkError> {
        self.hear_control()?;
        if !self.has_reported
            && let Ok(report) = self.session.read_file::<serde_json::Value>(CONTROLLER_FILE)
        {
            self.has_reported = self.mouth.try_say(&ToDesk::Realtime {
                report: report.to_string(),
            });
        }
        self.look_for_samples(now_ns);
        if self.ended.is_none() {
            self.ended = self.started.status().map(|status| (status, now_ns));
            if self.ended.is_some() {
                self.end_output();
            }
        }
        let Some((status, since_ns)) = self.ended else {
            return Ok(());
        };
        // What it wrote and sent before it ended still counts.
        let is_silent = self.started.is_silent() || now_ns.saturating_sub(since_ns) > LAST_WORDS_NS;
        if !self.has_told_end && is_silent && self.unsaid.is_none() {
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

    /// Leaves the output at the safe command: an answer that was under way must not replace it.
    fn end_output(&mut self) {
        self.output = None;
    }

    /// Puts the newest command out, unless it answers a sample from before samples went missing.
    fn put(&mut self, step: u64) {
        let Some(output) = &mut self.output else {
            return;
        };
        let is_stale = |missing: Missing| missing.back.is_none_or(|first| step < first);
        if self.missing.is_some_and(is_stale) || !output.put(step, &self.values) {
            return;
        }
        if let Some(Missing {
            since_ns, after, ..
        }) = self.missing.take()
        {
            let for_s = monotonic_ns().saturating_sub(since_ns) as f64 / 1e9;
            let what = format!(
                "no sample after step {after} for {} periods: its output was the safe command for {for_s:.3} s, and is the controller's again from step {step}",
                self.missed.periods
            );
            self.tell_output(what, true);
        }
    }

    fn tell_output(&self, what: String, is_back: bool) {
        self.mouth.try_say(&ToDesk::Output {
            what,
            switches: self.switches,
            is_back,
        });
    }

    /// Switches the output to the safe command once samples have been missing for long, by this machine's clock.
    fn look_for_samples(&mut self, now_ns: u64) {
        let Missed { period_s, periods } = self.missed;
        let Some(output) = &mut self.output else {
            return;
        };
        let Some(Sampled { step, at_ns }) = self.sampled else {
            return;
        };
        let limit_ns = (period_s * f64::from(periods) * 1e9) as u64;
        let is_late = now_ns.saturating_sub(at_ns) > limit_ns;
        if is_late && self.missing.is_none() {
            output.switch();
            let what = format!(
                "no sample after step {step} for {periods} periods: its output is the safe command"
            );
            self.missing = Some(Missing {
                since_ns: now_ns,
                after: step,
                back: None,
            });
            self.switches += 1;
            self.tell_output(what, false);
        }
    }
}

fn described(error: LinkError) -> String {
    error.to_string()
}
