//! Names as written by foreign tools, through everything that reads a scenario or a recording.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use proptest::strategy::{Strategy, ValueTree};
use proptest::test_runner::TestRunner;
use serde_json::Value;
use shared_types::layout::schema_name;
use shared_types::spelling::spelled;

use super::Place;
use crate::support::fmus::entries;
use crate::support::mcap_reader::Recording;

/// Names as written by tools, and names that are prefixes of others.
const FIXED: [&str; 16] = [
    "p",
    "p.q",
    "p.q.r",
    "bus.u",
    "a.b[1]",
    "a.b[1,2]",
    "'quoted name'.x",
    "φ.ω",
    "der(x.y)",
    "with space",
    "a-b",
    "x__y",
    "1st",
    "say \"no\"",
    "back\\slash",
    "#hash = [1]",
];
/// Number of additional generated names.
const GENERATED: usize = 24;
const STEPS: u32 = 20;

/// Adds names of random characters, none of which is ambiguous in a recording.
fn names() -> Vec<String> {
    let mut runner = TestRunner::deterministic();
    let random = "[a-cA-C_\\.\\[\\]0-2 '\"()#=é]{1,12}";
    let mut columns = BTreeSet::new();
    let mut names: Vec<String> = FIXED.map(str::to_owned).into();
    names.retain(|name| columns.insert(schema_name(&spelled(name).expect("short"))));
    assert_eq!(names.len(), FIXED.len());
    while names.len() < FIXED.len() + GENERATED {
        let tree = random.new_tree(&mut runner).expect("a strategy");
        let name = tree.current().trim().to_owned();
        if !name.is_empty() && columns.insert(schema_name(&spelled(&name).expect("short"))) {
            names.push(name);
        }
    }
    names
}

fn escaped(name: &str) -> String {
    name.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

/// Describes an FMU with an output, an input and a gain per name; inputs and gains get a suffix.
fn description(names: &[String]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"accumulators\" \
         instantiationToken=\"accumulators\">\n<CoSimulation modelIdentifier=\"accumulators\"/>\n<ModelVariables>\n\
         <Float64 name=\"time\" valueReference=\"0\" causality=\"independent\" variability=\"continuous\"/>\n",
    );
    let roles = [
        ("", "causality=\"output\" initial=\"exact\""),
        (".u", "causality=\"input\""),
        (".k", "causality=\"parameter\" variability=\"tunable\""),
    ];
    let mut reference = 0;
    for (ending, role) in roles {
        for name in names {
            reference += 1;
            let name = escaped(name);
            writeln!(
                text,
                "<Float64 name=\"{name}{ending}\" valueReference=\"{reference}\" {role} start=\"0\"/>"
            )
            .expect("text");
        }
    }
    text += "</ModelVariables>\n<ModelStructure>\n";
    for reference in 1..=names.len() {
        writeln!(
            text,
            "<Output valueReference=\"{reference}\" dependencies=\"\"/>"
        )
        .expect("text");
    }
    text + "</ModelStructure>\n</fmiModelDescription>\n"
}

/// Returns the names in a table of the plant's description.
fn table(described: &Value, table: &str) -> Vec<String> {
    let fields = described["description"]["plants"][0][table].as_array();
    let names = fields.expect("a list").iter();
    names
        .map(|field| field["name"].as_str().expect("text").to_owned())
        .collect()
}

