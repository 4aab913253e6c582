//! Parameters changed while an FMU runs: the others keep their values, and an unreadable value is reported.

use super::{Place, scenario};
use crate::support::fmus::{Entries, entries};
use crate::support::harness::Run;
use crate::support::mcap_reader::Recording;

/// Describes `tests/fmus/stubborn.c`, with the parameters as scalars or as one array of FMI 3.
fn stubborn(version: u32, is_array: bool, options: &[&str]) -> Entries {
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
        let warning = "plant: warning: parameter `p` was changed, and the change is not confirmed: the FMU does not let it be read";
        let run = biased(&place, "p").expect(0);
        assert_eq!(run.stderr.matches(warning).count(), 1, "{}", run.stderr);
        let run = biased(&place, "q").expect(0);
        assert!(!run.stderr.contains("not confirmed"), "{}", run.stderr);
    }
}
