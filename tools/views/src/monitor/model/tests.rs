use hil_config::scenario::Scenario;
use shared_types::describe::PlantDescription;
use shared_types::live::Possible;
use shared_types::record::{FaultBegun, RunEnd, Timing};

use super::*;

/// Checks a scenario of the project against the built-in plants and laws.
pub(crate) fn plan_of(text: &str) -> Plan {
    let plants: Vec<_> = (plant_process::models::all().iter())
        .map(|plant| plant.description.clone())
        .collect();
    let laws: Vec<_> = (controller_process::laws::all().iter())
        .map(|law| law.description.clone())
        .collect();
    let scenario = Scenario::parse(text, "watched.toml").expect("TOML");
    let checked = scenario.check(&plants, &laws, &possible_kinds());
    checked.unwrap_or_else(|problems| panic!("{problems}"))
}

fn possible_kinds() -> Vec<shared_types::describe::FaultKindDescription> {
    (plant_process::faults::kinds::all().into_iter())
        .map(|kind| kind.description)
        .collect()
}

/// Returns the paper's scenario.
pub(crate) fn plan() -> Plan {
    plan_of(include_str!("../../../../../scenarios/severe-leakage.toml"))
}

/// Returns the faults that the scenario's plant offers.
pub(crate) fn possible(plan: &Plan) -> Possible {
    Possible {
        rate: plan.run.rate,
        plant: plant(plan),
        reference: plan.reference(),
        inputs: hil_config::plan::driven(&plan.stimuli),
        kinds: possible_kinds(),
        networks: 1,
    }
}

fn plant(plan: &Plan) -> PlantDescription {
    let plants = plant_process::models::all().into_iter();
    let plants: Vec<_> = plants.map(|kind| kind.description).collect();
    plan.plant_among(&plants).expect("built in")
}

/// Returns the layout of the scenario's records.
pub(crate) fn layout(plan: &Plan) -> RecordLayout {
    let laws = controller_process::laws::all().into_iter();
    let laws: Vec<_> = laws.map(|kind| kind.description).collect();
    plan.record_layout(&plant(plan), &plan.law_among(&laws).expect("built in"))
}

/// Returns a model attached to a session of the scenario.
pub(crate) fn attached(plan: Plan, patterns: &[&str]) -> Model {
    let patterns: Vec<String> = patterns.iter().map(|&text| text.into()).collect();
    let layout = layout(&plan);
    let mut model = Model::new("demo", Some("/runs/demo".into()), plan, &patterns);
    model.attach(&layout).expect("its signals are there");
    model
}

/// Feeds a record in which every signal has the same value.
pub(crate) fn feed(model: &mut Model, layout: &RecordLayout, step: u64, value: f64) {
    let mut words = vec![0; layout.words()];
    words[0] = step;
    let first = layout.values_start();
    words[first..first + layout.values()].fill(value.to_bits());
    let mut view = layout.view(&words);
    view.timing = Timing {
        published_ns: 1_000_000_000 + step * 3_000,
        round_trip_ns: 1_500 + step % 7,
        ..Timing::default()
    };
    model.take(Seen::Record(view, &words));
}

fn spring_mass() -> Plan {
    plan_of(include_str!("../../../../../scenarios/spring-mass.toml"))
}

#[test]
fn a_model_reports_position_and_speed_of_the_run() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &[]);
    assert_eq!((model.state(), model.step()), ("starting", None));
    for step in 40..2000 {
        feed(&mut model, &layout, step, 0.5);
    }
    assert_eq!((model.state(), model.step()), ("running", Some(1999)));
    assert_eq!(model.joined_late(), Some(40));
    // 3 us per step of 1 ms.
    for step in 2000..60_000 {
        feed(&mut model, &layout, step, 0.5);
    }
    let speed = model.speed(1_000_000_000 + 60_000 * 3_000).expect("some");
    assert!((speed - 1e-3 / 3e-6).abs() < 0.5, "{speed}");
    let trips = model.pace().round_trips().expect("some");
    assert!((1500..1520).contains(&trips.p50), "{trips:?}");

    model.hear_status(Status {
        step: 60_002,
        time_s: 60.002,
        steps: 100_000,
        paused: true,
    });
    assert_eq!((model.state(), model.step()), ("paused", Some(60_002)));
    assert_eq!(model.seen(), Some(59_999));
}