#[test]
fn names_written_by_foreign_tools_survive_every_command() {
    let Some(place) = Place::new() else { return };
    let names = names();
    let count = format!("-DCOUNT_OF={}", names.len());
    let text = description(&names).into_bytes();
    place.fmu("names.fmu", &entries("accumulators", 3, text, &[&count]));
    let described = place
        .hil(&["describe", "--json", "names.fmu"])
        .expect(0)
        .json();
    let [truth, commands, gains] =
        ["truth", "commands", "parameters"].map(|name| table(&described, name));
    assert_eq!([&truth, &commands, &gains].map(Vec::len), [names.len(); 3]);

    let mut scenario = format!(
        "schema = 1\nname = \"names\"\n[run]\nduration_s = {:?}\nrate_hz = 100\n[plant]\nmodel = \"accumulators\"\n\
         program = \"names.fmu\"\n[controller]\nlaw = \"hold\"\n[plant.parameters]\n",
        f64::from(STEPS) / 100.0
    );
    for (gain, name) in (1..).zip(&gains) {
        writeln!(scenario, "\"{name}\" = {gain}").expect("text");
    }
    scenario += "[plant.safe_command]\n";
    for (value, name) in (1..).zip(&commands) {
        writeln!(scenario, "\"{name}\" = {value}").expect("text");
    }
    scenario += "[plant.limits]\n";
    for name in &truth {
        writeln!(scenario, "\"{name}\" = [-1.0, 1e6]").expect("text");
    }
    for (number, name) in truth.iter().enumerate() {
        let bound = f64::from(STEPS) * (2.0 + number as f64);
        writeln!(
            scenario,
            "[[requirements]]\nname = \"r{number}\"\nformula = \"always(truth.{name} < {bound:?})\"\n\
             [[plots]]\ntitle = \"p{number}\"\nsignals = [\"truth.{name}\", \"measured.{name}\"]"
        )
        .expect("text");
    }
    writeln!(
        scenario,
        "[[faults]]\nkind = \"bias\"\nat_s = 0.1\n[[faults.effects]]\ntarget = \"measured.{}\"\nbias = 1.0\n\
         [[changes]]\nat_s = 0.15\nset.\"plant.parameters.{}\" = 3.0",
        truth[1], gains[1]
    )
    .expect("text");

    let run = place.run(&scenario, "").expect(0);
    let recording = Recording::open(&run.recording());
    for (number, name) in truth.iter().enumerate() {
        let column = recording.column(&format!("truth.{}", schema_name(name)));
        let gain = 1.0 + number as f64;
        let expected = match number {
            1 => 15.0 * gain + 5.0 * 3.0,
            _ => f64::from(STEPS) * gain,
        };
        assert_eq!(column.last(), Some(&expected), "{name}");
    }
    let digest = run.summary()["digest"].clone();
    let folder = run.recording().with_file_name("").display().to_string();

    let output = place
        .hil(&["config", "show", "scenario.toml"])
        .expect(0)
        .stdout;
    place.rig.write("shown.toml", &output);
    place.hil(&["config", "check", "shown.toml"]).expect(0);
    place.hil(&["judge", &folder]).expect(0);
    place.hil(&["rerun", &folder, "--out", "again"]).expect(0);
    place.hil(&["replay", &folder]).expect(0);
    place.hil(&["compare", &folder, "again"]).expect(0);
    place
        .hil(&["report", &folder, "-o", "report.html"])
        .expect(0);
    place
        .hil(&["layout", &folder, "foxglove", "-o", "layout.json"])
        .expect(0);
    for name in &truth {
        let signal = format!("truth.{}", schema_name(name));
        place
            .hil(&[
                "export", &folder, "-o", "one.csv", "--force", "--signal", &signal,
            ])
            .expect(0);
    }
    place
        .hil(&["scenario", "from", &folder, "-o", "from.toml"])
        .expect(0);
    let from = std::fs::read_to_string(place.rig.path("from.toml")).expect("written");
    let repeated = place.run(&from, "").expect(0);
    assert_eq!(repeated.summary()["digest"], digest);
}

#[test]
fn a_full_name_is_never_confused_with_a_suffix_of_another() {
    let Some(place) = Place::new() else { return };
    // Gains `x.k` and `a.x.k`: the first is also a suffix of the second.
    let names = ["x", "a.x"].map(str::to_owned);
    let text = description(&names).into_bytes();
    place.fmu(
        "names.fmu",
        &entries("accumulators", 3, text, &["-DCOUNT_OF=2"]),
    );
    let scenario = "schema = 1\nname = \"names\"\n[run]\nduration_s = 0.2\nrate_hz = 100\n[plant]\n\
         model = \"accumulators\"\nprogram = \"names.fmu\"\n[controller]\nlaw = \"hold\"\n[plant.parameters]\n\
         x.k = 5\n[[changes]]\nat_s = 0.1\nset.\"plant.parameters.x.k\" = 1\n";
    let run = place.run(scenario, "").expect(0);
    let recording = Recording::open(&run.recording());
    let last = |name: &str| recording.column(name).last().copied();
    assert_eq!(last("truth.x"), Some(60.0));
    assert_eq!(last("truth.a_x"), Some(0.0));
    let short = scenario
        .replace("x.k = 5", "k = 5")
        .replace("parameters.x.k", "parameters.k");
    let run = place.run(&short, "").expect(0);
    let recording = Recording::open(&run.recording());
    let last = |name: &str| recording.column(name).last().copied();
    assert_eq!([last("truth.x"), last("truth.a_x")], [Some(60.0); 2]);
}

#[test]
fn a_law_with_a_fixed_step_is_refused_with_the_key_to_change() {
    let Some(place) = Place::new() else { return };
    let text = description(&["x.y".to_owned()]);
    let own = text.replace(
        "<CoSimulation ",
        "<CoSimulation fixedInternalStepSize=\"0.02\" ",
    );
    let fmu = |text: String| entries("accumulators", 3, text.into_bytes(), &["-DCOUNT_OF=1"]);
    place.fmu("plant.fmu", &fmu(text));
    place.fmu("law.fmu", &fmu(own));
    let scenario = "schema = 1\nname = \"steps\"\n[run]\nduration_s = 0.2\nrate_hz = 100\n[plant]\n\
         model = \"accumulators\"\nprogram = \"plant.fmu\"\n[controller]\nlaw = \"accumulators\"\n\
         program = \"law.fmu\"\n[[connect]]\nlaw = \"measured.x.y.u\"\nplant = \"measured.x.y\"\n\
         [[connect]]\nlaw = \"command.x.y\"\nplant = \"command.x.y.u\"\n";
    let expected = [
        "fixed step of 0.02 s",
        "set controller.rate_hz to 50 divided by an integer",
    ];
    place.run(scenario, "").expect(2).says(&expected);
    place.run(scenario, "--set controller.rate_hz=50").expect(0);
}
