//! The plant's side of a replay: speaks the protocol of a run over the link, with recorded samples.
//!
//! Like the plant's engine, the host never blocks on the controller: [`Host::poll`] does as much as possible and
//! returns the event to wait for. The controller cannot distinguish the host from a plant.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hil_session::clock::monotonic_ns;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use plant_process::tuning::{Offered, Tuning};
use shared_types::describe::Settings;
use shared_types::frame::{FrameKind, Header};
use shared_types::hello::{Control, Offer, Welcome};
use shared_types::link::{FrameSpec, Link, LinkError};
use shared_types::lockstep::{Abort, AbortCode, PlantAction, PlantEvent, PlantSide, Standing};
use shared_types::time::Step;

use super::comparison::Comparison;
use super::original::Original;
use super::tape::{Batch, Batches};
use crate::arguments::tolerance::Tolerances;

/// Event that the host waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// No event: the host made progress and should be polled again; a new wait begins.
    Busy,
    /// Next message or frame of the controller.
    Controller,
    /// No event: the replay is over.
    Over,
}

/// End of a replay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum ReplayEnd {
    /// The controller confirmed the last step of the run.
    Completed,
    /// The recording ended before the last step of the run.
    Short,
    /// The controller does not fit the run.
    Refused(String),
    /// The replay was aborted.
    Aborted(Abort),
}

/// Result of a replay.
pub(super) struct Replayed {
    pub(super) end: ReplayEnd,
    /// `None` if no controller was accepted.
    pub(super) comparison: Option<Comparison>,
    /// Time from the first sample to the end, in s.
    pub(super) wall_time_s: f64,
}

/// Replay in progress.
pub(super) struct Host<L> {
    link: L,
    side: PlantSide,
    session: u64,
    original: Arc<Original>,
    tolerances: Tolerances,
    batches: Batches,
    batch: Option<Batch>,
    /// Index of the current row in the batch.
    index: usize,
    /// Latest values from the controller; `answer` holds the latest accepted answer.
    received: Vec<f64>,
    answer: (Header, Vec<f64>),
    comparison: Option<Comparison>,
    /// Recorded changes of the law's parameters.
    tuning: Tuning,
    /// Number of answered samples, for the progress display.
    answered: Arc<AtomicU64>,
    began_ns: u64,
    end: Option<ReplayEnd>,
}

impl<L: Link> Host<L> {
    pub(super) fn new(
        link: L,
        session: u64,
        original: Arc<Original>,
        tolerances: Tolerances,
        batches: Batches,
        answered: Arc<AtomicU64>,
    ) -> Self {
        // Only the law's parameters matter: the effects of the plant's are in the samples.
        let rate = original.plan.run.rate;
        let tuning = Tuning::new(rate, &[], &Settings::default(), &[], &[], Step(0));
        Self {
            link,
            tuning,
            side: PlantSide::new(original.plan.run.steps),
            session,
            original,
            tolerances,
            batches,
            batch: None,
            index: 0,
            received: Vec::new(),
            answer: (Header::new(FrameKind::Command, Step(0)), Vec::new()),
            comparison: None,
            answered,
            began_ns: 0,
            end: None,
        }
    }

    /// Does as much as possible without blocking.
    ///
    /// # Errors
    /// If the link failed.
    pub(super) fn poll(&mut self) -> Result<Progress, LinkError> {
        if self.side.is_over() {
            Ok(Progress::Over)
        } else if self.side.is_greeting() {
            self.greet()
        } else if let Some(step) = self.side.unreleased() {
            self.send(step)
        } else {
            self.collect()
        }
    }

    /// Handles the wait limit, the death of the peer or a request to stop.
    ///
    /// # Errors
    /// If the link failed.
    pub(super) fn interrupt(&mut self, event: &PlantEvent<'_>) -> Result<(), LinkError> {
        match self.side.on(event) {
            PlantAction::Abort(abort) => {
                let code = abort.code();
                self.give_up(code, ReplayEnd::Aborted(abort))
            }
            _ => Ok(()),
        }
    }