#[test]
fn the_law_is_the_active_one() {
    let mut model = attached(spring_mass(), &[]);
    assert_eq!(model.law(), "pid");
    let change = |epoch, change| {
        let step = 10;
        Event::Controller(shared_types::record::ControllerChange {
            epoch,
            step,
            change,
        })
    };
    let reason = "not well".to_owned();
    model.take(Seen::Event(change(2, ControllerFate::Refused { reason })));
    assert_eq!(model.law(), "pid");
    let law = "hold".to_owned();
    model.take(Seen::Event(change(3, ControllerFate::Joined { law })));
    assert_eq!(model.law(), "hold");
}

#[test]
fn derived_signals_are_computed_from_the_records_that_are_seen() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &["tracking_error_m", "truth.position_m"]);
    feed(&mut model, &layout, 0, 0.25);
    let values: Vec<(String, f64)> = model.values().collect();
    // Truth and reference are equal here.
    assert_eq!(
        values,
        [
            ("truth.position_m".to_owned(), 0.25),
            ("tracking_error_m".to_owned(), 0.0)
        ]
    );
    let derived = model.plots()[0].signals[0];
    let history = model.history(derived).expect("it is drawn");
    assert_eq!(history.columns(0, 1, 1)[0].expect("a value").max, 0.0);
}

#[test]
fn an_unknown_signal_is_refused_when_the_signals_are_known() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = Model::new("demo", None, plan, &["truth.positon_m".into()]);
    let refused = model.attach(&layout).expect_err("no such signal");
    assert!(
        refused.to_string().contains("truth.position_m"),
        "{refused}"
    );
}

#[test]
fn events_are_logged_and_the_last_one_ends_the_run() {
    let mut model = attached(spring_mass(), &[]);
    model.take(Seen::Event(Event::Fault(FaultBegun {
        id: 3,
        effect: 0,
        step: 1500,
        kind: "bias".into(),
        target: "measured.position_m".into(),
        parameter: "position_m".into(),
        canonical: String::new(),
        wall_only: false,
    })));
    let text = "fault 3 bias on measured.position_m from step 1500 (1.5 s)";
    assert_eq!(model.note(), Some(text));
    model.take(Seen::Lost(7));
    assert_eq!(model.lost, 7);
    model.take(Seen::Event(Event::End(RunEnd::new(
        5000,
        Outcome::Completed,
    ))));
    model.end(Some("pass".into()));
    let ending = model.ending().expect("ended");
    assert_eq!((ending.steps, ending.is_gone), (Some(5000), true));
    assert_eq!(
        crate::monitor::line::ended(&model, ending),
        "spring-mass ended: pass, 5000 steps, /runs/demo"
    );
}

#[test]
fn a_vanished_session_is_reported_without_a_verdict() {
    let mut model = attached(spring_mass(), &[]);
    model.run_dir = None;
    model.end(None);
    let text = crate::monitor::line::text(&model, 0);
    assert_eq!(text, "spring-mass ended: without an outcome");
}

#[test]
fn a_killed_or_stopped_hil_is_reported() {
    let mut model = attached(spring_mass(), &[]);
    model.is_owner_stopped = true;
    let text = crate::monitor::line::text(&model, 0);
    assert_eq!(text, "spring-mass: starting, hil is stopped");
    model.abandon(false);
    assert!(!model.is_owner_stopped, "it is not any more");
    let text = crate::monitor::line::text(&model, 0);
    assert_eq!(
        text,
        "spring-mass ended: hil is gone without a summary, /runs/demo"
    );
    model.abandon(true);
    let text = crate::monitor::line::text(&model, 0);
    let mend = "`hil recover /runs/demo` completes its recording";
    assert_eq!(
        text,
        format!("spring-mass ended: hil is gone without a summary, {mend}")
    );
}

