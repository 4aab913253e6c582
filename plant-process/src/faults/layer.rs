//! The fault layer: every fault of a run, around the plant and the link.
//!
//! Called by the engine at each step, in this order: [`advance`](FaultLayer::advance) begins and
//! ends faults and moves parameters, [`sample`](FaultLayer::sample) makes of what was measured what
//! the controller gets, [`timing`](FaultLayer::timing) tells who is late, and
//! [`command`](FaultLayer::command) makes of what the controller sent what is applied. Models and
//! laws know nothing of it.
//!
//! Effects on one target act in the order in which they took hold: by step, then number of the
//! event, then place in the event. Each acts on what the one before left, and its size is what it
//! changed there.

use std::collections::VecDeque;

use hil_config::expression::{Columns, Group};
use hil_config::plan::{Condition, FaultEvent, FaultSource, Trigger};
use shared_types::describe::Invalid;
use shared_types::directive::Directive;
use shared_types::frame::{Header, VALIDITY_WORDS};
use shared_types::live::FaultState;
use shared_types::record::{Event, FaultEffectSize, FaultEnded, RecordLayout};
use shared_types::time::{Rate, Step};

use super::channel::{Channel, Message};
use super::effect::{Action, Direction, Effect, Life, Side, kept, moved};
use super::kind::{Passage, Reading};
use super::workshop::{FaultWorkshop, Prepared};

/// A step that never comes.
const NEVER: u64 = u64::MAX;

/// The faults of a run.
pub struct FaultLayer {
    parameters: Parameters,
    rate: Rate,
    seed: u64,
    /// The scenario's, until the columns of a record are known.
    scenario: Vec<FaultEvent>,
    events: Vec<Running>,
    /// The first step at which an event or effect begins or ends by its number.
    due: u64,
    /// Whether an event waits for or ends by a condition.
    watching: bool,
    acting: Acting,
    sample: Lane,
    command: Lane,
    /// Commands as they were applied last.
    applied: Vec<f64>,
    /// Whether an event ends by what it did.
    counting: bool,
    told: VecDeque<Event>,
}

/// An event and its effects.
struct Running {
    prepared: Prepared,
    /// The step at which it takes hold, once that is known.
    hold: Option<u64>,
}

/// The effects that act, each in the order in which it took hold, by event and place in it.
#[derive(Default)]
struct Acting {
    parameter: Vec<(usize, usize)>,
    sample: Vec<(usize, usize)>,
    command: Vec<(usize, usize)>,
    sample_link: Vec<(usize, usize)>,
    command_link: Vec<(usize, usize)>,
    timing: Vec<(usize, usize)>,
}

/// The plant's parameters.
struct Parameters {
    fields: Vec<shared_types::table::Field>,
    healthy: Vec<f64>,
    present: Vec<f64>,
    before: Vec<f64>,
    /// An effect on them ended: they must be made anew.
    stale: bool,
}

/// One direction: what was sent last, and the medium.
struct Lane {
    sent: Vec<f64>,
    invalid: [u64; VALIDITY_WORDS],
    age_steps: u32,
    any: bool,
    channel: Channel,
}

/// A live fault that was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Admitted {
    /// Its number.
    pub id: u32,
    /// Its kind.
    pub kind: String,
    /// The step at which it takes hold, if that is known.
    pub step: Option<Step>,
    /// What it waits for, if not.
    pub waits_for: Option<String>,
}

