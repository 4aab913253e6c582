//! `hil scenario from`: the scenario that repeats a recorded run, what was done to it while it went
//! on included.
//!
//! Made from what travels in the recording alone: the scenario as it was in effect, what plant and
//! controller said of themselves, and the events. A live fault becomes one of the scenario that
//! takes hold at the very steps at which it did. `hil rerun` runs the result.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use hil_config::plan::{Change, Clock, Condition, FaultEnd, FaultEvent, Realtime, Trigger};
use hil_config::show;
use hil_console::files::part_file;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::programs::binaries::named::Recorded;
use hil_facts::programs::checked::checked;
use hil_facts::results::faults::{FaultLog, LiveFault};
use hil_facts::results::late_commands::LateCommands;
use hil_facts::results::recorded_run::RecordedRun;
use hil_facts::results::resumed::{CHANGED_FAULTS, CHECK};
use hil_recording::reader::{ReadError, RunReader};
use plant_process::repeat::Missed;
use shared_types::record::{
    ControllerChange, ControllerFate, Event, FaultBegun, FaultEnded, Outcome, ValueChange,
};
use shared_types::time::{Rate, Step};

use crate::arguments::recordings::ScenarioFromArguments;

/// A recorded run as a scenario that repeats it, read to its end.
pub struct RecordedScenario {
    recorded: RecordedRun,
    log: FaultLog,
    /// Changes of values that were asked for while the run went on.
    live_changes: Vec<ValueChange>,
    session: String,
    started: String,
    /// Programs.
    pub programs: Recorded,
    /// Records in it.
    pub records: u64,
    /// Records lost while it was written.
    pub lost: u64,
    /// The digest of its records.
    pub digest: String,
    /// Outcome of the run, in one word; `None` if its plant or its writer died.
    pub outcome: Option<Outcome>,
    /// Steps at which the controller was not in time.
    pub missed: Vec<Missed>,
    /// Check of the checkpoint that it went on from, in words; `None` if it began at step 0.
    pub resumed_check: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// If the run cannot be read, or the scenario not be written.
pub fn scenario_from(arguments: &ScenarioFromArguments) -> Result<Exit, Failure> {
    let recorded = RecordedScenario::read(&arguments.run)?;
    let text = recorded.scenario()?;
    if !recorded.missed.is_empty() {
        tell!(
            "note: {} steps of the run missed their command, which no scenario can repeat; `hil rerun` does",
            recorded.missed.len()
        );
    }
    match &arguments.output {
        None => output::write(&text)?,
        Some(path) => part_file::write_text(path, &text)?,
    }
    Ok(Exit::Pass)
}

/// Refuses a run whose controller changed: nobody knows what a dead controller would have answered, and the
/// state of another one depends on when it took over.
fn refuse_succession(run: &Path, change: &ControllerChange) -> Result<(), Failure> {
    let (run, epoch, step) = (run.display(), change.epoch, change.step);
    let what = match &change.change {
        ControllerFate::Lost { reason, .. } => {
            format!("lost controller {epoch} at step {step} ({reason})")
        }
        ControllerFate::Joined { .. } => format!("got controller {epoch} at step {step}"),
        ControllerFate::Refused { .. } => return Ok(()),
    };
    Err(Failure::usage(format!(
        "{run} {what}: a run whose controller changed cannot be repeated; `hil judge`, `hil compare` and `hil export` read it"
    )))
}

impl RecordedScenario {
    /// Reads a run: its folder, or its recording.
    ///
    /// # Errors
    /// If it has no recording, or what travels in that cannot be understood.
    pub fn read(run: &Path) -> Result<Self, Failure> {
        let refused = |error: ReadError| Failure::usage(error);
        let mut reader = RunReader::open(run).map_err(refused)?;
        if let Some(faults) = reader.fact(CHANGED_FAULTS) {
            let (run, from) = (
                run.display(),
                reader.fact("resumed_from").unwrap_or_default(),
            );
            return Err(Failure::usage(format!(
                "{run} went on from a checkpoint with other sizes of fault {faults}, which had begun: no scenario repeats that; `hil run --from {from}` with the same --set does"
            )));
        }
        let recorded = RecordedRun::of(&reader, run)?;
        let plan = &recorded.plan;
        let mut log = FaultLog::default();
        let mut live_changes = Vec::new();
        let mut outcome = None;
        let mut missed = LateCommands::of(&reader);
        loop {
            let goes_on = reader.advance().map_err(refused)?;
            if let Some(missed) = &mut missed
                && goes_on
                && reader.step() < plan.run.steps
            {
                missed.take(reader.step(), reader.words());
            }
            for event in reader.events() {
                match event {
                    Event::Controller(change) => refuse_succession(run, change)?,
                    Event::Change(change) if change.live => live_changes.push(change.clone()),
                    Event::End(end) => outcome = Some(end.outcome),
                    event => log
                        .take(event)
                        .map_err(|error| Failure::usage(format!("{}: {error}", run.display())))?,
                }
            }
            if !goes_on {
                break;
            }
        }
        let needs_all = plan.run.clock == Clock::Realtime || outcome != Some(Outcome::Completed);
        if needs_all {
            // What it was has to be found in its steps.
            reader.refuse_excerpt().map_err(refused)?;
        }
        if let Some(torn) = reader.caveat() {
            tell!("note: {torn}");
        }
        let fact = |name| reader.fact(name).map(str::to_owned);
        Ok(Self {
            log,
            live_changes,
            session: fact("session").unwrap_or_default(),
            started: fact("started_utc").unwrap_or_default(),
            programs: Recorded::of(&reader, run),
            records: reader.records(),
            lost: reader
                .result("lost")
                .and_then(|lost| lost.parse().ok())
                .unwrap_or(0),
            digest: reader.digest(),
            outcome,
            missed: missed.map(LateCommands::missed).unwrap_or_default(),
            resumed_check: fact(CHECK),
            recorded,
        })
    }

