//! Values that change during a run: pending changes, and the courses of all changed values.
//!
//! The engine checks at each step whether there is work, which is one comparison in the common case. A change takes
//! effect before the step is measured, for all its keys at once. The change of a plant parameter sets its healthy
//! value, on which faults act; the change of a law parameter is sent to the controller; a changed reference signal
//! leaves its stimulus until it is cleared.

mod saved;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use hil_config::plan::{Change, PLANT_KEYS, REFERENCE_KEYS, Stimulus, law_keys};
use shared_types::describe::Settings;
use shared_types::hello::TunableParameter;
use shared_types::live::{ChangedValue, Tunable};
use shared_types::record::{Event, MOST_CHANGES, ValueChange};
use shared_types::table::Field;
use shared_types::time::{Rate, Step};
use shared_types::tuning::{Course, Tuned};

pub(crate) use saved::SavedTuning;

/// Step beyond the end of any run.
const NEVER: Step = Step(u64::MAX);
/// Maximum number of pending live changes.
const MOST_WAITING: usize = 256;

/// Changes of a run and the resulting values.
#[derive(Clone, Debug)]
pub struct Tuning {
    rate: Rate,
    fields: Vec<Field>,
    originals: Settings,
    /// Pending changes, in the order in which they will begin.
    waiting: VecDeque<Change>,
    /// First step at which there is work.
    next: Step,
    /// Courses of the plant's parameters by index, and courses of the law's parameters by full name.
    plant: BTreeMap<usize, Course>,
    law: BTreeMap<String, Course>,
    /// Tunable parameters of the active law.
    offered: Offered,
    /// Number of messages for the law so far.
    number: u64,
    references: Vec<Reference>,
    events: VecDeque<Event>,
    /// Number of accepted changes, which is also the number of the last change.
    accepted: usize,
    last_id: u32,
    /// Keys of changed law parameters that cannot be read back.
    unconfirmed: BTreeSet<String>,
}

/// Tunable parameters offered by a law.
#[derive(Clone, Debug, Default)]
pub struct Offered {
    /// Number of the controller; 0 for none.
    pub epoch: u32,
    /// Name of the law.
    pub law: String,
    /// The parameters.
    pub parameters: Vec<TunableParameter>,
}

/// Reference signal or driven input: its index among all of them, and its course if it has left its stimulus.
#[derive(Clone, Debug)]
struct Reference {
    key: String,
    /// Aliases of the signal.
    aliases: Vec<String>,
    unit: String,
    range: [f64; 2],
    column: usize,
    derivatives: usize,
    course: Option<Course>,
}

/// Creates the course of a value from a step on.
fn course(from: f64, to: f64, begin: Step, steps: u64) -> Course {
    Course {
        from,
        to,
        begin,
        steps,
    }
}

impl Tuning {
    /// Creates the changes of a scenario, for a run that begins at a step.
    #[must_use]
    pub fn new(
        rate: Rate,
        fields: &[Field],
        originals: &Settings,
        stimuli: &[Stimulus],
        changes: &[Change],
        first: Step,
    ) -> Self {
        // Driven inputs of the plant follow the reference signals.
        let (mut column, mut input) = (0, stimuli.iter().flat_map(Stimulus::fields).count());
        let references = stimuli.iter().map(|stimulus| {
            let is_input = stimulus.input().is_some();
            let derivatives = match is_input {
                true => 0,
                false => stimulus.waveform.derivatives(),
            };
            let next = if is_input { &mut input } else { &mut column };
            let begin = *next;
            *next += 1 + derivatives;
            Reference {
                key: stimulus.key(),
                aliases: stimulus.aliases.clone(),
                unit: stimulus.unit.clone(),
                range: stimulus.range,
                column: begin,
                derivatives,
                course: None,
            }
        });
        let mut tuning = Self {
            rate,
            fields: fields.to_vec(),
            originals: originals.clone(),
            references: references.collect(),
            waiting: (changes.iter())
                .filter(|change| change.step >= Some(first))
                .cloned()
                .collect(),
            next: NEVER,
            plant: BTreeMap::new(),
            law: BTreeMap::new(),
            offered: Offered::default(),
            number: 0,
            events: VecDeque::new(),
            accepted: changes.len(),
            last_id: changes.iter().map(|change| change.id).max().unwrap_or(0),
            unconfirmed: BTreeSet::new(),
        };
        tuning.sort();
        tuning
    }

