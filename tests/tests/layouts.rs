//! Layouts for Foxglove and PlotJuggler: every path leads to a recorded signal, and the shipped
//! files are those that `hil layout` makes.

use std::collections::BTreeSet;
use std::path::Path;

use quick_xml::events::Event;
use quick_xml::reader::Reader;
use serde_json::Value;

use crate::support::harness::{Rig, Run};
use crate::support::mcap_reader::Recording;
use crate::support::programs::{of_pendulum, shipped};

const SCENARIO: &str = "tests/scenarios/leakage.toml";
const SHORT: &str = "--set run.duration_s=0.02 --set faults[0].at_s=0.01";

/// The run of which the shipped layouts are made: those for Foxglove know what is small in it.
const SHIPPED: &str =
    "scenarios/severe-leakage.toml --set run.duration_s=9 --set requirements=[] --set metrics=[]";

/// A layout as `hil layout` prints it.
fn layout(rig: &Rig, run: &Run, viewer: &str) -> String {
    let folder = run.folder.to_str().expect("text");
    rig.hil(&["layout", folder, viewer]).expect(0).stdout
}

/// Collects the values of a key, however deep they are.
fn values<'v>(json: &'v Value, key: &str, found: &mut Vec<&'v Value>) {
    match json {
        Value::Object(object) => {
            for (name, value) in object {
                if name == key {
                    found.push(value);
                }
                values(value, key, found);
            }
        }
        Value::Array(array) => array.iter().for_each(|value| values(value, key, found)),
        _ => {}
    }
}

/// The panels of a tree, or of the trees of its tabs.
pub(crate) fn panels(tree: &Value, found: &mut Vec<String>) {
    match tree {
        Value::String(id) => found.push(id.clone()),
        Value::Object(halves) => {
            for half in ["first", "second"] {
                panels(&halves[half], found);
            }
        }
        other => panic!("neither a panel nor two halves: {other}"),
    }
}

/// The signals that a layout for Foxglove plots, as columns.
fn foxglove(text: &str) -> Vec<String> {
    let layout: Value = serde_json::from_str(text).expect("JSON");
    let configs = layout["configById"].as_object().expect("panels");
    let mut shown = Vec::new();
    panels(&layout["layout"], &mut shown);
    for tab in configs["Tab!hil"]["tabs"].as_array().expect("tabs") {
        panels(&tab["layout"], &mut shown);
    }
    let shown: BTreeSet<&String> = shown.iter().collect();
    assert_eq!(shown, configs.keys().collect(), "every panel has its place");
    let mut paths = Vec::new();
    values(&layout["configById"], "value", &mut paths);
    let columns = paths.into_iter().filter_map(|path| {
        let path = path.as_str().expect("a path");
        (path != "/events.event").then(|| path.strip_prefix("/record.").expect(path).to_owned())
    });
    columns.collect()
}

