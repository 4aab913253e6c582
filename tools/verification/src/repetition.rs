//! `hil scenario from`: the scenario that repeats a recorded run, including all live interventions.
//!
//! Built from the recording alone: the scenario in effect, the descriptions of plant and controller, and the
//! events. A live fault becomes a scenario fault that takes effect at the same steps. `hil rerun` runs the result.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use hil_config::plan::{Change, Clock, Condition, FaultEnd, FaultEvent, Plan, Realtime, Trigger};
use hil_config::show;
use hil_console::files::part_file;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::output;
use hil_facts::checkpoint;
use hil_facts::programs::binaries::named::Recorded;
use hil_facts::programs::checked::checked;
use hil_facts::results::faults::{FaultLog, LiveFault};
use hil_facts::results::late_commands::LateCommands;
use hil_facts::results::recorded_run::RecordedRun;
use hil_facts::results::resumed::{CHANGED_FAULTS, CHECK};
use hil_recording::reader::{ReadError, RunReader};
use plant_process::repeat::Missed;
use shared_types::describe::{Description, PlantDescription};
use shared_types::record::{
    ControllerChange, ControllerFate, Event, FaultBegun, FaultEnded, Outcome, ValueChange,
};
use shared_types::time::{Rate, Step};

use crate::arguments::recordings::ScenarioFromArguments;

/// Recorded run as a scenario that repeats it; the recording has been read to its end.
pub struct RecordedScenario {
    recorded: RecordedRun,
    log: FaultLog,
    /// Value changes that were requested during the run.
    live_changes: Vec<ValueChange>,
    /// `true` if only the steps before some step were read.
    is_part: bool,
    session: String,
    started: String,
    /// Programs of the run.
    pub programs: Recorded,
    /// Number of records.
    pub records: u64,
    /// Number of records lost while the recording was written.
    pub lost: u64,
    /// Digest of the run's records.
    pub digest: String,
    /// Outcome of the run, in one word; `None` if the plant or the recorder died.
    pub outcome: Option<Outcome>,
    /// Steps at which the controller was late.
    pub missed: Vec<Missed>,
    /// Result of checking the checkpoint from which the run resumed; `None` if the run began at step 0.
    pub resumed_check: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// If the run cannot be read, or the scenario cannot be written.
pub fn scenario_from(arguments: &ScenarioFromArguments) -> Result<Exit, Failure> {
    let recorded = RecordedScenario::read(&arguments.run)?;
    let text = recorded.scenario()?;
    if !recorded.missed.is_empty() {
        tell!(
            "note: the command was late at {} steps of the run, which no scenario can repeat; `hil rerun` does",
            recorded.missed.len()
        );
    }
    match &arguments.output {
        None => output::write(&text)?,
        Some(path) => part_file::write_text(path, &text)?,
    }
    Ok(Exit::Pass)
}

/// Refuses a run whose controller changed: the answers of a dead controller are unknown, and the state of its successor
/// depends on the time of the takeover.
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
        "{run} {what}: a run whose controller changed cannot be repeated; use `hil judge`, `hil compare` or `hil export` instead"
    )))
}

impl RecordedScenario {
    /// Reads a run, given its folder or its recording.
    ///
    /// # Errors
    /// If the recording is missing, or its contents are invalid.
    pub fn read(run: &Path) -> Result<Self, Failure> {
        Self::read_until(run, u64::MAX)
    }

    /// Reads the steps of a run before one step, with the live interventions before it; a run that is still being
    /// recorded is read as far as it goes.
    ///
    /// # Errors
    /// If the recording is missing, or its contents are invalid.
    pub fn before(run: &Path, step: Step) -> Result<Self, Failure> {
        Self::read_until(run, step.0)
    }

