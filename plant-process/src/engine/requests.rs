//! Requests to a run, served between two steps: faults, changes of values, marks, the newest record, pause and resume.
//! Leaves all checks that can be made earlier to [`live`](crate::live).

use hil_config::plan::{PLANT_KEYS, law_keys};
use hil_session::clock::monotonic_ns;
use shared_types::frame::{FrameKind, Header};
use shared_types::link::{Link, LinkError};
use shared_types::record::{Event, FaultAccepted, MOST_MARKS, Mark};
use shared_types::stream::RecordSink;
use shared_types::time::Step;

use super::{Engine, NEVER};
use crate::request_queue::{LoopRequest, TuningShown};

/// Hold of a run, in ns of the monotonic clock.
#[derive(Clone, Copy)]
pub(super) struct Held {
    /// Beginning.
    pub since_ns: u64,
    /// Time of the last message to the controller.
    told_ns: u64,
}

impl<L: Link, S: RecordSink> Engine<L, S> {
    /// Serves the queued requests before a step; returns `true` if the run is held at this step.
    pub(super) fn attend(&mut self, step: Step) -> Result<bool, LinkError> {
        while self.publisher.sink.has_room()?
            && let Some(request) = self.queue.next_request()
        {
            self.serve(request, step)?;
        }
        if !self.queue.holds(step) {
            if let Some(hold) = self.held.take() {
                let now_ns = monotonic_ns();
                self.commands.resume(hold.since_ns, now_ns);
                if let Some(pacer) = &mut self.pacer {
                    pacer.delay(now_ns - hold.since_ns);
                }
            }
            return Ok(false);
        }
        self.tell()?; // an observer should see all that happened
        let now_ns = monotonic_ns();
        let again_ns = self.hold_again_ns();
        let is_due = |hold: Held| now_ns - hold.told_ns >= again_ns;
        if self.held.is_none_or(is_due) {
            self.held = Some(Held {
                since_ns: self.held.map_or(now_ns, |hold| hold.since_ns),
                told_ns: now_ns,
            });
            self.link.send(&Header::new(FrameKind::Hold, step), &[])?;
        }
        Ok(true)
    }

    /// Returns the interval between hold messages to the controller, which is well within the controller's wait limit.
    fn hold_again_ns(&self) -> u64 {
        const OFTEN_NS: u64 = 100_000_000;
        let patience_ns = (self.job.wait_limit_s * 0.25e9) as u64;
        patience_ns.min(OFTEN_NS)
    }

    fn serve(&mut self, request: LoopRequest, step: Step) -> Result<(), LinkError> {
        let (queue, faults) = (&self.queue, &mut self.plant.faults);
        // Executed even if the client has gone.
        match request {
            LoopRequest::Admit(armed, answer) => {
                let events: Vec<_> = (armed.iter().map(|fault| fault.event().clone())).collect();
                let admitted = if step.0 < self.job.run.steps {
                    faults.admit(armed, step)
                } else {
                    Err("the run is over".into())
                };
                if let Ok(admitted) = &admitted {
                    for (fault, event) in admitted.iter().zip(events) {
                        self.publisher.sink.event(&Event::Accepted(FaultAccepted {
                            id: fault.id,
                            step: step.0,
                            fault: serde_json::to_value(event).unwrap_or_default(),
                        }))?;
                    }
                }
                let _ = answer.send(admitted);
            }
            LoopRequest::Clear(id, answer) => {
                let _ = answer.send((faults.clear(id, step), step));
            }
            LoopRequest::Show(answer) => {
                let _ = answer.send(faults.states());
            }
            LoopRequest::Pause(answer) => {
                queue.hold_at(step);
                let _ = answer.send(());
            }
            LoopRequest::Resume(answer) => {
                queue.hold_at(NEVER);
                let _ = answer.send(());
            }
            LoopRequest::Advance(steps, answer) => {
                let until = Step(step.0.saturating_add(steps));
                let _ = answer.send(if self.held.is_some() {
                    queue.hold_at(until);
                    Ok(until)
                } else {
                    Err("the run is not paused; pause it first with `hil pause`".into())
                });
            }
            LoopRequest::Record(answer) => {
                let record = (step.0 > 0).then(|| self.rows.record.clone());
                let _ = answer.send(record);
            }
            LoopRequest::Change(change, epoch, answer) => {
                let tuning = &mut self.plant.tuning;
                let is_late = step.0 >= self.job.run.steps;
                let _ = answer.send(if is_late {
                    Err("the run is over".into())
                } else if epoch != tuning.offered().epoch {
                    Err("the controller changed or was lost after the check of this change; send the change again".into())
                } else {
                    tuning.admit(*change, step)
                });
            }
            LoopRequest::Tunable(change, answer) => {
                if self.rows.stimulus_of != Some(step) {
                    self.prepare(step);
                }
                let tuning = &self.plant.tuning;
                let after = |prefix: &str| match &change {
                    Some(change) => tuning.settings_with(change, prefix),
                    None => Vec::new(),
                };
                let _ = answer.send(Box::new(TuningShown {
                    values: tuning.tunable(step, &self.rows.stimulus),
                    waiting: tuning.waiting().iter().cloned().collect(),
                    left: tuning.left(),
                    offered: tuning.offered().clone(),
                    plant_after: after(PLANT_KEYS),
                    law_after: after(&law_keys(&tuning.offered().law)),
                }));
            }
            LoopRequest::Mark(text, answer) => {
                let has_room = self.marks < MOST_MARKS;
                if has_room {
                    self.marks += 1;
                    let mark = Mark { step: step.0, text };
                    self.publisher.sink.event(&Event::Mark(mark))?;
                }
                let refusal = || {
                    format!(
                        "a run can have at most {MOST_MARKS} marks, and this run already has that many; add further notes to a new run"
                    )
                };
                let _ = answer.send(has_room.then_some(step).ok_or_else(refusal));
            }
        }
        Ok(())
    }
}
