//! Differences allowed to a run from a checkpoint: none that contradicts the steps before the checkpoint.
//!
//! The records before the checkpoint are fixed. So the plant, its instruments, its controller, the rate and the seed
//! must be the same, and reference signals must have the same values up to the checkpoint. A fault that has begun keeps
//! its target, its times and its profile, and only its magnitudes may change from there on; a fault that has not begun
//! may not begin earlier. Duration, clock and metrics are free.

use hil_config::plan::{Change, Clock, FaultAction, FaultEvent, Plan, Stimulus, Trigger, driven};
use plant_process::stimulus;
use shared_types::describe::Settings;
use shared_types::number::exact;
use shared_types::time::{Rate, Step};

use crate::results::faults::FaultLog;

/// Differences between a run that continues from a checkpoint and the run that made it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Branch {
    /// Numbers of the faults that had begun and continue with other magnitudes: no scenario reproduces such a run from
    /// its beginning.
    pub changed_faults: Vec<u32>,
}

/// Compares the plan of the run that made a checkpoint before `step` with that of the run to continue.
///
/// # Errors
/// All contradictions with the past.
pub(crate) fn check(
    then: &Plan,
    now: &Plan,
    step: Step,
    log: &FaultLog,
) -> Result<Branch, Vec<String>> {
    let mut check = Check {
        step,
        rate: then.run.rate,
        log,
        reasons: Vec::new(),
        branch: Branch::default(),
    };
    check.run(then, now);
    check.sides(then, now);
    check.stimuli(&then.stimuli, &now.stimuli);
    check.faults(&then.faults, &now.faults);
    check.changes(&then.changes, &now.changes);
    let conditions = |event: &FaultEvent| {
        matches!(event.trigger, Trigger::Condition(_)) || event.end.condition.is_some()
    };
    if then.derived != now.derived && now.faults.iter().any(conditions) {
        check.refuse(
            "the derived signals must stay the same, because conditions of faults were evaluated with them",
        );
    }
    if check.reasons.is_empty() {
        Ok(check.branch)
    } else {
        Err(check.reasons)
    }
}

struct Check<'a> {
    step: Step,
    rate: Rate,
    log: &'a FaultLog,
    reasons: Vec<String>,
    branch: Branch,
}

