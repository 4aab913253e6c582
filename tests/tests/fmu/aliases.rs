//! Aliases of variables, differences, and parameters that are read back.

use super::Place;
use crate::support::fmus::{Entries, entries, proportional};
use crate::support::mcap_reader::Recording;

const STEPS: usize = 20;

/// Variable of an accumulator FMU: attributes and aliases.
pub(super) struct Row<'a> {
    name: &'a str,
    aliases: &'a [&'a str],
    unit: &'a str,
}

/// Row for a plain number.
pub(super) const fn row<'a>(name: &'a str, aliases: &'a [&'a str]) -> Row<'a> {
    Row {
        name,
        aliases,
        unit: "",
    }
}

/// Returns an FMU whose output grows per step by its input and its gain, as entries of its archive.
pub(super) fn accumulator(version: u32, rows: &[Row<'_>; 3], options: &[&str]) -> Entries {
    let causalities = ["output", "input", "parameter"];
    let mut variables = String::new();
    let mut later = String::new();
    for (
        reference,
        (
            Row {
                name,
                aliases,
                unit,
            },
            causality,
        ),
    ) in (1..).zip(rows.iter().zip(causalities))
    {
        let start = match causality {
            "output" if version == 2 => "",
            "output" => " initial=\"exact\" start=\"0\"",
            _ => " start=\"0\"",
        };
        let variability = match causality {
            "parameter" => "tunable",
            _ => "continuous",
        };
        let attributes = |causality: &str| {
            format!(
                "valueReference=\"{reference}\" causality=\"{causality}\" variability=\"{variability}\""
            )
        };
        if version == 3 {
            let aliases = aliases
                .iter()
                .map(|alias| format!("<Alias name=\"{alias}\"/>"));
            let aliases: String = aliases.collect();
            variables += &format!(
                "<Float64 name=\"{name}\" {} {unit}{start}>{aliases}</Float64>",
                attributes(causality)
            );
            continue;
        }
        variables += &format!(
            "<ScalarVariable name=\"{name}\" {}><Real {unit}{start}/></ScalarVariable>",
            attributes(causality)
        );
        for alias in *aliases {
            let (other, start) = match causality {
                "parameter" => (causality, start),
                _ => ("local", ""),
            };
            later += &format!(
                "<ScalarVariable name=\"{alias}\" {}><Real {unit}{start}/></ScalarVariable>",
                attributes(other)
            );
        }
    }
    let (token, output) = match version {
        2 => (
            "guid",
            "<Outputs><Unknown index=\"1\" dependencies=\"\"/></Outputs>",
        ),
        _ => (
            "instantiationToken",
            "<Output valueReference=\"1\" dependencies=\"\"/>",
        ),
    };
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{version}.0\" \
         modelName=\"accumulators\" {token}=\"accumulators\"><CoSimulation modelIdentifier=\"accumulators\"/>\
         <ModelVariables>{variables}{later}</ModelVariables><ModelStructure>{output}</ModelStructure>\
         </fmiModelDescription>"
    );
    let options = [&["-DCOUNT_OF=1"], options].concat();
    entries("accumulators", version, text.into_bytes(), &options)
}

/// Returns a scenario of the plant `plant.fmu` under the law `law.fmu`.
pub(super) fn scenario(rest: &str) -> String {
    let duration_s = STEPS as f64 / 100.0;
    format!(
        "schema = 1\nname = \"names\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = 100\n[plant]\n\
         model = \"accumulators\"\nprogram = \"plant.fmu\"\n[controller]\nlaw = \"accumulators\"\n\
         program = \"law.fmu\"\n{rest}"
    )
}

