//! Plant reports about the end of a run, and the parts of them that are accepted.

use shared_types::record::{ControllerChange, ControllerFate, FaultEffectSize, Outcome, RunEnd};
use shared_types::time::Step;

use super::*;
use crate::results::recorded::Answers;
use crate::rig::plan;

const STEPS: u64 = 1000;

/// Returns a consistent report: all steps, all records, each with its answer.
fn honest() -> Recorded {
    Recorded {
        records: STEPS + 1,
        answers: Some(Answers {
            answered: STEPS,
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
fn accepted(clock: Clock, change: impl FnOnce(&mut Recorded, &mut RunEnd)) {
    assert_eq!(describe(clock, change), None);
}

#[track_caller]
fn rejected(clock: Clock, expected: &str, change: impl FnOnce(&mut Recorded, &mut RunEnd)) {
    let what = describe(clock, change).expect("a contradiction");
    assert!(what.contains(expected), "{what}");
}

const LOCKSTEP: Clock = Clock::Lockstep;
const REALTIME: Clock = Clock::Realtime;

fn streak(steps: std::ops::Range<u64>) -> Streaks {
    let mut streaks = Streaks::default();
    steps.for_each(|step| streaks.note(Step(step)));
    streaks
}

#[test]
fn a_complete_run_with_all_records_is_accepted() {
    for clock in [LOCKSTEP, Clock::Paced { factor: 2.0 }, REALTIME] {
        accepted(clock, |_, _| ());
    }
    // A plant that died reported nothing.
    assert_eq!(contradiction(&plan(), &Recorded::begun()), None);
}

#[test]
fn an_aborted_run_has_a_record_for_each_step_and_at_most_one_more() {
    for outcome in [Outcome::Diverged, Outcome::Stopped, Outcome::Failed] {
        for records in [400, 401] {
            accepted(LOCKSTEP, |recorded, end| {
                (recorded.records, end.steps, end.outcome) = (records, 400, outcome);
            });
        }
        for records in [0, 399, 402] {
            rejected(LOCKSTEP, "400 executed steps", |recorded, end| {
                (recorded.records, end.steps, end.outcome) = (records, 400, outcome);
            });
        }
        rejected(LOCKSTEP, "the run has 1000", |_, end| {
            (end.steps, end.outcome) = (1001, outcome);
        });
    }
}

#[test]
fn records_may_be_missing_only_in_real_time_and_only_if_counted() {
    let lacks = |lost: u64| {
        move |recorded: &mut Recorded, _: &mut RunEnd| {
            (recorded.records, recorded.lost) = (858, lost);
        }
    };
    accepted(REALTIME, lacks(143));
    accepted(REALTIME, lacks(150)); // some of them were events
    rejected(
        REALTIME,
        "1001 records, but 858 arrived and 142 were lost",
        lacks(142),
    );
    rejected(LOCKSTEP, "1001 records, but 858 arrived", lacks(143));
    rejected(Clock::Paced { factor: 1.0 }, "858 arrived", lacks(143));
}

#[test]
fn a_completed_run_has_the_steps_and_answers_of_its_plan() {
    for steps in [0, 2, 999] {
        rejected(
            LOCKSTEP,
            &format!("after {steps} steps"),
            |recorded, end| {
                (recorded.records, end.steps) = (steps + 1, steps);
            },
        );
    }
    rejected(LOCKSTEP, "18446744073709551615", |_, end| {
        end.steps = u64::MAX
    });
    rejected(LOCKSTEP, "a controller's answer", |recorded, _| {
        recorded.answers = Some(Answers::default());
    });
    // An excerpt does not count answers.
    accepted(LOCKSTEP, |recorded, _| recorded.answers = None);
}

#[test]
fn reported_late_commands_agree_with_the_records() {
    let held = |recorded: &mut Recorded, held: u64| {
        recorded.answers = Some(Answers {
            answered: STEPS,
            held,
        });
    };
    accepted(REALTIME, |recorded, end| {
        held(recorded, 3);
        (end.missed_commands, end.overruns) = (streak(5..8), streak(0..1001));
    });
    rejected(REALTIME, "3 commands missed", |_, end| {
        end.missed_commands = streak(5..8);
    });
    rejected(REALTIME, "0 commands missed", |recorded, _| {
        held(recorded, 3)
    });
    // Steps without a controller miss nothing.
    accepted(REALTIME, |recorded, _| {
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
    rejected(LOCKSTEP, "which is impossible in lockstep", |_, end| {
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
        rejected(REALTIME, "steps overran", |_, end| {
            end.overruns = streak(0..1);
            change(&mut end.overruns);
        });
    }
}

#[test]
fn effects_belong_to_existing_faults() {
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
    rejected(LOCKSTEP, "no such fault", |_, end| {
        end.effects = vec![effect(7)]
    });
    rejected(LOCKSTEP, "twice", |_, end| {
        end.effects = vec![effect(7), effect(7)];
    });
    rejected(LOCKSTEP, "after the end", |_, end| {
        end.effects = vec![FaultEffectSize {
            acted_steps: 1002,
            ..effect(7)
        }];
    });
    rejected(LOCKSTEP, "after the end", |_, end| {
        end.effects = vec![FaultEffectSize {
            ended_step: Some(1001),
            ..effect(7)
        }];
    });
    // The event of its acceptance may be lost.
    accepted(REALTIME, |recorded, end| {
        recorded.lost = 1;
        end.effects = vec![effect(7)];
    });
}
