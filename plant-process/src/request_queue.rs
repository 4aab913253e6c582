//! Queue of external requests, which wait here for the loop.
//!
//! The service thread of [`live`](crate::live) adds requests. The engine reads one number, the gate, before each step,
//! and opens the queue only when the step has reached the gate. The loop never waits for the queue, and the queue never
//! touches the loop's state.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, OnceLock, PoisonError};

use hil_config::plan::Change;
use shared_types::describe::Settings;
use shared_types::live::{FaultState, Status, Tunable};
use shared_types::record::RecordLayout;
use shared_types::time::Step;

use crate::faults::{Admitted, ArmedFault};
use crate::tuning::Offered;

/// Request to the loop.
pub enum LoopRequest {
    /// Admit these faults, all or none.
    Admit(Vec<Box<ArmedFault>>, Sender<Result<Vec<Admitted>, String>>),
    /// End one fault or all; the answer has the ended faults and the first step without them.
    Clear(Option<u32>, Sender<(Vec<u32>, Step)>),
    /// List the faults.
    Show(Sender<Vec<FaultState>>),
    /// Pause before the next step.
    Pause(Sender<()>),
    /// Resume.
    Resume(Sender<()>),
    /// Run N more steps, then pause; refused unless the run is paused.
    Advance(u64, Sender<Result<Step, String>>),
    /// Return the latest record; `None` before the first.
    Record(Sender<Option<Vec<u64>>>),
    /// Accept a change of values, checked for the controller of this epoch; the answer has its number and step.
    Change(Box<Change>, u32, Sender<Result<(u32, Step), String>>),
    /// List the values that can be changed, and the results of a proposed change.
    Tunable(Option<Box<Change>>, Sender<Box<TuningShown>>),
    /// Add a note before the next step.
    Mark(String, Sender<Result<Step, String>>),
}

/// Values that can be changed, at a step.
#[derive(Clone, Debug)]
pub struct TuningShown {
    /// Values that can be changed.
    pub values: Vec<Tunable>,
    /// Pending changes.
    pub waiting: Vec<Change>,
    /// Number of further changes that the run accepts.
    pub left: usize,
    /// Tunable parameters of the active law.
    pub offered: Offered,
    /// Settings of the plant and of the law after the proposed change.
    pub plant_after: Vec<Settings>,
    /// Parameters of the law, as far as changes set them.
    pub law_after: Vec<Settings>,
}

/// Queue of requests, shared between the loop and the service thread.
pub struct RequestQueue {
    /// First step that the loop must not begin without checking the queue.
    gate: AtomicU64,
    /// The next step.
    step: AtomicU64,
    held: AtomicBool,
    closed: AtomicBool,
    layout: OnceLock<RecordLayout>,
    requests: Mutex<Waiting>,
}

struct Waiting {
    waiting: VecDeque<LoopRequest>,
    /// Step before which the run is held.
    hold_at: Step,
}

impl RequestQueue {
    /// Creates the queue of a run that is to be held before a step; [`Step`] of `u64::MAX` for never.
    #[must_use]
    pub fn new(hold_at: Step) -> Self {
        Self {
            gate: AtomicU64::new(hold_at.0),
            step: AtomicU64::new(0),
            held: AtomicBool::new(false),
            closed: AtomicBool::new(false),
            layout: OnceLock::new(),
            requests: Mutex::new(Waiting {
                waiting: VecDeque::new(),
                hold_at,
            }),
        }
    }

    /// For the loop: returns `true` if a step may begin without checking the queue.
    #[must_use]
    pub fn is_open_for(&self, step: Step) -> bool {
        self.step.store(step.0, Ordering::Relaxed);
        step.0 < self.gate.load(Ordering::Acquire)
    }

    /// For the loop: takes one request, if there is one and the queue is not locked. If there is none, moves the gate
    /// to the step of the next hold.
    #[must_use]
    pub fn next_request(&self) -> Option<LoopRequest> {
        let mut requests = self.requests.try_lock().ok()?;
        let request = requests.waiting.pop_front();
        if request.is_none() {
            self.gate.store(requests.hold_at.0, Ordering::Release);
        }
        request
    }

    /// Requests a hold before a step; called by the loop.
    pub fn hold_at(&self, step: Step) {
        self.lock().hold_at = step;
    }

    /// For the loop: returns `true` if the run is held before a step, and publishes that status.
    #[must_use]
    pub fn holds(&self, step: Step) -> bool {
        let holds = step.0 >= self.lock().hold_at.0;
        self.held.store(holds, Ordering::Release);
        holds
    }

    /// For the loop: publishes the layout of the records.
    pub fn opened(&self, layout: &RecordLayout) {
        let _ = self.layout.set(layout.clone()); // a second controller has the same layout
    }

    /// For the loop: ends the service of requests because the run is over.
    pub fn close(&self) {
        self.closed.store(true, Ordering::Release);
        self.lock().waiting.clear();
    }

    /// Returns the layout of the records, once known.
    #[must_use]
    pub fn layout(&self) -> Option<&RecordLayout> {
        self.layout.get()
    }

    /// Returns `true` if the run is over.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }

    /// Returns `true` if a request waits for the loop.
    #[must_use]
    pub fn wants_attention(&self) -> bool {
        self.gate.load(Ordering::Acquire) == 0
    }

    /// Returns the run's step and time, and `paused` if it is held.
    #[must_use]
    pub fn status(&self, rate: shared_types::time::Rate, steps: u64) -> Status {
        let step = Step(self.step.load(Ordering::Relaxed));
        Status {
            step: step.0,
            time_s: rate.seconds(step),
            steps,
            paused: self.held.load(Ordering::Acquire),
        }
    }

    /// Adds a request to the queue and returns the receiver of its answer.
    pub fn push<T>(&self, request: impl FnOnce(Sender<T>) -> LoopRequest) -> Receiver<T> {
        let (answer, receiver) = channel();
        let mut requests = self.lock();
        if !self.is_closed() {
            requests.waiting.push_back(request(answer));
            self.gate.store(0, Ordering::Release);
        }
        receiver
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Waiting> {
        // No operation under this lock can be left incomplete, so a panic elsewhere does not matter.
        self.requests.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_gate_needs_no_check_and_a_request_closes_it() {
        let queue = RequestQueue::new(Step(u64::MAX));
        assert!(queue.is_open_for(Step(7)) && queue.next_request().is_none());
        let receiver = queue.push(LoopRequest::Pause);
        assert!(!queue.is_open_for(Step(8)) && queue.wants_attention());
        let Some(LoopRequest::Pause(answer)) = queue.next_request() else {
            panic!("the request waits");
        };
        queue.hold_at(Step(8));
        answer.send(()).expect("somebody waits");
        assert!(queue.next_request().is_none() && queue.holds(Step(8)));
        assert!(!queue.wants_attention() && !queue.is_open_for(Step(8)));
        assert!(receiver.recv().is_ok());
    }

    #[test]
    fn a_closed_queue_answers_nobody() {
        let queue = RequestQueue::new(Step(u64::MAX));
        let before = queue.push(LoopRequest::Pause);
        queue.close();
        let after = queue.push(LoopRequest::Pause);
        assert!(before.recv().is_err() && after.recv().is_err());
    }
}