    /// Returns the result of the replay.
    pub(super) fn finish(self) -> Replayed {
        let wall_ns = match self.began_ns {
            0 => 0,
            began_ns => monotonic_ns() - began_ns,
        };
        let stopped = || ReplayEnd::Aborted(Abort::Stopped { at: self.side.at() });
        Replayed {
            end: self.end.unwrap_or_else(stopped),
            comparison: self.comparison,
            wall_time_s: wall_ns as f64 / 1e9,
        }
    }

    fn greet(&mut self) -> Result<Progress, LinkError> {
        let Some(bytes) = self.link.receive_control()? else {
            return Ok(Progress::Controller);
        };
        let original = Arc::clone(&self.original);
        let offer = original.offer(self.session);
        let before = self.side.standing();
        let action = match Control::from_bytes(&bytes) {
            Ok(Control::Hello(hello)) => {
                let action = self.side.on(&PlantEvent::Hello(&hello, &offer));
                self.tuning.offer(Offered {
                    epoch: 1,
                    law: hello.law,
                    parameters: hello.tunable,
                });
                action
            }
            Ok(Control::Ready { epoch }) => self.side.on(&PlantEvent::Ready(epoch)),
            Ok(Control::Welcome(_) | Control::Refusal { .. } | Control::Tuned(_)) | Err(_) => {
                PlantAction::Nothing
            }
        };
        match action {
            PlantAction::Welcome(welcome) => self.welcome(*welcome)?,
            PlantAction::Refuse(reason) => self.refuse(reason)?,
            _ => {}
        }
        Ok(self.since(before))
    }

    /// Returns `Busy` if an event made progress; otherwise the wait continues.
    fn since(&self, before: Standing) -> Progress {
        if self.side.standing() == before {
            Progress::Controller
        } else {
            Progress::Busy
        }
    }

    fn welcome(&mut self, welcome: Welcome) -> Result<(), LinkError> {
        let original = &self.original;
        let compared = Comparison::new(
            &original.places.answer,
            &welcome.command,
            &self.tolerances,
            welcome.sample.len(),
            original.plan.run.rate,
        );
        match compared {
            Ok(comparison) => self.comparison = Some(comparison),
            Err(reason) => {
                self.side.on(&PlantEvent::Stop);
                return self.refuse(reason);
            }
        }
        self.link.open_frames(&FrameSpec {
            identity: welcome.frame_identity(),
            outgoing: welcome.sample.len(),
            incoming: welcome.command.len(),
        })?;
        self.received = vec![0.0; welcome.command.len()];
        self.answer.1.clone_from(&self.received);
        self.link
            .send_control(&Control::Welcome(Box::new(welcome)).to_bytes())
    }

    fn refuse(&mut self, reason: String) -> Result<(), LinkError> {
        let refusal = Control::Refusal {
            reason: reason.clone(),
        };
        self.end = Some(ReplayEnd::Refused(reason));
        self.link.send_control(&refusal.to_bytes())
    }

    /// Sends the sample of a step, or the end of the run.
    fn send(&mut self, step: Step) -> Result<Progress, LinkError> {
        if step.0 < self.original.plan.run.steps && !self.has_row() {
            self.side.on(&PlantEvent::Stop);
            self.give_up(AbortCode::Stopped, ReplayEnd::Short)?;
            return Ok(Progress::Over);
        }
        match self.side.on(&PlantEvent::Release) {
            PlantAction::SendSample(step) => {
                let Some(batch) = &self.batch else {
                    return Ok(Progress::Over);
                };
                for change in batch.changes(self.index) {
                    self.tuning.repeat(change);
                }
                if self.tuning.is_due(step) && self.tuning.advance(step, &[]) {
                    let tuned = Control::Tuned(self.tuning.tuned());
                    self.link.tell(&tuned.to_bytes())?;
                }
                while self.tuning.next_event().is_some() {} // nobody observes
                let row = batch.row(self.index);
                let header = Header {
                    time_ns: self.original.plan.run.rate.nanoseconds(step),
                    directive: row.head.directive.to_wire(),
                    age_steps: row.head.age_steps,
                    held_steps: row.head.held_steps,
                    tuning: self.tuning.number(),
                    invalid: row.head.invalid,
                    ..Header::new(FrameKind::Sample, step)
                };
                self.link.send(&header, row.sample)?;
            }
            PlantAction::SendEnd(step) => {
                self.link.send(&Header::new(FrameKind::End, step), &[])?;
            }
            _ => {}
        }
        Ok(Progress::Busy)
    }

