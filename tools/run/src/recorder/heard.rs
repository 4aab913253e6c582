//! Validation of a plant's records and events before they are used.

use hil_config::plan::{Clock, Plan};
use hil_facts::results::recorded::Recorded;
use hil_session::supervision::MOST_EPOCHS;
use shared_types::lockstep::OnLoss;
use shared_types::record::{
    ControllerChange, ControllerFate, Event, LONGEST_MARK, MOST_CHANGES, MOST_MARKS, RecordView,
};
use shared_types::time::Step;

/// Maximum number of events in a run. A live fault causes three per effect, and permanently costs the plant memory.
const MOST_EVENTS: u64 = 1 << 20;

/// State of the validation of a stream.
#[derive(Clone, Debug, Default)]
pub(super) struct Validator {
    /// Step after that of the last record.
    next_step: u64,
    /// Number of earlier steps without a record.
    missing: u64,
    events: u64,
    /// `true` after an invalid item: no later record counts.
    is_broken: bool,
}

impl Validator {
    pub(super) const fn next_step(&self) -> u64 {
        self.next_step
    }

    /// Returns `true` if an item was invalid.
    pub(super) const fn is_broken(&self) -> bool {
        self.is_broken
    }

    /// Marks the stream as invalid.
    pub(super) const fn broke(&mut self) {
        self.is_broken = true;
    }

    /// Validates a record, which must belong to the next step; in real time as many may be missing as are known to be
    /// lost.
    ///
    /// # Errors
    /// If the record is invalid; the error states the reason.
    pub(super) fn record(
        &mut self,
        plan: &Plan,
        view: &RecordView<'_>,
        lost: u64,
    ) -> Result<(), String> {
        let (step, next, last) = (view.step, self.next_step, plan.run.steps);
        let missing = match plan.run.clock {
            Clock::Realtime => lost - self.missing.min(lost),
            Clock::Lockstep | Clock::Paced { .. } => 0,
        };
        if step < next || step > next.saturating_add(missing) || step > last {
            return Err(if next > last {
                format!(
                    "received a record of step {step} after the last record, which is of step {last}"
                )
            } else {
                format!("received a record of step {step} instead of step {next}")
            });
        }
        let (actual, due) = (view.timing.time_ns, plan.run.rate.nanoseconds(Step(step)));
        if actual != due {
            return Err(format!(
                "the record of step {step} has the time {actual} ns instead of {due} ns"
            ));
        }
        self.missing += step - next;
        self.next_step = step + 1;
        Ok(())
    }

    /// Validates and sanitises an event.
    ///
    /// # Errors
    /// If the event is invalid; the error states the reason.
    pub(super) fn event(
        &mut self,
        plan: &Plan,
        event: &Event,
        recorded: &Recorded,
    ) -> Result<(), String> {
        self.events += 1;
        if self.events > MOST_EVENTS {
            return Err(format!("received more than {MOST_EVENTS} events"));
        }
        let Some(step) = event.step() else {
            return Ok(());
        };
        let steps = plan.run.steps;
        if step > steps {
            return Err(format!(
                "received an event of step {step} in a run of only {steps} steps"
            ));
        }
        match event {
            Event::Controller(change) => controller(plan, change, recorded.changes.len()),
            Event::Change(_) if recorded.values.len() >= MOST_CHANGES => Err(format!(
                "received more than {MOST_CHANGES} changes of values"
            )),
            Event::Mark(_) if recorded.marks.len() >= MOST_MARKS => {
                Err(format!("received more than {MOST_MARKS} marks"))
            }
            Event::Mark(mark) if mark.text.chars().count() > LONGEST_MARK => {
                let count = mark.text.chars().count();
                Err(format!(
                    "received a mark of {count} characters; at most {LONGEST_MARK} are allowed"
                ))
            }
            _ => Ok(()),
        }
    }
}

fn controller(plan: &Plan, change: &ControllerChange, before: usize) -> Result<(), String> {
    let (epoch, planned) = (change.epoch, plan.run.on_controller_loss);
    // Each joins, ends and may be refused.
    if before >= 3 * MOST_EPOCHS as usize {
        return Err(format!(
            "received more than {before} changes of controllers"
        ));
    }
    match &change.change {
        ControllerFate::Lost { policy, .. } if *policy != planned || planned == OnLoss::Abort => {
            Err(format!(
                "the plant reports the loss of controller {epoch} with the policy `{}`, but the run has the policy `{}`",
                policy.name(),
                planned.name()
            ))
        }
        _ => Ok(()),
    }
}