impl Check<'_> {
    fn refuse(&mut self, reason: impl Into<String>) {
        self.reasons.push(reason.into());
    }

    /// Formats the time of a step for a message.
    fn at(&self, step: Step) -> String {
        format!("step {step} ({} s)", self.rate.seconds(step))
    }

    fn run(&mut self, then: &Plan, now: &Plan) {
        let (then, now) = (&then.run, &now.run);
        if then.rate != now.rate {
            let (then, now) = (then.rate.hz(), now.rate.hz());
            self.refuse(format!(
                "run.rate_hz must stay {}, but is {}",
                exact(then),
                exact(now)
            ));
        } else if now.steps <= self.step.0 {
            let (end, begin) = (self.at(Step(now.steps)), self.at(self.step));
            self.refuse(format!(
                "run.duration_s ends the run at {end}, but the run begins at {begin}"
            ));
        }
        if then.seed != now.seed {
            let (then, now) = (then.seed, now.seed);
            self.refuse(format!("run.seed must stay {then}, but is {now}"));
        }
        if now.clock == Clock::Realtime {
            self.refuse(
                "run.clock: a run in real time does not reproduce its past; use lockstep or paced",
            );
        }
    }

    fn sides(&mut self, then: &Plan, now: &Plan) {
        let (plant, plant_now) = (&then.plant, &now.plant);
        let (law, law_now) = (&then.controller, &now.controller);
        let delays = [law, law_now].map(|one| one.command_delay_steps);
        let same = [
            ("plant.model", plant.model == plant_now.model),
            ("plant.substeps", plant.substeps == plant_now.substeps),
            ("plant.limits", plant.limits == plant_now.limits),
            ("sensors", then.sensors == now.sensors),
            ("actuators", then.actuators == now.actuators),
            ("controller.law", law.law == law_now.law),
            (
                "the given parameters of the law",
                law.law != law_now.law || names(&law.parameters) == names(&law_now.parameters),
            ),
            ("controller.made_for", law.made_for == law_now.made_for),
            ("connect", law.connections == law_now.connections),
            (
                "plant.inputs",
                names(&plant.inputs) == names(&plant_now.inputs),
            ),
            (
                "controller.rate_hz",
                law.rate_divisor == law_now.rate_divisor,
            ),
            ("controller.command_delay_steps", delays[0] == delays[1]),
        ];
        let others = same.into_iter().filter(|(_, is_same)| !is_same);
        let mut keys: Vec<String> = others
            .map(|(key, _)| format!("{key} must stay the same"))
            .collect();
        let of_law = format!("controller.{}", law.law);
        let tables = [
            ("plant.inputs", &plant.inputs, &plant_now.inputs),
            ("plant.parameters", &plant.parameters, &plant_now.parameters),
            (&*of_law, &law.parameters, &law_now.parameters),
            ("controller.model", &law.model, &law_now.model),
        ];
        // Another model or law has other parameters altogether.
        if keys.is_empty() {
            for (table, then, now) in tables {
                keys.extend(changed(then, now).map(|(name, then, now)| {
                    format!("{table}.{name} must stay {then}, but is {now}")
                }));
            }
        }
        self.reasons.extend(keys);
    }

    fn stimuli(&mut self, then: &[Stimulus], now: &[Stimulus]) {
        let fields = |stimuli: &[Stimulus]| {
            let fields = stimuli.iter().flat_map(Stimulus::fields);
            fields
                .map(|field| (field.name, field.unit))
                .collect::<Vec<_>>()
        };
        if fields(then) != fields(now) {
            self.refuse("the reference signals and their derivatives must stay the same");
            return;
        }
        if driven(then) != driven(now) {
            self.refuse("the inputs of the plant that stimuli drive must stay the same");
            return;
        }
        for (then, now) in then.iter().zip(now) {
            if then != now
                && let Some(step) = self.first_difference(then, now)
            {
                let (target, at, begin) = (&then.target, self.at(step), self.at(self.step));
                let what = match then.input() {
                    Some(_) => "input",
                    None => "reference signal",
                };
                self.refuse(format!(
                    "{what} {target} would already differ at {at}; it may differ from {begin} on"
                ));
            }
        }
    }

    /// Returns the first step before the checkpoint at which two reference signals differ.
    fn first_difference(&self, then: &Stimulus, now: &Stimulus) -> Option<Step> {
        let count = 1 + then.waveform.derivatives();
        let mut rows = [vec![0.0; count], vec![0.0; count]];
        (0..self.step.0).map(Step).find(|step| {
            let time_s = self.rate.seconds(*step);
            for (stimulus, row) in [then, now].into_iter().zip(&mut rows) {
                stimulus::evaluate(&stimulus.waveform, time_s, row);
            }
            let [then, now] = rows
                .each_ref()
                .map(|row| row.iter().map(|value| value.to_bits()));
            !then.eq(now)
        })
    }

    fn faults(&mut self, then: &[FaultEvent], now: &[FaultEvent]) {
        if then.len() != now.len() {
            let (then, now) = (then.len(), now.len());
            self.refuse(format!(
                "there were {then} faults but now there are {now}; add a fault to the running session with `hil inject`"
            ));
            return;
        }
        for (then, now) in then.iter().zip(now) {
            if then != now {
                self.fault(then, now);
            }
        }
    }

    /// Checks that changes before the checkpoint are the same; later changes are free.
    fn changes(&mut self, then: &[Change], now: &[Change]) {
        let before = |changes: &[Change]| {
            let past = changes
                .iter()
                .filter(|change| change.step < Some(self.step));
            past.map(|change| Change {
                id: 0,
                ..change.clone()
            })
            .collect::<Vec<_>>()
        };
        if before(then) != before(now) {
            let at = self.at(self.step);
            self.refuse(format!("changes of values before {at} must stay the same"));
        }
    }

    fn fault(&mut self, then: &FaultEvent, now: &FaultEvent) {
        let name = format!("fault {} `{}`", then.id, then.kind);
        let same_targets = (then.effects.iter().map(|effect| &effect.target))
            .eq(now.effects.iter().map(|effect| &effect.target));
        if then.kind != now.kind || !same_targets {
            self.refuse(format!("{name} must keep its kind and its targets"));
            return;
        }
        if let Some(ended) = self.log.ended.iter().find(|ended| ended.id == then.id) {
            let at = self.at(Step(ended.step));
            self.refuse(format!("{name} ended at {at} and must stay the same"));
            return;
        }
        match self.log.begun.iter().find(|begun| begun.id == then.id) {
            Some(begun) => {
                if same_but_for_sizes(then, now) {
                    self.branch.changed_faults.push(then.id);
                } else {
                    let at = self.at(Step(begun.step));
                    self.refuse(format!(
                        "{name} has been active since {at}: it must keep its times and its profile, and only its sizes may change"
                    ));
                }
            }
            None => self.waiting(&name, then, now),
        }
    }

    /// Checks a fault that has not begun.
    fn waiting(&mut self, name: &str, then: &FaultEvent, now: &FaultEvent) {
        let begin = match &now.trigger {
            Trigger::Step { step, .. } => Some(*step),
            Trigger::After { event, delay_steps } => {
                let leaders = self.log.begun.iter().filter(|begun| begun.id == *event);
                let step = leaders.map(|begun| begun.step).min();
                step.map(|step| Step(step.saturating_add(*delay_steps)))
            }
            Trigger::Condition(_) if then.trigger != now.trigger => {
                self.refuse(format!(
                    "{name} must keep its condition, because another one might have held before {}",
                    self.at(self.step)
                ));
                return;
            }
            Trigger::Condition(_) | Trigger::Now => None,
        };
        if let Some(begin) = begin.filter(|begin| *begin < self.step) {
            let (begin, first) = (self.at(begin), self.at(self.step));
            self.refuse(format!(
                "{name} would have begun at {begin}; it may begin from {first} on"
            ));
        }
    }
}

