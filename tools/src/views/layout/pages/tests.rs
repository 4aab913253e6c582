use super::*;

fn columns(signals: &[(&str, &str)]) -> Vec<Column> {
    let column = |(name, unit): &(&str, &str)| Column {
        name: (*name).into(),
        unit: (*unit).into(),
    };
    signals.iter().map(column).collect()
}

/// Title and curves of each plot, by page.
fn shown(signals: &[(&str, &str)]) -> Vec<(String, Vec<String>)> {
    let pages = of(&columns(signals));
    let plots = pages.into_iter().flat_map(|page| {
        let told = move |plot: Plot| (format!("{}/{}", page.title, plot.title), plot.curves);
        page.plots.into_iter().map(told)
    });
    plots.collect()
}

#[test]
fn units_are_found_at_the_end_of_names() {
    for (end, unit) in [
        ("m3ps_per_sqrt_pa", "m3/s/sqrt(Pa)"),
        ("radps2", "rad/s2"),
        ("n_m_s_per_rad", "N m s/rad"),
        ("nm", "N m"),
    ] {
        assert!(spells(end, unit), "{end} and {unit}");
    }
    assert!(!spells("angle_rad", "rad") && !spells("nm", "N"));
    let signal = columns(&[("truth.pump2_flow_m3ps", "m3/s")]);
    let signal = Signal::of(&signal[0]).expect("a signal");
    assert_eq!(signal.family(), "pump*_flow_m3ps");
}

#[test]
fn labels_tell_curves_apart_and_leave_out_what_the_title_says() {
    let labels = |title: &str, unit: &str, curves: &[&str]| {
        labels(&Plot {
            title: title.into(),
            unit: unit.into(),
            curves: curves.iter().map(|curve| (*curve).into()).collect(),
            wanted: None,
        })
    };
    let angles = ["reference.surface_angle_rad", "truth.surface_angle_rad"];
    let told = labels("surface_angle_rad", "rad", &angles);
    assert_eq!(told, ["reference", "truth"]);
    let pressures = ["truth.pump1_pressure2_pa", "truth.pump2_pressure1_pa"];
    let told = labels("pump*_pressure*_pa", "Pa", &pressures);
    assert_eq!(told, ["truth 1 2", "truth 2 1"]);
    let told = labels("z11, z12", "N", &["internal.z11", "internal.z12"]);
    assert_eq!(told, ["internal.z11", "internal.z12"]);
    let functions = ["internal.lyapunov_v3", "internal.lyapunov_bound"];
    assert_eq!(labels("lyapunov_*", "1", &functions), functions);
    let told = labels(
        "*_m",
        "m",
        &["truth.spring1_length_m", "truth.damper2_length_m"],
    );
    assert_eq!(told, ["truth.spring1_length", "truth.damper2_length"]);
    let told = labels("surface_angle_rad", "rad", &angles[1..]);
    assert_eq!(told, ["truth.surface_angle"]);
    let times = ["round_trip_ns", "controller_ns"];
    assert_eq!(labels("*_ns", "ns", &times), times);
}

#[test]
fn a_reference_is_plotted_with_truth_and_measurement_of_its_name() {
    let plots = of(&columns(&[
        ("truth.angle_rad", "rad"),
        ("truth.energy_j", "J"),
        ("measured.angle_rad", "rad"),
        ("reference.angle_rad", "rad"),
        ("reference.angle_d1_radps", "rad/s"),
        ("command.torque_nm", "N m"),
    ]));
    let [page, _] = &plots[..] else {
        panic!("{plots:?}");
    };
    let titles: Vec<&str> = page.plots.iter().map(|plot| &*plot.title).collect();
    assert_eq!(titles, ["angle_rad", "energy_j", "torque_nm"]);
    let tracking = [
        "reference.angle_rad",
        "measured.angle_rad",
        "truth.angle_rad",
    ];
    assert_eq!(page.plots[0].curves, tracking);
    let wanted = ["reference.angle_rad", "truth.angle_rad"].map(str::to_owned);
    assert_eq!(page.plots[0].wanted, Some(wanted));
}

#[test]
fn an_estimate_is_plotted_beside_what_it_estimates_and_nothing_else() {
    let plots = shown(&[
        ("truth.valve1_leakage_m3ps", "m3/s"),
        ("truth.valve1_flow_m3ps", "m3/s"),
        ("truth.force_n", "N"),
        ("internal.leakage_estimate1_m3ps", "m3/s"),
        ("internal.z11", "N"),
        ("internal.z12", "N"),
    ]);
    let expected = |title: &str, curves: &[&str]| {
        let curves: Vec<String> = curves.iter().map(|curve| (*curve).into()).collect();
        assert!(
            plots.contains(&(title.into(), curves)),
            "{title} in {plots:?}"
        );
    };
    let estimate = "internal.leakage_estimate1_m3ps";
    expected(
        "Controller/leakage_estimate1_m3ps",
        &[estimate, "truth.valve1_leakage_m3ps"],
    );
    expected("Controller/z11, z12", &["internal.z11", "internal.z12"]);
    expected("Tracking/force_n", &["truth.force_n"]);
    expected("Plant/valve1_flow_m3ps", &["truth.valve1_flow_m3ps"]);
}

#[test]
fn what_an_excerpt_lacks_is_not_plotted() {
    let plots = shown(&[("measured.angle_rad", "rad"), ("round_trip_ns", "")]);
    let title = |plot: &(String, Vec<String>)| plot.0.clone();
    let titles: Vec<String> = plots.iter().map(title).collect();
    assert_eq!(titles, ["Interface/angle_rad", "Loop/*_ns"]);
    assert_eq!(plots[1].1, ["round_trip_ns"]);
    assert!(of(&columns(&[("step", "")])).is_empty());
}

#[test]
fn many_plots_go_to_further_pages() {
    let names: Vec<String> = (0..10)
        .map(|i| format!("truth.{}_m", ["a", "b"][i % 2].repeat(i + 1)))
        .collect();
    let signals: Vec<(&str, &str)> = names.iter().map(|name| (&**name, "m")).collect();
    let pages = of(&columns(&signals));
    let counts: Vec<_> = pages
        .iter()
        .map(|page| (&*page.title, page.plots.len()))
        .collect();
    assert_eq!(counts, [("Tracking", 8), ("Tracking 2", 2)]);
}
