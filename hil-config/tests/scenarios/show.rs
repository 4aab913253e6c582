//! `show`: a plan as a scenario.

use hil_config::show::show;
use proptest::prelude::*;

use crate::{BASE, base_with, descriptions, plan, with_stimulus};

fn shown(text: &str) -> String {
    descriptions::shown(&plan(text))
}

#[test]
fn a_shown_plan_means_the_same() {
    let texts = [
        BASE.to_owned(),
        format!("further_plots = false\n{BASE}"),
        base_with("\"lockstep\"", "\"paced\""),
        base_with("plant_core = 2\n", "").replace("dma_latency_us = 20\n", ""),
        base_with("law = \"ftsc\"", "law = \"hold\"")
            .replace("internal.fault_detected", "truth.force_fight_n"),
        with_stimulus("kind = \"ramp\"\nduration_s = 1\nend = 3"),
        with_stimulus("kind = \"paper\"\nonset_per_s3 = 3"),
        with_stimulus("kind = \"chirp\"\nduration_s = 1\namplitude = 3\nstart_hz = 0\nend_hz = 1"),
        with_stimulus("kind = \"table\"\ntime_s = [1e-3, 0.1]\nvalues = [1, 2]"),
        base_with("[-0.4, 0.4]", "[-inf, inf]"),
        base_with(
            "[1.0, 2]]",
            "[1.0, 2]]\npublished_note = \"odd\"\npublished = [{ law = \"a\", window_s = [0, 1], value = 1, source = \"b\" }]",
        ),
        base_with(
            "every part of the format",
            "quotes \\\" and \\n lines # no comment",
        ),
    ];
    for text in texts {
        let shown_text = shown(&text);
        assert_eq!(plan(&shown_text), plan(&text), "{shown_text}");
    }
}

#[test]
fn every_parameter_is_shown_with_unit_and_range() {
    let text = shown(BASE);
    for line in [
        "actuator1.piston_mass_kg = 50.0 # kg, from 0.001 to 1e6. A parameter.",
        "surface.inertia_kg_m2 = 13.5 # kg m2, ",
        "gain_per_s = 10.0 # 1/s, ",
        "friction_n = 0.5 # N, ",
    ] {
        assert!(text.contains(line), "`{line}` is not in\n{text}");
    }
    assert!(text.contains("faultable"));
}

#[test]
fn a_plan_without_its_descriptions_is_not_shown() {
    let error = show(&plan(BASE), &[], &descriptions::laws(), &[]).expect_err("no plant");
    assert!(error.to_string().contains("plant `drhas`"));
    let error = show(&plan(BASE), &descriptions::plants(), &[], &[]).expect_err("no law");
    assert!(error.to_string().contains("law `ftsc`"));
}

proptest! {
    #[test]
    fn any_numbers_survive_showing(
        mass_kg in 1e-3..1e6_f64,
        rate_hz in prop::sample::select(vec![1.0, 3.0, 7.3, 1000.0, 9999.0, 0.7]),
        steps in 3..100_000_u64,
        at in 0.0..0.5_f64,
        skew in 0.0..0.4_f64,
        amplitude in -1e9..1e9_f64,
        divisor in 1..50_u32,
    ) {
        let duration_s = steps as f64 / rate_hz;
        let text = BASE
            .replace("piston_mass_kg = 50", &format!("piston_mass_kg = {mass_kg:?}"))
            .replace("rate_hz = 1000", &format!("rate_hz = {rate_hz:?}"))
            .replace("duration_s = 2.0", &format!("duration_s = {duration_s:?}"))
            .replace("rate_hz = 500", &format!("rate_hz = {:?}", rate_hz / f64::from(divisor)))
            .replace("at_s = 1.0", &format!("at_s = {:?}", at * duration_s))
            .replace("at_s = 0.5", "at_s = 0.0")
            .replace("skew_s = 0.25", &format!("skew_s = {:?}", skew * duration_s))
            .replace("amplitude = 0.1", &format!("amplitude = {amplitude:?}"))
            .replace("[[0, 1], [1.0, 2]]", &format!("[[0, {duration_s:?}]]"));
        // With few steps an effect may lie beyond the last one; nothing is shown then.
        if let Ok(expected) = crate::check(&text) {
            prop_assert_eq!(expected.controller.rate_divisor, divisor);
            prop_assert_eq!(plan(&shown(&text)), expected);
        } else {
            prop_assert!(steps < 20);
        }
    }
}