/// The same for PlotJuggler: curves, the sources of errors, and the file that it opens. Its question
/// which topics and which time is answered.
fn plotjuggler(text: &str) -> (Vec<String>, Option<String>) {
    let mut reader = Reader::from_str(text);
    reader.config_mut().trim_text(true);
    let (mut series, mut computed, mut file, mut open) = (vec![], vec![], None, vec![]);
    loop {
        let event = reader.read_event().expect("XML");
        let (element, is_open) = match event {
            Event::Eof => break,
            Event::Start(element) => (element, true),
            Event::Empty(element) => (element, false),
            Event::Text(text) => {
                let text = text.decode().expect("text").into_owned();
                if matches!(
                    open.last().map(String::as_str),
                    Some("linked_source" | "v1")
                ) {
                    series.push(text);
                }
                continue;
            }
            Event::End(_) => {
                open.pop();
                continue;
            }
            _ => continue,
        };
        let name = String::from_utf8(element.name().as_ref().to_vec()).expect("text");
        let attribute = |key: &str| {
            let value = element.try_get_attribute(key).expect("attributes");
            value.map(|value| String::from_utf8(value.value.into_owned()).expect("text"))
        };
        match &*name {
            "curve" => series.push(attribute("name").expect("a name")),
            "snippet" => computed.push(attribute("name").expect("a name")),
            "fileInfo" => file = attribute("filename"),
            "parameters" => {
                // It has no parser of JSON yet when it loads what its command line names.
                assert_eq!(attribute("selected_topics").as_deref(), Some("/record"));
                assert_eq!(attribute("use_mcap_log_time").as_deref(), Some("1"));
            }
            _ => {}
        }
        if is_open {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
    let recorded = series.into_iter().filter(|name| !computed.contains(name));
    let column = |name: String| {
        let path = name
            .strip_prefix("/record/")
            .unwrap_or_else(|| panic!("{name}"));
        path.replace('/', ".")
    };
    (recorded.map(column).collect(), file)
}

fn assert_recorded(curves: &[String], run: &Run) {
    let recorded = Recording::open(&run.recording()).columns;
    assert!(!curves.is_empty());
    for curve in curves {
        assert!(recorded.contains(curve), "{curve} in {recorded:?}");
    }
}

#[test]
fn every_curve_of_a_layout_is_a_signal_of_the_run_whatever_the_plant() {
    let rig = Rig::new();
    let own = of_pendulum("examples/own-plant/pendulum.toml");
    let runs = [
        rig.run(&format!("{SCENARIO} {SHORT}")).expect(0),
        rig.run(&format!("{SCENARIO} {SHORT} --set controller.law=pid"))
            .expect(0),
        rig.run(&format!(
            "{SCENARIO} {SHORT} --record measured.* --record command.*"
        ))
        .expect(0),
        rig.run("scenarios/spring-mass.toml").expect(0),
        rig.run(&own).expect(0),
    ];
    for run in &runs {
        assert_recorded(&foxglove(&layout(&rig, run, "foxglove")), run);
        assert_recorded(&plotjuggler(&layout(&rig, run, "plotjuggler")).0, run);
    }
    // What a user of an own plant looks for first.
    let pendulum = foxglove(&layout(&rig, &runs[4], "foxglove"));
    for curve in [
        "reference.angle_rad",
        "truth.angle_rad",
        "command.torque_nm",
    ] {
        assert!(
            pendulum.contains(&curve.to_owned()),
            "{curve} in {pendulum:?}"
        );
    }
}

#[test]
fn the_shipped_layouts_are_those_of_the_paper_and_show_its_figures() {
    let rig = Rig::new();
    let run = rig.run(SHIPPED).expect(0);
    for (viewer, file) in [
        ("foxglove", "foxglove-drhas.json"),
        ("plotjuggler", "plotjuggler-drhas.xml"),
    ] {
        let path = Path::new("docs/layouts").join(file);
        let text = shipped(&path);
        let made = layout(&rig, &run, viewer);
        assert!(
            text == made,
            "{0} is stale; `hil layout RUN {viewer} -o {0} --force` makes it anew of {SHIPPED}",
            path.display()
        );
    }
    let curves = foxglove(&layout(&rig, &run, "foxglove"));
    for figure in [
        "reference.surface_angle_rad",
        "truth.surface_angle_rad",
        "internal.lyapunov_v3",
        "internal.lyapunov_bound",
        "truth.force_fight_n",
        "command.actuator2_valve_current_a",
        "internal.leakage_estimate1_m3ps_per_sqrt_pa",
        "truth.actuator1_leakage_coefficient_m3ps_per_sqrt_pa",
        "truth.actuator2_leakage_flow_m3ps",
    ] {
        assert!(
            curves.contains(&figure.to_owned()),
            "{figure} in {curves:?}"
        );
    }
}

#[test]
fn a_layout_in_the_folder_of_a_run_opens_its_recording_and_no_other_does() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let folder = run.folder.to_str().expect("text");
    let (beside, apart) = (run.folder.join("plots.xml"), rig.path("plots.xml"));
    for (file, opened) in [(&beside, Some("run.mcap".to_owned())), (&apart, None)] {
        let path = file.to_str().expect("text");
        rig.hil(&["layout", folder, "plotjuggler", "-o", path])
            .expect(0)
            .prints(&["plots on"]);
        let text = std::fs::read_to_string(file).expect("written");
        assert_eq!(plotjuggler(&text).1, opened);
    }
}

#[test]
fn a_layout_that_cannot_be_made_says_why() {
    let rig = Rig::new();
    let run = rig.run(&format!("{SCENARIO} {SHORT}")).expect(0);
    let folder = run.folder.to_str().expect("text");
    let there = rig.write("there.json", "mine");
    let path = there.to_str().expect("text");
    rig.hil(&["layout", folder, "foxglove", "-o", path])
        .expect(2)
        .says(&["--force"]);
    assert_eq!(std::fs::read_to_string(&there).expect("read"), "mine");
    rig.hil(&["layout", folder, "foxglove", "-o", path, "--force"])
        .expect(0);
    rig.hil(&["layout", folder, "foxglove", "-o", "/dev/full"])
        .expect(3)
        .says(&["No space left"]);
    rig.hil(&["layout", folder, "rviz"])
        .expect(2)
        .says(&["foxglove", "plotjuggler"]);
    rig.hil(&["layout", "runs/nothing", "foxglove"])
        .expect(2)
        .says(&["runs/nothing"]);
}