    /// Returns true if the controller could be late.
    #[must_use]
    pub fn is_against_clock(&self) -> bool {
        self.recorded.plan.run.clock == Clock::Realtime
    }

    /// The same without what it asked of its machine: times are not repeated, and another machine
    /// may not have those cores.
    #[must_use]
    pub fn for_any_machine(mut self) -> Self {
        self.recorded.plan.realtime = Realtime::default();
        self
    }

    /// The scenario that repeats it.
    ///
    /// # Errors
    /// If the result would be no scenario for the plant and the controller of the run.
    pub fn scenario(&self) -> Result<String, Failure> {
        let RecordedRun {
            plant_program,
            controller_program,
            plant,
            ..
        } = &self.recorded;
        let mut plan = self.recorded.plan.clone();
        let rate = plan.run.rate;
        plan.programs = self.programs.programs();
        let gone = without_cleared(&mut plan.faults, &self.log);
        let (plants, laws) = (&plant_program.plants, &controller_program.laws);
        let kinds = &plant_program.faults;
        let mut text = format!(
            "# Repeats session `{}` of {}, with what was done to it while it ran.\n",
            comment(&self.session),
            comment(&self.started)
        );
        if !self.programs.is_own() {
            for (role, path) in self.programs.named() {
                // Writing to a string cannot fail.
                let _ = writeln!(
                    text,
                    "# Recorded by another user or elsewhere with the {} program {}; `{}` names the one to run.",
                    role.side,
                    comment(&path.display().to_string()),
                    role.key
                );
            }
        }
        for event in gone {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "# Fault {} of the scenario, `{}`, is left out: it was cleared before it took hold.",
                event.id,
                comment(&event.kind)
            );
        }
        let scenario = plan.changes.len();
        plan.changes
            .extend((1..).zip(&self.live_changes).map(|(id, live)| Change {
                id: scenario as u32 + id,
                step: Some(Step(live.step)),
                ramp_steps: live.ramp_steps,
                live: false,
                set: live.set.clone(),
                clear: live.clear.clone(),
            }));
        text += &show::show(&plan, plants, laws, kinds).map_err(Failure::usage)?;
        let mut live: Vec<&LiveFault> = self.log.accepted.iter().collect();
        live.sort_by_key(|live| live.event.id);
        for fault in live {
            let asked = comment(&asked(fault, rate));
            match resolved(fault, &self.log, rate) {
                Some(event) => {
                    let toml =
                        show::fault_toml(&event, plant, kinds, rate).map_err(Failure::usage)?;
                    let _ = write!(text, "\n# {asked}.\n{}", toml.trim_start());
                }
                None => {
                    let _ = writeln!(text, "\n# {asked}; it never took hold.");
                }
            }
        }
        checked(
            &text,
            Path::new("the scenario of the run"),
            plant_program,
            controller_program,
        )?;
        Ok(text)
    }
}

/// Ends the faults of a scenario where they were cleared. Takes out and returns those that were
/// cleared before they took hold, and those that could only have followed them.
fn without_cleared(faults: &mut Vec<FaultEvent>, log: &FaultLog) -> Vec<FaultEvent> {
    let mut gone = BTreeSet::new();
    for event in faults.iter_mut() {
        let Some(cleared) = cleared(event.id, log) else {
            continue;
        };
        if keep_taken(event, log) {
            let end = event.end.step.unwrap_or(cleared);
            event.end.step = Some(cleared.min(end));
        } else {
            gone.insert(event.id);
        }
    }
    loop {
        let follows = |event: &&FaultEvent| matches!(event.trigger, Trigger::After { event, .. } if gone.contains(&event));
        let more: Vec<u32> = faults
            .iter()
            .filter(follows)
            .map(|event| event.id)
            .collect();
        let before = gone.len();
        gone.extend(more);
        if gone.len() == before {
            let is_gone = |event: &mut FaultEvent| gone.contains(&event.id);
            let left_out = faults.extract_if(.., is_gone).collect();
            renumber(faults);
            return left_out;
        }
    }
}

