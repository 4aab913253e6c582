//! Control messages between plant and controller before step 0.
//!
//! An accepted message is written back unchanged. A hello is agreed to, or refused by name; the controller accepts the
//! agreement, in which both sides find every signal that they requested.

use shared_types::describe::PROTOCOL;
use shared_types::hello::{Control, Hello, Offer, Welcome, agree};
use shared_types::layout::SignalKind;
use shared_types::table::Field;
use shared_types::time::{Rate, Step};

use super::rig::rig;

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let control = match Control::from_bytes(bytes) {
        Ok(control) => control,
        Err(reason) => return assert!(!reason.is_empty()),
    };
    let written = control.to_bytes();
    let again = Control::from_bytes(&written).expect("what was written can be read");
    assert_eq!(again.to_bytes(), written);
    match control {
        Control::Hello(hello) => asked(hello),
        Control::Welcome(welcome) => answered(&welcome),
        Control::Refusal { .. } | Control::Ready { .. } | Control::Tuned(_) => {}
    }
}

/// A controller asks; it would be refused for its version and session alone, so also with the right
/// ones.
fn asked(hello: Hello) {
    let right = Hello {
        protocol: PROTOCOL,
        session: 7,
        ..hello.clone()
    };
    let plant = rig().plants.last().expect("a plant");
    let reference = [Field::signal("position_m", "m", "Where to.")];
    let offer = Offer {
        session: 7,
        epoch: 1,
        rate: Rate::new(1000.0).expect("a legal rate"),
        steps: 10,
        first: Step(0),
        against_clock: false,
        measured: &plant.measured,
        reference: &reference,
        commands: &plant.commands,
    };
    for hello in [hello, right] {
        let welcome = match agree(&hello, &offer) {
            Ok(welcome) => welcome,
            Err(refused) => {
                assert!(!refused.to_string().is_empty());
                continue;
            }
        };
        welcome.check(&hello).expect("agreed");
        for (kind, wanted) in [
            (SignalKind::Measured, &hello.measured),
            (SignalKind::Reference, &hello.reference),
        ] {
            let places = welcome.sample.bind(kind, wanted).expect("agreed");
            assert_eq!(places.len(), wanted.len());
            assert!(places.iter().all(|place| *place < welcome.sample.len()));
        }
        let commands = welcome.command.bind(SignalKind::Command, offer.commands);
        assert_eq!(commands.expect("agreed").len(), offer.commands.len());
    }
}

/// Answers as the plant, for any request.
fn answered(welcome: &Welcome) {
    let hello = Hello {
        protocol: PROTOCOL,
        session: welcome.session,
        law: "fuzzed".into(),
        measured: welcome.sample.fields(SignalKind::Measured),
        reference: welcome.sample.fields(SignalKind::Reference),
        commands: Some(welcome.command.fields(SignalKind::Command)),
        internals: welcome.command.fields(SignalKind::Internal),
        tunable: vec![],
    };
    if let Err(refused) = welcome.check(&hello) {
        assert!(!refused.to_string().is_empty());
    }
    let _ = welcome.sample.bind(SignalKind::Measured, &hello.measured);
    assert_eq!(welcome.frame_identity().session, welcome.session);
    let hz = welcome.rate.hz();
    assert!((Rate::MIN_HZ..=Rate::MAX_HZ).contains(&hz), "{hz} Hz");
    assert!(welcome.rate.period_s().is_finite());
    let _ = welcome.rate.nanoseconds(Step(welcome.steps));
}
