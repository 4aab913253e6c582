//! Parameters changed while an FMU runs: the others keep their values, and an unreadable value is reported.

use super::{Place, scenario};
use crate::support::fmus::{Entries, entries};
use crate::support::harness::Run;
use crate::support::mcap_reader::Recording;

/// Describes `tests/fmus/stubborn.c`, with the parameters as scalars or as one array of FMI 3.
pub(super) fn stubborn(version: u32, is_array: bool, options: &[&str]) -> Entries {
    let tunable = "causality=\"parameter\" variability=\"tunable\"";
    let variable = |name: &str, reference: u32, role: &str, start: &str| {
        let head = format!("name=\"{name}\" valueReference=\"{reference}\" {role}");
        match version {
            2 => format!("<ScalarVariable {head}><Real {start}/></ScalarVariable>"),
            _ => format!("<Float64 {head} {start}/>"),
        }
    };
    let parameters = match is_array {
        true => format!(
            "<Float64 name=\"p\" valueReference=\"3\" {tunable} start=\"5 1\"><Dimension start=\"2\"/></Float64>"
        ),
        false => {
            variable("p", 3, tunable, "start=\"5\"") + &variable("q", 4, tunable, "start=\"1\"")
        }
    };
    let outputs = variable("out_p", 1, "causality=\"output\"", "")
        + &variable("out_q", 2, "causality=\"output\"", "");
    let token = if version == 2 {
        "guid"
    } else {
        "instantiationToken"
    };
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{version}.0\" \
         modelName=\"stubborn\" {token}=\"stubborn\"><CoSimulation modelIdentifier=\"stubborn\"/>\
         <ModelVariables>{outputs}{parameters}</ModelVariables><ModelStructure/></fmiModelDescription>"
    );
    entries("stubborn", version, text.into_bytes(), options)
}

/// Runs 100 steps with a bias of 2 on a parameter from step 50 on.
fn biased(place: &Place, parameter: &str) -> Run {
    let text = scenario("stubborn", "stubborn.fmu", 100.0, 100.0)
        + &format!(
            "[[faults]]\nkind = \"bias\"\nat_s = 0.5\n[[faults.effects]]\ntarget = \"parameter.{parameter}\"\nbias = 2.0\n"
        );
    place.run(&text, "")
}

fn assert_ends_with(run: &Run, signal: &str, expected: f64) {
    let column = Recording::open(&run.recording()).column(&format!("truth.{signal}"));
    assert_eq!(column.last(), Some(&expected), "{signal}");
}

#[test]
fn a_fault_on_one_parameter_leaves_the_others_unchanged() {
    for version in [2, 3] {
        for will in ["-DBEGINS=4.0", "-DKEPT(value)=((value) == 5 ? 4 : (value))"] {
            let Some(place) = Place::new() else { return };
            place.fmu("stubborn.fmu", &stubborn(version, false, &[will]));
            let run = biased(&place, "q").expect(0).says(&["`p` starts at 5"]);
            assert_ends_with(&run, "out_q", 3.0);
            assert_ends_with(&run, "out_p", 4.0);
            // The parameter itself is still compared.
            let run = biased(&place, "p").expect(0);
            assert_ends_with(&run, "out_p", 7.0);
            assert_ends_with(&run, "out_q", 1.0);
        }
    }
}

#[test]
fn a_fault_on_an_array_element_leaves_the_others_unchanged() {
    let Some(place) = Place::new() else { return };
    place.fmu(
        "stubborn.fmu",
        &stubborn(3, true, &["-DBEGINS=4.0", "-DARRAYS"]),
    );
    let run = biased(&place, "p__2").expect(0);
    assert_ends_with(&run, "out_q", 3.0);
    assert_ends_with(&run, "out_p", 4.0);
}

#[test]
fn a_fault_on_an_unreadable_parameter_is_reported_as_unconfirmed() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        place.fmu(
            "stubborn.fmu",
            &stubborn(version, false, &["-DUNREADABLE=3"]),
        );
        let warning = "plant: warning: parameter `p` was changed, but the change is unconfirmed, because the FMU does not let it be read";
        let run = biased(&place, "p").expect(0);
        assert_eq!(run.stderr.matches(warning).count(), 1, "{}", run.stderr);
        let effect = &run.summary()["faults"][0]["effects"][0];
        assert_eq!(effect["unconfirmed"], true, "{effect}");
        run.prints(&["parameter.p 2 (not confirmed)"]);
        let run = biased(&place, "q").expect(0);
        assert!(!run.stderr.contains("unconfirmed"), "{}", run.stderr);
        let effect = &run.summary()["faults"][0]["effects"][0];
        assert_eq!(effect.get("unconfirmed"), None, "{effect}");
    }
}

#[test]
fn a_change_of_a_parameter_that_cannot_be_read_is_marked_in_its_row() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let unreadable = stubborn(version, false, &["-DUNREADABLE=3"]);
        place.fmu("stubborn.fmu", &unreadable);
        let change = |set: &str| {
            format!("[[changes]]\nat_s = 0.5\n[changes.set]\n{set}.p = 7.0\n{set}.q = 2.0\n")
        };
        let as_plant = scenario("stubborn", "stubborn.fmu", 100.0, 100.0);
        let as_plant = as_plant + &change("plant.parameters");
        let as_controller = "schema = 1\nname = \"fmu\"\n[run]\nduration_s = 1.0\nrate_hz = 100\n\
             [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"stubborn\"\nprogram = \"stubborn.fmu\"\n\
             [[connect]]\nlaw = \"command.out_q\"\nplant = \"command.force_n\"\nfactor = 1.0\n";
        let as_controller = as_controller.to_owned() + &change("controller.stubborn");
        for (text, key) in [
            (as_plant, "plant.parameters.p"),
            (as_controller, "controller.stubborn.p"),
        ] {
            let run = place.run(&text, "").expect(0);
            let row = &run.summary()["changes"][0];
            assert_eq!(row["unconfirmed"], serde_json::json!([key]), "{row}");
            let row = format!("(not confirmed: {key})");
            assert!(run.stdout.contains(&row), "{}", run.stdout);
            let folder = run.folder.display().to_string();
            let page = ["report", &folder, "-o", &format!("{key}.html")];
            place.hil(&page).expect(0);
            let page = place.rig.path(&format!("{key}.html"));
            let page = std::fs::read_to_string(page).expect("a page");
            assert!(page.contains(&row), "{key}");
        }
    }
}

#[test]
fn a_change_counts_where_the_fmu_sets_the_parameter_at_its_start() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        // Whatever was set before, its initialisation gives `p` the value 5.
        let resets = stubborn(version, false, &["-DBEGINS=5.0"]);
        place.fmu("stubborn.fmu", &resets);
        let text = scenario("stubborn", "stubborn.fmu", 100.0, 100.0)
            + "[[changes]]\nat_s = 0.5\n[changes.set]\nplant.parameters.p = 7.0\n";
        let run = place.run(&text, "").expect(0);
        assert_ends_with(&run, "out_p", 7.0);
        // As a value of the start it is not what the FMU has.
        let start =
            scenario("stubborn", "stubborn.fmu", 100.0, 100.0) + "[plant.parameters]\np = 7\n";
        let expected = ["parameter `p` was set to 7, but the FMU has 5"];
        place.run(&start, "").expect(2).says(&expected);
    }
}