#[test]
fn every_alias_refers_to_the_same_variable() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let plant = [
            row("x", &["body.x"]),
            row("u", &["body.force"]),
            row("k", &["body.gain"]),
        ];
        // The law uses the plant's other names, for its input as an alias of its own.
        let law = [
            row("body.force", &[]),
            row("sensor", &["body.x"]),
            row("g", &[]),
        ];
        place.fmu("plant.fmu", &accumulator(version, &plant, &[]));
        place.fmu("law.fmu", &accumulator(version, &law, &[]));
        let described = place.hil(&["describe", "plant.fmu"]).expect(0).stdout;
        for alias in ["Also body.x.", "Also body.force.", "Also body.gain."] {
            assert!(described.contains(alias), "{described}");
        }

        let text = scenario(
            "[plant.parameters]\nbody.gain = 2\n[plant.limits]\nbody.x = [-1.0, 1e12]\n\
             [plant.safe_command]\nbody.force = 0.0\n\
             [[derived]]\nname = \"twice\"\nexpression = \"truth.body.x + truth.x\"\n\
             [[requirements]]\nname = \"small\"\nformula = \"always(abs(measured.body.x) < 1e12)\"\n\
             [[plots]]\ntitle = \"x\"\nsignals = [\"truth.body.x\"]\n\
             [[faults]]\nkind = \"bias\"\nat_s = 0.15\n[[faults.effects]]\ntarget = \"command.body.force\"\n\
             bias = 1.0\n[[changes]]\nat_s = 0.1\nset.\"plant.parameters.body.gain\" = 3.0\n",
        );
        let run = place.run(&text, "").expect(0);
        let recording = Recording::open(&run.recording());
        let (mut x, mut force) = (0.0, 0.0);
        let mut expected = vec![x];
        for step in 0..STEPS {
            force += x;
            let gain = if step < 10 { 2.0 } else { 3.0 };
            let bias = if step < 15 { 0.0 } else { 1.0 };
            x += force + bias + gain;
            expected.push(x);
        }
        assert_eq!(recording.column("truth.x"), expected);
        let digest = run.summary()["digest"].clone();
        let folder = run.folder.display().to_string();
        place.hil(&["judge", &folder]).expect(0);
        place.hil(&["rerun", &folder, "--out", "again"]).expect(0);

        let own = (text.replace("body.gain", "k"))
            .replace("body.force", "u")
            .replace("body.x", "x");
        assert_eq!(place.run(&own, "").expect(0).summary()["digest"], digest);
        let both = |value: &str| {
            let given = format!("[plant.parameters]\nk = {value}\nbody.gain = 2");
            text.replace("[plant.parameters]\nbody.gain = 2", &given)
        };
        place.run(&both("2"), "").expect(0);
        (place.run(&both("7"), "").expect(2)).says(&["both are names of one variable"]);
    }
}

#[test]
fn a_difference_is_converted_without_unit_offsets() {
    let Some(place) = Place::new() else { return };
    let sent = |unit: &str, is_difference: bool, version| {
        let unit = format!("unit=\"{unit}\" relativeQuantity=\"{is_difference}\"");
        let output = Row {
            unit: &unit,
            ..row("rise", &[])
        };
        place.fmu(
            "plant.fmu",
            &accumulator(version, &[output, row("u", &[]), row("k", &[])], &[]),
        );
    };
    let received = |is_difference: bool, version| {
        let unit = format!("unit=\"K\" relativeQuantity=\"{is_difference}\"");
        let input = Row {
            unit: &unit,
            ..row("rise_k", &[])
        };
        place.fmu(
            "law.fmu",
            &accumulator(version, &[row("u", &[]), input, row("g", &[])], &[]),
        );
    };
    let text = scenario(
        "[plant.parameters]\nk = 9\n[[connect]]\nlaw = \"measured.rise_k\"\nplant = \"measured.rise\"\n",
    );
    for version in [2, 3] {
        for (unit, factor, zero_k) in [
            ("degC", 1.0, 273.15),
            ("degF", 5.0 / 9.0, 459.67 * 5.0 / 9.0),
        ] {
            for (is_difference, offset_k) in [(true, 0.0), (false, zero_k)] {
                sent(unit, is_difference, version);
                received(is_difference, version);
                let run = place.run(&text, "").expect(0);
                let command = Recording::open(&run.recording()).column("command.u");
                // The rise is 0 at step 0, then 9 and the first command.
                let first = offset_k;
                let second = first + (9.0 + first) * factor + offset_k;
                for (value, expected) in command.iter().zip([first, second]) {
                    let is_near = (value - expected).abs() <= 1e-12 * expected;
                    assert!(is_near, "{unit} {is_difference}: {value} for {expected}");
                }
            }
            received(true, version);
            (place.run(&text, "").expect(2)).says(&["`rise_k` is declared as a difference"]);
        }
    }
}

#[test]
fn a_parameter_not_accepted_by_the_fmu_ends_the_run() {
    let text = scenario("")
        .replace("program = \"law.fmu\"\n", "")
        .replace("law = \"accumulators\"", "law = \"hold\"");
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let rows = [row("x", &[]), row("u", &[]), row("k", &[])];
        let stubborn = "-DKEPT(value)=((value) > 5 ? 5 : (value))";
        place.fmu("plant.fmu", &accumulator(version, &rows, &[stubborn]));
        let expected = ["parameter `k` was set to 7, but the FMU has 5"];
        let start = format!("{text}[plant.parameters]\nk = 7\n");
        place.run(&start, "").expect(2).says(&expected);
        let change = format!("{text}[[changes]]\nat_s = 0.1\nset.\"plant.parameters.k\" = 7.0\n");
        // An FMU may be initialised to another value and take this one later: its step decides.
        place.run(&change, "").expect(3).says(&expected);
        let fault = format!(
            "{text}[[faults]]\nkind = \"bias\"\nat_s = 0.1\n[[faults.effects]]\ntarget = \"parameter.k\"\nbias = 7.0\n"
        );
        place.run(&fault, "").expect(3).says(&expected);
        place
            .run(&fault.replace("bias = 7.0", "bias = 5.0"), "")
            .expect(0);
    }
}