impl FaultLayer {
    /// The faults of a scenario.
    ///
    /// # Errors
    /// If one of them cannot be.
    pub fn new(workshop: &FaultWorkshop, events: &[FaultEvent]) -> Result<Self, Invalid> {
        for event in events {
            workshop.effects(event)?;
        }
        Ok(Self {
            parameters: Parameters {
                fields: workshop.parameters.clone(),
                healthy: workshop.healthy.clone(),
                present: workshop.healthy.clone(),
                before: workshop.healthy.clone(),
                stale: false,
            },
            rate: workshop.rate,
            seed: workshop.seed,
            scenario: events.to_vec(),
            events: Vec::new(),
            due: NEVER,
            watching: false,
            acting: Acting::default(),
            sample: Lane::new(workshop.sample_width()),
            command: Lane::new(workshop.commands()),
            applied: vec![0.0; workshop.commands()],
            counting: false,
            told: VecDeque::new(),
        })
    }

    /// Arms the scenario's faults, now that it is known what a record holds.
    ///
    /// # Errors
    /// If a condition names a signal that there is not.
    pub fn open(&mut self, workshop: &FaultWorkshop, layout: &RecordLayout) -> Result<(), Invalid> {
        let columns = columns(layout);
        for event in std::mem::take(&mut self.scenario) {
            let prepared = workshop.prepare(event, &columns)?;
            self.arm(prepared, Step(0));
        }
        Ok(())
    }

    /// Brings the faults to a step: begins and ends them and moves the plant's parameters. True if
    /// a parameter changed. `last` is the record before, which conditions are asked of.
    pub fn advance(&mut self, step: Step, last: Option<&[f64]>) -> bool {
        if self.watching
            && let Some(last) = last
        {
            self.watch(step.0, last);
        }
        if step.0 >= self.due {
            self.end_due(step);
            self.begin_due(step);
            self.look_ahead();
        }
        let moving = !self.acting.parameter.is_empty() || self.parameters.stale;
        moving && self.move_parameters(step)
    }

