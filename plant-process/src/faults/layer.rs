//! The fault layer: every fault of a run, around the plant and the link.
//!
//! Called by the engine at each step, in this order: [`advance`](FaultLayer::advance) begins and
//! ends faults and moves parameters, [`sample`](FaultLayer::sample) makes of what was measured what
//! the controller gets, [`timing`](FaultLayer::timing) tells who is late, and
//! [`command`](FaultLayer::command) makes of what the controller sent what is applied. None of these
//! allocates. Models and laws know nothing of it.
//!
//! Effects on one target act in the order in which they took hold: by step, then number of the
//! event, then place in the event. Each acts on what the one before left, and its size is what it
//! changed there.

use std::collections::VecDeque;

use hil_config::expression::Columns;
use hil_config::plan::FaultEvent;
use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::directive::Directive;
use shared_types::frame::{FrameKind, VALIDITY_WORDS};
use shared_types::live::FaultState;
use shared_types::record::{Event, FaultEffectSize, FaultEnded, RecordLayout};
use shared_types::time::{Rate, Step};

use super::builder::{ArmedFault, FaultBuilder};
use super::effect::{Action, Direction, Effect, SavedEffect};
use super::parameters::{Parameters, SavedParameters};
use super::schedule::{Change, SavedEvent, Schedule, waits_for};
use super::signal_path::{SavedPath, SignalPath};
use super::timing::Timing;

/// Ended faults that are let go of for each that is taken.
const MOST_RETIRED: usize = 4;

/// The faults of a run.
pub struct FaultLayer {
    rate: Rate,
    seed: u64,
    /// The scenario's, until the columns of a record are known.
    scenario: Vec<FaultEvent>,
    schedule: Schedule,
    /// The effects of all events that are armed, in the order in which these were.
    effects: Vec<Effect>,
    targets: Targets,
    told: VecDeque<Event>,
    /// Room for the path of a random stream.
    path: String,
}

/// The state of all faults between two steps.
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedFaults {
    events: Vec<SavedEvent>,
    /// In the order in which their events were armed.
    effects: Vec<SavedEffect>,
    parameters: SavedParameters,
    sample: SavedPath,
    command: SavedPath,
    timing: Vec<usize>,
}

impl SavedFaults {
    /// The plant's parameters as they acted.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.parameters.row()
    }
}

/// Targets of effects, each with the effects that act on it.
struct Targets {
    parameters: Parameters,
    sample: SignalPath,
    command: SignalPath,
    timing: Timing,
}

/// A live fault that was taken.
#[derive(Clone, Debug, PartialEq)]
pub struct Admitted {
    /// Number.
    pub id: u32,
    /// Kind.
    pub kind: String,
    /// The step at which it takes hold, if that is known.
    pub step: Option<Step>,
    /// Event or condition that the fault waits for, if the step is not known.
    pub waits_for: Option<String>,
}

impl FaultLayer {
    /// The faults of a scenario.
    ///
    /// # Errors
    /// If one of them cannot be.
    pub fn new(builder: &FaultBuilder, events: &[FaultEvent]) -> Result<Self, Invalid> {
        for event in events {
            builder.effects(event)?;
        }
        Ok(Self {
            rate: builder.rate,
            seed: builder.seed,
            scenario: events.to_vec(),
            schedule: Schedule::default(),
            effects: Vec::new(),
            targets: Targets {
                parameters: Parameters::new(&builder.parameters, &builder.healthy),
                sample: SignalPath::new(builder.sample_width(), FrameKind::Sample),
                command: SignalPath::new(builder.commands(), FrameKind::Command),
                timing: Timing::default(),
            },
            told: VecDeque::new(),
            path: String::new(),
        })
    }

