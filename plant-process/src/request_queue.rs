//! Requests from outside, which wait here until the loop has a moment.
//!
//! The service thread of [`live`](crate::live) puts requests into it; the engine looks at one number
//! before each step, the gate, and looks into the queue only when the step has reached
//! it. The loop never waits for the queue, and the queue never touches the loop's state.

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
    /// Take these faults, all or none.
    Admit(Vec<Box<ArmedFault>>, Sender<Result<Vec<Admitted>, String>>),
    /// End one fault or all; answered with those that ended and the first step without them.
    Clear(Option<u32>, Sender<(Vec<u32>, Step)>),
    /// Show the faults.
    Show(Sender<Vec<FaultState>>),
    /// Hold before the next step.
    Pause(Sender<()>),
    /// Go on.
    Resume(Sender<()>),
    /// Go on for N steps, then hold; refused unless the run is held.
    Advance(u64, Sender<Result<Step, String>>),
    /// Show the newest record; `None` before the first.
    Record(Sender<Option<Vec<u64>>>),
    /// Take a change of values, checked for the controller of this epoch; answered with its number and step.
    Change(Box<Change>, u32, Sender<Result<(u32, Step), String>>),
    /// Show what can be changed, and what a change would make of it.
    Tunable(Option<Box<Change>>, Sender<Box<TuningShown>>),
    /// Put a note before the next step.
    Mark(String, Sender<Result<Step, String>>),
}

/// Values that can be changed, at a step.
#[derive(Clone, Debug)]
pub struct TuningShown {
    /// Values, changes that wait, and the number of those that the run can still take.
    pub values: Vec<Tunable>,
    /// Changes that wait.
    pub waiting: Vec<Change>,
    /// Number of changes that the run can still take.
    pub left: usize,
    /// Parameters that the active law offers.
    pub offered: Offered,
    /// Settings of the plant and of the law as the change would make them.
    pub plant_after: Vec<Settings>,
    /// Parameters of the law, as far as changes set them.
    pub law_after: Vec<Settings>,
}

/// Queue of requests. Shared between the loop and the service thread.
pub struct RequestQueue {
    /// The loop may begin any step below this without looking into the queue.
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
    /// The step before which the run is held.
    hold_at: Step,
}

impl RequestQueue {
    /// Makes the queue of a run that is to be held before a step; [`Step`] of `u64::MAX` for never.
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

    /// For the loop: whether a step may begin without looking into the queue.
    #[must_use]
    pub fn is_open_for(&self, step: Step) -> bool {
        self.step.store(step.0, Ordering::Relaxed);
        step.0 < self.gate.load(Ordering::Acquire)
    }

    /// For the loop: takes one request, if there is one and the queue is free. `None` also moves the
    /// gate to where the run is to be held.
    #[must_use]
    pub fn next_request(&self) -> Option<LoopRequest> {
        let mut requests = self.requests.try_lock().ok()?;
        let request = requests.waiting.pop_front();
        if request.is_none() {
            self.gate.store(requests.hold_at.0, Ordering::Release);
        }
        request
    }

    /// For the loop: holds the run before a step from now on.
    pub fn hold_at(&self, step: Step) {
        self.lock().hold_at = step;
    }

    /// For the loop: whether the run is to be held before a step; notes it for the outside.
    #[must_use]
    pub fn holds(&self, step: Step) -> bool {
        let holds = step.0 >= self.lock().hold_at.0;
        self.held.store(holds, Ordering::Release);
        holds
    }

    /// For the loop: what the records hold is known.
    pub fn opened(&self, layout: &RecordLayout) {
        let _ = self.layout.set(layout.clone()); // a second controller has the same layout
    }

    /// For the loop: the run is over, nobody takes requests any more.
    pub fn close(&self) {
        self.closed.store(true, Ordering::Release);
        self.lock().waiting.clear();
    }

    /// Returns the layout of the records, once it is known.
    #[must_use]
    pub fn layout(&self) -> Option<&RecordLayout> {
        self.layout.get()
    }

    /// Returns true if the run is over.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Acquire)
    }

    /// Tells if a request waits for the loop.
    #[must_use]
    pub fn wants_attention(&self) -> bool {
        self.gate.load(Ordering::Acquire) == 0
    }

    /// Returns the run's step and time, and if the run is held.
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

    /// Puts a request into the queue and gives where its answer will come.
    pub fn push<T>(&self, request: impl FnOnce(Sender<T>) -> LoopRequest) -> Receiver<T> {
        let (answer, answered) = channel();
        let mut requests = self.lock();
        if !self.is_closed() {
            requests.waiting.push_back(request(answer));
            self.gate.store(0, Ordering::Release);
        }
        answered
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Waiting> {
        // Nothing is left half done under this lock, so that a panic elsewhere does not matter.
        self.requests.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_gate_needs_no_look_and_a_request_closes_it() {
        let queue = RequestQueue::new(Step(u64::MAX));
        assert!(queue.is_open_for(Step(7)) && queue.next_request().is_none());
        let answered = queue.push(LoopRequest::Pause);
        assert!(!queue.is_open_for(Step(8)) && queue.wants_attention());
        let Some(LoopRequest::Pause(answer)) = queue.next_request() else {
            panic!("the request waits");
        };
        queue.hold_at(Step(8));
        answer.send(()).expect("somebody waits");
        assert!(queue.next_request().is_none() && queue.holds(Step(8)));
        assert!(!queue.wants_attention() && !queue.is_open_for(Step(8)));
        assert!(answered.recv().is_ok());
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
