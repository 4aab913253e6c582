//! Parts of a scenario that begin, end or move while the probe runs, so that the loop is not the same throughout.

use std::ops::Range;

use hil_config::plan::{FaultEvent, Plan, Profile, Stimulus};
use hil_config::stimulus::evaluate;
use shared_types::record::Event;
use shared_types::time::Step;

use super::probe::{Course, WINDOWS};

/// Share of its size below which the rest of an exponential fault is no movement.
const REST: f64 = 1e-4;

/// Returns the reason to refuse a measurement during which a fault, a change or a stimulus begins, ends or moves.
pub(super) fn of(plan: &Plan, events: &[Event], course: Course) -> Option<String> {
    let all = Movements {
        plan,
        events,
        steps: course.first_step..course.end_step(),
    };
    let event = events.iter().find_map(|event| all.event(event));
    let reason = event.or_else(|| {
        let mut stimuli = plan.stimuli.iter();
        stimuli.find_map(|one| all.stimulus(one, course.period_steps))
    });
    let [from_s, until_s] = [all.steps.start, all.steps.end].map(|step| all.seconds(step));
    reason.map(|(reason, remedy)| {
        format!(
            "{reason}, while the probe runs from {from_s} s to {until_s} s, so the loop is not the same throughout; {remedy}"
        )
    })
}

/// Reason and remedy.
type Reason = (String, &'static str);

struct Movements<'a> {
    plan: &'a Plan,
    events: &'a [Event],
    /// Steps of the probe.
    steps: Range<u64>,
}

impl Movements<'_> {
    fn seconds(&self, step: u64) -> f64 {
        self.plan.run.rate.seconds(Step(step))
    }

    /// Returns `true` if a step is within the measurement and not its first.
    const fn is_within(&self, step: u64) -> bool {
        self.steps.start < step && step < self.steps.end
    }

    fn event(&self, event: &Event) -> Option<Reason> {
        const FAULT: &str = "choose another --at, another --fault, or --fault 0 for none";
        match event {
            Event::Fault(begun) if !begun.wall_only => {
                let (id, kind, begin_s) = (begun.id, &begun.kind, self.seconds(begun.step));
                let fault = self.plan.faults.iter().find(|one| one.id == id);
                if self.is_within(begun.step) {
                    return Some((format!("fault {id} ({kind}) begins at {begin_s} s"), FAULT));
                }
                let [from_s, until_s] = moving_s(fault?, begun.effect)?.map(|s| begin_s + s);
                let is_over = self.events.iter().any(|event| {
                    matches!(event, Event::FaultEnded(ended)
                        if (ended.id, ended.effect) == (id, begun.effect)
                            && ended.step <= self.steps.start)
                });
                let moves = !is_over
                    && from_s < self.seconds(self.steps.end)
                    && until_s > self.seconds(self.steps.start);
                moves.then(|| {
                    let text = format!("fault {id} ({kind}) moves from {from_s} s to {until_s} s");
                    (text, FAULT)
                })
            }
            Event::FaultEnded(ended) if self.is_within(ended.step) => Some((
                format!("fault {} ends at {} s", ended.id, self.seconds(ended.step)),
                FAULT,
            )),
            Event::Change(change) => {
                let end = change.step + change.ramp_steps;
                let moves = self.is_within(change.step)
                    || (change.step < self.steps.end && self.steps.start < end);
                moves.then(|| {
                    let text = format!(
                        "change {} takes effect at {} s ({})",
                        change.id,
                        self.seconds(change.step),
                        change.described()
                    );
                    (text, "choose another --at")
                })
            }
            _ => None,
        }
    }

    /// Compares the periods of the measurement: a stimulus that moves in each of them is judged by the loop's own
    /// motion, one that moves in some only begins or ends.
    fn stimulus(&self, one: &Stimulus, period_steps: u64) -> Option<Reason> {
        let mut row = vec![0.0; 1 + one.waveform.derivatives()];
        let mut value = |step: u64| {
            evaluate(&one.waveform, self.seconds(step), &mut row);
            row[0]
        };
        let (mut before, mut first, mut moves) =
            (value(self.steps.start), None, [false; 1 + WINDOWS]);
        for step in self.steps.start + 1..self.steps.end {
            let now = value(step);
            if now != before {
                first = first.or(Some(step));
                moves[((step - self.steps.start) / period_steps) as usize] = true;
            }
            before = now;
        }
        let first = first.filter(|_| moves.contains(&false))?;
        let text = format!(
            "the stimulus of {} moves at {} s",
            one.target,
            self.seconds(first)
        );
        Some((text, "choose an --at at which it stands still"))
    }
}

/// Returns the times after the beginning of an effect between which its size moves, if it does.
fn moving_s(event: &FaultEvent, effect: u32) -> Option<[f64; 2]> {
    match &event.effects.get(effect as usize)?.profile {
        Profile::Step => None,
        Profile::Ramp { duration_s } => Some([0.0, *duration_s]),
        Profile::Exponential { speed_per_s } => Some([0.0, -libm::log(REST) / speed_per_s]),
        Profile::Pulse { duration_s } => Some([*duration_s; 2]),
        Profile::Intermittent { .. } | Profile::Sine { .. } => Some([0.0, f64::INFINITY]),
        Profile::Table { time_s, values } => {
            let pairs = time_s.windows(2).zip(values.windows(2));
            let mut moving = pairs.filter(|(_, values)| values[0] != values[1]);
            let first = moving.next()?.0;
            let last = moving.next_back().map_or(first, |(times, _)| times);
            Some([first[0], last[1]])
        }
    }
}