    /// The state of all faults. Call it between two steps, when observers have been told everything.
    ///
    /// # Errors
    /// If a fault that acts cannot save its state.
    pub fn save(&mut self) -> Result<SavedFaults, Invalid> {
        Ok(SavedFaults {
            events: self.schedule.save(),
            effects: (self.effects.iter_mut().map(Effect::save)).collect::<Result<_, _>>()?,
            parameters: self.targets.parameters.save(),
            sample: self.targets.sample.save(),
            command: self.targets.command.save(),
            timing: self.targets.timing.stack().clone(),
        })
    }

    /// Puts a state back; the events that it is of are armed, in the order in which they were.
    ///
    /// # Errors
    /// If it is not one of these faults.
    pub fn restore(&mut self, saved: SavedFaults) -> Result<(), Invalid> {
        restore_effects(&mut self.effects, &saved.effects)?;
        self.schedule.restore(&saved.events, &self.effects)?;
        let targets = &mut self.targets;
        targets.parameters.restore(saved.parameters)?;
        targets.sample.restore(saved.sample)?;
        targets.command.restore(saved.command)?;
        targets.timing.restore(&saved.timing);
        Ok(())
    }

    /// Looks whether a state is one of these faults, before there is a layer of them.
    ///
    /// # Errors
    /// Why it is not.
    pub fn check(
        builder: &FaultBuilder,
        events: &[FaultEvent],
        saved: &SavedFaults,
    ) -> Result<(), Invalid> {
        let mut effects = Vec::new();
        for event in events {
            effects.extend(builder.effects(event)?);
        }
        restore_effects(&mut effects, &saved.effects)?;
        Parameters::new(&builder.parameters, &builder.healthy).check(&saved.parameters)
    }

    /// Arms the scenario's faults, now that it is known what a record holds.
    ///
    /// # Errors
    /// If a condition names a signal that there is not.
    pub fn open(&mut self, builder: &FaultBuilder, layout: &RecordLayout) -> Result<(), Invalid> {
        let columns = Columns::from(layout);
        for event in std::mem::take(&mut self.scenario) {
            let armed = builder.build(event, &columns)?;
            self.arm(armed, Step(0));
        }
        self.schedule.look_ahead(&self.effects);
        Ok(())
    }

    /// Brings the faults to a step: begins and ends them and moves the plant's parameters. True if
    /// a parameter changed. `last` is the record before, which conditions are asked of.
    pub fn advance(&mut self, step: Step, last: Option<&[f64]>) -> bool {
        if self.schedule.turn(&mut self.effects, step, last) {
            self.follow(step, false);
        }
        let (effects, rate) = (&mut self.effects, self.rate);
        self.targets.parameters.advance(effects, step, rate)
    }

    /// Gives a parameter of the plant another base, on which faults act; ahead of [`advance`](Self::advance).
    pub fn rebase(&mut self, index: usize, value: f64) {
        self.targets.parameters.rebase(index, value);
    }

