//! Two networks: A alone and both, with faults on one of them or on both.

use std::hash::{DefaultHasher, Hash, Hasher};

use hil_config::plan::FaultEvent;

use super::{PORT, Rig, event};

/// Random loss, duplication and reordering on a target.
fn unreliable(target: &str) -> Vec<FaultEvent> {
    let chance: &[(&str, f64)] = &[("probability", 0.2)];
    ["message-loss", "message-duplication", "message-reordering"]
        .into_iter()
        .zip(1..)
        .map(|(kind, id)| event(id, kind, 0, &[(target, chance)]))
        .collect()
}

/// Sends readings that a frame carries exactly; returns how many of them did not arrive at their step, and a digest of
/// all that arrived.
fn missed(networks: u8, events: &[FaultEvent], steps: u64) -> (u64, u64) {
    let mut rig = Rig::new(PORT, networks, events);
    let (mut missed, mut digest) = (0, DefaultHasher::new());
    for k in 0..steps {
        let reading = (k % 30_000) as f64 * 0.25;
        let passed = rig.send(reading, true);
        let is_there = passed.a_m == reading && passed.invalid & 1 == 0 && passed.age_steps == 0;
        missed += u64::from(!is_there);
        (passed.a_m.to_bits(), passed.invalid).hash(&mut digest);
    }
    (missed, digest.finish())
}

fn one_unreliable_network_loses_nothing(steps: u64) {
    let (none, healthy) = missed(1, &[], steps);
    assert_eq!(none, 0);
    for network in ["link.sample.a", "link.sample.b"] {
        let (missed, digest) = missed(2, &unreliable(network), steps);
        assert_eq!((missed, digest), (0, healthy), "{network}");
    }
    let (alone, _) = missed(1, &unreliable("link.sample"), steps);
    assert!(alone > steps / 5, "a single network loses frames: {alone}");
}

#[test]
fn a_hundred_thousand_frames_survive_one_unreliable_network() {
    one_unreliable_network_loses_nothing(100_000);
}

#[test]
#[ignore = "long: a minute"]
fn ten_million_frames_survive_one_unreliable_network() {
    one_unreliable_network_loses_nothing(10_000_000);
}

#[test]
fn a_silent_network_changes_nothing_but_the_counts() {
    let lost = event(1, "message-loss", 3, &[("link.sample.a", &[])]);
    let mut rig = Rig::new(PORT, 2, &[lost]);
    let passed = rig.count(10);
    let expected: Vec<_> = (0..10).map(|k| (f64::from(k), true, 0)).collect();
    assert_eq!(passed, expected);
    let counts = rig.counts("motion");
    assert_eq!(
        (counts.sent, counts.accepted, counts.redundant),
        (10, 10, 3)
    );
}

#[test]
fn an_effect_without_a_network_acts_on_both_alike() {
    let chance: &[(&str, f64)] = &[("probability", 0.5)];
    let lost = event(1, "message-loss", 1, &[("link.sample", chance)]);
    let text = PORT.replace("    { kind = \"counter\", type = \"u8\" },\n", "");
    let mut both = Rig::new(&text, 2, std::slice::from_ref(&lost));
    let passed = both.count(2000);
    let lost_frames = passed.iter().filter(|(_, _, age)| *age > 0).count();
    // Half of them, and an eighth that comes after two or more lost ones, out of order.
    assert!((1200..1300).contains(&lost_frames), "{lost_frames}");
    // Of each frame both copies arrived, or none.
    let counts = both.counts("motion");
    assert_eq!(counts.accepted, counts.redundant);
    assert_eq!(counts.out_of_order % 2, 0);
}

#[test]
fn a_flood_on_one_network_is_no_loss_and_on_both_it_is() {
    let one = event(1, "babble", 2, &[("link.sample.b", &[])]);
    let mut rig = Rig::new(PORT, 2, &[one]);
    assert!(
        rig.count(20)
            .iter()
            .all(|(_, is_valid, age)| *is_valid && *age == 0)
    );
    let both = event(
        1,
        "babble",
        2,
        &[("link.sample.a", &[]), ("link.sample.b", &[])],
    );
    let mut rig = Rig::new(PORT, 2, &[both]);
    assert_eq!(rig.count(20)[19], (1.0, false, 18));
}

#[test]
fn frames_lost_on_both_networks_are_lost() {
    let chance: &[(&str, f64)] = &[("probability", 0.5)];
    let lost = event(
        1,
        "message-loss",
        0,
        &[("link.sample.a", chance), ("link.sample.b", chance)],
    );
    let mut rig = Rig::new(PORT, 2, &[lost]);
    let passed = rig.count(4000);
    let lost_frames = passed.iter().filter(|(_, _, age)| *age > 0).count();
    // A quarter, and those that an order of numbers or a counter refuses afterwards.
    assert!(lost_frames > 900, "{lost_frames}");
}
