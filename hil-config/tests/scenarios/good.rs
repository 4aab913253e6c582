//! Valid scenarios and their meaning.

use hil_config::formula::Formula;
use hil_config::plan::{
    Clock, FaultAction, FaultEffect, FaultEnd, FaultSource, Move, Panel, Plan, Plot, PlotKind,
    Profile, Programs, Realtime, Requirement, Scale, Trace, Trigger, Waveform,
};
use proptest::prelude::*;
use shared_types::describe::{Operation, Settings};
use shared_types::time::{Rate, Step};
use shared_types::wait::WaitStrategy;

use crate::descriptions::{self, Checked};
use crate::{BASE, base_with, check, parse, plan};

fn rate(hz: f64) -> Rate {
    Rate::new(hz).expect("a rate")
}

#[test]
fn the_base_has_the_documented_meaning() {
    let Plan {
        name,
        description,
        run,
        realtime,
        plant,
        controller,
        stimuli,
        sensors,
        actuators,
        bus,
        faults,
        changes,
        derived,
        metrics,
        analyses,
        requirements,
        plots,
        further_plots,
        panel,
        programs,
        probes,
    } = plan(BASE);
    assert!(further_plots);
    assert!(analyses.is_empty() && changes.is_empty() && probes.is_empty());
    assert!(sensors.is_empty() && actuators.is_empty() && bus.is_none());
    assert_eq!(programs, Programs::default());
    let expected = Requirement {
        name: "stays-small".into(),
        description: "the surface stays near its middle".into(),
        formula: Formula::parse("always(abs(truth.surface_angle_rad) < 0.2)").expect("right"),
        unit: "rad".into(),
        trace: Trace {
            id: Some("T-12.3".into()),
            verifies: vec!["SYS_7".into(), "SYS-8.1".into()],
        },
    };
    assert_eq!(requirements, [expected]);
    let error = Plot {
        title: "Error".into(),
        kind: PlotKind::Time,
        name: None,
        caption: None,
        span_s: [None; 2],
        signals: vec!["error_rad".into(), "internal.fault_detected".into()],
        laws: vec!["ftsc".into()],
        scale: Scale::Log,
        lines: vec![0.1, 0.2],
    };
    let surface = Plot {
        title: "Surface".into(),
        kind: PlotKind::Time,
        name: None,
        caption: None,
        span_s: [None; 2],
        signals: vec!["truth.surface_angle_rad".into()],
        laws: Vec::new(),
        scale: Scale::Linear,
        lines: Vec::new(),
    };
    assert!(error.is_for("ftsc") && !error.is_for("pid") && surface.is_for("pid"));
    assert_eq!(plots, [error, surface]);
    let expected = Panel {
        window_s: 2.0,
        readings: vec!["error_rad".into(), "internal.*".into()],
        tune: vec!["reference.*".into()],
        inject: vec!["leakage --actuator 1".into()],
    };
    assert_eq!(panel, expected);
    assert_eq!(
        (name.as_str(), description.as_str()),
        ("base", "every part of the format")
    );
    assert_eq!((run.rate, run.steps, run.seed), (rate(1000.0), 2000, 7));
    assert_eq!(run.clock, Clock::Lockstep);

    let expected = Realtime {
        plant_core: Some(2),
        controller_core: Some(3),
        recorder_core: Some(0),
        priority: 80,
        lock_memory: true,
        prefault: false,
        dma_latency_us: Some(20),
        wait: WaitStrategy::Spin,
    };
    assert_eq!(realtime, expected);
    let (ours, theirs) = (realtime.plant(), realtime.controller());
    assert_eq!((ours.core, ours.peer_core), (Some(2), Some(3)));
    assert_eq!((theirs.core, theirs.peer_core), (Some(3), Some(2)));

    assert_eq!((plant.model.as_str(), plant.substeps), ("drhas", 2));
    assert_eq!(plant.parameters.0.len(), 7);
    assert_eq!(plant.parameters.get("actuator1.piston_mass_kg"), Some(50.0));
    assert_eq!(plant.parameters.get("actuator2.piston_mass_kg"), Some(60.0));
    assert_eq!(plant.parameters.get("surface.inertia_kg_m2"), Some(13.5));
    assert_eq!(plant.limits.len(), 1);
    assert_eq!((plant.limits[0].min, plant.limits[0].max), (-0.4, 0.4));

    assert_eq!(controller.law, "ftsc");
    assert_eq!(
        (controller.rate_divisor, controller.command_delay_steps),
        (2, 1)
    );
    assert_eq!(controller.parameters.get("gain_per_s"), Some(10.0));

    assert_eq!(stimuli.len(), 2);
    assert_eq!(
        (stimuli[1].target.as_str(), stimuli[1].unit.as_str()),
        ("load_n", "N")
    );
    let step = Waveform::Step {
        at_s: 0.5,
        before: 0.0,
        after: 2.0,
    };
    assert_eq!(stimuli[1].waveform, step);

    let fault = &faults[0];
    assert_eq!((faults.len(), fault.id, &fault.name), (1, 1, &None));
    assert_eq!(
        (fault.kind.as_str(), fault.source),
        ("leakage", FaultSource::Scenario)
    );
    let trigger = Trigger::Step {
        step: Step(1000),
        at_s: 1.0,
    };
    assert_eq!(
        (&fault.trigger, &fault.end),
        (&trigger, &FaultEnd::default())
    );
    let mut sizes = Settings::default();
    sizes.set("coefficient_m3ps_per_sqrt_pa", 0.0);
    let second = FaultEffect {
        target: "actuator2".into(),
        skew_steps: 250,
        profile: Profile::Exponential { speed_per_s: 0.5 },
        action: FaultAction::Move {
            sizes,
            moves: vec![Move {
                parameter: "actuator2.leakage_coefficient_m3ps_per_sqrt_pa".into(),
                operation: Operation::Add,
                by: 0.0,
            }],
        },
    };
    assert_eq!(faults[0].effects[0].skew_steps, 0);
    assert_eq!(faults[0].effects[1], second);

    let units: Vec<&str> = derived.iter().map(|d| d.unit.as_str()).collect();
    assert_eq!(units, ["rad", "1"]);
    let windows: Vec<(u64, u64)> = metrics[0]
        .windows
        .iter()
        .map(|window| (window.first.0, window.last.0))
        .collect();
    assert_eq!(windows, [(0, 1000), (1000, 2000)]);
    assert!(metrics[1].windows.is_empty());
}