    /// The plant's parameters as they act.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        &self.parameters.present
    }

    /// Writes the faultable ones of them.
    pub fn faultable(&self, row: &mut [f64]) {
        let Parameters {
            fields, present, ..
        } = &self.parameters;
        let faultable = fields
            .iter()
            .zip(present)
            .filter(|(field, _)| field.faultable);
        for (to, (_, value)) in row.iter_mut().zip(faultable) {
            *to = *value;
        }
    }

    /// Makes of the healthy measured and reference signals what the controller gets; gives its age
    /// in steps.
    pub fn sample(
        &mut self,
        step: Step,
        (sensed, stimulus): (&[f64], &[f64]),
        row: &mut [f64],
        invalid: &mut [u64; VALIDITY_WORDS],
    ) -> u32 {
        let (measured, reference) = row.split_at_mut(sensed.len());
        measured.copy_from_slice(sensed);
        reference.copy_from_slice(stimulus);
        *invalid = [0; VALIDITY_WORDS];
        for &(event, effect) in &self.acting.sample {
            let effect = &mut self.events[event].prepared.effects[effect];
            let last = self.sample.any.then_some(&self.sample.sent[..]);
            strike(effect, step, self.rate, (row, invalid), last);
        }
        let links = &self.acting.sample_link;
        if links.is_empty() {
            self.sample.note(row, invalid, 0);
            return 0;
        }
        pass(
            &mut self.events,
            links,
            step,
            self.rate,
            &mut self.sample,
            (row, invalid, 0),
        )
    }

    /// What the controller is told to do with its time, and how long the plant is busy, in ns.
    pub fn timing(&mut self, step: Step) -> (Directive, u64) {
        let (mut directive, mut plant_ns) = (Directive::default(), 0);
        for &(event, effect) in &self.acting.timing {
            let effect = &mut self.events[event].prepared.effects[effect];
            let at = effect.moment(step, self.rate);
            let before = directive;
            let mut acted = false;
            match &mut effect.action {
                Action::Timing(fault) => {
                    fault.timing(&at, &mut directive);
                    acted = directive != before;
                }
                Action::Busy(side, fault) => {
                    let mut busy = Directive::default();
                    fault.timing(&at, &mut busy);
                    acted = busy.busy_ns > 0;
                    match side {
                        Side::Controller => {
                            directive.busy_ns = directive.busy_ns.saturating_add(busy.busy_ns);
                        }
                        Side::Plant => plant_ns += u64::from(busy.busy_ns),
                    }
                }
                _ => {}
            }
            effect.note(acted, 0.0);
        }
        (directive, plant_ns)
    }

    /// The plant was busy for so long.
    pub fn plant_was_busy(&mut self, busy_ns: u64) {
        for &(event, effect) in &self.acting.timing {
            let effect = &mut self.events[event].prepared.effects[effect];
            if matches!(effect.action, Action::Busy(Side::Plant, _)) && effect.is_acting() {
                effect.grow(busy_ns as f64);
            }
        }
    }

    /// Makes of the commands that the controller sent what is applied; gives its age in steps.
    pub fn command(
        &mut self,
        step: Step,
        header: &Header,
        command: &[f64],
        applied: &mut [f64],
    ) -> u32 {
        applied.copy_from_slice(command);
        if !self.acting.timing.is_empty() {
            self.note_timing(header);
        }
        let mut invalid = [0; VALIDITY_WORDS];
        let mut age_steps = header.age_steps;
        let links = &self.acting.command_link;
        if links.is_empty() {
            self.command.note(command, &invalid, age_steps);
        } else {
            let message = (&mut *applied, &mut invalid, age_steps);
            age_steps = pass(
                &mut self.events,
                links,
                step,
                self.rate,
                &mut self.command,
                message,
            );
        }
        for &(event, effect) in &self.acting.command {
            let effect = &mut self.events[event].prepared.effects[effect];
            strike(
                effect,
                step,
                self.rate,
                (applied, &mut invalid),
                Some(&self.applied),
            );
        }
        // What drives a valve holds the last current that was good.
        if invalid != [0; VALIDITY_WORDS] {
            for (index, value) in applied.iter_mut().enumerate() {
                if is_invalid(&invalid, index) {
                    *value = self.applied[index];
                }
            }
        }
        self.applied.copy_from_slice(applied);
        if self.counting {
            self.finish_occurrences(step);
        }
        age_steps
    }

    /// Whether there is something to tell observers.
    #[must_use]
    pub fn has_events(&self) -> bool {
        !self.told.is_empty()
    }

    /// What took hold or ended, in its order.
    pub fn next_event(&mut self) -> Option<Event> {
        self.told.pop_front()
    }

    /// Takes live faults before a step, all or none.
    ///
    /// # Errors
    /// If one of them should have taken hold in the past.
    pub fn admit(
        &mut self,
        prepared: Vec<Box<Prepared>>,
        next: Step,
    ) -> Result<Vec<Admitted>, String> {
        for fault in &prepared {
            let hold = self.hold_of(&fault.event.trigger, next);
            if let Some(step) = hold.filter(|&step| step < next.0) {
                let (at_s, next_s) = (self.rate.seconds(Step(step)), self.rate.seconds(next));
                return Err(format!(
                    "step {step} ({at_s} s) is past: the run is at step {next} ({next_s} s)"
                ));
            }
        }
        Ok((prepared.into_iter())
            .map(|prepared| {
                let (id, kind) = (prepared.event.id, prepared.event.kind.clone());
                let waits_for = waits_for(&prepared.event.trigger);
                let step = self.arm(*prepared, next);
                Admitted {
                    id,
                    kind,
                    waits_for: step.is_none().then_some(waits_for),
                    step,
                }
            })
            .collect())
    }

    /// Ends a fault or all of them from a step on, also those that wait; gives their numbers.
    pub fn clear(&mut self, id: Option<u32>, next: Step) -> Vec<u32> {
        let mut cleared = Vec::new();
        for event in 0..self.events.len() {
            let number = self.events[event].prepared.event.id;
            if id.is_some_and(|id| id != number) || !self.events[event].is_open() {
                continue;
            }
            cleared.push(number);
            for effect in 0..self.events[event].prepared.effects.len() {
                self.end(event, effect, next, true);
            }
        }
        self.look_ahead();
        cleared
    }

    /// Every fault, in the order of their numbers.
    #[must_use]
    pub fn states(&self) -> Vec<FaultState> {
        let state = |running: &Running| {
            let Prepared { event, effects, .. } = &running.prepared;
            let acts = effects.iter().any(|effect| effect.life == Life::Acts);
            let waits = !acts && running.is_open();
            FaultState {
                id: event.id,
                kind: event.kind.clone(),
                source: match event.source {
                    FaultSource::Scenario => "scenario".into(),
                    FaultSource::Cli => "cli".into(),
                },
                state: match (acts, waits) {
                    (true, _) => "active".into(),
                    (_, true) => "waiting".into(),
                    _ => "ended".into(),
                },
                waits_for: waits.then(|| match running.hold {
                    Some(step) => format!("step {step}"),
                    None => waits_for(&event.trigger),
                }),
                effects: effects.iter().map(Effect::size).collect(),
            }
        };
        self.events.iter().map(state).collect()
    }

    /// What became of each effect.
    #[must_use]
    pub fn effects(&self) -> Vec<FaultEffectSize> {
        let effects = self
            .events
            .iter()
            .flat_map(|running| &running.prepared.effects);
        effects.map(Effect::size).collect()
    }

    /// Frames that were corrupted on purpose and refused by their check sum.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.sample.channel.rejected() + self.command.channel.rejected()
    }

    /// The step at which a trigger takes hold, if it is known.
    fn hold_of(&self, trigger: &Trigger, next: Step) -> Option<u64> {
        match trigger {
            Trigger::Step { step, .. } => Some(step.0),
            Trigger::Now => Some(next.0),
            Trigger::Condition(_) => None,
            Trigger::After { event, delay_steps } => {
                let other = (self.events.iter()).find(|other| other.prepared.event.id == *event)?;
                let begun = other.hold.filter(|&hold| hold < next.0);
                begun.map(|hold| hold + delay_steps)
            }
        }
    }

    fn arm(&mut self, prepared: Prepared, next: Step) -> Option<Step> {
        let hold = self.hold_of(&prepared.event.trigger, next);
        self.events.push(Running { prepared, hold });
        self.look_ahead();
        hold.map(Step)
    }

    /// Asks the conditions about the record before this step.
    fn watch(&mut self, step: u64, last: &[f64]) {
        for running in &mut self.events {
            if !running.is_open() {
                continue;
            }
            if running.hold.is_none()
                && let Some(when) = &mut running.prepared.when
                && when.observe(last)
            {
                running.hold = Some(step);
                self.due = step;
            } else if running.hold.is_some_and(|hold| hold < step)
                && let Some(until) = &mut running.prepared.until
                && until.observe(last)
            {
                running.prepared.event.end.step = Some(Step(step));
                self.due = step;
            }
        }
    }

    fn end_due(&mut self, step: Step) {
        for event in 0..self.events.len() {
            for effect in 0..self.events[event].prepared.effects.len() {
                if self.events[event]
                    .end_of(effect)
                    .is_some_and(|end| end <= step.0)
                {
                    self.end(event, effect, step, false);
                }
            }
        }
    }

    fn end(&mut self, event: usize, effect: usize, step: Step, cleared: bool) {
        let ended = &mut self.events[event].prepared.effects[effect];
        let acts = ended.life == Life::Acts;
        // Who repeats the run must know also of what was cleared before it took hold.
        if acts || (cleared && ended.life == Life::Waits) {
            self.told.push_back(Event::FaultEnded(FaultEnded {
                id: ended.taken.id,
                effect: ended.taken.effect,
                step: step.0,
                cleared,
            }));
        }
        if acts {
            let list = self.acting.list_of(&ended.action);
            list.retain(|&acting| acting != (event, effect));
            self.parameters.stale |=
                matches!(ended.action, Action::Move(_) | Action::Parameter(..));
        }
        ended.end(step);
        let running = &mut self.events[event];
        if !running.is_open() && !running.has_held() {
            running.hold = None; // what follows it waits for ever
        }
    }

    fn begin_due(&mut self, step: Step) {
        // An event may begin another that comes before it in the list: again until nothing begins.
        while self.begin_events(step) {}
        for event in 0..self.events.len() {
            let Some(hold) = self.events[event].hold else {
                continue;
            };
            for effect in 0..self.events[event].prepared.effects.len() {
                let waiting = &self.events[event].prepared.effects[effect];
                if waiting.life == Life::Waits && hold + waiting.skew_steps <= step.0 {
                    self.begin(event, effect, step);
                }
            }
        }
    }

    /// Gives a step to the events that follow others; true if there was one.
    fn begin_events(&mut self, step: Step) -> bool {
        let mut any = false;
        for event in 0..self.events.len() {
            let Trigger::After {
                event: other,
                delay_steps,
            } = self.events[event].prepared.event.trigger
            else {
                continue;
            };
            if self.events[event].hold.is_some() || !self.events[event].is_open() {
                continue;
            }
            let other = (self.events.iter()).find(|found| found.prepared.event.id == other);
            let hold = other.and_then(|other| other.hold);
            if let Some(hold) = hold.filter(|&hold| hold <= step.0) {
                self.events[event].hold = Some(hold + delay_steps);
                any = true;
            }
        }
        any
    }

    fn begin(&mut self, event: usize, effect: usize, step: Step) {
        let same = |one: &Effect, other: &Effect| {
            let (one, other) = (&one.taken, &other.taken);
            (&one.kind, &one.target) == (&other.kind, &other.target)
        };
        let beginning = &self.events[event].prepared.effects[effect];
        let acting = self
            .events
            .iter()
            .flat_map(|running| &running.prepared.effects);
        let ordinal = acting
            .filter(|other| other.life == Life::Acts && other.taken.step == step.0)
            .filter(|other| same(other, beginning))
            .count();
        let beginning = &mut self.events[event].prepared.effects[effect];
        beginning.hold(step, self.seed, ordinal);
        self.told.push_back(Event::Fault(beginning.taken.clone()));
        let list = self.acting.list_of(&beginning.action);
        if list.is_empty() {
            match beginning.action {
                Action::Link(Direction::Sample, _) => self.sample.begin(step),
                Action::Link(Direction::Command, _) => self.command.begin(step),
                _ => {}
            }
        }
        list.push((event, effect));
    }

    /// Ends effects that have acted as often as they should.
    fn finish_occurrences(&mut self, step: Step) {
        for list in self.acting.all() {
            for &(event, effect) in list {
                let Prepared { event, effects, .. } = &self.events[event].prepared;
                let wanted = event.end.occurrences;
                if wanted.is_some_and(|wanted| effects[effect].occurrences() >= wanted) {
                    self.due = step.0 + 1;
                }
            }
        }
    }

    /// Finds the next step at which something begins or ends by its number.
    fn look_ahead(&mut self) {
        let open = self.events.iter().filter(|running| running.is_open());
        (self.due, self.watching, self.counting) = (NEVER, false, false);
        for running in open {
            let event = &running.prepared.event;
            self.watching |= running.prepared.until.is_some()
                || (running.prepared.when.is_some() && running.hold.is_none());
            for (number, effect) in running.prepared.effects.iter().enumerate() {
                let begin = match (effect.life, running.hold) {
                    (Life::Waits, Some(hold)) => Some(hold + effect.skew_steps),
                    _ => None,
                };
                let end = running.end_of(number);
                for step in [begin, end].into_iter().flatten() {
                    self.due = self.due.min(step);
                }
            }
            self.counting |= event.end.occurrences.is_some();
            if let (Trigger::After { event, .. }, None) = (&event.trigger, running.hold) {
                let other = (self.events.iter()).find(|other| other.prepared.event.id == *event);
                if let Some(hold) = other.and_then(|other| other.hold) {
                    self.due = self.due.min(hold);
                }
            }
        }
    }

    fn move_parameters(&mut self, step: Step) -> bool {
        let Parameters {
            fields,
            healthy,
            present,
            before,
            stale,
        } = &mut self.parameters;
        *stale = false;
        before.copy_from_slice(present);
        present.copy_from_slice(healthy);
        for &(event, effect) in &self.acting.parameter {
            let effect = &mut self.events[event].prepared.effects[effect];
            let at = effect.moment(step, self.rate);
            let (mut acted, mut change) = (false, 0.0);
            match &mut effect.action {
                Action::Move(moves) => {
                    for (place, &mut (index, operation, by)) in moves.iter_mut().enumerate() {
                        let value = present[index];
                        present[index] = moved(&fields[index], operation, value, by, at.gain);
                        acted |= present[index] != value;
                        if place == 0 {
                            change = (present[index] - value).abs();
                        }
                    }
                }
                Action::Parameter(index, fault) => {
                    let value = present[*index];
                    let reading = fault.number(&at, Reading { value, valid: true });
                    present[*index] = kept(&fields[*index], value, reading.value);
                    change = (present[*index] - value).abs();
                    acted = change > 0.0;
                }
                _ => {}
            }
            effect.note(acted, change);
        }
        *present != *before
    }

    /// What the answer tells of how late the controller was.
    fn note_timing(&mut self, header: &Header) {
        for &(event, effect) in &self.acting.timing {
            let effect = &mut self.events[event].prepared.effects[effect];
            match effect.action {
                Action::Busy(Side::Controller, _) if effect.is_acting() => {
                    effect.grow(header.work_ns as f64);
                }
                Action::Timing(..) => effect.grow(f64::from(header.age_steps)),
                _ => {}
            }
        }
    }
}

