//! `[[faults]]`: the keys of an event, of an effect and of each profile.

use shared_types::time::Rate;

use super::{Key, KeyKind, LENGTH, MAX_S, MAX_STEPS, TEXT, number, number_or};

/// A number of steps or times, with no default.
const fn count(min: i64) -> KeyKind {
    KeyKind::Integer {
        min,
        max: MAX_STEPS as i64,
        default: None,
    }
}

const TIME: KeyKind = number("s", 0.0, MAX_S);
const TIME_OR_ZERO: KeyKind = number_or("s", 0.0, MAX_S, 0.0);

/// `[[faults]]`. An event has exactly one of [`TRIGGERS`].
pub(crate) const FAULT: &[Key] = &[
    Key::new(
        "name",
        TEXT,
        "Name of the event, which `after` of another one refers to.",
    ),
    Key::new(
        "kind",
        TEXT,
        "Kind of fault: one of the plant's own, or one on signals, links or timing.",
    )
    .required(),
    Key::new("at_s", TIME, "When it takes hold; rounds up to a step."),
    Key::new("at_step", count(0), "The step at which it takes hold."),
    Key::new(
        "when",
        TEXT,
        "It takes hold at the step after the record at which this expression has held for `for_s`.",
    ),
    Key::new(
        "for_s",
        TIME_OR_ZERO,
        "For how long `when` must hold: so many records in a row, at least one.",
    ),
    Key::new(
        "after",
        KeyKind::Event,
        "It takes hold so long after another event did: the event's name, or its number in the file from 1.",
    ),
    Key::new(
        "delay_s",
        TIME_OR_ZERO,
        "How long after; rounds up to a step.",
    ),
    Key::new("delay_steps", count(0), "How many steps after."),
    Key::new(
        "duration_s",
        LENGTH,
        "Each effect ends so long after it took hold; rounds up to a step. Of several ends the first counts; without any the fault stays.",
    ),
    Key::new(
        "duration_steps",
        count(1),
        "Each effect ends so many steps after it took hold.",
    ),
    Key::new("end_s", TIME, "When it ends; rounds up to a step."),
    Key::new("end_step", count(1), "The first step without it."),
    Key::new(
        "occurrences",
        count(1),
        "Each effect ends after so many runs of steps at which it changed something.",
    ),
    Key::new(
        "until",
        TEXT,
        "It ends when this expression has held for `until_for_s` since it took hold.",
    ),
    Key::new(
        "until_for_s",
        TIME_OR_ZERO,
        "For how long `until` must hold: so many records in a row, at least one.",
    ),
    Key::new(
        "effects",
        KeyKind::List(EFFECT),
        "What it does, one entry per target.",
    )
    .required(),
];

/// The keys that say when an event takes hold.
pub(crate) const TRIGGERS: [&str; 4] = ["at_s", "at_step", "when", "after"];

/// All that is asked of a running run at once.
pub(crate) const REQUEST: &[Key] = &[Key::new(
    "faults",
    KeyKind::List(FAULT),
    "Fault events. One without a trigger takes hold at once.",
)
.required()];

/// `[[faults.effects]]`; besides these the keys of the kind of fault.
pub(crate) const EFFECT: &[Key] = &[
    Key::new(
        "profile",
        KeyKind::Section(PROFILE),
        "Course of the effect's size from when it takes hold. Default: all at once, or what the plant's fault has.",
    ),
    Key::new(
        "skew_s",
        TIME_OR_ZERO,
        "How much later than the event this effect takes hold.",
    ),
    Key::new("skew_steps", count(0), "The same in steps."),
];

/// The target of a kind of fault that is not of the plant.
pub(crate) const TARGET: &[Key] = &[Key::new(
    "target",
    TEXT,
    "What it acts on: measured.x, reference.x, command.x, parameter.x, link.sample, link.command, controller or plant.",
)
.required()];

/// `profile`; besides this the keys of the kind in [`PROFILES`].
pub(crate) const PROFILE: &[Key] = &[Key::new("kind", TEXT, "Which course.").required()];

/// A kind of profile.
#[derive(Debug)]
pub(crate) struct ProfileKind {
    /// The profile's `kind`.
    pub name: &'static str,
    /// Description of the profile.
    pub text: &'static str,
    /// Keys.
    pub keys: &'static [Key],
}

/// The courses of an effect's size.
pub(crate) const PROFILES: &[ProfileKind] = &[
    ProfileKind {
        name: "step",
        text: "1: all at once.",
        keys: &[],
    },
    ProfileKind {
        name: "ramp",
        text: "t / duration, at most 1.",
        keys: &[Key::new("duration_s", LENGTH, "Time to the full size.").required()],
    },
    ProfileKind {
        name: "exponential",
        text: "1 - exp(-speed t).",
        keys: &[Key::new(
            "speed_per_s",
            number("1/s", 0.0, 1e9),
            "How fast it sets in.",
        )
        .required()],
    },
    ProfileKind {
        name: "pulse",
        text: "1 for the duration, then 0.",
        keys: &[Key::new("duration_s", LENGTH, "Length of the pulse.").required()],
    },
    ProfileKind {
        name: "intermittent",
        text: "1 in the first part of every period, 0 in the rest.",
        keys: &[
            Key::new("period_s", LENGTH, "Period.").required(),
            Key::new("duty", number("1", 1e-9, 1.0), "The part of a period.").required(),
        ],
    },
    ProfileKind {
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
    ProfileKind {
        name: "table",
        text: "Straight lines between points, constant before the first and after the last.",
        keys: &[
            Key::new(
                "file",
                TEXT,
                "CSV file with the columns time_s,value, relative to the scenario. In its place: time_s and values.",
            ),
            Key::new(
                "time_s",
                KeyKind::Numbers,
                "Times since it took hold, strictly rising.",
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
    fn the_profiles_are_named_as_in_the_plan() {
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