#[test]
fn a_law_assumes_the_nominal_plant_unless_set_otherwise() {
    let model = plan(BASE).controller.model;
    // Set explicitly; from the plant's parameters; from the law, because the plant has no such parameter.
    assert_eq!(model.get("surface.inertia_kg_m2"), Some(13.0));
    assert_eq!(model.get("actuator2.piston_mass_kg"), Some(60.0));
    assert_eq!(model.get("friction_n"), Some(0.5));
}

#[test]
fn a_law_does_not_take_a_nominal_value_of_another_unit() {
    let mut laws = descriptions::laws();
    for law in &mut laws {
        for field in &mut law.model {
            field.unit = field.unit.replace("kg m2", "g m2");
        }
    }
    let text = base_with("surface.inertia_kg_m2 = 13.0", "");
    let plan = parse(&text)
        .and_then(|scenario| scenario.check(&descriptions::plants(), &laws, &descriptions::kinds()))
        .expect("right");
    let model = plan.controller.model;
    assert_eq!(model.get("surface.inertia_kg_m2"), Some(1.0)); // the law's default
    assert_eq!(model.get("actuator2.piston_mass_kg"), Some(60.0)); // the plant's
}

#[test]
fn a_fault_moves_faultable_parameters_only() {
    let mut plants = descriptions::plants();
    for field in &mut plants[0].parameters {
        field.faultable = field.faultable && field.name.starts_with("actuator1");
    }
    let problems = parse(BASE)
        .and_then(|scenario| scenario.check(&plants, &descriptions::laws(), &descriptions::kinds()))
        .expect_err("actuator 2 cannot leak");
    assert_eq!(problems.0.len(), 1, "{problems}");
    assert_eq!(problems.0[0].key, "faults[0].effects[1].actuator");
}

