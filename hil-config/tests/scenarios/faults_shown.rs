//! Shown faults keep their meaning.

use hil_config::plan::{FaultEvent, FaultSource, Plan, Trigger};
use hil_config::show::{ShowError, fault_toml};
use proptest::prelude::*;
use shared_types::time::Rate;

use crate::faults::{EFFECT, event, faults};
use crate::{base_with_faults, check, descriptions, plan};

#[test]
fn an_event_is_shown_with_what_it_waits_for() {
    let one = |event: &FaultEvent| {
        let plant = &descriptions::plants()[0];
        let rate = Rate::new(1000.0).expect("a rate");
        fault_toml(event, plant, &descriptions::kinds(), rate)
    };
    let after = event("after = \"other\"\ndelay_s = 0.5");
    let text = one(&after).expect("described");
    assert!(
        text.contains("\nafter = 2\ndelay_s = 0.5 # 500 steps\n"),
        "{text}"
    );
    let now = FaultEvent {
        trigger: Trigger::Now,
        ..after.clone()
    };
    assert_eq!(one(&now), Err(ShowError::Now(1)));
    let unknown = FaultEvent {
        kind: "gremlin".into(),
        ..after
    };
    let error = one(&unknown).expect_err("no such kind").to_string();
    assert!(
        error.contains("fault `gremlin` of plant `drhas`"),
        "{error}"
    );
}

#[test]
fn events_written_one_by_one_mean_the_same() {
    let text = "[[faults]]\nkind = \"burst\"\nname = \"b\"\nat_s = 0.5\neffects = [{ actuator = 1 }, { actuator = 2, skew_s = 0.0005 }]\n\
         [[faults]]\nkind = \"bias\"\nafter = \"b\"\neffects = [{ target = \"measured.surface_angle_rad\", bias = 1 }]\n";
    let expected = faults(text);
    let plant = &descriptions::plants()[0];
    let rate = Rate::new(1000.0).expect("a rate");
    let texts: Vec<String> = (expected.iter())
        .map(|event| fault_toml(event, plant, &descriptions::kinds(), rate).expect("described"))
        .collect();
    assert_eq!(faults(&texts.concat()), expected);
}

fn toml(value: f64) -> String {
    format!("{value:?}")
}

fn trigger() -> impl Strategy<Value = String> {
    prop_oneof![
        (0.0..0.5_f64).prop_map(|at_s| format!("at_s = {at_s:?}")),
        (0..300_u64).prop_map(|step| format!("at_step = {step}")),
        (0.0..0.3_f64).prop_map(|for_s| format!("when = \"error_rad > 1\"\nfor_s = {for_s:?}")),
        Just("when = \"large\"".to_owned()),
        (0.0..0.2_f64).prop_map(|s| format!("after = \"first\"\ndelay_s = {s:?}")),
        (0..100_u64).prop_map(|steps| format!("after = 1\ndelay_steps = {steps}")),
    ]
}

fn end() -> impl Strategy<Value = String> {
    let duration = prop_oneof![
        Just(String::new()),
        (1e-3..9.0_f64).prop_map(|s| format!("duration_s = {s:?}\n")),
        (1..9999_u64).prop_map(|steps| format!("duration_steps = {steps}\n")),
    ];
    let end = prop_oneof![
        Just(String::new()),
        (1.5..2.0_f64).prop_map(|s| format!("end_s = {s:?}\n")),
    ];
    let until = prop_oneof![
        Just(String::new()),
        (0.0..0.5_f64).prop_map(|s| format!("until = \"large\"\nuntil_for_s = {s:?}\n")),
    ];
    let occurrences = prop_oneof![Just(""), Just("occurrences = 7\n")];
    (duration, end, until, occurrences).prop_map(|(a, b, c, d)| format!("{a}{b}{c}{d}"))
}

fn profile() -> impl Strategy<Value = String> {
    let number = 1e-3..10.0_f64;
    let kind = prop_oneof![
        Just("kind = \"step\"".to_owned()),
        number
            .clone()
            .prop_map(|d| format!("kind = \"ramp\", duration_s = {d:?}")),
        number
            .clone()
            .prop_map(|c| format!("kind = \"exponential\", speed_per_s = {c:?}")),
        Just("kind = \"exponential\", speed_per_s = 1e8".to_owned()), // not that of a leakage
        number
            .clone()
            .prop_map(|d| format!("kind = \"pulse\", duration_s = {d:?}")),
        (number.clone(), 1e-3..1.0_f64)
            .prop_map(|(p, d)| format!("kind = \"intermittent\", period_s = {p:?}, duty = {d:?}")),
        (number, -9.0..9.0_f64)
            .prop_map(|(f, p)| format!("kind = \"sine\", frequency_hz = {f:?}, phase_rad = {p:?}")),
        (0.0..1.0_f64).prop_map(|v| format!(
            "kind = \"table\", time_s = [-1, {v:?}, 2e300], values = [{v:?}, 1, 0]"
        )),
    ];
    kind.prop_map(|kind| format!("profile = {{ {kind} }}\n"))
}