#[test]
fn a_start_value_changed_by_the_fmu_is_reported_and_the_run_continues() {
    let text = scenario("")
        .replace("program = \"law.fmu\"\n", "")
        .replace("law = \"accumulators\"", "law = \"hold\"");
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let rows = [row("x", &[]), row("u", &[]), row("k", &[])];
        let other = "-DKEPT(value)=((value) + 5)";
        place.fmu("plant.fmu", &accumulator(version, &rows, &[other]));
        let run = place.run(&text, "").expect(0);
        let warning =
            "parameter `k` starts at 0 according to the FMU's own description, but the FMU has 5";
        assert!(run.stderr.contains(warning), "{}", run.stderr);
        // A value set by the user is treated differently.
        let chosen = format!("{text}[plant.parameters]\nk = 1\n");
        place.run(&chosen, "").expect(2);
    }
}

#[test]
fn an_unreadable_parameter_is_not_confirmed_and_the_run_continues() {
    let Some(place) = Place::new() else { return };
    place.fmu("p.fmu", &proportional());
    let text = super::scenario("proportional", "p.fmu", 10.0, 10.0);
    let run = place.run(&text, "").expect(0);
    let log = std::fs::read_to_string(run.folder.join("plant.log")).expect("a log");
    for name in ["gain_n_per_m", "trouble"] {
        let line = format!("parameter `{name}` is unconfirmed");
        assert_eq!(log.matches(&line).count(), 1, "{log}");
    }
}

