//! Faulty fault events: each has one problem, at the marked place, and is refused with the problem and its remedy.

use hil_config::problem::ProblemKind;

use crate::bad::{assert_found, assert_one_problem};
use crate::{base_with_faults, only, problems};

use ProblemKind::{
    Duplicate, Expression, Mismatch, MissingKey, OutOfRange, UnknownKey, UnknownName, Unreadable,
    WrongType,
};

/// Beginning of the cases: each case replaces the keys of the event, or those of its effect.
const EVENT: &str = "kind = \"bias\"\nat_s = 0.5\n";
const EFFECT: &str = "target = \"measured.surface_angle_rad\"\nbias = 0.1\n";

/// Keys of an event, and the expected problem: its kind and pieces of its text.
type Case = (&'static str, ProblemKind, &'static [&'static str]);

/// Kind of an event, the keys of its effect, and the expected problem.
type EffectCase = (
    &'static str,
    &'static str,
    ProblemKind,
    &'static [&'static str],
);

#[rustfmt::skip] // a table reads best with a case on a line
const EVENTS: &[Case] = &[
    // Kind and name
    ("at_s = 0.5\nkind = ^\"bais\"", UnknownName, &["plant `drhas` has no fault `bais`", "`leakage`, `burst`, `bias`, `drift`", "nearest: `bias`"]),
    ("at_s = 0.5\nkind = ^\"leackage\"", UnknownName, &["nearest: `leakage`"]),
    ("kind = \"bias\"\nat_s = 0.5\nname = ^\"1a\"", OutOfRange, &["`faults[0].name` is `1a`", "a letter first"]),
    ("kind = \"bias\"\nat_s = 0.5\nname = ^1", WrongType, &["`faults[0].name` is a number"]),
    ("kind = \"bias\"\nat_s = 0.5\n^form = 1", UnknownKey, &["unknown key `form` in `faults[0]`", "`at_step`", "`until_for_s`"]),
    ("kind = \"bias\"\nat_s = 0.5\n^bias = 1", UnknownKey, &["unknown key `bias` in `faults[0]`", "help: `bias` belongs to a table [[faults.effects]]"]),
    ("kind = \"bias\"\nat_s = 0.5\n^target = \"measured.surface_angle_rad\"", UnknownKey, &["help: `target` belongs to a table [[faults.effects]]"]),
    // Triggers
    ("kind = \"bias\"\nat_s = 0.5\n at_step = ^7", Mismatch, &["has both `at_s` and `at_step`", "exactly one of `at_s`, `at_step`, `when`, `after`"]),
    ("kind = \"bias\"\nat_s = 0.5\nwhen = ^\"1\"", Mismatch, &["has both `at_s` and `when`"]),
    ("kind = \"bias\"\nat_s = ^2", OutOfRange, &["`faults[0].at_s`: the run is already over at 2 s", "a time from 0 to 1.999 in s, step 1999"]),
    ("kind = \"bias\"\nat_s = ^1e15", OutOfRange, &["the run is already over at 1e15 s"]),
    ("kind = \"bias\"\nat_step = ^2000", OutOfRange, &["the run is already over at step 2000", "a step from 0 to 1999, which is at 1.999 s"]),
    ("kind = \"bias\"\nat_step = ^1.5", WrongType, &["`faults[0].at_step` is a number", "a whole number from 0"]),
    ("kind = \"bias\"\nat_step = ^-1", OutOfRange, &["`faults[0].at_step` is -1"]),
    ("kind = \"bias\"\nat_s = 0.5\nfor_s = ^0.1", Mismatch, &["`faults[0].for_s` belongs to `when`, which is missing"]),
    ("kind = \"bias\"\nat_s = 0.5\ndelay_s = ^0.1", Mismatch, &["`faults[0].delay_s` belongs to `after`"]),
    ("kind = \"bias\"\nat_s = 0.5\ndelay_steps = ^1", Mismatch, &["`faults[0].delay_steps` belongs to `after`"]),
    ("kind = \"bias\"\nwhen = \"^truth.surface_angel_rad > 0\"", Expression, &["unknown signal `truth.surface_angel_rad`", "nearest: `truth.surface_angle_rad`"]),
    ("kind = \"bias\"\nwhen = \"large and ^parameter.actuator1.leakage > 0\"", Expression, &["unknown signal `parameter.actuator1.leakage`", "nearest: `parameter.actuator1.leakage_coefficient_m3ps_per_sqrt_pa`"]),
    ("kind = \"bias\"\nwhen = \"^bulk_modulus_pa > 0\"", Expression, &["nearest: `parameter.actuator1.bulk_modulus_pa`, `parameter.actuator2.bulk_modulus_pa`"]),
    ("kind = \"bias\"\nwhen = \"^actuator2.bulk_modulus_pa > 0\"", Expression, &["unknown kind of signal `actuator2`", "nearest: `parameter.actuator2.bulk_modulus_pa`"]),
    ("kind = \"bias\"\nwhen = \"^max_abs(error_rad) > 1\"", Expression, &["can be used only in [[metrics]]"]),
    ("kind = \"bias\"\nwhen = \"error_rad >^\"", Expression, &["found the end"]),
    ("kind = \"bias\"\nwhen = ^1", WrongType, &["`faults[0].when` is a number"]),
    ("kind = \"bias\"\nwhen = \"large\"\nfor_s = ^2", OutOfRange, &["must hold for 2000 consecutive records", "a time below 2 in s"]),
    ("kind = \"bias\"\nwhen = \"large\"\nfor_s = ^-1", OutOfRange, &["`faults[0].for_s` is -1"]),
    ("kind = \"bias\"\nafter = ^\"jam\"", UnknownName, &["there is no fault event `jam`", "a number from 1 to 1"]),
    ("kind = \"bias\"\nafter = ^0", UnknownName, &["there is no fault event 0", "a number from 1 to 1"]),
    ("kind = \"bias\"\nafter = ^true", WrongType, &["`faults[0].after` is true or false"]),
    ("kind = \"bias\"\nafter = ^1", Mismatch, &["event 1 waits for itself"]),
    ("kind = \"bias\"\nname = \"b\"\nafter = ^\"b\"", Mismatch, &["`b` waits for itself"]),
    // Ends
    ("kind = \"bias\"\nat_s = 0.5\nduration_s = ^0", OutOfRange, &["`faults[0].duration_s` is 0", "in s"]),
    ("kind = \"bias\"\nat_s = 0.5\nduration_steps = ^0", OutOfRange, &["`faults[0].duration_steps` is 0", "a whole number from 1"]),
    ("kind = \"bias\"\nat_s = 0.5\nduration_s = 1\nduration_steps = ^1", Duplicate, &["`faults[0].duration_steps` repeats `duration_s`"]),
    ("kind = \"bias\"\nat_s = 0.5\nend_s = ^2.1", OutOfRange, &["the run is already over at 2.1 s", "from 0 to 2 in s, step 2000"]),
    ("kind = \"bias\"\nat_s = 0.5\nend_step = ^2001", OutOfRange, &["the run is already over at step 2001"]),
    ("kind = \"bias\"\nat_s = 0.5\nend_s = ^0.5", Mismatch, &["the fault would end at 0.5 s, but it takes effect at 0.5 s"]),
    ("kind = \"bias\"\nwhen = \"large\"\nfor_s = 1.5\nend_s = ^1", Mismatch, &["the fault would end at 1 s, but it takes effect at 1.5 s"]),
    ("kind = \"bias\"\nat_s = 0.5\noccurrences = ^0", OutOfRange, &["`faults[0].occurrences` is 0"]),
    ("kind = \"bias\"\nat_s = 0.5\nuntil = \"^eror_rad\"", Expression, &["unknown derived signal `eror_rad`", "nearest: `error_rad`"]),
    ("kind = \"bias\"\nat_s = 0.5\nuntil_for_s = ^1", Mismatch, &["`faults[0].until_for_s` belongs to `until`"]),
];

#[rustfmt::skip] // a table reads best with a case on a line
const EFFECTS: &[EffectCase] = &[
    // Targets of numbers
    ("bias", "target = ^\"measured.surface_angel_rad\"\nbias = 1", UnknownName, &["plant `drhas` has no signal `measured.surface_angel_rad`", "one of `measured.surface_angle_rad`", "nearest: `measured.surface_angle_rad`"]),
    ("bias", "target = ^\"command.surface_angle_rad\"\nbias = 1", UnknownName, &["plant `drhas` has no signal `command.surface_angle_rad`", "`command.actuator1_valve_current_a`, `command.actuator2_valve_current_a`"]),
    ("bias", "target = ^\"reference.wind_mps\"\nbias = 1", UnknownName, &["no stimulus provides the reference signal `wind_mps`", "`reference.load_n`"]),
    ("bias", "target = ^\"surface_angle_rad\"\nbias = 1", UnknownName, &["unknown target `surface_angle_rad`", "a signal (measured.x, reference.x, command.x) or a faultable parameter (parameter.x)", "nearest: `measured.surface_angle_rad`, `reference.surface_angle_rad`"]),
    ("bias", "target = ^\"truth.surface_angle_rad\"\nbias = 1", UnknownName, &["unknown target `truth.surface_angle_rad`", "nearest: `measured.surface_angle_rad`, `reference.surface_angle_rad`"]),
    ("bias", "target = ^\"parameter.actuator1.bulk_modulus\"\nbias = 1", UnknownName, &["plant `drhas` has no parameter `actuator1.bulk_modulus`", "nearest: `parameter.actuator1.bulk_modulus_pa`"]),
    ("bias", "target = ^\"parameter.surface.inertia_kg_m2\"\nbias = 1", Mismatch, &["parameter `surface.inertia_kg_m2` of plant `drhas` is not faultable", "one of `parameter.actuator1.leakage_coefficient_m3ps_per_sqrt_pa`, `parameter.actuator1.bulk_modulus_pa`, `parameter.actuator2.leakage_coefficient_m3ps_per_sqrt_pa`, `parameter.actuator2.bulk_modulus_pa`"]),
    ("bias", "target = ^\"link.sample\"\nbias = 1", Mismatch, &["a fault of kind `bias` cannot act on `link.sample`"]),
    ("bias", "target = ^1\nbias = 1", WrongType, &["`faults[0].effects[0].target` is a number"]),
    // Targets of the other classes
    ("dropout", "target = ^\"parameter.actuator1.bulk_modulus_pa\"", Mismatch, &["a fault of kind `dropout` cannot act on `parameter.actuator1.bulk_modulus_pa`", "a signal: measured.x, reference.x or command.x"]),
    ("message-loss", "target = ^\"measured.surface_angle_rad\"", Mismatch, &["cannot act on `measured.surface_angle_rad`", "`link.sample` or `link.command`"]),
    ("message-loss", "target = ^\"link.samples\"", UnknownName, &["unknown target `link.samples`", "nearest: `link.sample`"]),
    ("late", "target = ^\"link.sample\"\nbusy_us = 1", Mismatch, &["`controller` or `plant`"]),
    ("skip", "target = ^\"plant\"\nsteps = 1", Mismatch, &["a fault of kind `skip` cannot act on `plant`", "expected: `controller`"]),
    // Parameters of kinds
    ("bias", "target = \"measured.actuator1_position_m\"\nbias = ^nan", OutOfRange, &["`faults[0].effects[0].bias` is not a number", "expected: a number in m"]),
    ("bias", "target = \"measured.actuator1_pressure1_pa\"\nbias = ^\"1\"", WrongType, &["expected: a number in Pa"]),
    ("bias", "target = \"measured.actuator1_pressure1_pa\"\nbias = 1\n^bais = 2", UnknownKey, &["unknown key `bais` in `faults[0].effects[0]`", "`profile`, `skew_s`, `skew_steps`, `target`, `bias`"]),
    ("bias", "target = \"measured.actuator1_pressure1_pa\"\nbias = 1\n^actuator = 2", UnknownKey, &["unknown key `actuator`"]),
    ("drift", "target = \"reference.load_n\"\nrate_per_s = ^11", OutOfRange, &["is 11, out of range", "a number of at most 10 in N/s"]),
    ("delay", "target = \"reference.load_n\"\nsteps = ^2.5", OutOfRange, &["`faults[0].effects[0].steps` is 2.5, not a whole number", "a whole number from 0 to 1000"]),
    ("delay", "target = \"reference.load_n\"\nsteps = ^1001", OutOfRange, &["is 1001, out of range"]),
    ("skip", "target = \"controller\"\nsteps = 1\nperiod_steps = ^0.5", OutOfRange, &["is 0.5, not a whole number"]),
    // Lists
    ("message-loss", "target = \"link.sample\"\npattern = ^1", WrongType, &["`faults[0].effects[0].pattern` is a number", "a list of numbers, or { file = \"x.csv\" }"]),
    ("message-loss", "target = \"link.sample\"\npattern = ^[]", OutOfRange, &["`faults[0].effects[0].pattern` is empty"]),
    ("message-loss", "target = \"link.sample\"\npattern = [1, ^inf]", OutOfRange, &["`faults[0].effects[0].pattern[1]` is inf"]),
    ("message-loss", "target = \"link.sample\"\n^pattern = {}", MissingKey, &["`faults[0].effects[0].pattern.file` is missing"]),
    ("message-loss", "target = \"link.sample\"\npattern = { file = ^\"no.csv\" }", Unreadable, &["no.csv` cannot be read", "a CSV file: lines of one number"]),
    ("late", "target = \"plant\"\nbusy_us = 1\nhistogram = [[1, 2], ^[3]]", WrongType, &["`faults[0].effects[0].histogram[1]` has 1 numbers", "expected: 2 numbers"]),
    ("late", "target = \"plant\"\nbusy_us = 1\nhistogram = [^1, [3, 4]]", WrongType, &["`faults[0].effects[0].histogram[0]` is a number", "a list of numbers"]),
    // Faults of the plant
    ("burst", "actuator = ^0", UnknownName, &["plant `drhas` has no actuator 0", "one of `1`, `2`"]),
    ("burst", "actuator = 1\n^target = \"actuator1\"", UnknownKey, &["unknown key `target`", "`actuator`, `factor`"]),
    ("burst", "actuator = 1\nfactor = ^3", OutOfRange, &["`actuator1.bulk_modulus_pa` would become 1e9 * 3 = 3e9, out of range", "from 1e6 to 2e9 in Pa"]),
    ("burst", "actuator = 1\nfactor = ^11", OutOfRange, &["`faults[0].effects[0].factor` is 11", "from 0 to 10"]),
    ("leakage", "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = ^1e-4\nprofile = { kind = \"sine\", frequency_hz = 1 }", OutOfRange, &["would become 0 + 0.0001 * -1 = -0.0001, out of range"]),
    ("leakage", "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = ^6e-4\nprofile = { kind = \"table\", time_s = [0, 1, 2], values = [0, 2, 1] }", OutOfRange, &["would become 0 + 0.0006 * 2 = 0.0012, out of range"]),
    // Profiles
    ("leakage", "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = 0\nspeed_per_s = ^1\nprofile = { kind = \"step\" }", Mismatch, &["`faults[0].effects[0].speed_per_s` is the speed of the default course, which `profile` replaces", "one of `speed_per_s`, `profile`"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = ^\"ramp\"", WrongType, &["`faults[0].effects[0].profile` is text", "a table"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = ^\"rampe\" }", UnknownName, &["unknown kind of profile `rampe`", "`step`, `ramp`, `exponential`, `pulse`, `intermittent`, `sine`, `table`", "nearest: `ramp`"]),
    ("dropout", "target = \"reference.load_n\"\n^profile = {}", MissingKey, &["`faults[0].effects[0].profile.kind` is missing"]),
    ("dropout", "target = \"reference.load_n\"\n^profile = { kind = \"ramp\" }", MissingKey, &["`faults[0].effects[0].profile.duration_s` is missing", "in s"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"pulse\", duration_s = ^0 }", OutOfRange, &["`faults[0].effects[0].profile.duration_s` is 0"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"intermittent\", period_s = 1, duty = ^1.5 }", OutOfRange, &["`faults[0].effects[0].profile.duty` is 1.5"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"step\", ^duty = 1 }", UnknownKey, &["unknown key `duty` in `faults[0].effects[0].profile`"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"sine\", frequency_hz = ^0 }", OutOfRange, &["in Hz"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = ^\"table\" }", Mismatch, &["a profile of kind `table` must define its points in exactly one way"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"table\", time_s = ^[1, 1], values = [1, 2] }", Mismatch, &["time 1 follows time 1"]),
    // The run ends 1.5 s after the event.
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"table\", time_s = ^[1.6, 2], values = [1, 0] }", OutOfRange, &["the table goes from 1.6 to 2 s and counts from the beginning of the effect, after which the run lasts for at most 1.5 s", "so it has no effect"]),
    ("dropout", "target = \"reference.load_n\"\nskew_s = 1\nprofile = { kind = \"table\", time_s = ^[0.6, 2], values = [1, 0] }", OutOfRange, &["lasts for at most 0.5 s"]),
    ("dropout", "target = \"reference.load_n\"\nprofile = { kind = \"table\", time_s = ^[-2, -1], values = [1, 0] }", OutOfRange, &["the table goes from -2 to -1 s"]),
    // Skew
    ("dropout", "target = \"reference.load_n\"\nskew_s = ^1.5", OutOfRange, &["`faults[0].effects[0].skew_s`: the run is already over at 2 s", "a skew to at most 1.999 s, step 1999"]),
    ("dropout", "target = \"reference.load_n\"\nskew_steps = ^1500", OutOfRange, &["`faults[0].effects[0].skew_steps`: the run is already over at 2 s"]),
    ("dropout", "target = \"reference.load_n\"\nskew_s = 0\nskew_steps = ^0", Duplicate, &["`faults[0].effects[0].skew_steps` repeats `skew_s`"]),
];

#[test]
fn each_faulty_event_is_refused_with_its_place_and_the_expected_value() {
    for (event, kind, pieces) in EVENTS {
        let text = format!("[[faults]]\n{event}\n[[faults.effects]]\n{EFFECT}");
        assert_one_problem(&base_with_faults(&text), *kind, pieces);
    }
}

#[test]
fn each_faulty_effect_is_refused_with_its_place_and_the_expected_value() {
    for (fault, effect, kind, pieces) in EFFECTS {
        let event = format!(
            "[[faults]]
kind = \"{fault}\"
at_s = 0.5"
        );
        let text = format!(
            "{event}
[[faults.effects]]
{effect}"
        );
        assert_one_problem(&base_with_faults(&text), *kind, pieces);
    }
}

#[test]
fn a_missing_key_is_reported_where_its_table_begins() {
    #[rustfmt::skip] // a table
    let cases = [
        (
            "^[[faults]]\nkind = \"bias\"",
            format!("[[faults.effects]]\n{EFFECT}"),
            &[
                "`faults[0]` has no trigger",
                "one of `at_s`, `at_step`, `when`, `after`",
            ][..],
        ),
        ("^[[faults]]\nkind = \"bias\"\nat_s = 0.5", String::new(), &["`faults[0].effects` is missing"]),
        ("^[[faults]]\nat_s = 0.5", format!("[[faults.effects]]\n{EFFECT}"), &["`faults[0].kind` is missing"]),
        ("[[faults]]\nkind = \"bias\"\nat_s = 0.5", "^[[faults.effects]]\nbias = 1".into(), &["`faults[0].effects[0].target` is missing"]),
        (
            "[[faults]]\nkind = \"bias\"\nat_s = 0.5",
            "^[[faults.effects]]\ntarget = \"measured.surface_angle_rad\"".into(),
            &["`faults[0].effects[0].bias` is missing", "a number in rad"],
        ),
        (
            "[[faults]]\nkind = \"burst\"\nat_s = 0.5",
            "^[[faults.effects]]\nfactor = 1".into(),
            &[
                "`faults[0].effects[0].actuator` is missing",
                "one of `1`, `2`",
            ],
        ),
    ];
    for (event, effect, pieces) in cases {
        let text = base_with_faults(&format!("{event}\n{effect}"));
        assert_one_problem(&text, MissingKey, pieces);
    }
}

/// Formats faults of several events: the keys of each event, and a common effect.
fn events(keys: &[&str]) -> String {
    let text: Vec<String> = keys
        .iter()
        .map(|keys| format!("[[faults]]\nkind = \"bias\"\n{keys}\n[[faults.effects]]\n{EFFECT}"))
        .collect();
    base_with_faults(&text.join("\n"))
}

#[test]
fn events_that_wait_for_each_other_are_reported_once() {
    let text = events(&[
        "after = \"c\"",
        "name = \"b\"\nafter = ^3",
        "name = \"c\"\nafter = \"b\"",
        "after = \"b\"\ndelay_s = 5",
    ]);
    assert_one_problem(
        &text,
        Mismatch,
        &[
            "`b`, `c` wait for each other",
            "an event that takes effect by itself",
        ],
    );
}

#[test]
fn an_event_after_another_must_fit_into_the_run() {
    let text = events(&[
        "name = \"a\"\nat_s = 1.5",
        "name = \"b\"\nafter = \"a\"\ndelay_s = 0.25",
        "after = \"b\"\ndelay_steps = ^250",
    ]);
    assert_one_problem(
        &text,
        OutOfRange,
        &[
            "`faults[2].delay_steps`: the run is already over at 2 s, the earliest possible time",
            "by 1.999 s, step 1999",
        ],
    );
    let text = text.replace('^', "").replace("250", "249");
    assert!(crate::check(&text).is_ok());
}

#[test]
fn two_events_with_the_same_name_are_refused() {
    let text = events(&["name = \"a\"\nat_s = 1.5", "name = ^\"a\"\nat_s = 1"]);
    assert_one_problem(&text, Duplicate, &["already named `a`"]);
}

#[test]
fn effects_that_leave_a_range_together_are_refused() {
    let leak = |at_s: f64, size: f64, more: &str| {
        format!(
            "[[faults]]\nkind = \"leakage\"\nat_s = {at_s:?}\n{more}\n\
             effects = [{{ actuator = 1, coefficient_m3ps_per_sqrt_pa = {size:?}, speed_per_s = 1 }}]\n"
        )
    };
    // In the order of time, not of the file: the first to leave the range is the event at 1 s.
    let text = base_with_faults(&[leak(1.0, 6e-4, ""), leak(0.5, 7e-4, "")].concat());
    let problem = only(problems(&text));
    assert_eq!(problem.key, "faults[0].effects[0]");
    let pieces = [
        "`actuator1.leakage_coefficient_m3ps_per_sqrt_pa` would become 0.0007 + 0.0006 = 0.0013",
        "with the effects before it",
        "from 0 to 0.001",
    ];
    assert_found(&problem, OutOfRange, &pieces);
    // An effect that ends may be over before the other begins.
    let apart = [leak(1.0, 6e-4, ""), leak(0.5, 7e-4, "duration_s = 0.5")].concat();
    assert!(crate::check(&base_with_faults(&apart)).is_ok());
    // The other actuator has a coefficient of its own.
    let other = leak(0.5, 7e-4, "").replace("actuator = 1", "actuator = 2");
    let apart = [leak(1.0, 6e-4, ""), other].concat();
    assert!(crate::check(&base_with_faults(&apart)).is_ok());
}

#[test]
fn faults_of_an_unknown_plant_are_checked_as_far_as_possible() {
    let text = events(&["at_s = 0.5"]).replace("\"drhas\"", "\"dhras\"");
    let text = text.replace("kind = \"bias\"", "kind = \"leakage\"\nfor_s = 1");
    let reported = problems(&text);
    let keys: Vec<&str> = reported
        .iter()
        .map(|problem| problem.key.as_str())
        .collect();
    assert_eq!(keys, ["plant.model", "faults[0].for_s"]);
}

#[test]
fn the_cases_are_valid_without_their_mistakes() {
    let text = format!("[[faults]]\n{EVENT}[[faults.effects]]\n{EFFECT}");
    assert_eq!(crate::plan(&base_with_faults(&text)).faults.len(), 1);
}