/// Numbers events by their place, as a scenario does, also where one follows another.
fn renumber(faults: &mut [FaultEvent]) {
    let before: Vec<u32> = faults.iter().map(|event| event.id).collect();
    let now = |id: u32| (1..).zip(&before).find(|(_, before)| **before == id);
    for event in faults {
        event.id = now(event.id).map_or(event.id, |(now, _)| now);
        if let Trigger::After { event: other, .. } = &mut event.trigger {
            *other = now(*other).map_or(*other, |(now, _)| now);
        }
    }
}

/// The first step without an event that somebody cleared.
fn cleared(id: u32, log: &FaultLog) -> Option<Step> {
    let is_it = |ended: &&FaultEnded| ended.id == id && ended.cleared;
    log.ended.iter().find(is_it).map(|ended| Step(ended.step))
}

fn taken(id: u32, log: &FaultLog) -> impl Iterator<Item = &FaultBegun> {
    log.taken.iter().filter(move |taken| taken.id == id)
}

/// Keeps the effects of a cleared event that had taken hold; whether there are any.
fn keep_taken(event: &mut FaultEvent, log: &FaultLog) -> bool {
    let numbers: BTreeSet<u32> = taken(event.id, log).map(|taken| taken.effect).collect();
    let mut number = 0..;
    event.effects.retain(|_| {
        number
            .next()
            .is_some_and(|number| numbers.contains(&number))
    });
    !event.effects.is_empty()
}

/// A live fault as the scenario must have it to repeat what it did; `None` if it never took hold.
fn resolved(live: &LiveFault, log: &FaultLog, rate: Rate) -> Option<FaultEvent> {
    let mut event = live.event.clone();
    let id = event.id;
    let first = taken(id, log).min_by_key(|taken| taken.step)?;
    let at = Step(first.step);
    let planned = event.effects.get(first.effect as usize)?.skew_steps;
    for (number, effect) in (0..).zip(&mut event.effects) {
        let step = taken(id, log)
            .find(|taken| taken.effect == number)
            .map(|taken| taken.step);
        effect.skew_steps = match step {
            Some(step) => step - at.0,
            None => effect.skew_steps.saturating_sub(planned),
        };
    }
    event.trigger = Trigger::Step {
        step: at,
        at_s: rate.seconds(at),
    };
    let ends: BTreeSet<u64> = (log.ended.iter().filter(|ended| ended.id == id))
        .map(|ended| ended.step)
        .collect();
    let ended = log.ended.iter().filter(|ended| ended.id == id).count();
    let cleared = cleared(id, log);
    if cleared.is_some() {
        keep_taken(&mut event, log);
    }
    match ends.first() {
        // All at once, whatever the reason was.
        Some(step) if ends.len() == 1 && ended >= event.effects.len() => {
            event.end = FaultEnd {
                step: Some(Step(*step)),
                ..FaultEnd::default()
            };
        }
        _ => event.end.step = cleared.or(event.end.step),
    }
    Some(event)
}

/// Describes the fault that was asked for, in words.
fn asked(live: &LiveFault, rate: Rate) -> String {
    let LiveFault { step, event } = live;
    let when = match &event.trigger {
        Trigger::Now => "at once".into(),
        Trigger::Step { step, at_s } => format!("at {at_s} s, step {step}"),
        Trigger::Condition(condition) => format!("when {}", held(condition)),
        Trigger::After { event, delay_steps } => format!("{delay_steps} steps after fault {event}"),
    };
    let FaultEnd {
        step: end,
        after_steps,
        occurrences,
        condition,
    } = &event.end;
    let ends = [
        end.map(|step| format!("until step {step}")),
        after_steps.map(|steps| format!("for {steps} steps")),
        occurrences.map(|times| format!("{times} times")),
        condition
            .as_ref()
            .map(|condition| format!("until {}", held(condition))),
    ];
    let ends: String = ends
        .into_iter()
        .flatten()
        .map(|end| format!(", {end}"))
        .collect();
    let time_s = rate.seconds(Step(*step));
    format!(
        "Live fault {}, asked for before step {step} ({time_s} s): {when}{ends}",
        event.id
    )
}

fn held(condition: &Condition) -> String {
    match condition.records {
        0 | 1 => format!("`{}` holds", condition.expression),
        records => format!("`{}` has held for {records} steps", condition.expression),
    }
}

/// Text that may stand behind a `#`.
fn comment(text: &str) -> String {
    text.replace(char::is_control, " ")
}

#[cfg(test)]
mod tests;