#[test]
fn aliases_work_during_the_run_and_afterwards() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let plant = [
            row("x", &["body.x"]),
            row("u", &["body.force"]),
            row("k", &["body.gain"]),
        ];
        let law = [
            row("u", &[]),
            row("reference_r", &["reference_goal"]),
            row("g", &["law.gain"]),
        ];
        place.fmu("plant.fmu", &accumulator(version, &plant, &[]));
        place.fmu("law.fmu", &accumulator(version, &law, &[]));
        let text = scenario(
            "[plant.parameters]\nk = 2\n[[stimuli]]\ntarget = \"goal\"\nkind = \"step\"\nat_s = 0.0\nbefore = 0.0\n\
             after = 1.0\n[panel]\nreadings = [\"truth.body.x\"]\n\
             tune = [\"plant.parameters.body.gain\", \"reference.r\"]\n\
             [[changes]]\nat_s = 0.12\nset.\"reference.r\" = 3.0\n[[changes]]\nat_s = 0.15\nclear = [\"reference.r\"]\n",
        );
        let path = place.rig.write("live.toml", &text);
        let view = place.hil(&["config", "show", "live.toml"]).expect(0);
        view.prints(&["[\"plant.parameters.k\", \"reference.goal\"]"]);

        let line = format!("{} --pause-at 0.1", path.display());
        let run = place.rig.start_with(place.command(), &line);
        let rig = &place.rig;
        rig.until_held_at(10);
        let asked = |words: &str| rig.in_session(words).expect(0);
        for words in ["get", "watch --count 1"] {
            for pattern in ["truth.body.x", "truth.body.*", "truth.body_x"] {
                let values = asked(&format!("{words} --json {pattern}")).json();
                let signals = values["signals"].as_array().expect("a list");
                assert_eq!(signals.len(), 1, "{values}");
                assert_eq!(signals[0]["name"], "truth.x", "{values}");
            }
        }
        let monitor = asked("monitor --once --json --signal truth.body.x").json();
        assert!(monitor["signals"].get("truth.x").is_some(), "{monitor}");
        let tunable = asked("get --tunable --json plant.parameters.body.gain reference.r").json();
        let keys: Vec<_> = (tunable["values"].as_array().expect("a list").iter())
            .map(|one| (one["key"].as_str(), one.get("aliases")))
            .collect();
        let own = ["plant.parameters.k", "reference.goal"];
        assert_eq!(keys, own.map(|key| (Some(key), None)));
        #[rustfmt::skip] // a table
        let cases = [
            ("get --session SESSION truth.bod", "truth.body.x\n"),
            ("set --session SESSION plant.parameters.bod", "plant.parameters.body.gain=\n"),
            ("set --session SESSION controller.accumulators.law", "controller.accumulators.law.gain=\n"),
            ("set --session SESSION reference.r", "reference.r=\n"),
            ("inject --session SESSION bias parameter.bod", "parameter.body.gain\n"),
            ("inject --session SESSION bias command.bod", "command.body.force\n"),
        ];
        for (typed, completed) in cases {
            let mut hil = place.command();
            hil.env("HIL_COMPLETE", "bash");
            hil.env("HIL_COMPLETE_BREAKS", "=:");
            let typed = typed.replace("SESSION", rig.session());
            hil.args(["--", "hil", &format!("hil {typed}")]);
            let offered = rig.program(hil).expect(0).stdout;
            assert_eq!(offered, completed, "{typed}");
        }
        let change =
            asked("set plant.parameters.body.gain=5 controller.accumulators.law.gain=0.5 --json");
        let change = change.json();
        assert_eq!(change["step"], 10, "{change}");
        let values = change["set"].as_array().expect("a list").iter();
        let values: Vec<_> = values
            .map(|one| (one["key"].as_str(), one["value"].as_f64()))
            .collect();
        let law = (Some("controller.accumulators.g"), Some(0.5));
        assert_eq!(values, [law, (Some("plant.parameters.k"), Some(5.0))]);
        asked("resume");
        let run = run.finish().expect(0);

        let recording = Recording::open(&run.recording());
        let reference: Vec<f64> = (0..STEPS)
            .map(|step| if (12..15).contains(&step) { 3.0 } else { 1.0 })
            .collect();
        assert_eq!(recording.column("reference.goal")[..STEPS], reference);
        let (mut x, mut force) = (0.0, 0.0);
        let mut expected = vec![x];
        for (step, reference) in reference.iter().enumerate() {
            let (gain, law_gain) = if step < 10 { (2.0, 0.0) } else { (5.0, 0.5) };
            force += reference + law_gain;
            x += force + gain;
            expected.push(x);
        }
        assert_eq!(recording.column("truth.x"), expected);

        let folder = run.folder.display().to_string();
        let table = place.hil(&["export", &folder, "--signal", "truth.body.x"]);
        let table = table.expect(0).stdout;
        assert_eq!(table.lines().next(), Some("step,time_s,truth.x"), "{table}");
        let page = [
            "report",
            &folder,
            "--signal",
            "truth.body.x",
            "-o",
            "page.html",
        ];
        place.hil(&page).expect(0);
        let unknown = [
            "report",
            &folder,
            "--signal",
            "truth.body.z",
            "-o",
            "other.html",
        ];
        place.hil(&unknown).expect(2).says(&["no run has a signal"]);
        place.hil(&["rerun", &folder, "--out", "again"]).expect(0);
        let compare = |arguments: &[&str]| {
            let both = ["compare", "again", &folder, "--json"];
            place.hil(&[&both[..], arguments].concat())
        };
        let of = |signal: &str| {
            let tolerance = format!("{signal}=1");
            let compared = compare(&["--signal", signal, "--tolerance", &tolerance]);
            compared.expect(0).json()
        };
        assert_eq!(of("truth.body.x"), of("truth.x"));
        (compare(&["--signal", "truth.body.z"]).expect(2)).says(&["has no signal `truth.body.z`"]);
        let replay = ["replay", &folder, "--tolerance", "command.body.force=0"];
        place.hil(&replay).expect(0);
        let text = text.split("[panel]").next().expect("what is before");
        let some = "--record truth.body.* --record command.body_force";
        let kept = place.run(text, some);
        let columns = Recording::open(&kept.expect(0).recording()).columns;
        let kept = |name: &str| columns.iter().any(|column| column == name);
        assert!(kept("truth.x") && kept("command.u"), "{columns:?}");
        assert!(!kept("measured.x"), "{columns:?}");
    }
}

#[test]
fn an_alias_of_an_output_can_be_requested_as_an_inner_signal() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let plant = [row("x", &["body.x"]), row("u", &[]), row("k", &[])];
        place.fmu("plant.fmu", &accumulator(version, &plant, &[]));
        let text = scenario("")
            .replace("program = \"law.fmu\"\n", "")
            .replace("law = \"accumulators\"", "law = \"hold\"");
        let [plain, asked] = [
            &text,
            &text.replace("[plant]\n", "[plant]\nlocals = [\"body.x\"]\n"),
        ]
        .map(|text| place.run(text, "").expect(0).digest());
        // It is there as the output.
        assert_eq!(plain, asked, "FMI {version}");
        let other = text.replace("[plant]\n", "[plant]\nlocals = [\"body.z\"]\n");
        place
            .run(&other, "")
            .expect(2)
            .says(&["no inner signal of the FMU matches"]);
    }
}