/// Generates kind and keys of an effect, without its profile.
fn fault() -> impl Strategy<Value = (&'static str, String)> {
    let any = -1e3..1e3_f64;
    let target = prop::sample::select(vec![
        "measured.surface_angle_rad",
        "reference.surface_angle_d1_radps",
        "command.actuator1_valve_current_a",
        "parameter.actuator1.bulk_modulus_pa",
    ]);
    prop_oneof![
        (1..=2, 0.0..1e-5_f64).prop_map(|(n, c)| (
            "leakage",
            format!("actuator = {n}\ncoefficient_m3ps_per_sqrt_pa = {c:?}\n")
        )),
        (1..=2, 0.9..1.0_f64)
            .prop_map(|(n, f)| ("burst", format!("actuator = {n}\nfactor = {f:?}\n"))),
        Just(("burst", "actuator = 1\n".to_owned())),
        (target.clone(), any)
            .prop_map(|(t, b)| ("bias", format!("target = \"{t}\"\nbias = {}\n", toml(b)))),
        (target, 0..1000).prop_map(|(t, n)| ("delay", format!("target = \"{t}\"\nsteps = {n}\n"))),
        Just(("dropout", "target = \"reference.load_n\"\n".to_owned())),
        prop::collection::vec(0..2, 1..9).prop_map(|list| (
            "message-loss",
            format!("target = \"link.command\"\npattern = {list:?}\n")
        )),
        prop::collection::vec((0.0..1e6_f64, 0..9), 1..5).prop_map(|rows| {
            let rows: Vec<String> = rows.iter().map(|(t, n)| format!("[{t:?}, {n}]")).collect();
            let rows = rows.join(", ");
            (
                "late",
                format!("target = \"controller\"\nbusy_us = 2.5\nhistogram = [{rows}]\n"),
            )
        }),
        (1..9).prop_map(|n| ("skip", format!("target = \"controller\"\nsteps = {n}\n"))),
    ]
}

fn skew() -> impl Strategy<Value = String> {
    prop_oneof![
        Just(String::new()),
        (0.0..0.2_f64).prop_map(|s| format!("skew_s = {s:?}\n")),
        (0..100_u64).prop_map(|steps| format!("skew_steps = {steps}\n")),
    ]
}

/// Every part of the syntax.
const ALL: &str = r#"
[[faults]]
name = "a"
kind = "burst"
when = "error_rad > 1"
for_s = 0.1
duration_s = 0.5
occurrences = 3
effects = [{ actuator = 1, profile = { kind = "ramp", duration_s = 2 }, skew_s = 0.1 }]

[[faults]]
kind = "late"
after = "a"
delay_steps = 3
end_s = 1.5
until = "large"
[[faults.effects]]
target = "plant"
busy_us = 3
histogram = [[1, 2], [3, 4]]
[[faults.effects]]
target = "controller"
busy_us = 3
profile = { kind = "table", time_s = [0, 1], values = [0, 1] }
skew_steps = 7
"#;

proptest! {
    #[test]
    fn no_change_of_valid_faults_makes_the_check_panic(
        cut in 0..ALL.len(), length in 0..40_usize, put in "[\\[\\]=.\"a-z0-9 \n{},#-]{0,12}",
    ) {
        prop_assert!(check(&base_with_faults(ALL)).is_ok());
        let mut text = ALL.to_owned();
        text.replace_range(cut..(cut + length).min(ALL.len()), &put);
        let _ = check(&base_with_faults(&text));
    }

    #[test]
    fn a_plan_with_any_fault_is_shown_as_one_that_means_the_same(
        (kind, keys) in fault(),
        trigger in trigger(),
        end in end(),
        profile in profile(),
        skew in skew(),
        rate_hz in prop::sample::select(vec![1000.0, 999.9, 3333.3, 700.0]),
        steps in 9000..20_000_u64,
    ) {
        // A leak below its healthy 0 is refused.
        prop_assume!(!(profile.contains("sine") && keys.starts_with("actuator")));
        let own_speed = if kind == "leakage" { "speed_per_s = 2.5\n" } else { "" };
        let text = format!(
            "[[faults]]\nname = \"first\"\nkind = \"bias\"\nat_s = 0.123\n{EFFECT}\n\
             [[faults]]\nkind = \"{kind}\"\n{trigger}\n{end}\
             [[faults.effects]]\n{keys}{profile}{skew}\
             [[faults.effects]]\n{keys}{own_speed}"
        );
        let text = base_with_faults(&text)
            .replace("rate_hz = 1000", &format!("rate_hz = {rate_hz:?}"))
            .replace("rate_hz = 500\n", "")
            .replace("duration_s = 2.0", &format!("duration_s = {:?}", steps as f64 / rate_hz));
        let expected: Plan = match check(&text) {
            Ok(plan) => plan,
            Err(problems) => panic!("{problems}\n{text}"),
        };
        prop_assert_eq!(expected.faults[1].source, FaultSource::Scenario);
        let shown_text = descriptions::shown(&expected);
        prop_assert_eq!(plan(&shown_text), expected, "{}", shown_text);
    }
}
