//! The layer step by step, against sequences computed by hand.
//!
//! At step k the healthy plant measures `a_m` = k and `b_m` = 10, the rig requests `r_m` = 5, and the controller
//! answers with `u_n` = k and `v_n` = -1. The fault kinds here are as simple as possible.

mod kinds;
mod links;
mod live;
mod rig;
mod schedule;
mod targets;

use hil_config::plan::Trigger;
use shared_types::describe::Operation;
use shared_types::directive::Directive;
use shared_types::record::RecordLayout;

use self::rig::*;
use super::FaultLayer;

#[test]
fn without_a_fault_everything_passes_unchanged() {
    for events in [
        vec![],
        vec![event(1, "plus", at(1000), &[on("measured.a_m", 1.0)])],
    ] {
        let mut rig = Rig::new(&events);
        for (k, passed) in (0..).zip(rig.run(50)) {
            let healthy = Passed {
                sample: [f64::from(k), 10.0, 5.0],
                invalid: 0,
                sample_age_steps: 0,
                directive: Directive::default(),
                busy_ns: 0,
                applied: [f64::from(k), -1.0],
                command_age_steps: 0,
                parameters: [1.0, 10.0, 0.0],
                retuned: false,
            };
            assert_eq!(passed, healthy);
        }
        assert_eq!((rig.events, rig.layer.rejected()), (vec![], 0));
    }
}

#[test]
fn impossible_faults_are_refused_by_name() {
    #[rustfmt::skip] // a table
    let cases = [
        ("plus", on("measured.c_m", 1.0), "`plus` cannot act on `measured.c_m`"),
        ("plus", on("link.sample", 1.0), "`plus` cannot act on `link.sample`"),
        ("gone", on("parameter.gain", 1.0), "`gone` cannot act on `parameter.gain`"),
        ("plus", on("parameter.mass_kg", 1.0), "`mass_kg` is not faultable"),
        ("late", on("measured.a_m", 1.0), "`late` cannot act on `measured.a_m`"),
        ("late", on("link.other", 1.0), "`late` cannot act on `link.other`"),
        ("jump", on("plant", 1.0), "`jump` cannot act on `plant`"),
        ("sabotage", on("plant", 1.0), "there is no fault `sabotage`"),
        ("x", moving(&[("mass_kg", Operation::Add, 1.0)]), "`mass_kg` is not faultable"),
        ("x", moving(&[]), "moves no parameter"),
    ];
    let builder = builder();
    for (kind, effect, expected) in cases {
        let event = event(1, kind, at(0), &[effect]);
        let result = FaultLayer::new(&builder, &[event]);
        let result = result.map(|_| ()).expect_err(expected).to_string();
        assert!(result.contains(expected), "{result}");
    }
}

#[test]
fn a_condition_on_an_unknown_signal_is_refused_once_the_signals_are_known() {
    let condition = Trigger::Condition(when("internal.z > 0", 1));
    let event = event(1, "plus", condition, &[on("measured.a_m", 1.0)]);
    let builder = builder();
    let mut layer = FaultLayer::new(&builder, &[event]).expect("not known yet");
    let result = layer.open(&builder, &RecordLayout::default());
    assert!(
        result
            .expect_err("unknown")
            .to_string()
            .contains("internal.z")
    );
}
