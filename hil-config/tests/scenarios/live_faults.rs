//! Faults requested during a run.

use hil_config::live_requests::RequestContext;
use hil_config::plan::{FaultEvent, FaultSource, Trigger};
use hil_config::problem::{Problem, ProblemKind};
use shared_types::live::Refusal;
use shared_types::table::Field;
use shared_types::time::Step;

use crate::bad::assert_found;
use crate::{BASE, descriptions, only, plan};

const BIAS: &str = "effects = [{ target = \"measured.surface_angle_rad\", bias = 0.1 }]";

/// Requests faults from the base's run, which has the events 1, `leak`, and 2.
fn ask(toml: &str) -> Result<Vec<FaultEvent>, Vec<Problem>> {
    let (plants, kinds) = (descriptions::plants(), descriptions::kinds());
    let context = RequestContext {
        names: vec![("leak".into(), 1)],
        first_id: 3,
        ..RequestContext::of(&plan(BASE), &plants[0], &kinds)
    };
    let checked = context.check(toml, &[Field::signal("fault_detected", "1", "x")]);
    checked.map_err(|problems| problems.0)
}

fn refused(toml: &str) -> Vec<Problem> {
    ask(toml).expect_err("it is wrong")
}

#[test]
fn a_live_event_equals_a_scenarios_except_for_number_and_source() {
    let begin = BASE.find("[[faults]]").expect("faults");
    let end = BASE.find("[[derived]]").expect("what follows them");
    let expected = FaultEvent {
        id: 3,
        source: FaultSource::Cli,
        ..plan(BASE).faults.remove(0)
    };
    assert_eq!(ask(&BASE[begin..end]).expect("right"), [expected]);
}

#[test]
fn an_event_without_a_trigger_takes_effect_at_once() {
    let text = format!("[[faults]]\nkind = \"bias\"\n{BIAS}\n");
    let events = ask(&[text.as_str(), &text].concat()).expect("right");
    let actual: Vec<(u32, &Trigger)> = events.iter().map(|e| (e.id, &e.trigger)).collect();
    assert_eq!(actual, [(3, &Trigger::Now), (4, &Trigger::Now)]);
    // With this delay it is over in any case.
    let problem = only(refused(
        &text.replace("bias = 0.1", "bias = 0.1, skew_s = 2"),
    ));
    assert_found(
        &problem,
        ProblemKind::OutOfRange,
        &["the run is already over"],
    );
}

#[test]
fn every_trigger_of_a_scenario_is_available() {
    let step = Trigger::Step {
        step: Step(500),
        at_s: 0.5,
    };
    for (keys, expected) in [
        ("at_s = 0.5", step.clone()),
        ("at_step = 500", step),
        (
            "after = \"leak\"\ndelay_s = 0.5",
            Trigger::After {
                event: 1,
                delay_steps: 500,
            },
        ),
        (
            "after = 2",
            Trigger::After {
                event: 2,
                delay_steps: 0,
            },
        ),
    ] {
        let events = ask(&format!("[[faults]]\nkind = \"bias\"\n{keys}\n{BIAS}"));
        assert_eq!(events.expect(keys)[0].trigger, expected);
    }
    let when = "when = \"large and internal.fault_detected > 0\"";
    let events = ask(&format!("[[faults]]\nkind = \"bias\"\n{when}\n{BIAS}"));
    assert!(matches!(
        events.expect(when)[0].trigger,
        Trigger::Condition(_)
    ));
}

#[test]
fn new_events_may_wait_for_each_other() {
    let text = format!(
        "[[faults]]\nkind = \"bias\"\nafter = \"b\"\n{BIAS}\n\
         [[faults]]\nkind = \"bias\"\nname = \"b\"\nafter = \"leak\"\n{BIAS}\n"
    );
    let events = ask(&text).expect("right");
    let after = |event| Trigger::After {
        event,
        delay_steps: 0,
    };
    assert_eq!(
        (&events[0].trigger, &events[1].trigger),
        (&after(4), &after(1))
    );
    let problem = only(refused(&text.replace("\"leak\"", "3")));
    assert_found(
        &problem,
        ProblemKind::Mismatch,
        &["event 3, `b` wait for each other"],
    );
}

#[test]
fn each_faulty_request_is_refused_with_the_expected_value() {
    let one = |keys: &str| format!("[[faults]]\nkind = \"bias\"\n{keys}\n{BIAS}");
    #[rustfmt::skip] // a table
    let cases = [
        (String::new(), ProblemKind::MissingKey, &["`faults` is missing"][..]),
        ("faults = []".into(), ProblemKind::MissingKey, &["`faults` is missing", "at least one fault event"]),
        ("[[faults]".into(), ProblemKind::Syntax, &["not TOML"]),
        (format!("schema = 1\n{}", one("")), ProblemKind::UnknownKey, &["unknown key `schema`", "one of `faults`"]),
        (one("name = \"leak\""), ProblemKind::Duplicate, &["already named `leak`"]),
        (one("after = 4"), ProblemKind::UnknownName, &["there is no fault event 4", "one of `leak`, or a number from 1 to 3"]),
        (one("after = \"leek\""), ProblemKind::UnknownName, &["nearest: `leak`"]),
        (one("at_s = 2"), ProblemKind::OutOfRange, &["the run is already over at 2 s"]),
        (
            one("").replace(
                "0.1 }",
                "0.1, profile = { kind = \"table\", file = \"x.csv\" } }",
            ),
            ProblemKind::Unreadable,
            &["a running plant reads no files"],
        ),
        (
            "[[faults]]\nkind = \"message-loss\"\n\
             effects = [{ target = \"link.sample\", pattern = { file = \"x.csv\" } }]"
                .into(),
            ProblemKind::Unreadable,
            &["a running plant reads no files", "the numbers themselves"],
        ),
    ];
    for (text, kind, pieces) in cases {
        let problem = only(refused(&text));
        assert_found(&problem, kind, pieces);
        assert_eq!(problem.source, "request");
    }
}

#[test]
fn a_problem_is_answered_with_its_key_and_the_alternatives() {
    let problems = refused(&format!("[[faults]]\nkind = \"bais\"\n{BIAS}"));
    let refusal = Refusal::from(&problems[0]);
    assert_eq!(refusal.key, "faults[0].kind");
    assert_eq!(refusal.message, "plant `drhas` has no fault `bais`");
    assert_eq!(refusal.nearest[0], "bias");
    let expected = refusal.expected.expect("what is possible");
    assert!(
        expected.contains("`leakage`, `burst`, `bias`"),
        "{expected}"
    );

    let with_help = Problem {
        help: Some("do this".into()),
        ..problems[0].clone()
    };
    let message = Refusal::from(&with_help).message;
    assert_eq!(message, "plant `drhas` has no fault `bais`; do this");
}