    fn sort(&mut self) {
        let order = |change: &Change| (change.step, change.id);
        self.waiting.make_contiguous().sort_by_key(order);
        let first = self.waiting.front().and_then(|change| change.step);
        self.next = first.map_or(self.next, |first| first.min(self.next));
    }

    /// Returns `true` if there is work at a step.
    #[inline]
    #[must_use]
    pub fn is_due(&self, step: Step) -> bool {
        step >= self.next
    }

    /// Accepts a live change before a step.
    ///
    /// # Errors
    /// If its step is past, or there are too many changes.
    pub fn admit(&mut self, mut change: Change, next: Step) -> Result<(u32, Step), String> {
        let step = change.step.unwrap_or(next);
        if step < next {
            let (at_s, next_s) = (self.rate.seconds(step), self.rate.seconds(next));
            return Err(format!(
                "step {step} ({at_s} s) is past, because the run is at step {next} ({next_s} s); choose a later time"
            ));
        }
        if self.left() == 0 {
            return Err(format!(
                "a run can have at most {MOST_CHANGES} changes, and this run has reached that number; set further values in a new run"
            ));
        }
        if self.waiting.iter().filter(|change| change.live).count() >= MOST_WAITING {
            return Err(format!(
                "at most {MOST_WAITING} changes can wait for their step; send the change again once a waiting one has begun"
            ));
        }
        self.accepted += 1;
        self.last_id += 1;
        change.id = self.last_id;
        change.step = Some(step);
        self.waiting.push_back(change);
        self.sort();
        Ok((self.last_id, step))
    }

    /// Accepts a recorded change.
    pub fn repeat(&mut self, change: &ValueChange) {
        self.waiting.push_back(Change {
            id: change.id,
            step: Some(Step(change.step)),
            ramp_steps: change.ramp_steps,
            live: change.live,
            set: change.set.clone(),
            clear: change.clear.clone(),
        });
        self.sort();
    }

    /// Returns the number of further changes that the run accepts.
    #[must_use]
    pub fn left(&self) -> usize {
        MOST_CHANGES.saturating_sub(self.accepted)
    }

    /// Advances the values to a step; `stimulus` holds the step's reference signals without changes. Returns `true` if
    /// the law must be informed.
    pub fn advance(&mut self, step: Step, stimulus: &[f64]) -> bool {
        let mut moves_law = false;
        while let Some(change) = self.waiting.pop_front() {
            if change.step > Some(step) {
                self.waiting.push_front(change);
                break;
            }
            moves_law |= self.take(change, step, stimulus);
        }
        let goes_on = (self.plant.values()).any(|course| !course.is_over(step));
        let first = self.waiting.front().and_then(|change| change.step);
        self.next = match (goes_on, first) {
            (true, _) => step.next(),
            (false, Some(first)) => first,
            (false, None) => NEVER,
        };
        self.number += u64::from(moves_law);
        moves_law
    }