#[test]
fn a_specific_parameter_wins_over_a_bare_one_in_any_order() {
    let lines = ["piston_mass_kg = 50", "actuator2.piston_mass_kg = 60.0"];
    let turned = BASE.replace(&lines.join("\n"), &[lines[1], lines[0]].join("\n"));
    assert_ne!(turned, BASE);
    assert_eq!(plan(&turned), plan(BASE));
}

#[test]
fn parameters_may_stand_in_nested_tables() {
    let nested = BASE.replace("actuator2.piston_mass_kg = 60.0", "").replace(
        "[plant.limits]",
        "[plant.parameters.actuator2]\npiston_mass_kg = 60\n[plant.limits]",
    );
    assert_eq!(plan(&nested), plan(BASE));
}

#[test]
fn omitted_keys_have_their_defaults() {
    let text = "
schema = 1
[run]
duration_s = 1
rate_hz = 100
[plant]
model = \"spring-mass\"
[controller]
law = \"pid\"
[[stimuli]]
target = \"position_m\"
kind = \"paper\"
";
    let actual = plan(text);
    assert_eq!(actual.name, "base"); // the file's
    assert_eq!(actual.description, "");
    assert_eq!((actual.run.seed, actual.run.clock), (1, Clock::Lockstep));
    assert_eq!(actual.plant.substeps, 4);
    assert_eq!(
        (
            actual.controller.rate_divisor,
            actual.controller.command_delay_steps
        ),
        (1, 0)
    );
    assert_eq!(
        actual.controller.parameters.get("gain_n_per_m"),
        Some(300.0)
    );
    let paper = Waveform::Paper {
        amplitude: 0.2,
        frequency_hz: 1.0,
        onset_per_s3: 0.1,
    };
    assert_eq!(actual.stimuli[0].waveform, paper);
}

#[test]
fn a_pace_is_used_by_the_paced_clock() {
    let text = base_with("\"lockstep\"\npace = 1.0", "\"paced\"\npace = 2.5");
    assert_eq!(plan(&text).run.clock, Clock::Paced { factor: 2.5 });
}

#[test]
fn a_fault_between_two_steps_takes_effect_at_the_later_one() {
    let text = base_with("at_s = 1.0", "at_s = 1.0001");
    let trigger = Trigger::Step {
        step: Step(1001),
        at_s: 1.0001,
    };
    assert_eq!(plan(&text).faults[0].trigger, trigger);
}

#[test]
fn a_window_between_steps_holds_the_steps_inside_it() {
    let text = base_with("[1.0, 2]]", "[1.0001, 1.9999]]");
    let window = plan(&text).metrics[0].windows[1];
    assert_eq!((window.first, window.last), (Step(1001), Step(1999)));
    assert_eq!((window.start_s, window.end_s), (1.0001, 1.9999));
}

#[test]
fn a_window_may_be_a_single_step() {
    for (window, step) in [("[0, 0]", 0), ("[2, 2]", 2000), ("[1.5, 1.5]", 1500)] {
        let text = base_with("[1.0, 2]]", &format!("{window}]"));
        let only = plan(&text).metrics[0].windows[1];
        assert_eq!(
            (only.first, only.last),
            (Step(step), Step(step)),
            "{window}"
        );
    }
}

#[test]
fn decimal_durations_that_binary_cannot_hold_are_whole_numbers_of_steps() {
    for (duration_s, rate_hz, steps) in [
        ("0.3", "10", 3),
        ("0.7", "10000", 7000),
        ("2.1", "10000", 21000),
        ("1099511.627776", "1e6", 1 << 40),
        ("1000", "0.001", 1),
        ("0.1", "30", 3),
    ] {
        let text = format!(
            "schema = 1\nrun = {{duration_s = {duration_s}, rate_hz = {rate_hz}}}\n\
             plant.model = \"spring-mass\"\ncontroller.law = \"hold\"\n"
        );
        assert_eq!(
            plan(&text).run.steps,
            steps,
            "{duration_s} s at {rate_hz} Hz"
        );
    }
}

