//! Words of a plant in the record stream, checked before anything is made of them.

use hil_config::plan::{Clock, Plan};
use hil_facts::results::recorded::Recorded;
use hil_session::supervision::MOST_EPOCHS;
use shared_types::lockstep::OnLoss;
use shared_types::record::{
    ControllerChange, ControllerFate, Event, LONGEST_MARK, MOST_CHANGES, MOST_MARKS, RecordView,
};
use shared_types::time::Step;

/// Most events of a run. A live fault brings three for each effect, and costs the plant memory for ever.
const MOST_EVENTS: u64 = 1 << 20;

/// State of a stream as far as it was heard.
#[derive(Clone, Debug, Default)]
pub(super) struct Heard {
    /// The step after that of the last record.
    next_step: u64,
    /// Steps before it that have no record.
    missing: u64,
    events: u64,
    /// Something was wrong: no record after it counts.
    is_broken: bool,
}

impl Heard {
    pub(super) const fn next_step(&self) -> u64 {
        self.next_step
    }

    /// Returns true if something was wrong before.
    pub(super) const fn is_broken(&self) -> bool {
        self.is_broken
    }

    /// Something is wrong with the stream.
    pub(super) const fn broke(&mut self) {
        self.is_broken = true;
    }

    /// Takes a record, which must be the one after the one before; in real time as many may be
    /// missing as are known to be lost.
    ///
    /// # Errors
    /// If something is wrong with the record; the error says what.
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
                format!("a record of step {step} came after the last one, that of step {last}")
            } else {
                format!("a record of step {step} came where that of step {next} was due")
            });
        }
        let (said, due) = (view.timing.time_ns, plan.run.rate.nanoseconds(Step(step)));
        if said != due {
            return Err(format!(
                "the record of step {step} says that it is of {said} ns, and its time is {due} ns"
            ));
        }
        self.missing += step - next;
        self.next_step = step + 1;
        Ok(())
    }

    /// Takes an event, cleaned.
    ///
    /// # Errors
    /// If something is wrong with the event; the error says what.
    pub(super) fn event(
        &mut self,
        plan: &Plan,
        event: &Event,
        recorded: &Recorded,
    ) -> Result<(), String> {
        self.events += 1;
        if self.events > MOST_EVENTS {
            return Err(format!("more than {MOST_EVENTS} events came"));
        }
        let Some(step) = event.step() else {
            return Ok(());
        };
        let steps = plan.run.steps;
        if step > steps {
            return Err(format!(
                "an event of step {step} came in a run of {steps} steps"
            ));
        }
        match event {
            Event::Controller(change) => controller(plan, change, recorded.changes.len()),
            Event::Change(_) if recorded.values.len() >= MOST_CHANGES => {
                Err(format!("more than {MOST_CHANGES} changes of values came"))
            }
            Event::Mark(_) if recorded.marks.len() >= MOST_MARKS => {
                Err(format!("more than {MOST_MARKS} marks came"))
            }
            Event::Mark(mark) if mark.text.chars().count() > LONGEST_MARK => {
                let count = mark.text.chars().count();
                Err(format!(
                    "a mark of {count} characters came, and {LONGEST_MARK} are allowed"
                ))
            }
            _ => Ok(()),
        }
    }
}

fn controller(plan: &Plan, change: &ControllerChange, before: usize) -> Result<(), String> {
    let (epoch, planned) = (change.epoch, plan.run.on_controller_loss);
    // Each comes, goes and may be refused.
    if before >= 3 * MOST_EPOCHS as usize {
        return Err(format!("more than {before} changes of controllers came"));
    }
    match &change.change {
        ControllerFate::Lost { policy, .. } if *policy != planned || planned == OnLoss::Abort => {
            Err(format!(
                "the plant says that it lost controller {epoch} and goes on with `{}`, and the run has `{}`",
                policy.name(),
                planned.name()
            ))
        }
        _ => Ok(()),
    }
}