    /// Begins a change; returns `true` if it affects the law.
    fn take(&mut self, change: Change, step: Step, stimulus: &[f64]) -> bool {
        let mut moves_law = false;
        let own = law_keys(&self.offered.law);
        for ChangedValue { key, value, .. } in &change.set {
            let (to, steps) = (*value, change.ramp_steps);
            if let Some(name) = key.strip_prefix(PLANT_KEYS) {
                if let Some(place) = self.fields.iter().position(|field| field.name == name) {
                    let from = self.plant_value(place, step);
                    (self.plant).insert(place, course(from, to, step, steps));
                }
            } else if let Some(signal) = self.references.iter_mut().find(|one| one.key == *key) {
                let from =
                    (signal.course).map_or(stimulus[signal.column], |course| course.at(step));
                signal.course = Some(course(from, to, step, steps));
            } else {
                let offered = key.strip_prefix(&*own).and_then(|name| {
                    let named = |one: &&TunableParameter| one.field.name == name;
                    self.offered.parameters.iter().find(named)
                });
                let before = self.law.get(key).map(|course| course.at(step));
                // A parameter that has no value yet has none from which a ramp could begin.
                let known = before.or(offered.map(|one| one.value));
                let known = known.filter(|from| !from.is_nan());
                let (from, steps) = known.map_or((to, 0), |from| (from, steps));
                if offered.is_some_and(|one| one.is_unreadable) {
                    self.unconfirmed.insert(key.clone());
                }
                (self.law).insert(key.clone(), course(from, to, step, steps));
                moves_law = true;
            }
        }
        for signal in &mut self.references {
            if change.clear.contains(&signal.key) {
                signal.course = None;
            }
        }
        self.events.push_back(Event::Change(ValueChange {
            id: change.id,
            step: step.0,
            ramp_steps: change.ramp_steps,
            live: change.live,
            set: change.set,
            clear: change.clear,
        }));
        moves_law
    }

    fn plant_value(&self, place: usize, step: Step) -> f64 {
        let original = self.originals.get(&self.fields[place].name);
        (self.plant.get(&place)).map_or(original.unwrap_or(f64::NAN), |course| course.at(step))
    }

    /// Lists the changed healthy values of plant parameters, at a step.
    pub fn bases(&self, step: Step) -> impl Iterator<Item = (usize, f64)> {
        (self.plant.iter()).map(move |(place, course)| (*place, course.at(step)))
    }

    /// Returns the keys of changed parameters that cannot be read back; `unreadable` lists those of the plant.
    #[must_use]
    pub fn unconfirmed(&self, unreadable: &[String]) -> BTreeSet<String> {
        let of_plant = (self.plant.keys())
            .map(|place| &self.fields[*place].name)
            .filter(|name| unreadable.contains(name))
            .map(|name| format!("{PLANT_KEYS}{name}"));
        self.unconfirmed.iter().cloned().chain(of_plant).collect()
    }

    /// Writes reference signals and driven inputs that have left their stimulus into the row of a step.
    pub fn overrule(&self, step: Step, row: &mut [f64]) {
        for signal in &self.references {
            let Some(course) = &signal.course else {
                continue;
            };
            let own = &mut row[signal.column..=signal.column + signal.derivatives];
            own.fill(0.0);
            if signal.derivatives > 0 {
                own[1] = course.slope_at(step) * self.rate.hz();
            }
            own[0] = course.at(step);
        }
    }

    /// Returns the number of messages for the law so far.
    #[inline]
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Creates the message to the active law, which has all its changed parameters.
    #[must_use]
    pub fn tuned(&self) -> Tuned {
        let own = law_keys(&self.offered.law);
        let courses = (0_u32..)
            .zip(&self.offered.parameters)
            .filter_map(|(place, one)| {
                let course = self.law.get(&format!("{own}{}", one.field.name))?;
                Some((place, *course))
            });
        Tuned {
            number: self.number,
            courses: courses.collect(),
        }
    }

    /// Switches to another active law. A parameter whose initial value differs from that of the previous controller is
    /// reset to its initial value; all others stay tuned.
    pub fn offer(&mut self, offered: Offered) {
        let before = std::mem::replace(&mut self.offered, offered);
        if before.law == self.offered.law {
            for one in &self.offered.parameters {
                let same = |other: &&TunableParameter| other.field.name == one.field.name;
                let was = before.parameters.iter().find(same);
                if was.is_some_and(|was| was.value.to_bits() != one.value.to_bits()) {
                    self.law
                        .remove(&(law_keys(&self.offered.law) + &one.field.name));
                }
            }
        }
    }

