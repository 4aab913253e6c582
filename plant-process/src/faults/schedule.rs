//! The schedule: the step at which each fault begins and ends.
//!
//! Called by the layer once per step, before everything else. The schedule handles triggers, ends and conditions,
//! independently of the actions of effects. While no beginning or end is due and no condition is watched, a call is one
//! comparison.
//!
//! Of ended events only the listed data remains. The rest is released when another fault is admitted, which allocates
//! anyway, and never at a step.
//!
//! At one step, faults end before others begin, and the beginnings are ordered by event number and by index in the
//! event.

use std::ops::Range;

use hil_config::condition::Watch;
use hil_config::plan::{Condition, FaultEnd, FaultEvent, FaultSource, Trigger};
use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::live::FaultState;
use shared_types::time::Step;

use super::builder::ArmedFault;
use super::effect::{Effect, Life};

/// Step that never comes.
const NEVER: u64 = u64::MAX;

/// Change of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// Effect that begins.
    Begins(usize),
    /// Effect that ended by itself.
    Ends(usize),
}

/// Events of a run.
#[derive(Default)]
pub(super) struct Schedule {
    /// Events by number.
    events: Vec<Scheduled>,
    /// Indices of the events that are not over, ascending.
    living: Vec<usize>,
    /// Indices of the events that are over and still own their resources.
    over: Vec<usize>,
    /// Number of effects of the living events.
    living_effects: usize,
    /// First step at which a beginning or end is due.
    due: u64,
    /// Indices of events that begin or end by a condition.
    watching: Vec<usize>,
    /// `true` if an effect has a maximum number of occurrences.
    counting: bool,
    /// Changes at the last turn, in order.
    changes: Vec<Change>,
}

/// Event with its state.
struct Scheduled {
    event: FaultEvent,
    when: Option<Watch>,
    until: Option<Watch>,
    effects: Range<usize>,
    /// Step at which the event begins, once known.
    hold: Option<u64>,
    /// `true` once the event has begun.
    held: bool,
    /// Step at which the event ends, once known.
    end: Option<u64>,
    /// `true` once all effects of the event have ended.
    over: bool,
}

/// Saved state of an event.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct SavedEvent {
    id: u32,
    /// Step at which the event began, if it has begun.
    held: Option<u64>,
    over: bool,
    /// Numbers of records for which the conditions of its beginning and its end have held.
    conditions_held: [u64; 2],
}

impl Schedule {
    /// Returns the state of every event.
    pub(super) fn save(&self) -> Vec<SavedEvent> {
        let save = |scheduled: &Scheduled| {
            // Ended events evaluate no conditions, and may have none any more.
            let records_held = |watch: &Option<Watch>| {
                let watch = watch.as_ref().filter(|_| !scheduled.over);
                watch.map_or(0, Watch::held)
            };
            SavedEvent {
                id: scheduled.event.id,
                held: scheduled.hold.filter(|_| scheduled.held),
                over: scheduled.over,
                conditions_held: [&scheduled.when, &scheduled.until].map(records_held),
            }
        };
        self.events.iter().map(save).collect()
    }

    /// Restores the states; the effects are restored separately. Future beginnings and ends follow from the events
    /// alone.
    pub(super) fn restore(
        &mut self,
        saved: &[SavedEvent],
        effects: &[Effect],
    ) -> Result<(), Invalid> {
        let same = |(scheduled, saved): (&Scheduled, &SavedEvent)| scheduled.event.id == saved.id;
        if saved.len() != self.events.len() || !self.events.iter().zip(saved).all(same) {
            let (theirs, ours) = (saved.len(), self.events.len());
            return Err(Invalid(format!(
                "the {theirs} faults in the state are not the {ours} faults of this run"
            )));
        }
        for (scheduled, saved) in self.events.iter_mut().zip(saved) {
            if saved.held.is_some() {
                (scheduled.hold, scheduled.held) = (saved.held, true);
            }
            scheduled.over = saved.over;
            for (watch, records) in [&mut scheduled.when, &mut scheduled.until]
                .into_iter()
                .zip(saved.conditions_held)
            {
                if let Some(watch) = watch {
                    watch.go_on_from(records);
                }
            }
        }
        self.look_ahead(effects);
        // An effect that may end at the next step by its occurrences is found by checking.
        self.due = 0;
        Ok(())
    }

