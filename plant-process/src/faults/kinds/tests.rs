//! Every kind against its closed form or a sequence computed by hand: tests common to all kinds.

mod messages;
mod numbers;
mod page;
mod stages;
mod timing;

use shared_types::describe::{FaultKindDescription, Settings};
use shared_types::directive::Directive;
use shared_types::frame::words;
use shared_types::random::RandomStream;
use shared_types::time::{Rate, Step};

use super::*;
use crate::faults::kind::{AnySetup, Fault, Moment, Passage, Reading};

type Parameters<'a> = &'a [(&'a str, f64)];

/// Steps per second in these tests, chosen such that times of steps are exact in binary.
const RATE_HZ: f64 = 8.0;
/// Bits of a frame with one signal.
const BITS: u64 = 64 * words(1) as u64;

fn rate(hz: f64) -> Rate {
    Rate::new(hz).expect("a valid rate")
}

fn entry(kind: &str) -> FaultKindEntry {
    let entries = all()
        .into_iter()
        .find(|entry| entry.description.kind == kind);
    entries.unwrap_or_else(|| panic!("no kind `{kind}`"))
}

/// Starts a fault as the fault builder does: omitted parameters have their defaults.
fn try_start(kind: &str, values: Parameters<'_>, list: &[f64]) -> Result<Box<dyn Fault>, Invalid> {
    let entry = entry(kind);
    let mut parameters = Settings::default();
    for field in &entry.description.parameters {
        let value = values.iter().find(|(name, _)| *name == field.name);
        let value = value.map(|(_, value)| *value).or(field.default);
        parameters.set(&field.name, value.unwrap_or_else(|| panic!("{field:?}")));
    }
    (entry.start)(&AnySetup {
        parameters: &parameters,
        list,
        rate: rate(RATE_HZ),
        signals: 4,
        is_instrument: false,
    })
}

/// Does the same, and begins with a seed.
fn seeded(kind: &str, parameters: Parameters<'_>, list: &[f64], seed: u64) -> Box<dyn Fault> {
    let fault = try_start(kind, parameters, list);
    let mut fault = fault.unwrap_or_else(|e| panic!("{kind}: {e}"));
    fault.hold(RandomStream::new(seed, "kinds"));
    fault
}

fn start(kind: &str, parameters: Parameters<'_>, list: &[f64]) -> Box<dyn Fault> {
    seeded(kind, parameters, list, 1)
}

/// Returns a moment after the fault began at step 100.
fn moment_at(since_steps: u64, gain: f64, hz: f64) -> Moment {
    Moment {
        step: 100 + since_steps,
        since_steps,
        since_s: rate(hz).seconds(Step(since_steps)),
        gain,
    }
}

fn moment(since_steps: u64, gain: f64) -> Moment {
    moment_at(since_steps, gain, RATE_HZ)
}

fn valid(value: f64) -> Reading {
    Reading { value, valid: true }
}

/// Returns the passages that a fault makes of healthy messages, one for each profile value.
fn passages(fault: &mut dyn Fault, gains: &[f64]) -> Vec<Passage> {
    (0..)
        .zip(gains)
        .map(|(since, &gain)| {
            let mut passage = Passage::healthy(BITS);
            fault.message(&moment(since, gain), &mut passage);
            passage
        })
        .collect()
}

fn directives(fault: &mut dyn Fault, gains: &[f64]) -> Vec<Directive> {
    (0..)
        .zip(gains)
        .map(|(since, &gain)| {
            let mut directive = Directive::default();
            fault.timing(&moment(since, gain), &mut directive);
            directive
        })
        .collect()
}

/// Asserts that something happened about as often as expected: within five standard deviations.
fn assert_frequency(what: &str, happened: usize, count: usize, probability: f64) {
    let n = count as f64;
    let sigma = (n * probability * (1.0 - probability)).sqrt();
    let error = happened as f64 - n * probability;
    assert!(error.abs() < 5.0 * sigma, "{what}: {happened} of {count}");
}

/// Returns meaningful parameters for any kind.
fn sample(description: &FaultKindDescription) -> Vec<(String, f64)> {
    let value = |name: &str| match name {
        "min" => -1.0,
        "busy_us" => 20.0,
        _ => 1.0,
    };
    let required = (description.parameters.iter())
        .filter(|field| field.default.is_none() || field.name == "busy_us");
    required
        .map(|field| (field.name.clone(), value(&field.name)))
        .collect()
}

#[test]
fn nothing_happens_while_the_profile_is_0() {
    for entry in all() {
        let description = &entry.description;
        let kind = &description.kind;
        let owned = sample(description);
        let values: Vec<(&str, f64)> = owned.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        // Places of signals and their factors; every other list may be left out.
        let list: &[f64] = match kind.as_str() {
            "cross-coupling" => &[2.0, 0.5],
            _ => &[],
        };
        let mut fault = start(kind, &values, list);
        for (since, x) in (0..).zip([0.3, -1e9, 5.0, 1e-9]) {
            let at = moment(since, 0.0);
            let row = [x, 7.0, 0.0, 0.0];
            assert_eq!(fault.coupled(&at, valid(x), &row), valid(x), "{kind}");
            let mut passage = Passage::healthy(BITS);
            fault.message(&at, &mut passage);
            assert_eq!(passage, Passage::healthy(BITS), "{kind}");
            let mut directive = Directive::default();
            fault.timing(&at, &mut directive);
            assert_eq!(directive, Directive::default(), "{kind}");
        }
    }
}

#[test]
fn random_kinds_repeat_with_their_seed_and_differ_with_another() {
    let half = [("probability", 0.5)];
    let cases: [(&str, Parameters<'_>); 9] = [
        ("noise", &[("standard_deviation", 1.0)]),
        (
            "gauss-markov",
            &[("standard_deviation", 1.0), ("time_constant_s", 1.0)],
        ),
        ("random-walk", &[("walk_per_sqrt_s", 1.0)]),
        ("message-loss", &half),
        ("message-jitter", &[("steps", 100.0)]),
        ("message-duplication", &half),
        ("message-reordering", &half),
        ("message-corruption", &[]),
        ("late", &[("spread_us", 100.0)]),
    ];
    for (kind, parameters) in cases {
        let course = |seed| {
            let mut fault = seeded(kind, parameters, &[], seed);
            let numbers: Vec<u64> = (0..64)
                .map(|k| fault.number(&moment(k, 1.0), valid(0.0)).value.to_bits())
                .collect();
            let messages = passages(fault.as_mut(), &[1.0; 64]);
            (numbers, messages, directives(fault.as_mut(), &[1.0; 64]))
        };
        assert_eq!(course(1), course(1), "{kind}");
        assert_ne!(course(1), course(2), "{kind}");
    }
}

#[test]
fn inconsistent_parameters_are_refused_with_the_reason() {
    type Case<'a> = (&'a str, Parameters<'a>, &'a [f64], &'a str);
    #[rustfmt::skip] // a table
    let cases: &[Case<'_>] = &[
        ("delay", &[("steps", 1.5)], &[], "`steps` is 1.5"),
        ("message-delay", &[("steps", 0.5)], &[], "`steps` is 0.5"),
        ("message-jitter", &[("steps", 2.5)], &[], "`steps` is 2.5"),
        ("message-duplication", &[("lag_steps", 1.1)], &[], "`lag_steps`"),
        ("message-corruption", &[("bits", 1.5)], &[], "`bits` is 1.5"),
        ("skip", &[("steps", 1.5)], &[], "`steps` is 1.5"),
        ("skip", &[("steps", 1.0), ("burst", 1.5)], &[], "`burst` is 1.5"),
        ("skip", &[("steps", 1.0), ("period_steps", 9.5)], &[], "`period_steps` is 9.5"),
        ("skip", &[("steps", 2.0), ("burst", 2.0), ("period_steps", 5.0)], &[], "takes 6 steps"),
        ("spike", &[("amplitude", 1.0), ("period_s", 0.25), ("width_s", 0.25)], &[], "never end"),
        // Shorter in time, equal in steps.
        ("spike", &[("amplitude", 1.0), ("period_s", 0.25), ("width_s", 0.2)], &[], "2 steps every 2 steps"),
        ("saturation", &[("min", 1.0), ("max", 0.5)], &[], "above `max`"),
        ("sample-hold", &[("every_steps", 1.5)], &[], "`every_steps` is 1.5"),
        ("sample-hold", &[("every_steps", 3.0), ("phase_steps", 3.0)], &[], "`phase_steps` is 3"),
        ("cross-coupling", &[], &[], "`cross` is missing"),
        ("cross-coupling", &[], &[5.0, 0.1], "signal 5, but there are only the signals 1 to 4"),
        ("cross-coupling", &[], &[0.0, 0.1], "signal 0"),
        ("message-loss", &[], &[1.0, 0.5], "contains 0.5"),
        (
            "message-loss",
            &[("probability", 0.5)],
            &[1.0],
            "give only one",
        ),
        ("late", &[], &[], "needs"),
        ("late", &[("busy_us", 1.0)], &[1.0, 1.0], "replaces"),
        ("late", &[], &[1.0, -1.0], "weight -1"),
        ("late", &[], &[-1.0, 1.0], "-1 us"),
        ("late", &[], &[1.0, f64::NAN], "weight nan"),
        ("late", &[], &[1.0, 0.0], "no positive weight"),
        ("late", &[], &[1.0, 1.0, 2.0], "without a weight"),
    ];
    for (kind, parameters, list, reason) in cases {
        match try_start(kind, parameters, list) {
            Ok(_) => panic!("{kind} takes {parameters:?} {list:?}"),
            Err(Invalid(found)) => {
                assert!(found.contains(reason), "{kind} {parameters:?}: {found}");
            }
        }
    }
}

#[test]
fn every_kind_has_a_name_of_its_own_and_defaults_in_range() {
    let mut names = Vec::new();
    for FaultKindEntry { description, .. } in all() {
        assert!(!names.contains(&description.kind), "{}", description.kind);
        for field in &description.parameters {
            let in_range = field.default.is_none_or(|default| field.admits(default));
            assert!(in_range && !field.description.is_empty(), "{field:?}");
        }
        names.push(description.kind);
    }
    assert_eq!(names.len(), 31);
}