impl Running {
    fn is_open(&self) -> bool {
        let effects = &self.prepared.effects;
        effects.iter().any(|effect| effect.life != Life::Ended)
    }

    fn has_held(&self) -> bool {
        let effects = &self.prepared.effects;
        effects.iter().any(|effect| effect.size().step.is_some())
    }

    /// The step at which an effect ends, if it is known.
    fn end_of(&self, effect: usize) -> Option<u64> {
        let Prepared { event, effects, .. } = &self.prepared;
        let effect = &effects[effect];
        if effect.life == Life::Ended {
            return None;
        }
        let at_step = event.end.step.map(|step| step.0);
        if effect.life == Life::Waits {
            // Over before it took hold.
            return at_step;
        }
        let after = event.end.after_steps.map(|steps| effect.taken.step + steps);
        let done = event
            .end
            .occurrences
            .is_some_and(|wanted| effect.occurrences() >= wanted);
        let done = done.then_some(0);
        [at_step, after, done].into_iter().flatten().min()
    }
}

impl Acting {
    fn list_of(&mut self, action: &Action) -> &mut Vec<(usize, usize)> {
        match action {
            Action::Move(_) | Action::Parameter(..) => &mut self.parameter,
            Action::Sample(..) => &mut self.sample,
            Action::Command(..) => &mut self.command,
            Action::Link(Direction::Sample, _) => &mut self.sample_link,
            Action::Link(Direction::Command, _) => &mut self.command_link,
            Action::Timing(..) | Action::Busy(..) => &mut self.timing,
        }
    }