    /// Arms an event whose effects are at `effects` and which waits from step `next` on. Returns the step at which the
    /// event begins, if known. [`look_ahead`](Self::look_ahead) must follow.
    pub(super) fn arm(
        &mut self,
        armed: ArmedFault,
        effects: Range<usize>,
        next: Step,
    ) -> Option<Step> {
        let ArmedFault {
            event, when, until, ..
        } = armed;
        self.living_effects += effects.len();
        self.changes.reserve(2 * self.living_effects);
        let scheduled = Scheduled {
            hold: self.hold_of(&event.trigger, next),
            held: false,
            end: event.end.step.map(|step| step.0),
            over: false,
            event,
            when,
            until,
            effects,
        };
        let hold = scheduled.hold;
        let place = self.place_after(scheduled.event.id);
        self.events.insert(place, scheduled);
        for later in self.living.iter_mut().chain(&mut self.over) {
            *later += usize::from(*later >= place);
        }
        let among = self.living.partition_point(|other| *other < place);
        self.living.insert(among, place);
        self.watching.reserve(self.living.len());
        self.over.reserve(self.living.len());
        hold.map(Step)
    }

    /// Returns the number of effects of events that are not over.
    pub(super) const fn living_effects(&self) -> usize {
        self.living_effects
    }

    /// Releases the resources of an ended event and returns the indices of its effects.
    pub(super) fn retire(&mut self) -> Option<Range<usize>> {
        let scheduled = &mut self.events[self.over.pop()?];
        (scheduled.when, scheduled.until) = (None, None);
        scheduled.event.name = None;
        scheduled.event.trigger = Trigger::Now;
        scheduled.event.end = FaultEnd::default();
        scheduled.event.effects = Vec::new();
        Some(scheduled.effects.clone())
    }

    /// Returns the step at which a trigger fires for an event admitted before step `next`, if known.
    pub(super) fn hold_of(&self, trigger: &Trigger, next: Step) -> Option<u64> {
        match trigger {
            Trigger::Step { step, .. } => Some(step.0),
            Trigger::Now => Some(next.0),
            Trigger::Condition(_) => None,
            Trigger::After { event, delay_steps } => {
                let other = self.find(*event).filter(|other| other.held)?;
                let hold = other.hold?.saturating_add(*delay_steps);
                Some(if hold < next.0 { next.0 } else { hold })
            }
        }
    }

    /// Returns the event that a trigger follows, if that event ended before it began, so that the trigger would wait
    /// for ever.
    pub(super) fn follows_in_vain(&self, trigger: &Trigger) -> Option<u32> {
        let Trigger::After { event, .. } = trigger else {
            return None;
        };
        let other = self.find(*event)?;
        (other.over && !other.held).then_some(*event)
    }

    fn place_after(&self, id: u32) -> usize {
        self.events.partition_point(|other| other.event.id <= id)
    }

    fn find(&self, id: u32) -> Option<&Scheduled> {
        let place = self.place_after(id).checked_sub(1)?;
        Some(&self.events[place]).filter(|scheduled| scheduled.event.id == id)
    }

    /// Determines the beginnings and ends of a step. `last` is the previous record, for evaluating conditions. Returns
    /// `true` if there are any, which [`changes`](Self::changes) then lists.
    pub(super) fn turn(
        &mut self,
        effects: &mut [Effect],
        step: Step,
        last: Option<&[f64]>,
    ) -> bool {
        if let Some(last) = last
            && !self.watching.is_empty()
        {
            self.watch(step, last);
        }
        if step.0 < self.due {
            return false;
        }
        self.changes.clear();
        self.end_due(effects, step);
        // An event may begin because of one that comes later in the list.
        while self.hold_due(step) {}
        self.begin_due(effects, step);
        self.look_ahead(effects);
        !self.changes.is_empty()
    }

