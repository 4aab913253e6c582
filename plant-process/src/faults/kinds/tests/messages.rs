//! Kinds that act on messages of the link.

use shared_types::frame::{FrameKind, VALIDITY_WORDS};

use super::*;
use crate::faults::channel::{About, Channel};

#[test]
fn messages_are_lost_delayed_duplicated_and_swapped_as_specified() {
    // Each message's copies by their delays, with `+` after an overtaken one.
    fn text(passage: &Passage) -> String {
        let copies = passage.copies.iter().zip(passage.overtaken);
        let copies = copies.filter_map(|(copy, overtaken)| {
            copy.map(|late| format!("{late}{}", if overtaken { "+" } else { "" }))
        });
        copies.collect::<Vec<_>>().join(" ")
    }
    type Case<'a> = (&'a str, Parameters<'a>, &'a [f64], &'a [(f64, &'a str)]);
    #[rustfmt::skip] // a table
    let cases: &[Case<'_>] = &[
        ("message-loss", &[], &[], &[(1.0, ""), (0.0, "0"), (2.0, "")]),
        ("message-loss", &[], &[1.0, 0.0, 0.0], &[(1.0, ""), (1.0, "0"), (1.0, "0"), (0.1, ""), (1.0, "0"), (1.0, "0"), (0.0, "0")]),
        ("message-loss", &[("probability", 0.0)], &[], &[(1.0, "0"); 3]),
        // round(2.5) = 3, halves away from 0; never early.
        ("message-delay", &[("steps", 5.0)], &[], &[(0.0, "0"), (0.5, "3"), (1.0, "5"), (-1.0, "0"), (2.0, "10")]),
        ("message-duplication", &[("lag_steps", 3.0)], &[], &[(1.0, "0 3+"), (0.0, "0"), (1.0, "0 3+")]),
        ("message-duplication", &[], &[], &[(1.0, "0 1+")]),
        // The message after a swapped one keeps its place.
        ("message-reordering", &[], &[], &[(1.0, "1+"), (1.0, "0"), (1.0, "1+"), (1.0, "0"), (0.0, "0"), (1.0, "1+")]),
        ("message-jitter", &[("steps", 0.0)], &[], &[(1.0, "0"); 3]),
    ];
    for (kind, parameters, list, steps) in cases {
        let mut fault = start(kind, parameters, list);
        let gains: Vec<f64> = steps.iter().map(|(gain, _)| *gain).collect();
        let actual: Vec<String> = passages(fault.as_mut(), &gains).iter().map(text).collect();
        let expected: Vec<&str> = steps.iter().map(|(_, copies)| *copies).collect();
        assert_eq!(actual, expected, "{kind} {parameters:?} {list:?}");
    }
}

