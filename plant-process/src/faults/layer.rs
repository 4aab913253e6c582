//! The fault layer: every fault of a run, around the plant and the link.
//!
//! Called by the engine at each step, in this order: [`advance`](FaultLayer::advance) begins and ends faults and moves
//! parameters, [`sample`](FaultLayer::sample) turns the measured signals into those that the controller receives,
//! [`timing`](FaultLayer::timing) returns the delays of both sides, and [`command`](FaultLayer::command) turns the
//! controller's commands into the applied ones. None of these methods allocates. Models and laws are unaware of the
//! layer.
//!
//! Effects on one target act in the order in which they began: by step, then by number of the event, then by index in
//! the event. Each effect acts on the result of the previous one, and its size is the change that it made.

mod targets;

use std::collections::VecDeque;

use hil_config::expression::Columns;
use hil_config::plan::FaultEvent;
use serde::{Deserialize, Serialize};
use shared_types::describe::Invalid;
use shared_types::directive::Directive;
use shared_types::frame::{FrameKind, VALIDITY_WORDS};
use shared_types::live::FaultState;
use shared_types::record::{BusCounts, Event, FaultEffectSize, FaultEnded, RecordLayout};
use shared_types::state::State;
use shared_types::time::{Rate, Step};

use super::builder::{ArmedFault, FaultBuilder};
use super::bus::{Bus, Line};
use super::effect::{Effect, SavedEffect};
use super::parameters::{Parameters, SavedParameters};
use super::schedule::{Change, SavedEvent, Schedule, waits_for};
use super::signal_path::{SavedPath, SignalPath};
use super::timing::Timing;
use targets::Targets;

/// Maximum number of ended faults released per admitted fault.
const MOST_RETIRED: usize = 4;

/// Faults of a run.
pub struct FaultLayer {
    rate: Rate,
    seed: u64,
    /// Faults of the scenario, until the columns of a record are known.
    scenario: Vec<FaultEvent>,
    schedule: Schedule,
    /// Effects of all armed events, in the order of arming.
    effects: Vec<Effect>,
    targets: Targets,
    events: VecDeque<Event>,
    /// Buffer for the path of a random stream.
    path: String,
}

/// Saved state of all faults between two steps.
#[derive(Debug, Serialize, Deserialize)]
pub struct SavedFaults {
    events: Vec<SavedEvent>,
    /// Effects in the order in which their events were armed.
    effects: Vec<SavedEffect>,
    parameters: SavedParameters,
    sample: SavedPath,
    command: SavedPath,
    input: SavedPath,
    timing: Vec<usize>,
}

impl SavedFaults {
    /// Returns the effective parameters of the plant.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.parameters.row()
    }
}

/// Admitted live fault.
#[derive(Clone, Debug, PartialEq)]
pub struct Admitted {
    /// Number.
    pub id: u32,
    /// Kind.
    pub kind: String,
    /// Step at which the fault begins, if known.
    pub step: Option<Step>,
    /// Event or condition that the fault waits for, if the step is unknown.
    pub waits_for: Option<String>,
}