    /// Returns the changes at the last turn, in order.
    pub(super) fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Evaluates the conditions on the record before a step. An end condition is evaluated beginning with the record of
    /// the event's first step.
    fn watch(&mut self, step: Step, last: &[f64]) {
        let before = Step(step.0.saturating_sub(1));
        for &place in &self.watching {
            let scheduled = &mut self.events[place];
            if scheduled.held {
                if let Some(until) = &mut scheduled.until
                    && until.observe(before, last)
                {
                    scheduled.end = Some(step.0);
                    self.due = step.0;
                }
            } else if scheduled.hold.is_none()
                && let Some(when) = &mut scheduled.when
                && when.observe(before, last)
            {
                scheduled.hold = Some(step.0);
                self.due = step.0;
            }
        }
    }

    fn end_due(&mut self, effects: &mut [Effect], step: Step) {
        for &place in &self.living {
            let scheduled = &mut self.events[place];
            let event_ends = scheduled.end.is_some_and(|end| end <= step.0);
            for place in scheduled.effects.clone() {
                let effect = &mut effects[place];
                let ends = event_ends
                    || effect.own_end().is_some_and(|end| end <= step.0)
                    || effect.is_spent();
                if ends {
                    if matches!(effect.life, Life::Acts(_)) {
                        self.changes.push(Change::Ends(place));
                    }
                    effect.end(step);
                }
            }
            let ended = |effect: &Effect| effect.life == Life::Ended;
            scheduled.over = effects[scheduled.effects.clone()].iter().all(ended);
        }
    }

    /// Begins due events; returns `true` if an event was due.
    fn hold_due(&mut self, step: Step) -> bool {
        let mut any = false;
        for at in 0..self.living.len() {
            let place = self.living[at];
            let scheduled = &self.events[place];
            if scheduled.held || scheduled.over {
                continue;
            }
            let hold = match &scheduled.event.trigger {
                trigger @ Trigger::After { .. } if scheduled.hold.is_none() => {
                    self.hold_of(trigger, step)
                }
                _ => scheduled.hold,
            };
            let scheduled = &mut self.events[place];
            scheduled.hold = hold;
            scheduled.held = hold.is_some_and(|hold| hold <= step.0);
            any |= scheduled.held;
        }
        any
    }

    fn begin_due(&mut self, effects: &mut [Effect], step: Step) {
        for &place in &self.living {
            let scheduled = &self.events[place];
            for place in scheduled.effects.clone() {
                let due = scheduled.begin_of(&effects[place]);
                if due.is_some_and(|due| due <= step.0) {
                    effects[place].hold(step);
                    self.changes.push(Change::Begins(place));
                }
            }
        }
    }

    /// Determines the next step at which a beginning or end is due.
    pub(super) fn look_ahead(&mut self, effects: &[Effect]) {
        (self.due, self.counting) = (NEVER, false);
        self.watching.clear();
        self.bury();
        self.living_effects = 0;
        for &place in &self.living {
            let scheduled = &self.events[place];
            self.living_effects += scheduled.effects.len();
            let waits = scheduled.hold.is_none() && scheduled.when.is_some();
            if waits || scheduled.until.is_some() {
                self.watching.push(place);
            }
            // An event that follows this one gets its step then.
            let hold = scheduled.hold.filter(|_| !scheduled.held);
            let mut due = earlier(hold, scheduled.end);
            for effect in &effects[scheduled.effects.clone()] {
                if effect.life != Life::Ended {
                    due = earlier(due, earlier(scheduled.begin_of(effect), effect.own_end()));
                    self.counting |= effect.is_counted();
                }
            }
            self.due = earlier(due, Some(self.due)).unwrap_or(NEVER);
        }
    }