    fn read_until(run: &Path, step: u64) -> Result<Self, Failure> {
        let refused = |error: ReadError| Failure::usage(error);
        let mut reader = RunReader::open(run).map_err(refused)?;
        if let Some(faults) = reader.fact(CHANGED_FAULTS) {
            let (run, from) = (
                run.display(),
                reader.fact("resumed_from").unwrap_or_default(),
            );
            return Err(Failure::usage(format!(
                "{run} resumed from a checkpoint with changed parameters of the active fault {faults}: no scenario repeats that; `hil run --from {from}` with the same --set does"
            )));
        }
        let recorded = RecordedRun::of(&reader, run)?;
        let plan = &recorded.plan;
        let mut log = FaultLog::default();
        let mut live_changes = Vec::new();
        let mut outcome = None;
        let mut missed = LateCommands::of(&reader);
        while reader.records() < step {
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
            // Late commands can be determined only from all steps.
            reader.refuse_excerpt().map_err(refused)?;
        }
        let is_part = step < u64::MAX;
        if let (false, Some(torn)) = (is_part, reader.caveat()) {
            tell!("note: {torn}");
        }
        let fact = |name| reader.fact(name).map(str::to_owned);
        Ok(Self {
            log,
            live_changes,
            is_part,
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

    /// Returns the nearest checkpoint in the folder of the run from which a step can be reached again.
    #[must_use]
    pub fn checkpoint_before(&self, folder: &Path, step: Step) -> Option<(Step, PathBuf)> {
        checkpoint::nearest(folder, step, &self.log, &self.live_changes)
    }

    /// Returns the number of steps and the rate of the whole run.
    #[must_use]
    pub const fn length(&self) -> (Step, Rate) {
        let run = &self.recorded.plan.run;
        (Step(run.steps), run.rate)
    }

    /// Returns `true` if the plant was behind a port, which does not repeat.
    pub fn is_behind_port(&self) -> bool {
        self.recorded.plant.port.is_some()
    }

    /// Returns `true` if the controller could be late.
    pub fn is_against_clock(&self) -> bool {
        self.recorded.plan.run.clock == Clock::Realtime
    }

    /// Removes the real-time settings of the run, because timing is not reproduced and another machine may lack the
    /// cores.
    #[must_use]
    pub(crate) fn for_any_machine(mut self) -> Self {
        self.recorded.plan.realtime = Realtime::default();
        self
    }

    /// Returns the scenario that repeats the run.
    ///
    /// # Errors
    /// If the result is not a valid scenario for the run's plant and controller.
    pub fn scenario(&self) -> Result<String, Failure> {
        let RecordedRun {
            plant_program,
            controller_program,
            plant,
            ..
        } = &self.recorded;
        let mut head = format!(
            "# Repeats session `{}` of {}, including live interventions.\n",
            comment(&self.session),
            comment(&self.started)
        );
        if !self.programs.is_own() {
            for (role, path) in self.programs.named() {
                // Writing to a string cannot fail.
                let _ = writeln!(
                    head,
                    "# Recorded by another user or elsewhere with the {} program {}; `{}` chooses the program to run.",
                    role.side,
                    comment(&path.display().to_string()),
                    role.key
                );
            }
        }
        let interventions = Interventions {
            log: &self.log,
            changes: &self.live_changes,
            keeps_waiting: self.is_part,
        };
        let plan = Plan {
            programs: self.programs.programs(),
            ..self.recorded.plan.clone()
        };
        let text =
            interventions.scenario(head, plan, plant, [plant_program, controller_program])?;
        checked(
            &text,
            Path::new("the scenario of the run"),
            plant_program,
            controller_program,
        )?;
        Ok(text)
    }
}

/// Live faults and changes of a run.
pub struct Interventions<'a> {
    /// Faults of the run.
    pub log: &'a FaultLog,
    /// Changes of values that were requested during the run.
    pub changes: &'a [ValueChange],
    /// `true` to keep faults that wait for a later step: the run goes on.
    pub keeps_waiting: bool,
}

impl Interventions<'_> {
    /// Returns the scenario that repeats the run of a plan with these interventions, below the comments in `head`.
    ///
    /// # Errors
    /// If the plan does not belong to the plant and the described programs.
    pub fn scenario(
        &self,
        head: String,
        mut plan: Plan,
        plant: &PlantDescription,
        [plant_program, controller_program]: [&Description; 2],
    ) -> Result<String, Failure> {
        let rate = plan.run.rate;
        let removed = without_cleared(&mut plan.faults, self.log);
        let (plants, laws) = (&plant_program.plants, &controller_program.laws);
        let kinds = &plant_program.faults;
        let mut text = head;
        for event in removed {
            // Writing to a string cannot fail.
            let _ = writeln!(
                text,
                "# Fault {} of the scenario, `{}`, is left out because it was cleared before it took effect.",
                event.id,
                comment(&event.kind)
            );
        }
        let scenario = plan.changes.len();
        plan.changes
            .extend((1..).zip(self.changes).map(|(id, live)| Change {
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
            let request = comment(&request_text(fault, rate));
            let waiting = || {
                let is_waiting = self.keeps_waiting && cleared(fault.event.id, self.log).is_none();
                is_waiting.then(|| fault.event.clone())
            };
            match resolved(fault, self.log, rate).or_else(waiting) {
                Some(event) => {
                    let toml =
                        show::fault_toml(&event, plant, kinds, rate).map_err(Failure::usage)?;
                    let _ = write!(text, "\n# {request}.\n{}", toml.trim_start());
                }
                None => {
                    let _ = writeln!(text, "\n# {request}; it never took effect.");
                }
            }
        }
        Ok(text)
    }
}

/// Ends the scenario's faults where they were cleared. Removes and returns faults that were cleared before they took
/// effect, and faults that could only have followed those.
fn without_cleared(faults: &mut Vec<FaultEvent>, log: &FaultLog) -> Vec<FaultEvent> {
    let mut removed = BTreeSet::new();
    for event in faults.iter_mut() {
        let Some(cleared) = cleared(event.id, log) else {
            continue;
        };
        if keep_taken(event, log) {
            let end = event.end.step.unwrap_or(cleared);
            event.end.step = Some(cleared.min(end));
        } else {
            removed.insert(event.id);
        }
    }
    loop {
        let follows = |event: &&FaultEvent| matches!(event.trigger, Trigger::After { event, .. } if removed.contains(&event));
        let more: Vec<u32> = faults
            .iter()
            .filter(follows)
            .map(|event| event.id)
            .collect();
        let before = removed.len();
        removed.extend(more);
        if removed.len() == before {
            let is_gone = |event: &mut FaultEvent| removed.contains(&event.id);
            let left_out = faults.extract_if(.., is_gone).collect();
            renumber(faults);
            return left_out;
        }
    }
}

/// Renumbers events consecutively, as a scenario does, including references between events.
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

/// Returns the first step after an event was cleared.
fn cleared(id: u32, log: &FaultLog) -> Option<Step> {
    let is_it = |ended: &&FaultEnded| ended.id == id && ended.cleared;
    log.ended.iter().find(is_it).map(|ended| Step(ended.step))
}

fn begun_effects(id: u32, log: &FaultLog) -> impl Iterator<Item = &FaultBegun> {
    log.begun.iter().filter(move |effect| effect.id == id)
}

/// Keeps the effects of a cleared event that had begun; returns `true` if there are any.
fn keep_taken(event: &mut FaultEvent, log: &FaultLog) -> bool {
    let numbers: BTreeSet<u32> = begun_effects(event.id, log)
        .map(|begun| begun.effect)
        .collect();
    let mut number = 0..;
    event.effects.retain(|_| {
        number
            .next()
            .is_some_and(|number| numbers.contains(&number))
    });
    !event.effects.is_empty()
}

/// Converts a live fault to a scenario fault with the same effect; `None` if it never took effect.
fn resolved(live: &LiveFault, log: &FaultLog, rate: Rate) -> Option<FaultEvent> {
    let mut event = live.event.clone();
    let id = event.id;
    let first = begun_effects(id, log).min_by_key(|begun| begun.step)?;
    let at = Step(first.step);
    let planned = event.effects.get(first.effect as usize)?.skew_steps;
    for (number, effect) in (0..).zip(&mut event.effects) {
        let step = begun_effects(id, log)
            .find(|begun| begun.effect == number)
            .map(|begun| begun.step);
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
        // All effects ended at once, for whatever reason.
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

/// Describes the requested fault in words.
fn request_text(live: &LiveFault, rate: Rate) -> String {
    let LiveFault { step, event } = live;
    let when = match &event.trigger {
        Trigger::Now => "at once".into(),
        Trigger::Step { step, at_s } => format!("at {at_s} s, step {step}"),
        Trigger::Condition(condition) => format!("when {}", condition_text(condition)),
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
            .map(|condition| format!("until {}", condition_text(condition))),
    ];
    let ends: String = ends
        .into_iter()
        .flatten()
        .map(|end| format!(", {end}"))
        .collect();
    let time_s = rate.seconds(Step(*step));
    format!(
        "Live fault {}, requested before step {step} ({time_s} s): {when}{ends}",
        event.id
    )
}

fn condition_text(condition: &Condition) -> String {
    match condition.records {
        0 | 1 => format!("`{}` holds", condition.expression),
        records => format!("`{}` has held for {records} steps", condition.expression),
    }
}

/// Removes line breaks from a text for use behind a `#`.
fn comment(text: &str) -> String {
    text.replace(char::is_control, " ")
}

#[cfg(test)]
mod tests;