    fn all(&self) -> [&[(usize, usize)]; 6] {
        [
            &self.parameter,
            &self.sample,
            &self.command,
            &self.sample_link,
            &self.command_link,
            &self.timing,
        ]
    }
}

impl Lane {
    fn new(width: usize) -> Self {
        Self {
            sent: vec![0.0; width],
            invalid: [0; VALIDITY_WORDS],
            age_steps: 0,
            any: false,
            channel: Channel::new(width),
        }
    }

    /// Notes what was sent.
    fn note(&mut self, values: &[f64], invalid: &[u64; VALIDITY_WORDS], age_steps: u32) {
        self.sent.copy_from_slice(values);
        self.invalid = *invalid;
        self.age_steps = age_steps;
        self.any = true;
    }

    /// A fault of the link takes hold: until now what was sent was received.
    fn begin(&mut self, step: Step) {
        let last = Message {
            values: &self.sent,
            invalid: &self.invalid,
            age_steps: self.age_steps,
        };
        self.channel.begin(step.0, self.any.then_some(&last));
    }
}

fn is_invalid(invalid: &[u64; VALIDITY_WORDS], index: usize) -> bool {
    invalid[index / 64] >> (index % 64) & 1 == 1
}

/// Lets a fault act on one signal. An invalid or impossible value gives way to the last good one,
/// if there is one.
fn strike(
    effect: &mut Effect,
    step: Step,
    rate: Rate,
    (row, invalid): (&mut [f64], &mut [u64; VALIDITY_WORDS]),
    last: Option<&[f64]>,
) {
    let at = effect.moment(step, rate);
    let (Action::Sample(index, fault) | Action::Command(index, fault)) = &mut effect.action else {
        return;
    };
    let index = *index;
    let before = Reading {
        value: row[index],
        valid: !is_invalid(invalid, index),
    };
    let mut after = fault.number(&at, before);
    after.valid &= after.value.is_finite();
    if !after.valid {
        after.value = last.map_or(before.value, |last| last[index]);
        invalid[index / 64] |= 1 << (index % 64);
    }
    row[index] = after.value;
    effect.note(after != before, (after.value - before.value).abs());
}

