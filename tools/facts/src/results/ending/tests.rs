//! Accounts of a plant about its end, and the part of them that is believed.

use shared_types::record::{ControllerChange, ControllerFate, FaultEffectSize, Outcome, RunEnd};
use shared_types::time::Step;

use super::*;
use crate::results::recorded::Answers;
use crate::rig::plan;

const STEPS: u64 = 1000;

/// An honest account: all steps, all records, each with its answer.
fn honest() -> Recorded {
    Recorded {
        records: STEPS + 1,
        answers: Some(Answers {
            given: STEPS,
            held: 0,
        }),
        end: Some(RunEnd::new(STEPS, Outcome::Completed)),
        ..Recorded::begun()
    }
}

fn describe(clock: Clock, change: impl FnOnce(&mut Recorded, &mut RunEnd)) -> Option<String> {
    let mut plan = plan();
    plan.run.clock = clock;
    let mut recorded = honest();
    let mut end = recorded.end.take().expect("it has one");
    change(&mut recorded, &mut end);
    recorded.end = Some(end);
    contradiction(&plan, &recorded)
}

#[track_caller]
fn believed(clock: Clock, change: impl FnOnce(&mut Recorded, &mut RunEnd)) {
    assert_eq!(describe(clock, change), None);
}

#[track_caller]
fn doubted(clock: Clock, wanted: &str, change: impl FnOnce(&mut Recorded, &mut RunEnd)) {
    let what = describe(clock, change).expect("a contradiction");
    assert!(what.contains(wanted), "{what}");
}

const LOCKSTEP: Clock = Clock::Lockstep;
const REALTIME: Clock = Clock::Realtime;

fn streak(steps: std::ops::Range<u64>) -> Streaks {
    let mut streaks = Streaks::default();
    steps.for_each(|step| streaks.note(Step(step)));
    streaks
}

#[test]
fn all_planned_steps_with_all_records_are_believed() {
    for clock in [LOCKSTEP, Clock::Paced { factor: 2.0 }, REALTIME] {
        believed(clock, |_, _| ());
    }
    // A plant that died told nothing.
    assert_eq!(contradiction(&plan(), &Recorded::begun()), None);
}

#[test]
fn a_run_that_broke_off_has_a_record_for_each_step_and_perhaps_one_more() {
    for outcome in [Outcome::Diverged, Outcome::Stopped, Outcome::Failed] {
        for records in [400, 401] {
            believed(LOCKSTEP, |recorded, end| {
                (recorded.records, end.steps, end.outcome) = (records, 400, outcome);
            });
        }
        for records in [0, 399, 402] {
            doubted(LOCKSTEP, "executed 400 steps", |recorded, end| {
                (recorded.records, end.steps, end.outcome) = (records, 400, outcome);
            });
        }
        doubted(LOCKSTEP, "the run has 1000", |_, end| {
            (end.steps, end.outcome) = (1001, outcome);
        });
    }
}

#[test]
fn records_may_lack_against_the_clock_alone_and_only_if_they_were_counted() {
    let lacks = |lost: u64| {
        move |recorded: &mut Recorded, _: &mut RunEnd| {
            (recorded.records, recorded.lost) = (858, lost);
        }
    };
    believed(REALTIME, lacks(143));
    believed(REALTIME, lacks(150)); // some of them were events
    doubted(
        REALTIME,
        "1001 records; 858 came and 142 were lost",
        lacks(142),
    );
    doubted(LOCKSTEP, "1001 records; 858 came", lacks(143));
    doubted(Clock::Paced { factor: 1.0 }, "858 came", lacks(143));
}

#[test]
fn steps_and_answers_of_a_completed_run_are_those_of_the_plan() {
    for steps in [0, 2, 999] {
        doubted(
            LOCKSTEP,
            &format!("after {steps} steps"),
            |recorded, end| {
                (recorded.records, end.steps) = (steps + 1, steps);
            },
        );
    }
    doubted(LOCKSTEP, "18446744073709551615", |_, end| {
        end.steps = u64::MAX
    });
    doubted(LOCKSTEP, "answer of a controller", |recorded, _| {
        recorded.answers = Some(Answers::default());
    });
    // An excerpt does not have them.
    believed(LOCKSTEP, |recorded, _| recorded.answers = None);
}

#[test]
fn what_came_too_late_is_what_the_records_have() {
    let held = |recorded: &mut Recorded, held: u64| {
        recorded.answers = Some(Answers { given: STEPS, held });
    };
    believed(REALTIME, |recorded, end| {
        held(recorded, 3);
        (end.missed_commands, end.overruns) = (streak(5..8), streak(0..1001));
    });
    doubted(REALTIME, "3 commands missed", |_, end| {
        end.missed_commands = streak(5..8);
    });
    doubted(REALTIME, "0 commands missed", |recorded, _| {
        held(recorded, 3)
    });
    // Steps without a controller miss nothing.
    believed(REALTIME, |recorded, _| {
        held(recorded, 3);
        recorded.changes.push(ControllerChange {
            epoch: 1,
            step: 997,
            change: ControllerFate::Lost {
                reason: String::new(),
                policy: shared_types::lockstep::OnLoss::Hold,
            },
        });
    });
    doubted(LOCKSTEP, "in lockstep none is due", |_, end| {
        end.overruns = streak(5..8)
    });
    let impossible: [fn(&mut Streaks); 5] = [
        |streaks| streaks.count = u64::MAX,
        |streaks| streaks.longest = 2,
        |streaks| streaks.longest = 0,
        |streaks| streaks.first_step = None,
        |streaks| streaks.first_step = Some(u64::MAX),
    ];
    for change in impossible {
        doubted(REALTIME, "steps overran", |_, end| {
            end.overruns = streak(0..1);
            change(&mut end.overruns);
        });
    }
}

#[test]
fn effects_are_those_of_faults_that_there_are() {
    let effect = |id: u32| FaultEffectSize {
        id,
        effect: 0,
        kind: "bias".into(),
        target: "measured.x".into(),
        parameter: "x".into(),
        step: Some(1),
        ended_step: None,
        acted_steps: 1,
        max_effect: 1.0,
        unit: "m".into(),
    };
    doubted(LOCKSTEP, "no such fault", |_, end| {
        end.effects = vec![effect(7)]
    });
    doubted(LOCKSTEP, "twice", |_, end| {
        end.effects = vec![effect(7), effect(7)];
    });
    doubted(LOCKSTEP, "beyond the end", |_, end| {
        end.effects = vec![FaultEffectSize {
            acted_steps: 1002,
            ..effect(7)
        }];
    });
    doubted(LOCKSTEP, "beyond the end", |_, end| {
        end.effects = vec![FaultEffectSize {
            ended_step: Some(1001),
            ..effect(7)
        }];
    });
    // It may be lost that it was accepted.
    believed(REALTIME, |recorded, end| {
        recorded.lost = 1;
        end.effects = vec![effect(7)];
    });
}