    /// Ensures that a row is available; returns `false` at the end.
    fn has_row(&mut self) -> bool {
        if self.began_ns == 0 {
            self.began_ns = monotonic_ns();
        }
        while self
            .batch
            .as_ref()
            .is_none_or(|batch| self.index >= batch.len())
        {
            self.batch = self.batches.exchange(self.batch.take());
            self.index = 0;
            if self.batch.is_none() {
                return false;
            }
        }
        true
    }

    fn collect(&mut self) -> Result<Progress, LinkError> {
        let Some(header) = self.link.receive(&mut self.received)? else {
            return Ok(Progress::Controller);
        };
        let before = self.side.standing();
        match self.side.on(&PlantEvent::Frame(&header)) {
            PlantAction::Apply(step) => {
                if let (Some(batch), Some(comparison)) = (&self.batch, &mut self.comparison) {
                    comparison.take(&batch.row(self.index), &self.received, &header.invalid);
                }
                self.answer.0 = header;
                std::mem::swap(&mut self.answer.1, &mut self.received);
                self.index += 1;
                self.answered.store(step.0 + 1, Ordering::Relaxed);
            }
            PlantAction::Finish => self.end = Some(ReplayEnd::Completed),
            PlantAction::Abort(abort) => {
                let code = abort.code();
                self.give_up(code, ReplayEnd::Aborted(abort))?;
            }
            PlantAction::Ignore(_) if self.contradicts(&header) => {
                self.interrupt(&PlantEvent::Contradiction(Step(header.step)))?;
            }
            _ => {}
        }
        Ok(self.since(before))
    }

    /// Returns `true` if a skipped command differs from the accepted one for the same step.
    fn contradicts(&self, header: &Header) -> bool {
        let (accepted, values) = &self.answer;
        let content = |header: &Header| (header.invalid, header.age_steps);
        let mut both = values.iter().zip(&self.received);
        header.kind() == Some(FrameKind::Command)
            && (header.epoch, header.step) == (accepted.epoch, accepted.step)
            && (content(header) != content(accepted)
                || both.any(|(accepted, other)| accepted.to_bits() != other.to_bits()))
    }

    /// Notifies the controller and ends the replay.
    fn give_up(&mut self, code: AbortCode, end: ReplayEnd) -> Result<(), LinkError> {
        let header = Header {
            directive: code as u64,
            ..Header::new(FrameKind::Abort, self.side.at())
        };
        let reason = "the replay ended before its first step".into();
        self.end = Some(end);
        match self.link.send(&header, &[]) {
            // Only the control channel exists before the frames are open.
            Err(LinkError::NotOpen) => self
                .link
                .send_control(&Control::Refusal { reason }.to_bytes()),
            other => other,
        }
    }
}

impl Original {
    /// Returns the plant's offer for the run, as the controller receives it.
    pub(super) fn offer(&self, session: u64) -> Offer<'_> {
        Offer {
            session,
            epoch: 1,
            rate: self.plan.run.rate,
            steps: self.plan.run.steps,
            first: Step(0),
            // Samples that were late for the run's controller are marked as unseen.
            against_clock: false,
            measured: &self.plant.measured,
            reference: &self.reference,
            commands: &self.plant.commands,
        }
    }
}

/// Polls a host to its end; every wait has a time limit.
///
/// # Errors
/// If the link failed.
pub(super) fn drive<L: Link>(
    host: &mut Host<L>,
    mut waiter: Waiter,
    supervision: &Supervision,
) -> Result<(), LinkError> {
    waiter.sleep_on(host.link.sleeper());
    loop {
        if supervision.wants_stop() {
            host.interrupt(&PlantEvent::Stop)?;
        }
        // Checked before the poll: messages that the controller sent before it ended still count.
        let peer_gone = supervision.is_peer_gone();
        match host.poll()? {
            Progress::Busy => waiter.done(),
            Progress::Over => return Ok(()),
            Progress::Controller if peer_gone => host.interrupt(&PlantEvent::PeerGone(1))?,
            Progress::Controller => {
                if waiter.pause() {
                    host.interrupt(&PlantEvent::Deadline(waiter.limit().ms()))?;
                }
            }
        }
    }
}