    /// Moves ended events out of the list of living events; there is room for all of them.
    fn bury(&mut self) {
        let (events, over) = (&self.events, &mut self.over);
        self.living.retain(|place| {
            let lives = !events[*place].over;
            if !lives {
                over.push(*place);
            }
            lives
        });
    }

    /// Ends effects that have completed their maximum number of occurrences, from the next step on.
    pub(super) fn count(&mut self, effects: &[Effect], step: Step) {
        let spent = |effect: &Effect| effect.life != Life::Ended && effect.is_spent();
        let mut living = self.living.iter();
        let effects_of = |place: &usize| effects[self.events[*place].effects.clone()].iter();
        if self.counting && living.any(|place| effects_of(place).any(spent)) {
            self.due = step.0 + 1;
        }
    }

    /// Ends one or all events from a step on, including waiting ones; returns their numbers.
    pub(super) fn clear(
        &mut self,
        effects: &mut [Effect],
        id: Option<u32>,
        step: Step,
    ) -> Vec<u32> {
        self.changes.clear();
        let mut cleared = Vec::new();
        for &place in &self.living {
            let scheduled = &mut self.events[place];
            let number = scheduled.event.id;
            if id.is_some_and(|id| id != number) {
                continue;
            }
            cleared.push(number);
            for place in scheduled.effects.clone() {
                if effects[place].life != Life::Ended {
                    effects[place].end(step);
                    self.changes.push(Change::Ends(place));
                }
            }
            scheduled.over = true;
        }
        self.look_ahead(effects);
        cleared
    }

    /// Lists every event by its number.
    pub(super) fn states(&self, effects: &[Effect]) -> Vec<FaultState> {
        let state = |scheduled: &Scheduled| {
            let effects = &effects[scheduled.effects.clone()];
            let acts = |effect: &Effect| matches!(effect.life, Life::Acts(_));
            let state = if scheduled.over {
                "ended"
            } else if effects.iter().any(acts) {
                "active"
            } else {
                "waiting"
            };
            FaultState {
                id: scheduled.event.id,
                kind: scheduled.event.kind.clone(),
                source: match scheduled.event.source {
                    FaultSource::Scenario => "scenario".into(),
                    FaultSource::Cli => "cli".into(),
                },
                state: state.into(),
                waits_for: (state == "waiting").then(|| self.waits_for(scheduled, effects)),
                effects: effects.iter().map(|effect| effect.size().clone()).collect(),
            }
        };
        self.events.iter().map(state).collect()
    }

    /// Describes the step, event or condition that an event waits for.
    fn waits_for(&self, scheduled: &Scheduled, effects: &[Effect]) -> String {
        let trigger = &scheduled.event.trigger;
        let begins = effects
            .iter()
            .filter_map(|effect| scheduled.begin_of(effect));
        match (begins.min(), self.follows_in_vain(trigger)) {
            (Some(step), _) => format!("step {step}"),
            (None, Some(other)) => format!("fault {other}, which ended before it took effect"),
            (None, None) => waits_for(trigger),
        }
    }
}

impl Scheduled {
    fn begin_of(&self, effect: &Effect) -> Option<u64> {
        let waits = effect.life == Life::Waits;
        let hold = self.hold.filter(|_| waits)?;
        Some(hold.saturating_add(effect.skew_steps))
    }
}

/// Describes the step, event or condition that a trigger waits for.
pub(super) fn waits_for(trigger: &Trigger) -> String {
    match trigger {
        Trigger::Step { step, .. } => format!("step {step}"),
        Trigger::Now => "the next step".into(),
        Trigger::Condition(Condition {
            expression,
            records,
        }) => match records {
            0 | 1 => format!("`{expression}` to hold"),
            _ => format!("`{expression}` to hold for {records} consecutive records"),
        },
        Trigger::After { event, delay_steps } => match delay_steps {
            0 => format!("fault {event} to take effect"),
            _ => format!("{delay_steps} steps after fault {event} takes effect"),
        },
    }
}

fn earlier(one: Option<u64>, other: Option<u64>) -> Option<u64> {
    [one, other].into_iter().flatten().min()
}