impl FaultLayer {
    /// Creates the faults of a scenario.
    ///
    /// # Errors
    /// If one of the faults is invalid.
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
                input: SignalPath::new(builder.inputs(), FrameKind::Sample),
                timing: Timing::default(),
            },
            events: VecDeque::new(),
            path: String::new(),
        })
    }

    /// Lets the signals of both directions cross the frames of a bus.
    #[must_use]
    pub fn with_bus(mut self, bus: Option<Bus>) -> Self {
        if let Some(Bus { sample, command }) = bus {
            self.targets.sample.cross(sample);
            self.targets.command.cross(command);
        }
        self
    }

    /// Returns the state of the bus, one of each direction; none without a bus.
    ///
    /// # Errors
    /// Never, as it consists of numbers only.
    pub fn save_bus(&self) -> Result<Vec<State>, Invalid> {
        let lines = [&self.targets.sample, &self.targets.command];
        let lines = lines.into_iter().filter_map(SignalPath::line);
        lines.map(|line| State::of(&line.save())).collect()
    }

    /// Restores the state of the bus from the end of these states, and returns the others.
    ///
    /// # Errors
    /// If it is one of another bus.
    pub fn restore_bus<'a>(&mut self, states: &'a [State]) -> Result<&'a [State], Invalid> {
        let lines = [&mut self.targets.sample, &mut self.targets.command];
        let lines: Vec<_> = lines.into_iter().filter_map(SignalPath::line_mut).collect();
        let (others, own) = (states.len().checked_sub(lines.len()))
            .and_then(|others| states.split_at_checked(others))
            .ok_or_else(|| Invalid("the state has none of the bus".into()))?;
        for (line, state) in lines.into_iter().zip(own) {
            line.restore(&state.read::<Vec<u64>>()?)?;
        }
        Ok(others)
    }

    /// Returns the counts of each frame of the bus.
    #[must_use]
    pub fn bus_counts(&self) -> Vec<BusCounts> {
        let lines = [&self.targets.sample, &self.targets.command];
        let lines = lines.into_iter().filter_map(SignalPath::line);
        lines.flat_map(Line::counts).collect()
    }

    /// Returns the state of all faults. Call it between two steps, when all events have been published.
    ///
    /// # Errors
    /// If an active fault cannot save its state.
    pub fn save(&mut self) -> Result<SavedFaults, Invalid> {
        Ok(SavedFaults {
            events: self.schedule.save(),
            effects: (self.effects.iter_mut().map(Effect::save)).collect::<Result<_, _>>()?,
            parameters: self.targets.parameters.save(),
            sample: self.targets.sample.save(),
            command: self.targets.command.save(),
            input: self.targets.input.save(),
            timing: self.targets.timing.stack().clone(),
        })
    }

    /// Restores a saved state; its events are armed in their original order.
    ///
    /// # Errors
    /// If the state does not belong to these faults.
    pub fn restore(&mut self, saved: SavedFaults) -> Result<(), Invalid> {
        restore_effects(&mut self.effects, &saved.effects)?;
        self.schedule.restore(&saved.events, &self.effects)?;
        let targets = &mut self.targets;
        targets.parameters.restore(saved.parameters)?;
        targets.sample.restore(saved.sample)?;
        targets.command.restore(saved.command)?;
        targets.input.restore(saved.input)?;
        targets.timing.restore(&saved.timing);
        Ok(())
    }

    /// Checks if a state matches these faults, before a layer exists.
    ///
    /// # Errors
    /// The mismatch.
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

    /// Arms the scenario's faults, once the layout of a record is known.
    ///
    /// # Errors
    /// If a condition names an unknown signal.
    pub fn open(&mut self, builder: &FaultBuilder, layout: &RecordLayout) -> Result<(), Invalid> {
        let columns = Columns::from(layout);
        for event in std::mem::take(&mut self.scenario) {
            let armed = builder.build(event, &columns)?;
            self.arm(armed, Step(0));
        }
        self.schedule.look_ahead(&self.effects);
        Ok(())
    }

    /// Advances the faults to a step: begins and ends faults and changes the plant's parameters. Returns `true` if a
    /// parameter changed. `last` is the previous record, for evaluating conditions.
    pub fn advance(&mut self, step: Step, last: Option<&[f64]>) -> bool {
        if self.schedule.turn(&mut self.effects, step, last) {
            self.follow(step, false);
        }
        let (effects, rate) = (&mut self.effects, self.rate);
        self.targets.parameters.advance(effects, step, rate)
    }

    /// Sets the healthy value of a plant parameter, on which faults act. Call it before [`advance`](Self::advance).
    pub fn rebase(&mut self, index: usize, value: f64) {
        self.targets.parameters.rebase(index, value);
    }

    /// Returns the effective parameters of the plant.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        self.targets.parameters.row()
    }

    /// Writes the effective faultable parameters.
    pub fn faultable(&self, row: &mut [f64]) {
        for (to, value) in row.iter_mut().zip(self.targets.parameters.faultable()) {
            *to = value;
        }
    }

    /// Turns the healthy measured and reference signals into those that the controller receives; returns their age in
    /// steps. `invalid` are first the bits of the readings and afterwards those that the controller receives.
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
        let (path, effects, rate) = (&mut self.targets.sample, &mut self.effects, self.rate);
        path.apply_signal_faults(effects, step, rate, (row, invalid));
        path.apply_link_faults(effects, step, rate, (row, invalid), 0)
    }

    /// Turns the inputs of the plant that the scenario drives into those that it applies.
    pub fn input(&mut self, step: Step, driven: &[f64], row: &mut [f64]) {
        row.copy_from_slice(driven);
        if row.is_empty() {
            return;
        }
        let (path, effects) = (&mut self.targets.input, &mut self.effects);
        path.apply_signal_faults(effects, step, self.rate, (row, &mut [0; VALIDITY_WORDS]));
    }

    /// Returns the controller's timing directive, and the plant's busy time in ns.
    pub fn timing(&mut self, step: Step) -> (Directive, u64) {
        self.targets.timing.ask(&mut self.effects, step, self.rate)
    }

    /// Records the plant's actual busy time.
    pub fn plant_was_busy(&mut self, busy_ns: u64) {
        let timing = &self.targets.timing;
        timing.plant_was_busy(&mut self.effects, busy_ns);
    }

    /// Converts the controller's commands into the applied ones and returns their age in steps. `age_steps` is the age
    /// of the controller's commands at this step, `work_ns` the time that the controller spent on them. `invalid` holds
    /// the validity bits of these commands, first as sent and afterwards as received by the plant. As in a valve driver
    /// that holds the last good current, an invalid command leaves the previous one in force.
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

    /// Returns `true` if there is an event for observers.
    #[must_use]
    pub fn has_events(&self) -> bool {
        let has_events = |path: &SignalPath| path.line().is_some_and(Line::has_events);
        !self.events.is_empty()
            || has_events(&self.targets.sample)
            || has_events(&self.targets.command)
    }

    /// Takes the next event: a beginning or end, in order, or a signal of the bus that exceeds its range.
    pub fn next_event(&mut self) -> Option<Event> {
        let Targets {
            sample, command, ..
        } = &mut self.targets;
        let mark = |path: &mut SignalPath| path.line_mut()?.next_event().map(Event::Mark);
        (self.events.pop_front())
            .or_else(|| mark(sample))
            .or_else(|| mark(command))
    }

    /// Admits live faults before a step, all or none.
    ///
    /// # Errors
    /// If one of the faults should have begun in the past, or would never begin.
    pub fn admit(
        &mut self,
        armed: Vec<Box<ArmedFault>>,
        next: Step,
    ) -> Result<Vec<Admitted>, String> {
        for fault in &armed {
            let trigger = &fault.event().trigger;
            if let Some(other) = self.schedule.follows_in_vain(trigger) {
                return Err(format!(
                    "fault {other} ended before it took effect, so nothing can follow it"
                ));
            }
            let hold = self.schedule.hold_of(trigger, next);
            if let Some(step) = hold.filter(|&step| step < next.0) {
                let (at_s, next_s) = (self.rate.seconds(Step(step)), self.rate.seconds(next));
                return Err(format!(
                    "step {step} ({at_s} s) is past, because the run is at step {next} ({next_s} s); choose a later time"
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
                    "the fault would end at step {end} ({end_s} s), but cannot begin before step {begin} ({begin_s} s)"
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

    /// Releases the resources of at most N ended faults; their reports remain.
    fn retire(&mut self, most: usize) {
        for effects in (0..most).map_while(|_| self.schedule.retire()) {
            self.effects[effects].iter_mut().for_each(Effect::retire);
        }
    }

    /// Ends one or all faults from a step on, including waiting ones; returns their numbers.
    pub fn clear(&mut self, id: Option<u32>, next: Step) -> Vec<u32> {
        let cleared = self.schedule.clear(&mut self.effects, id, next);
        self.follow(next, true);
        cleared
    }

    /// Lists every fault, in the order of the fault numbers.
    #[must_use]
    pub fn states(&self) -> Vec<FaultState> {
        self.schedule.states(&self.effects)
    }

    /// Returns the report on each effect.
    #[must_use]
    pub fn effects(&self) -> Vec<FaultEffectSize> {
        let size = |effect: &Effect| effect.size().clone();
        self.effects.iter().map(size).collect()
    }

    /// Returns the number of frames corrupted by faults and rejected by their checksum.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.targets.sample.rejected() + self.targets.command.rejected()
    }

    /// Arms an event, reserving all the memory it will need.
    fn arm(&mut self, mut armed: ArmedFault, next: Step) -> Option<Step> {
        let begin = self.effects.len();
        let end = begin + armed.effects.len();
        let living = self.schedule.living_effects() + armed.effects.len();
        for effect in armed.effects.drain(..) {
            self.path.reserve(effect.path_length());
            self.targets.stack_of(&effect.action).reserve(living);
            self.effects.push(effect);
        }
        self.events.reserve(2 * living);
        self.schedule.arm(armed, begin..end, next)
    }

    /// Applies the changes of the schedule and reports them.
    fn follow(&mut self, step: Step, cleared: bool) {
        for &change in self.schedule.changes() {
            match change {
                Change::Begins(place) => {
                    let twins = self.targets.begin(&mut self.effects, place);
                    let effect = &mut self.effects[place];
                    effect.start(self.seed, twins, &mut self.path);
                    self.events.extend(effect.take_taken().map(Event::Fault));
                }
                Change::Ends(place) => {
                    self.targets.end(&mut self.effects, place, step);
                    let size = self.effects[place].size();
                    self.events.push_back(Event::FaultEnded(FaultEnded {
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

fn restore_effects(effects: &mut [Effect], saved: &[SavedEffect]) -> Result<(), Invalid> {
    if saved.len() != effects.len() {
        let (theirs, ours) = (saved.len(), effects.len());
        return Err(Invalid(format!(
            "the state contains {theirs} effects of faults, but this run has {ours}"
        )));
    }
    let mut pairs = effects.iter_mut().zip(saved);
    pairs.try_for_each(|(effect, saved)| effect.restore(saved))
}
