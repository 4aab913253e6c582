//! Conditions of an audit that must not matter to a run, chosen for a plan and this machine.

use std::num::NonZero;
use std::sync::Arc;

use hil_config::live_requests::RequestContext;
use hil_config::plan::{Clock, Plan};
use hil_facts::checkpoint;
use hil_target::machine::built_for;
use rustix::thread::{CpuSet, sched_getaffinity};
use shared_types::lockstep::OnLoss;
use shared_types::time::Step;

use crate::suite::case::{Case, Row};

/// Total delay of a repetition with delays, relative to the duration of the reference run, and the minimum in s
/// ([`DELAYS_S`]).
const DELAYS: f64 = 1.0;
const DELAYS_S: f64 = 0.2;
/// Longest delay of a side per step, in us.
const LONGEST_DELAY_US: f64 = 200.0;
/// Slow-down factor of the paced repetition.
const SLOWER: f64 = 2.0;

/// Builds the cases of an audit from its reference; none unless the reference ended by itself, was recorded and has a
/// digest.
pub(super) fn cases(reference: &Case, row: &Row) -> Vec<Case> {
    let ran = row
        .ran
        .as_ref()
        .filter(|ran| row.is_over() && ran.recording.is_some() && ran.summary.digest.is_some());
    let Some(ran) = ran else {
        return Vec::new();
    };
    let mut cases = under_conditions(reference, ran.summary.wall_time_s);
    for (number, case) in (1..).zip(&mut cases) {
        let settings = &mut case.environment.settings;
        settings.out = Some(ran.folder.join(format!("audit-{number}")));
        settings.session = None;
    }
    cases
}

/// Builds a case for each condition, given the duration of the reference in s.
fn under_conditions(reference: &Case, wall_time_s: f64) -> Vec<Case> {
    let plan = &reference.plan;
    let condition = |label: &str, change: &dyn Fn(&mut Plan)| {
        let mut case = reference.clone();
        case.label = label.into();
        change(&mut case.plan);
        case
    };
    let speed = match plan.run.clock {
        Clock::Paced { .. } => condition("as fast as both sides can", &|plan| {
            plan.run.clock = Clock::Lockstep;
        }),
        Clock::Lockstep | Clock::Realtime => {
            let factor = pace(plan, wall_time_s);
            let label = format!("paced at {factor:.1} times real time");
            condition(&label, &|plan| plan.run.clock = Clock::Paced { factor })
        }
    };
    let cores = cores();
    let on = |plant: u32, controller: u32| {
        move |plan: &mut Plan| {
            plan.realtime.plant_core = Some(plant);
            plan.realtime.controller_core = Some(controller);
            plan.realtime.recorder_core = None;
        }
    };
    let last = *cores.last().unwrap_or(&cores[0]);
    let mut apart = condition("each process on a core of its own", &on(last, cores[0]));
    if cores.len() < 2 {
        apart.skipped = Some("there is only one core".into());
    }
    let mut conditions = vec![
        condition("the same again", &|_| {}),
        speed,
        condition("both processes on one core", &on(cores[0], cores[0])),
        apart,
        Case {
            noise: true,
            ..condition("busy cores", &|_| {})
        },
        delayed(reference, wall_time_s),
        saved(reference),
    ];
    conditions.extend(on_this_machine(reference));
    conditions
}

/// Returns the case with the target's controller on this machine, if possible.
fn on_this_machine(reference: &Case) -> Option<Case> {
    let at = reference.environment.binaries.controller.at.as_ref()?;
    let mut case = reference.clone();
    case.label = format!("on this machine in place of {}", at.target());
    let mut binaries = (*case.environment.binaries).clone();
    binaries.controller.at = None;
    let built = built_for(&binaries.controller.path).ok().flatten();
    let own = rustix::system::uname();
    let own = own.machine().to_string_lossy();
    case.skipped = built
        .filter(|built| *built != own)
        .map(|built| format!("the controller is built for {built}"));
    case.environment.binaries = Arc::new(binaries);
    Some(case)
}

/// Chooses a pace at which the sides wait for the clock.
fn pace(plan: &Plan, wall_time_s: f64) -> f64 {
    let duration_s = plan.run.rate.seconds(Step(plan.run.steps));
    let shortest_s = 1e-3;
    let took_s = if wall_time_s > shortest_s {
        wall_time_s
    } else {
        shortest_s
    };
    duration_s / (SLOWER * took_s)
}

/// Builds a case with random delays on both sides, which must affect only the duration.
fn delayed(reference: &Case, wall_time_s: f64) -> Case {
    let plan = &reference.plan;
    let total_s = if DELAYS * wall_time_s > DELAYS_S {
        DELAYS * wall_time_s
    } else {
        DELAYS_S
    };
    // Two sides, each with half of the maximum delay on average.
    let spread_us = 1e6 * total_s / plan.run.steps as f64;
    let spread_us = spread_us.clamp(0.1, LONGEST_DELAY_US);
    let effect = |target: &str| {
        format!("[[faults.effects]]\ntarget = \"{target}\"\nspread_us = {spread_us:?}\n")
    };
    let text = format!(
        "[[faults]]\nkind = \"late\"\nat_s = 0.0\n{}{}",
        effect("plant"),
        effect("controller")
    );
    let mut condition = Case {
        label: format!("both sides late by up to {spread_us:.1} us at random"),
        ..reference.clone()
    };
    let (plants, laws, kinds) = reference.environment.binaries.described();
    let (Some(plant), Some(law)) = (plan.plant_among(plants), plan.law_among(laws)) else {
        condition.skipped = Some("the binaries have no description".into());
        return condition;
    };
    match RequestContext::of(plan, &plant, kinds).check(&text, &law.internals) {
        Ok(faults) => condition.plan.faults.extend(faults),
        Err(_) => condition.skipped = Some("the plant's binary has no fault `late`".into()),
    }
    condition
}

/// Builds a case in which both sides save their state halfway, without an effect on the run; separate processes then
/// check that the state restores exactly.
fn saved(reference: &Case) -> Case {
    let (plan, environment) = (&reference.plan, &reference.environment);
    let mut case = Case {
        label: "both sides save their state halfway".into(),
        ..reference.clone()
    };
    let unsaveable = checkpoint::refuse_unsaveable(plan, &environment.binaries);
    case.skipped = if let Err(failure) = unsaveable {
        Some(failure.reason())
    } else if environment.binaries.controller.at.is_some() {
        Some("a controller on a target saves no state".into())
    } else if plan.run.on_controller_loss != OnLoss::Abort {
        Some("the state of a controller with on-loss handling cannot be saved".into())
    } else if plan.run.steps < 2 {
        Some("there is only one step".into())
    } else {
        None
    };
    let halfway_s = plan.run.rate.seconds(Step(plan.run.steps / 2));
    case.environment.settings.checkpoints_at_s = vec![halfway_s];
    case
}

/// Returns the cores that this process may use; at least one.
fn cores() -> Vec<u32> {
    let some = |count: usize| (0..count as u32).collect();
    match sched_getaffinity(None) {
        Ok(allowed) => (0..CpuSet::MAX_CPU)
            .filter(|&core| allowed.is_set(core))
            .map(|core| core as u32)
            .collect(),
        Err(_) => some(std::thread::available_parallelism().map_or(1, NonZero::get)),
    }
}
