//! `[[faults]]`: the keys of an event, of an effect and of each profile.

use shared_types::time::Rate;

use super::{
    Key, KeyKind, LENGTH, MAX_S, MAX_STEPS, SectionKind, TEXT, integer, number, number_or,
};

/// Returns the type of a number of steps or times, without a default.
const fn count(min: i64) -> KeyKind {
    integer(min, MAX_STEPS as i64)
}

const TIME: KeyKind = number("s", 0.0, MAX_S);
const TIME_OR_ZERO: KeyKind = number_or("s", 0.0, MAX_S, 0.0);

/// `[[faults]]`. An event has exactly one of [`TRIGGERS`].
pub(crate) const FAULT: &[Key] = keys! {
    name: TEXT, "Name of the event, to which `after` of another event refers.";
    kind!: TEXT, "Kind of fault: one of the plant's own, or one on signals, links or timing.";
    at_s: TIME, "Time at which the event takes effect; rounds up to a step.";
    at_step: count(0), "Step at which the event takes effect.";
    when: TEXT,
        "Trigger condition: the event takes effect at the step after the record at which this expression has held for `for_s`.";
    for_s: TIME_OR_ZERO, "Time that `when` must hold, in consecutive records, at least one.";
    after: KeyKind::Event,
        "Earlier event that this event follows after a delay: the name of the earlier event, or its number in the file from 1.";
    delay_s: TIME_OR_ZERO, "Delay after the earlier event takes effect; rounds up to a step.";
    delay_steps: count(0), "Delay after the earlier event takes effect, in steps.";
    duration_s: LENGTH,
        "Time that each effect acts from the step at which it takes effect; rounds up to a step. The earliest of several ends counts; without an end the fault stays.";
    duration_steps: count(1), "Number of steps that each effect acts from the step at which it takes effect.";
    end_s: TIME, "Time at which the event ends; rounds up to a step.";
    end_step: count(1), "First step without the fault.";
    occurrences: count(1),
        "Number of times that each effect acts before it ends: runs of consecutive steps at which it changed something.";
    until: TEXT,
        "End condition: the event ends when this expression has held for `until_for_s` since the event took effect.";
    until_for_s: TIME_OR_ZERO, "Time that `until` must hold, in consecutive records, at least one.";
    effects!: KeyKind::List(EFFECT), "Effects of the event, one entry per target.";
};

/// Keys that trigger an event.
pub(crate) const TRIGGERS: [&str; 4] = ["at_s", "at_step", "when", "after"];

/// Faults of one request during a run.
pub(crate) const REQUEST: &[Key] = keys! {
    faults!: KeyKind::List(FAULT), "Fault events. An event without a trigger takes effect at once.";
};

/// `[[faults.effects]]`; in addition the keys of the fault kind.
pub(crate) const EFFECT: &[Key] = keys! {
    profile: KeyKind::Section(PROFILE),
        "Course of the effect's size from the step at which it begins. Default: full size at once, or the profile of the plant's fault.";
    skew_s: TIME_OR_ZERO, "Delay of this effect after the event takes effect.";
    skew_steps: count(0), "Delay of this effect after the event takes effect, in steps.";
};

/// Target of a fault kind other than the plant's own.
pub(crate) const TARGET: &[Key] = keys! {
    target!: TEXT,
        "Target of the effect: measured.x, reference.x, command.x, input.x, parameter.x, link.sample, link.command (with two networks also link.sample.a, link.sample.b, link.command.a and link.command.b), controller or plant.";
};

/// `profile`; in addition the keys of the kind in [`PROFILES`].
pub(crate) const PROFILE: &[Key] = keys! {
    kind!: TEXT, "Kind of profile.";
};

/// Courses of an effect's size.
pub(crate) const PROFILES: &[SectionKind] = kinds! {
    "step": "1: all at once." {}
    "ramp": "t / duration, at most 1." {
        duration_s!: LENGTH, "Time to the full size.";
    }
    "exponential": "1 - exp(-speed t)." {
        speed_per_s!: number("1/s", 0.0, 1e9), "Speed of the onset.";
    }
    "pulse": "1 for the duration, then 0." {
        duration_s!: LENGTH, "Length of the pulse.";
    }
    "intermittent": "1 in the first part of every period, 0 in the rest." {
        period_s!: LENGTH, "Period.";
        duty!: number("1", 1e-9, 1.0), "Active share of a period.";
    }
    "sine": "sin(2 pi frequency t + phase)." {
        frequency_hz!: number("Hz", 1e-9, Rate::MAX_HZ), "Frequency.";
        phase_rad: number_or("rad", -1e6, 1e6, 0.0), "Phase.";
    }
    "table": "Straight lines between points, constant before the first and after the last." {
        file: TEXT,
            "File with a column of times and one of values, relative to the scenario, as for a stimulus. Alternative: time_s and values.";
        time_s: KeyKind::Numbers, "Times since the effect began, strictly ascending.";
        values: KeyKind::Numbers, "Values, as many as times.";
    }
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Profile;

    #[test]
    fn profile_names_match_those_in_the_plan() {
        let points = || vec![1.0];
        let profiles = [
            Profile::Step,
            Profile::Ramp { duration_s: 1.0 },
            Profile::Exponential { speed_per_s: 1.0 },
            Profile::Pulse { duration_s: 1.0 },
            Profile::Intermittent {
                period_s: 1.0,
                duty: 1.0,
            },
            Profile::Sine {
                frequency_hz: 1.0,
                phase_rad: 0.0,
            },
            Profile::Table {
                time_s: points(),
                values: points(),
            },
        ];
        assert_eq!(profiles.len(), PROFILES.len());
        for (kind, profile) in PROFILES.iter().zip(profiles) {
            let tagged = serde_json::to_value(&profile).expect("serialises");
            assert_eq!(tagged["kind"], kind.name);
            for key in kind.keys.iter().filter(|key| key.required) {
                assert!(tagged.get(key.name).is_some(), "{}", key.name);
            }
        }
    }
}