    /// Records that there is no controller to tune.
    pub fn lose_controller(&mut self) {
        self.offered.epoch = 0;
    }

    /// Returns the tunable parameters of the active law.
    #[must_use]
    pub const fn offered(&self) -> &Offered {
        &self.offered
    }

    /// Returns `true` if there is an event for observers.
    #[must_use]
    pub fn has_events(&self) -> bool {
        !self.events.is_empty()
    }

    /// Takes the next event.
    pub fn next_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Returns the pending changes, in the order in which they will begin.
    #[must_use]
    pub const fn waiting(&self) -> &VecDeque<Change> {
        &self.waiting
    }

    /// Lists everything that can be changed with its values at a step, including the changes that begin there.
    #[must_use]
    pub fn tunable(&self, step: Step, stimulus: &[f64]) -> Vec<Tunable> {
        if self
            .waiting
            .front()
            .is_some_and(|change| change.step <= Some(step))
        {
            let mut there = self.clone();
            there.advance(step, stimulus);
            return there.tunable(step, stimulus);
        }
        let key_of = |group: &str, name: &str| format!("{group}{name}");
        let one = |group: &str, field: &Field, original: f64, course: Option<&Course>| Tunable {
            key: key_of(group, &field.name),
            aliases: (field.aliases.iter())
                .map(|alias| key_of(group, alias))
                .collect(),
            unit: field.unit.clone(),
            description: field.description.clone(),
            min: field.min,
            max: field.max,
            value: course.map_or(original, |course| course.at(step)),
            target: course.map_or(original, |course| course.to),
            original,
            until_step: (course.filter(|course| !course.is_over(step)))
                .map(|course| course.end().0),
            is_changed: course.is_some(),
        };
        let own = law_keys(&self.offered.law);
        let of_law = self.offered.parameters.iter().map(|parameter| {
            let course = self.law.get(&key_of(&own, &parameter.field.name));
            one(&own, &parameter.field, parameter.value, course)
        });
        let is_tunable = |(_, field): &(usize, &Field)| field.tunable || field.faultable;
        let of_plant = (self.fields.iter().enumerate().filter(is_tunable)).map(|(place, field)| {
            let original = self.originals.get(&field.name).unwrap_or(f64::NAN);
            one(PLANT_KEYS, field, original, self.plant.get(&place))
        });
        let signals = self.references.iter().map(|signal| {
            let begin = signal.key.find('.').map_or(0, |dot| dot + 1);
            let (group, name) = signal.key.split_at(begin);
            let description = match group {
                REFERENCE_KEYS => "Reference signal of the rig.",
                _ => "Input of the plant, driven by the scenario.",
            };
            let field = Field {
                aliases: signal.aliases.clone(),
                min: signal.range[0],
                max: signal.range[1],
                ..Field::signal(name, &signal.unit, description)
            };
            let original = stimulus.get(signal.column).copied().unwrap_or(0.0);
            one(group, &field, original, signal.course.as_ref())
        });
        of_law.chain(of_plant).chain(signals).collect()
    }

    /// Returns the settings of the plant or the law after a proposed change, and after each later change.
    #[must_use]
    pub fn settings_with(&self, change: &Change, prefix: &str) -> Vec<Settings> {
        let mut present = Settings::default();
        if prefix == PLANT_KEYS {
            present = self.originals.clone();
            for (place, course) in &self.plant {
                present.set(&self.fields[*place].name, course.to);
            }
        } else {
            for (key, course) in &self.law {
                if let Some(name) = key.strip_prefix(prefix) {
                    present.set(name, course.to);
                }
            }
        }
        let is_of_it = |change: &Change| change.set.iter().any(|one| one.key.starts_with(prefix));
        let mut all: Vec<Change> = self.waiting.iter().cloned().collect();
        all.push(change.clone());
        all.retain(is_of_it);
        match is_of_it(change) {
            true => hil_config::plan::settings_after(&all, prefix, &present),
            false => Vec::new(),
        }
    }
}