    /// The plant's parameters as they act.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.targets.parameters.row()
    }

    /// Writes the faultable ones of them.
    pub fn faultable(&self, row: &mut [f64]) {
        for (to, value) in row.iter_mut().zip(self.targets.parameters.faultable()) {
            *to = value;
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
        let (path, effects, rate) = (&mut self.targets.sample, &mut self.effects, self.rate);
        path.apply_signal_faults(effects, step, rate, (row, invalid));
        path.apply_link_faults(effects, step, rate, (row, invalid), 0)
    }

    /// Returns what the controller is to do with its time, and how long the plant is to be busy, in ns.
    pub fn timing(&mut self, step: Step) -> (Directive, u64) {
        self.targets.timing.ask(&mut self.effects, step, self.rate)
    }

    /// The plant was busy for so long.
    pub fn plant_was_busy(&mut self, busy_ns: u64) {
        let timing = &self.targets.timing;
        timing.plant_was_busy(&mut self.effects, busy_ns);
    }

    /// Makes of the commands that the controller sent what is applied; gives its age in steps. `age_steps`
    /// is their age as this step meets them, `work_ns` the controller's work on them.
    /// `invalid` are the bits of these commands, as they were sent and then as the plant gets them. What
    /// drives a valve holds the last current that was good: an invalid command leaves the one before in
    /// force.
    pub fn command(
        &mut self,
        step: Step,
        (age_steps, work_ns): (u32, u64),
        (command, invalid): (&[f64], &mut [u64; VALIDITY_WORDS]),
        applied: &mut [f64],
    ) -> u32 {
        applied.copy_from_slice(command);
        let (effects, rate) = (&mut self.effects, self.rate);
        (self.targets.timing).answered(effects, age_steps, work_ns);
        let path = &mut self.targets.command;
        let age_steps = path.apply_link_faults(effects, step, rate, (applied, invalid), age_steps);
        path.apply_signal_faults(effects, step, rate, (applied, invalid));
        self.schedule.count(effects, step);
        age_steps
    }

    /// Returns true if there is an event for observers.
    #[must_use]
    pub fn has_events(&self) -> bool {
        !self.told.is_empty()
    }

    /// Takes out the next event: what took hold or ended, in order.
    pub fn next_event(&mut self) -> Option<Event> {
        self.told.pop_front()
    }

    /// Takes live faults before a step, all or none.
    ///
    /// # Errors
    /// If one of them should have taken hold in the past, or never will.
    pub fn admit(
        &mut self,
        armed: Vec<Box<ArmedFault>>,
        next: Step,
    ) -> Result<Vec<Admitted>, String> {
        for fault in &armed {
            let trigger = &fault.event().trigger;
            if let Some(other) = self.schedule.follows_in_vain(trigger) {
                return Err(format!(
                    "fault {other} ended before it took hold: nothing can follow it"
                ));
            }
            let hold = self.schedule.hold_of(trigger, next);
            if let Some(step) = hold.filter(|&step| step < next.0) {
                let (at_s, next_s) = (self.rate.seconds(Step(step)), self.rate.seconds(next));
                return Err(format!(
                    "step {step} ({at_s} s) is past: the run is at step {next} ({next_s} s)"
                ));
            }
        }
        for fault in &armed {
            let event = fault.event();
            let hold = self.schedule.hold_of(&event.trigger, next);
            let begin = hold.map_or(next, Step);
            if let Some(end) = event.end.step.filter(|end| *end <= begin) {
                let (end_s, begin_s) = (self.rate.seconds(end), self.rate.seconds(begin));
                return Err(format!(
                    "it would end at step {end} ({end_s} s) and not begin before step {begin} ({begin_s} s)"
                ));
            }
        }
        self.retire(MOST_RETIRED * armed.len());
        let admitted = armed.into_iter().map(|armed| {
            let event = armed.event();
            let (id, kind, waits_for) = (event.id, event.kind.clone(), waits_for(&event.trigger));
            let step = self.arm(*armed, next);
            Admitted {
                id,
                kind,
                waits_for: step.is_none().then_some(waits_for),
                step,
            }
        });
        let admitted = admitted.collect();
        self.schedule.look_ahead(&self.effects);
        Ok(admitted)
    }

    /// Lets go of what ended faults needed to act, of N at most; what is told of them stays.
    fn retire(&mut self, most: usize) {
        for effects in (0..most).map_while(|_| self.schedule.retire()) {
            self.effects[effects].iter_mut().for_each(Effect::retire);
        }
    }

    /// Ends a fault or all of them from a step on, also those that wait; gives their numbers.
    pub fn clear(&mut self, id: Option<u32>, next: Step) -> Vec<u32> {
        let cleared = self.schedule.clear(&mut self.effects, id, next);
        self.follow(next, true);
        cleared
    }

    /// Every fault, in the order of their numbers.
    #[must_use]
    pub fn states(&self) -> Vec<FaultState> {
        self.schedule.states(&self.effects)
    }

    /// Returns the record of what became of each effect.
    #[must_use]
    pub fn effects(&self) -> Vec<FaultEffectSize> {
        let size = |effect: &Effect| effect.size().clone();
        self.effects.iter().map(size).collect()
    }

    /// Frames that were corrupted on purpose and refused by their check sum.
    #[must_use]
    pub const fn rejected(&self) -> u64 {
        self.targets.sample.rejected() + self.targets.command.rejected()
    }

    /// Takes an event, with room for all that it will do.
    fn arm(&mut self, mut armed: ArmedFault, next: Step) -> Option<Step> {
        let begin = self.effects.len();
        let end = begin + armed.effects.len();
        let living = self.schedule.living_effects() + armed.effects.len();
        for effect in armed.effects.drain(..) {
            self.path.reserve(effect.path_length());
            self.targets.stack_of(&effect.action).reserve(living);
            self.effects.push(effect);
        }
        self.told.reserve(2 * living);
        self.schedule.arm(armed, begin..end, next)
    }

    /// Does what the schedule says, and tells of it.
    fn follow(&mut self, step: Step, cleared: bool) {
        for &change in self.schedule.changes() {
            match change {
                Change::Begins(place) => {
                    let twins = self.targets.begin(&mut self.effects, place);
                    let effect = &mut self.effects[place];
                    effect.start(self.seed, twins, &mut self.path);
                    self.told.extend(effect.take_taken().map(Event::Fault));
                }
                Change::Ends(place) => {
                    self.targets.end(&mut self.effects, place, step);
                    let size = self.effects[place].size();
                    self.told.push_back(Event::FaultEnded(FaultEnded {
                        id: size.id,
                        effect: size.effect,
                        step: step.0,
                        cleared,
                    }));
                }
            }
        }
    }
}