#[test]
fn limits_may_be_infinite() {
    let text = base_with("[-0.4, 0.4]", "[-inf, inf]");
    assert_eq!(plan(&text).plant.limits[0].max, f64::INFINITY);
}

#[test]
fn a_stimulus_may_name_its_unit() {
    let text = base_with("target = \"load_n\"", "target = \"load\"\nunit = \"kN\"");
    assert_eq!(plan(&text).stimuli[1].unit, "kN");
}

#[test]
fn expressions_may_stand_in_strings_of_any_form() {
    let text = base_with("\"max_abs(error_rad)\"", "'''\nmax_abs(\n  error_rad)'''");
    assert_eq!(plan(&text).metrics.len(), 2);
    let wrong = text.replace("\n  error_rad", "\n  eror_rad");
    let problem = &crate::problems(&wrong)[0];
    let excerpt = problem.excerpt.as_ref().expect("a place");
    assert_eq!(
        (excerpt.text.as_str(), excerpt.column),
        ("  eror_rad)'''", 3)
    );
}

proptest! {
    #[test]
    fn no_text_makes_the_check_panic(text in "(?s).{0,200}") {
        let _ = check(&text);
    }

    #[test]
    fn no_change_of_a_valid_scenario_makes_the_check_panic(
        cut in 0..BASE.len(), length in 0..40_usize, put in "[\\[\\]=.\"a-z0-9 \n{},#-]{0,12}",
    ) {
        let mut text = BASE.to_owned();
        text.replace_range(cut..(cut + length).min(BASE.len()), &put);
        let _ = check(&text);
    }

    #[test]
    fn every_value_of_every_kind_can_be_put_anywhere(
        key in "(run|plant|controller|stimuli|faults|derived|metrics)(\\[[01]\\])?(\\.(rate_hz|duration_s|pace|parameters|limits|law|model|ftsc|effects|at_s|skew_s|windows_s|expression|kind|name|target)(\\[[01]\\])?){0,2}",
        value in prop::sample::select(vec![
            "1", "-1", "1e300", "nan", "inf", "true", "[]", "{}", "[[]]", "[{}]", "''", "x", "1979-05-27", "[1, 2]",
        ]),
    ) {
        let scenario = parse(BASE).expect("TOML").set(&[format!("{key}={value}")]);
        let _ = scenario.checked();
    }
}

#[test]
fn a_metric_has_the_unit_of_its_expression_and_an_integral_that_of_the_area() {
    let added = |metrics: &str| plan(&format!("{BASE}\n{metrics}")).metrics;
    #[rustfmt::skip] // a table
    let cases = [
        ("area_rad", "integral(abs(truth.surface_angle_rad))", "rad s"),
        ("leaked", "integral(truth.actuator1_leakage_flow_m3ps)", "m3"),
        ("worst", "max_abs(truth.surface_angle_rad)", "rad"),
        ("both", "integral(truth.actuator1_leakage_flow_m3ps) + integral(truth.actuator2_leakage_flow_m3ps)", "m3"),
        // For products and mixtures the signals' names determine no unit, only the metric's own.
        ("power_n", "2 * max_abs(truth.surface_angle_rad)", "N"),
        ("odd_s", "max(truth.surface_angle_rad) + integral(truth.surface_angle_rad)", "s"),
    ];
    for (name, expression, unit) in cases {
        let text = format!("[[metrics]]\nname = \"{name}\"\nexpression = \"{expression}\"\n");
        let metrics = added(&text);
        assert_eq!(
            metrics.last().map(|last| &*last.unit),
            Some(unit),
            "{expression}"
        );
        let with_unit = added(&format!("{text}unit = \"Nm\"\n"));
        assert_eq!(with_unit.last().map(|last| &*last.unit), Some("Nm"));
    }
}
