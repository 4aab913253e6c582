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
pub(crate) const FAULT: &[Key] = &[
    Key::new(
        "name",
        TEXT,
        "Name of the event, to which `after` of another event refers.",
    ),
    Key::new(
        "kind",
        TEXT,
        "Kind of fault: one of the plant's own, or one on signals, links or timing.",
    )
    .required(),
    Key::new(
        "at_s",
        TIME,
        "Time at which the event takes hold; rounds up to a step.",
    ),
    Key::new("at_step", count(0), "Step at which the event takes hold."),
    Key::new(
        "when",
        TEXT,
        "Trigger condition: the event takes hold at the step after the record at which this expression has held for `for_s`.",
    ),
    Key::new(
        "for_s",
        TIME_OR_ZERO,
        "Time that `when` must hold, in consecutive records, at least one.",
    ),
    Key::new(
        "after",
        KeyKind::Event,
        "Earlier event that this event follows after a delay: the name of the earlier event, or its number in the file from 1.",
    ),
    Key::new(
        "delay_s",
        TIME_OR_ZERO,
        "Delay after the earlier event takes hold; rounds up to a step.",
    ),
    Key::new(
        "delay_steps",
        count(0),
        "Delay after the earlier event takes hold, in steps.",
    ),
    Key::new(
        "duration_s",
        LENGTH,
        "Time that each effect acts from the step at which it takes hold; rounds up to a step. The earliest of several ends counts; without an end the fault stays.",
    ),
    Key::new(
        "duration_steps",
        count(1),
        "Number of steps that each effect acts from the step at which it takes hold.",
    ),
    Key::new(
        "end_s",
        TIME,
        "Time at which the event ends; rounds up to a step.",
    ),
    Key::new("end_step", count(1), "First step without the fault."),
    Key::new(
        "occurrences",
        count(1),
        "Number of times that each effect acts before it ends: runs of consecutive steps at which it changed something.",
    ),
    Key::new(
        "until",
        TEXT,
        "End condition: the event ends when this expression has held for `until_for_s` since the event took hold.",
    ),
    Key::new(
        "until_for_s",
        TIME_OR_ZERO,
        "Time that `until` must hold, in consecutive records, at least one.",
    ),
    Key::new(
        "effects",
        KeyKind::List(EFFECT),
        "Effects of the event, one entry per target.",
    )
    .required(),
];

/// Keys that trigger an event.
pub(crate) const TRIGGERS: [&str; 4] = ["at_s", "at_step", "when", "after"];

/// Faults of one request during a run.
pub(crate) const REQUEST: &[Key] = &[Key::new(
    "faults",
    KeyKind::List(FAULT),
    "Fault events. An event without a trigger takes hold at once.",
)
.required()];

/// `[[faults.effects]]`; in addition the keys of the fault kind.
pub(crate) const EFFECT: &[Key] = &[
    Key::new(
        "profile",
        KeyKind::Section(PROFILE),
        "Course of the effect's size from the step at which the effect takes hold. Default: full size at once, or the profile of the plant's fault.",
    ),
    Key::new(
        "skew_s",
        TIME_OR_ZERO,
        "Delay of this effect after the event takes hold.",
    ),
    Key::new(
        "skew_steps",
        count(0),
        "Delay of this effect after the event takes hold, in steps.",
    ),
];

/// Target of a fault kind other than the plant's own.
pub(crate) const TARGET: &[Key] = &[Key::new(
    "target",
    TEXT,
    "Target of the effect: measured.x, reference.x, command.x, parameter.x, link.sample, link.command, controller or plant.",
)
.required()];

/// `profile`; in addition the keys of the kind in [`PROFILES`].
pub(crate) const PROFILE: &[Key] = &[Key::new("kind", TEXT, "Kind of profile.").required()];

/// Courses of an effect's size.
pub(crate) const PROFILES: &[SectionKind] = &[
    SectionKind {
        name: "step",
        text: "1: all at once.",
        keys: &[],
    },
    SectionKind {
        name: "ramp",
        text: "t / duration, at most 1.",
        keys: &[Key::new("duration_s", LENGTH, "Time to the full size.").required()],
    },
    SectionKind {
        name: "exponential",
        text: "1 - exp(-speed t).",
        keys: &[Key::new(
            "speed_per_s",
            number("1/s", 0.0, 1e9),
            "Speed of the onset.",
        )
        .required()],
    },
    SectionKind {
        name: "pulse",
        text: "1 for the duration, then 0.",
        keys: &[Key::new("duration_s", LENGTH, "Length of the pulse.").required()],
    },
    SectionKind {
        name: "intermittent",
        text: "1 in the first part of every period, 0 in the rest.",
        keys: &[
            Key::new("period_s", LENGTH, "Period.").required(),
            Key::new("duty", number("1", 1e-9, 1.0), "Active share of a period.").required(),
        ],
    },
    SectionKind {
        name: "sine",
        text: "sin(2 pi frequency t + phase).",
        keys: &[
            Key::new(
                "frequency_hz",
                number("Hz", 1e-9, Rate::MAX_HZ),
                "Frequency.",
            )
            .required(),
            Key::new("phase_rad", number_or("rad", -1e6, 1e6, 0.0), "Phase."),
        ],
    },
    SectionKind {
        name: "table",
        text: "Straight lines between points, constant before the first and after the last.",
        keys: &[
            Key::new(
                "file",
                TEXT,
                "File with a column of times and one of values, relative to the scenario, as for a stimulus. Alternative: time_s and values.",
            ),
            Key::new(
                "time_s",
                KeyKind::Numbers,
                "Times since the effect took hold, strictly rising.",
            ),
            Key::new("values", KeyKind::Numbers, "Values, as many as times."),
        ],
    },
];

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