/// Sends 100, 101, 102 .. from step 100 on, after 99 arrived, through faults in the order in which they act; returns
/// the receiver's values and ages.
fn received(stack: &[(&str, Parameters<'_>, &[f64])], steps: u64) -> Vec<(f64, u32)> {
    let mut faults: Vec<_> = (stack.iter())
        .map(|(kind, parameters, list)| start(kind, parameters, list))
        .collect();
    let (mut channel, all_valid) = (Channel::new(1, FrameKind::Sample), [0; VALIDITY_WORDS]);
    let about = |step| About {
        step,
        ..About::default()
    };
    channel.note(&[99.0], about(99));
    channel.begin();
    let mut actual = Vec::new();
    for since in 0..steps {
        let at = moment(since, 1.0);
        let mut passage = Passage::healthy(channel.bits());
        for fault in &mut faults {
            fault.message(&at, &mut passage);
        }
        channel.put(&[at.step as f64], about(at.step));
        channel.send(Step(at.step), &passage);
        let (mut values, mut invalid) = ([0.0], all_valid);
        let age_steps = channel.receive(Step(at.step), &mut values, &mut invalid);
        actual.push((values[0], age_steps));
    }
    actual
}

#[test]
fn a_receiver_sees_the_messages_that_the_medium_lets_through() {
    type Case<'a> = (&'a [(&'a str, Parameters<'a>, &'a [f64])], &'a [(f64, u32)]);
    #[rustfmt::skip] // a table
    let cases: &[Case<'_>] = &[
        (&[("message-loss", &[], &[])], &[(99.0, 1), (99.0, 2), (99.0, 3)]),
        (&[("message-loss", &[], &[1.0, 1.0, 0.0])], &[(99.0, 1), (99.0, 2), (102.0, 0), (102.0, 1)]),
        (&[("message-delay", &[("steps", 2.0)], &[])], &[(99.0, 1), (99.0, 2), (100.0, 2), (101.0, 2)]),
        // Every message is followed by the previous one.
        (&[("message-duplication", &[], &[])], &[(100.0, 0), (100.0, 1), (101.0, 1), (102.0, 1)]),
        // 100 arrives after 101, 102 after 103.
        (&[("message-reordering", &[], &[])], &[(99.0, 1), (100.0, 1), (100.0, 2), (102.0, 1)]),
        (&[("message-corruption", &[("bits", 3.0)], &[])], &[(99.0, 1), (99.0, 2), (99.0, 3)]),
        // The duplicate of a late message is even later, whichever acts first.
        (
            &[
                ("message-delay", &[("steps", 2.0)], &[]),
                ("message-duplication", &[], &[]),
            ],
            &[(99.0, 1), (99.0, 2), (100.0, 2), (100.0, 3), (101.0, 3)],
        ),
        (
            &[
                ("message-duplication", &[], &[]),
                ("message-delay", &[("steps", 2.0)], &[]),
            ],
            &[(99.0, 1), (99.0, 2), (100.0, 2), (100.0, 3), (101.0, 3)],
        ),
        // A lost message cannot be duplicated.
        (&[("message-loss", &[], &[0.0, 1.0]), ("message-duplication", &[], &[])], &[(100.0, 0), (100.0, 1), (102.0, 0), (102.0, 1)]),
        // A second duplication duplicates the first copy again.
        (
            &[
                ("message-loss", &[], &[0.0, 1.0, 1.0, 1.0]),
                ("message-duplication", &[("lag_steps", 1.0)], &[]),
                ("message-duplication", &[("lag_steps", 3.0)], &[]),
            ],
            &[(100.0, 0), (100.0, 1), (100.0, 2), (100.0, 3), (104.0, 0)],
        ),
    ];
    for (stack, expected) in cases {
        let steps = expected.len() as u64;
        assert_eq!(received(stack, steps), *expected, "{stack:?}");
    }
}

#[test]
fn probabilities_are_the_requested_ones_times_the_profile() {
    let count = 20_000;
    for (kind, probability, gain, expected) in [
        ("message-loss", 0.2, 1.0, 0.2),
        ("message-loss", 0.2, 0.5, 0.1),
        ("message-duplication", 0.3, 1.0, 0.3),
        ("message-corruption", 0.4, 0.25, 0.1),
        // Of the messages after an unswapped one, P are swapped, and each of those is followed by an unswapped one: f =
        // P (1 - f).
        ("message-reordering", 0.25, 1.0, 0.2),
    ] {
        let mut fault = start(kind, &[("probability", probability)], &[]);
        let actual = passages(fault.as_mut(), &vec![gain; count]);
        let hit = actual.iter().filter(|one| **one != Passage::healthy(BITS));
        assert_frequency(kind, hit.count(), count, expected);
    }
}

#[test]
fn jitter_is_uniform_from_zero_to_the_longest_delay() {
    let (count, mut counts) = (20_000, [0; 6]);
    let mut jitter = start("message-jitter", &[("steps", 8.0)], &[]);
    for passage in passages(jitter.as_mut(), &vec![0.5; count]) {
        counts[passage.copies[0].expect("it arrives") as usize] += 1;
    }
    for (late_steps, happened) in counts.into_iter().enumerate().take(5) {
        assert_frequency(&format!("{late_steps} steps late"), happened, count, 0.2);
    }
    assert_eq!(counts[5], 0, "round(8 g) = 4 is the latest");
}

#[test]
fn corruption_inverts_different_bits_anywhere_in_the_frame() {
    let (count, bits) = (2_000, 16);
    let mut corruption = start("message-corruption", &[("bits", 16.0)], &[]);
    let mut in_first_half = 0;
    for passage in passages(corruption.as_mut(), &vec![1.0; count]) {
        assert_eq!(passage.flipped, bits);
        let mut flips = passage.flips;
        flips.sort_unstable();
        assert!(flips.windows(2).all(|pair| pair[0] < pair[1]), "{flips:?}");
        assert!(flips[bits - 1] < BITS);
        in_first_half += flips.iter().filter(|bit| **bit < BITS / 2).count();
    }
    assert_frequency("in the first half", in_first_half, count * bits, 0.5);
    // A frame with exactly as many bits has each of them inverted.
    let mut tiny = Passage::healthy(16);
    corruption.message(&moment(0, 1.0), &mut tiny);
    let mut flips = tiny.flips;
    flips.sort_unstable();
    assert_eq!(flips.to_vec(), (0..16).collect::<Vec<u64>>());
}

#[test]
fn a_flood_delays_and_loses_the_shares_that_follow_from_its_load() {
    const MESSAGES: usize = 100_000;
    for (load, wait_steps, gain) in [
        (1.0, 0.0, 1.0),
        (0.6, 3.0, 1.0),
        (0.8, 1000.0, 0.5),
        (0.6, 0.0, 0.0),
    ] {
        let mut fault = start("babble", &[("load", load), ("wait_steps", wait_steps)], &[]);
        let passages = passages(fault.as_mut(), &[gain; MESSAGES]);
        let share = |is_it: &dyn Fn(Option<u32>) -> bool| {
            let count = passages
                .iter()
                .filter(|passage| is_it(passage.copies[0]))
                .count();
            count as f64 / MESSAGES as f64
        };
        // Geometric: P(d = n) = p^n (1 - p), and beyond the longest wait nothing is sent.
        let busy: f64 = load * gain;
        let within = |actual: f64, expected: f64| (actual - expected).abs() < 0.01;
        let lost = libm::pow(busy, wait_steps + 1.0);
        assert!(
            within(share(&|copy| copy.is_none()), lost),
            "{load} {wait_steps}"
        );
        for n in 0..=(wait_steps as u32).min(5) {
            let expected = libm::pow(busy, n.into()) * (1.0 - busy);
            assert!(
                within(share(&|copy| copy == Some(n)), expected),
                "{load} {n}"
            );
        }
    }
}