/// Lists the names of settings, in order.
fn names(settings: &Settings) -> Vec<&String> {
    settings.0.keys().collect()
}

/// Returns the settings that differ, by name.
fn changed<'a>(then: &'a Settings, now: &'a Settings) -> impl Iterator<Item = (&'a str, f64, f64)> {
    then.0.iter().filter_map(|(name, then)| {
        let (then, now) = (then.0, now.get(name)?);
        (then.to_bits() != now.to_bits()).then_some((name.as_str(), then, now))
    })
}

/// Returns `true` if two events on the same targets differ only in magnitudes.
fn same_but_for_sizes(then: &FaultEvent, now: &FaultEvent) -> bool {
    let mut sized = now.clone();
    for (sized, then) in sized.effects.iter_mut().zip(&then.effects) {
        match (&mut sized.action, &then.action) {
            (
                FaultAction::Move { sizes, moves },
                FaultAction::Move {
                    sizes: sizes_then,
                    moves: moves_then,
                },
            ) => {
                sizes.clone_from(sizes_then);
                for (sized, then) in moves.iter_mut().zip(moves_then) {
                    sized.by = then.by;
                }
            }
            (
                FaultAction::Kind { parameters, .. },
                FaultAction::Kind {
                    parameters: then, ..
                },
            ) => parameters.clone_from(then),
            _ => {}
        }
    }
    sized == *then
}