impl Targets {
    /// The effects that act where this one does.
    const fn stack_of(&mut self, action: &Action) -> &mut Vec<usize> {
        match action {
            // What is over is in no stack.
            Action::Move(_) | Action::Parameter(..) | Action::Over => self.parameters.stack(),
            Action::Signal(Direction::Sample, ..) => self.sample.signals(),
            Action::Signal(Direction::Command, ..) => self.command.signals(),
            Action::Link(Direction::Sample, ..) => self.sample.link(),
            Action::Link(Direction::Command, ..) => self.command.link(),
            Action::Skip(..) | Action::Busy(..) => self.timing.stack(),
        }
    }

    /// An effect takes hold; gives the number of those just like it before.
    fn begin(&mut self, effects: &mut [Effect], place: usize) -> usize {
        match effects[place].action {
            Action::Link(Direction::Sample, ..) => self.sample.begin(&mut effects[place]),
            Action::Link(Direction::Command, ..) => self.command.begin(&mut effects[place]),
            _ => {}
        }
        let stack = self.stack_of(&effects[place].action);
        let is_twin = |other: &&usize| effects[**other].is_twin_of(&effects[place]);
        let twins = stack.iter().filter(is_twin).count();
        stack.push(place);
        twins
    }

    /// An effect ended; nothing changes if it never took hold.
    fn end(&mut self, effects: &mut [Effect], place: usize, step: Step) {
        let stack = self.stack_of(&effects[place].action);
        let Some(index) = stack.iter().position(|&other| other == place) else {
            return;
        };
        stack.remove(index);
        match effects[place].action {
            Action::Move(_) | Action::Parameter(..) => self.parameters.heal(),
            Action::Link(Direction::Sample, ..) => self.sample.end(effects, step),
            Action::Link(Direction::Command, ..) => self.command.end(effects, step),
            _ => {}
        }
    }
}

fn restore_effects(effects: &mut [Effect], saved: &[SavedEffect]) -> Result<(), Invalid> {
    if saved.len() != effects.len() {
        let (theirs, ours) = (saved.len(), effects.len());
        return Err(Invalid(format!(
            "{theirs} effects of faults were saved, and there are {ours} here"
        )));
    }
    let mut pairs = effects.iter_mut().zip(saved);
    pairs.try_for_each(|(effect, saved)| effect.restore(saved))
}