/// Sends a message through the faults of a link and takes what the receiver has after it.
fn pass(
    events: &mut [Running],
    links: &[(usize, usize)],
    step: Step,
    rate: Rate,
    lane: &mut Lane,
    (row, invalid, age_steps): (&mut [f64], &mut [u64; VALIDITY_WORDS], u32),
) -> u32 {
    let mut passage = Passage::healthy(lane.channel.bits());
    for &(event, effect) in links {
        let effect = &mut events[event].prepared.effects[effect];
        let at = effect.moment(step, rate);
        let before = passage;
        if let Action::Link(_, fault) = &mut effect.action {
            fault.message(&at, &mut passage);
        }
        effect.note(passage != before, 0.0);
    }
    lane.note(row, invalid, age_steps);
    let message = Message {
        values: &lane.sent,
        invalid,
        age_steps,
    };
    lane.channel.send(step.0, &message, &passage);
    let received_age_steps = lane.channel.receive(step.0, row, invalid);
    let added_steps = received_age_steps.saturating_sub(age_steps);
    for &(event, effect) in links {
        let effect = &mut events[event].prepared.effects[effect];
        effect.grow(f64::from(added_steps));
    }
    received_age_steps
}

/// What a trigger waits for, in words.
fn waits_for(trigger: &Trigger) -> String {
    match trigger {
        Trigger::Step { step, .. } => format!("step {step}"),
        Trigger::Now => "the next step".into(),
        Trigger::Condition(Condition {
            expression,
            records,
        }) => format!("`{expression}` to hold for {records} records"),
        Trigger::After { event, delay_steps } => {
            format!("fault {event} and {delay_steps} steps more")
        }
    }
}

/// The columns of a record.
#[must_use]
pub fn columns(layout: &RecordLayout) -> Columns {
    let mut columns = Columns::default();
    for (group, fields) in Group::ALL.into_iter().zip(layout.groups()) {
        columns.push_fields(group, fields);
    }
    columns
}