#[test]
fn a_missing_answer_keeps_the_known_requirements() {
    let mut model = attached(spring_mass(), &[]);
    model.hear_standings(None);
    assert_eq!(*model.judged(), Judged::Silent);
    model.hear_standings(Some(Vec::new()));
    model.hear_standings(None);
    assert_eq!(*model.judged(), Judged::Known(Vec::new()));
}

#[test]
fn an_answer_after_the_end_does_not_replace_the_summary() {
    let late = Standing {
        name: "settles".into(),
        verdict: "undecided".into(),
        robustness: None,
        at_least: None,
        at_most: None,
        unit: "m".into(),
        decided_at_s: None,
        vacuous: None,
    };
    let mut model = attached(spring_mass(), &[]);
    model.hear_standings(Some(Vec::new()));
    model.end(None);
    model.hear_standings(Some(vec![late]));
    assert_eq!(*model.judged(), Judged::Known(Vec::new()));
}

#[test]
fn a_record_that_is_not_newer_changes_nothing() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &["truth.position_m"]);
    feed(&mut model, &layout, 10, 0.5);
    feed(&mut model, &layout, 9, 0.25);
    feed(&mut model, &layout, 10, 0.25);
    assert_eq!(model.seen(), Some(10));
    assert_eq!(model.values().next().expect("one").1, 0.5);
}

#[test]
fn nan_values_stay_visible_as_such() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &["truth.position_m"]);
    feed(&mut model, &layout, 0, f64::NAN);
    assert!(model.values().next().expect("one").1.is_nan());
    let text = crate::monitor::line::json(&model, 0);
    assert_eq!(text["signals"]["truth.position_m"], serde_json::Value::Null);
}

#[test]
fn the_last_values_stay_when_the_final_record_lacks_them() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &["command.force_n"]);
    feed(&mut model, &layout, 4999, 0.5);
    feed(&mut model, &layout, 5000, f64::NAN);
    assert!(model.values().next().expect("one").1.is_nan());
    model.take(Seen::Event(Event::End(RunEnd::new(
        5000,
        Outcome::Completed,
    ))));
    assert_eq!(model.values().next().expect("one").1, 0.5);
    // A value missing before does not count as a last value.
    let mut model = attached(spring_mass(), &["command.force_n"]);
    for step in 4999..=5000 {
        feed(&mut model, &layout, step, f64::NAN);
    }
    model.end(None);
    assert!(model.values().next().expect("one").1.is_nan());
}

#[test]
fn an_outdated_account_adds_no_event_twice() {
    let mut model = attached(spring_mass(), &[]);
    let mark = |step| {
        Event::Mark(shared_types::record::Mark {
            step,
            text: "here".into(),
        })
    };
    let rate = model.rate();
    let events = |steps: std::ops::Range<u64>| -> Vec<Happening> {
        steps
            .filter_map(|step| Happening::of(&mark(step), rate))
            .collect()
    };
    model.hear_account(0, events(0..2));
    model.take(Seen::Event(mark(3)));
    model.hear_whole_account(events(0..5));
    model.hear_account(2, events(2..4));
    let steps: Vec<u64> = model.log().list().iter().map(|one| one.step).collect();
    assert_eq!(steps, [0, 1, 2, 3, 4]);
}

#[test]
fn an_invalid_signal_leaves_a_gap() {
    let plan = spring_mass();
    let layout = layout(&plan);
    let mut model = attached(plan, &["measured.position_m", "truth.position_m"]);
    feed(&mut model, &layout, 0, 1.0);
    let mut words = vec![0; layout.words()];
    words[0] = 1;
    let first = layout.values_start();
    words[first..first + layout.values()].fill(2.0_f64.to_bits());
    words[1] = u64::MAX;
    model.take(Seen::Record(layout.view(&words), &words));
    let measured = layout.truth.len();
    for trace in &model.traces {
        let is_measured = trace.column == measured;
        assert_eq!(trace.value.is_nan(), is_measured, "{}", trace.column);
        let drawn = trace.history.columns(1, 2, 2);
        assert_eq!(drawn[1].is_some(), !is_measured, "{}", trace.column);
    }
}
