use super::*;
use crate::monitor::model::tests::{layout, plan, plan_of};
use crate::plots::bounds::bounds;

fn columns(signals: &[(&str, &str)]) -> Vec<Column> {
    let column = |(name, unit): &(&str, &str)| Column {
        name: (*name).into(),
        unit: (*unit).into(),
    };
    signals.iter().map(column).collect()
}

/// Returns section and signals of each plot of some columns.
fn shown(signals: &[(&str, &str)], subject: Subject<'_>) -> Vec<(&'static str, String)> {
    let plots = choose(&Choice {
        columns: &columns(signals),
        subjects: &[subject],
        patterns: &[],
        values: None,
    });
    let summaries = plots
        .iter()
        .map(|plot| (plot.section, plot.signals.join(" ")));
    summaries.collect()
}

#[test]
fn signals_that_belong_together_share_a_plot_and_nothing_is_shown_twice() {
    let signals = [
        ("truth.angle_rad", "rad"),
        ("truth.pump1_flow_m3ps", "m3/s"),
        ("truth.pump2_flow_m3ps", "m3/s"),
        ("truth.energy_j", "J"),
        ("measured.angle_rad", "rad"),
        ("reference.angle_rad", "rad"),
        ("reference.angle_d1_radps", "rad/s"),
        ("command.torque_nm", "N m"),
        ("applied.torque_nm", "N m"),
        ("internal.flow_estimate_m3ps", "m3/s"),
        ("internal.z11", "N"),
        ("internal.z12", "N"),
        ("parameter.gain", "1"),
        ("round_trip_ns", ""),
        ("step", ""),
    ];
    assert_eq!(
        shown(&signals, Subject::default()),
        [
            ("Tracking", "reference.angle_rad truth.angle_rad".to_owned()),
            ("Commands", "command.torque_nm".into()),
            (
                "Controller",
                "internal.flow_estimate_m3ps truth.pump1_flow_m3ps truth.pump2_flow_m3ps".into()
            ),
            ("Controller", "internal.z11 internal.z12".into()),
            ("Plant", "truth.energy_j".into()),
            ("Interface", "truth.angle_rad measured.angle_rad".into()),
            ("Interface", "command.torque_nm applied.torque_nm".into()),
            ("Loop", "round_trip_ns".into()),
        ]
    );
    assert!(shown(&[("step", "")], Subject::default()).is_empty());
}

#[test]
fn plots_have_few_signals_of_one_unit_and_fewer_where_runs_overlap() {
    let names: Vec<String> = (1..=6).map(|number| format!("truth.x{number}_m")).collect();
    let signals: Vec<(&str, &str)> = names.iter().map(|name| (name.as_str(), "m")).collect();
    for (runs, expected) in [(1, vec![4, 2]), (3, vec![2, 2, 2])] {
        let subjects: Vec<Subject<'_>> = (0..runs).map(|_| Subject::default()).collect();
        let plots = choose(&Choice {
            columns: &columns(&signals),
            subjects: &subjects,
            patterns: &[],
            values: None,
        });
        let counts: Vec<usize> = plots.iter().map(|plot| plot.signals.len()).collect();
        assert_eq!(counts, expected);
    }
    let mixed = by_unit(&columns(&[("a", "m"), ("b", "N"), ("c", "m")]));
    let counts: Vec<_> = mixed
        .iter()
        .map(|plot| (plot.unit.as_str(), plot.signals.len()))
        .collect();
    assert_eq!(counts, [("m", 2), ("N", 1)]);
}

