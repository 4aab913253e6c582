//! Runs that end: diverged, stopped, refused, and confirmed at the last moment.

use std::cell::RefCell;
use std::rc::Rc;

use hil_config::plan::Limit;
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use shared_types::record::ControllerFate;

use super::*;
use crate::engine::chatter;

#[test]
fn a_diverged_plant_ends_at_the_step_with_the_signal_named() {
    let mut job = job(9);
    job.plant.limits = vec![Limit {
        signal: "position_m".into(),
        min: -1.5,
        max: 1.5,
    }];
    let (mut engine, mut controller, mut source) = greeted(job);
    let end = run(&mut engine, &mut controller, 1.0);
    assert_eq!(end.kind(), Some(FrameKind::Abort));
    assert_eq!(AbortCode::from_wire(end.directive), AbortCode::Diverged);
    let run_end = engine.end().expect("over");
    let reason = "plant diverged at step 2 (0.2 s): position_m = 2 m is outside -1.5 to 1.5 m";
    assert_eq!(
        (run_end.outcome, run_end.reason.as_deref()),
        (Outcome::Diverged, Some(reason))
    );
    let (records, _) = published(&mut source);
    assert_eq!(
        records.last().expect("some")[..2],
        [2.0, 2.0],
        "its last record shows it"
    );
}

#[test]
fn a_plant_with_a_nan_output_is_stopped_before_sending_it() {
    let (mut engine, mut controller, mut source) = greeted(job(9));
    let end = run(&mut engine, &mut controller, f64::MAX);
    assert_eq!(AbortCode::from_wire(end.directive), AbortCode::Diverged);
    let (records, _) = published(&mut source);
    assert!(records.iter().flatten().all(|value| value.is_finite()));
}

#[test]
fn a_nan_command_ends_the_run_and_is_named() {
    for force_n in [f64::NAN, f64::INFINITY] {
        let (mut engine, mut controller, mut source) = greeted(job(9));
        let end = run(&mut engine, &mut controller, force_n);
        assert_eq!(AbortCode::from_wire(end.directive), AbortCode::NotANumber);
        let reason = engine.end().expect("over").reason.clone().expect("told");
        assert!(reason.contains("command of step 0: force_n"), "{reason}");
        assert_eq!(published(&mut source).0.len(), 0);
    }
}

#[test]
fn a_controller_in_the_same_process_is_lost_with_its_own_reason() {
    let other = "controller gave up at step 0: see its log";
    for known in [Some("no gain"), None] {
        let reason = known.unwrap_or(other);
        for policy in [OnLoss::Abort, OnLoss::Hold] {
            let job = chatter::job_of(2, policy, Clock::Lockstep);
            let (engine, mut controller, mut source) = greeted(job);
            let mut engine = engine.without_log();
            frame(&mut engine, &mut controller);
            let abort = Header {
                directive: AbortCode::Other as u64,
                ..Header::new(FrameKind::Abort, Step(0))
            };
            controller.send(&abort, &[]).expect("sends");
            if let Some(known) = known {
                engine.controller_failed(known.into());
            }
            while engine.poll().expect("polls") != Progress::Over {}
            let end = engine.end().expect("over");
            if policy == OnLoss::Abort {
                assert_eq!(end.reason.as_deref(), Some(reason));
                continue;
            }
            assert_eq!(end.outcome, Outcome::Completed);
            let (_, events) = published(&mut source);
            let [Event::Controller(change), Event::End(_)] = &events[..] else {
                panic!("{events:?}");
            };
            let fate = ControllerFate::Lost {
                reason: reason.into(),
                policy,
            };
            assert_eq!(change.change, fate);
        }
    }
}

#[test]
fn a_stop_informs_the_controller_and_keeps_the_records() {
    let (mut engine, mut controller, mut source) = greeted(job(9));
    for step in 0..2 {
        frame(&mut engine, &mut controller);
        let answer = Header::new(FrameKind::Command, Step(step));
        controller.send(&answer, &[0.0; 3]).expect("sends");
        engine.poll().expect("polls");
    }
    engine.interrupt(&PlantEvent::Stop).expect("stops");
    let abort = controller.receive(&mut [0.0; 3]).expect("polls");
    let abort = abort.expect("a frame");
    assert_eq!(AbortCode::from_wire(abort.directive), AbortCode::Stopped);
    assert_eq!(engine.poll().expect("polls"), Progress::Over);
    let (records, events) = published(&mut source);
    assert_eq!(records.len(), 2);
    assert!(matches!(&events[..], [Event::End(end)] if end.outcome == Outcome::Stopped));
}

#[test]
fn an_incompatible_controller_is_refused_with_the_reason() {
    let (mut engine, mut controller, _source) = started(&kind(), job(3));
    let hello = Hello {
        measured: vec![Field::signal("posiition_m", "m", "x")],
        ..Hello::new(5, "test")
    };
    let Control::Refusal { reason } = greet(&mut engine, &mut controller, hello) else {
        panic!("no refusal");
    };
    assert!(
        reason.contains("no signal `posiition_m`, nearest: position_m"),
        "{reason}"
    );
    assert_eq!(engine.end().map(|end| end.outcome), Some(Outcome::Failed));
}

/// Link whose other end confirms and ends just after the plant polled in vain.
struct LastWord {
    inner: InProcessLink,
    controller: Rc<RefCell<InProcessLink>>,
    supervision: Supervision,
}

impl Link for LastWord {
    shared_types::pass_on!(self => self.inner; send_control tell receive_control expect peer open_frames take_over send rejected);

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        let result = self.inner.receive(values)?;
        if result.is_none() {
            let confirmed = Header::new(FrameKind::EndConfirmed, Step(0));
            self.controller.borrow_mut().send(&confirmed, &[])?;
            self.supervision.peer_gone(1);
        }
        Ok(result)
    }
}

#[test]
fn a_confirmation_sent_just_before_the_controllers_end_counts() {
    let (inner, controller) = pair();
    let controller = Rc::new(RefCell::new(controller));
    let supervision = Supervision::new();
    let link = LastWord {
        inner,
        controller: Rc::clone(&controller),
        supervision: supervision.clone(),
    };
    let (sink, _source) = shared_types::stream::in_process::pair();
    let mut engine = Engine::new(&kind(), &kinds::all(), job(0), link, sink).expect("starts");
    let mut end = controller.borrow_mut();
    let answer = greet(&mut engine, &mut end, Hello::new(5, "test"));
    join(&mut end, answer, 1);
    drop(end);
    let limit = WaitLimit::from_seconds(60.0);
    crate::program::drive(&mut engine, Waiter::new(limit), &supervision).expect("drives");
    let end = engine.end().expect("over");
    assert_eq!(
        (end.outcome, end.reason.as_deref()),
        (Outcome::Completed, None)
    );
}