#[test]
fn the_scenario_comes_first_then_what_its_requirements_compare_with_their_levels() {
    let text = include_str!("../../../../scenarios/spring-mass.toml");
    let plan = plan_of(&text.replace(
        "[[plots]]\ntitle = \"Force\"",
        "[[requirements]]\nname = \"slow\"\nformula = \"always[1s,2s](abs(truth.velocity_mps) < 3)\"\n\n[[plots]]\ntitle = \"Force\"",
    ));
    let layout = layout(&plan);
    let fields = [
        ("truth", &layout.truth),
        ("reference", &layout.reference),
        ("command", &layout.command),
    ];
    let columns = fields.into_iter().flat_map(|(group, fields)| {
        fields.iter().map(move |field| Column {
            name: format!("{group}.{}", field.name),
            unit: field.unit.clone(),
        })
    });
    let subject = Subject {
        bounds: bounds(&plan, 5.0).0,
        ..Subject::of(&plan)
    };
    let plots = choose(&Choice {
        columns: &columns.collect::<Vec<_>>(),
        subjects: &[subject],
        patterns: &[Pattern::new("truth.velo*").expect("a pattern")],
        values: None,
    });
    let headings: Vec<_> = plots
        .iter()
        .map(|plot| (plot.section, plot.title.as_str()))
        .collect();
    assert_eq!(
        headings[..4],
        [
            ("Figures", "Position, wanted and true"),
            ("Figures", "Force"),
            ("Signals asked for", "truth.velocity_mps"),
            ("Plant", "truth.acceleration_mps2"),
        ],
        "{headings:?}"
    );
    let levels: Vec<_> = (plots[2].limits.iter())
        .map(|limit| (limit.level, limit.from_s, limit.until_s))
        .collect();
    assert_eq!(levels, [(3.0, 1.0, 2.0), (-3.0, 1.0, 2.0)]);
}

#[test]
fn a_scenario_may_do_without_further_plots() {
    let text = include_str!("../../../../scenarios/spring-mass.toml");
    let signals = [
        ("truth.position_m", "m"),
        ("truth.velocity_mps", "m/s"),
        ("reference.position_m", "m"),
        ("command.force_n", "N"),
        ("round_trip_ns", ""),
    ];
    let plan = plan_of(&format!("further_plots = false\n{text}"));
    let own = [
        (
            "Figures",
            "reference.position_m truth.position_m".to_owned(),
        ),
        ("Figures", "command.force_n".into()),
        ("Loop", "round_trip_ns".into()),
    ];
    assert_eq!(shown(&signals, Subject::of(&plan)), own);
    // Another run of the same report may have them.
    let other = plan_of(text);
    let plots = choose(&Choice {
        columns: &columns(&signals),
        subjects: &[Subject::of(&plan), Subject::of(&other)],
        patterns: &[],
        values: None,
    });
    assert!(
        plots
            .iter()
            .any(|plot| plot.signals == ["truth.velocity_mps"])
    );
}

/// Values of a run in which one sensor is wrong and one parameter changes.
struct OneFault;

impl Values for OneFault {
    fn differ(&self, _: &str, b: &str) -> bool {
        b == "measured.b_m"
    }

    fn changes(&self, name: &str) -> bool {
        name == "parameter.pump2_leak"
    }
}

#[test]
fn known_values_exclude_sensors_and_parameters_unaffected_by_faults() {
    let columns = columns(&[
        ("truth.a_m", "m"),
        ("truth.b_m", "m"),
        ("measured.a_m", "m"),
        ("measured.b_m", "m"),
        ("parameter.pump1_leak", "1"),
        ("parameter.pump2_leak", "1"),
    ]);
    let plots = choose(&Choice {
        columns: &columns,
        subjects: &[Subject::default()],
        patterns: &[],
        values: Some(&OneFault),
    });
    let signals: Vec<_> = plots.iter().map(|plot| plot.signals.join(" ")).collect();
    assert_eq!(
        signals,
        [
            "truth.a_m",
            "truth.b_m",
            "truth.b_m measured.b_m",
            "parameter.pump2_leak"
        ]
    );
}

#[test]
fn without_values_the_parameters_are_those_changed_by_the_scenario() {
    let plan = plan();
    let leakage = "leakage_coefficient_m3ps_per_sqrt_pa";
    let moved = format!("parameter.actuator1_{leakage}");
    let signals = [
        (moved.as_str(), "m3/s/sqrt(Pa)"),
        ("parameter.actuator1_bulk_modulus_pa", "Pa"),
    ];
    assert_eq!(
        shown(&signals, Subject::of(&plan)),
        [("Parameters", moved.clone())]
    );
}
