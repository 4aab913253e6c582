//! Slips in model descriptions that are no reason to refuse an FMU: the variable is left out and listed.

use super::tuning::stubborn;
use super::{Place, scenario, with};
use crate::support::mcap_reader::Recording;

/// The FMU with another model description.
fn described(place: &Place, version: u32, change: impl FnOnce(String) -> String) {
    let entries = with(stubborn(version, false, &[]), ".xml", |bytes| {
        change(String::from_utf8(bytes).expect("text")).into_bytes()
    });
    place.fmu("stubborn.fmu", &entries);
}

#[test]
fn an_inner_variable_that_is_unusable_is_left_out_and_the_fmu_runs() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        let inner = |head: &str, is_known: bool| match (version, is_known) {
            (2, true) => format!("<ScalarVariable {head}><Real/></ScalarVariable>"),
            (2, false) => format!("<ScalarVariable {head}><Complex/></ScalarVariable>"),
            (_, true) => format!("<Float64 {head}/>"),
            (_, false) => format!("<Complex {head}/>"),
        };
        let slips = inner("name=\"a\" causality=\"local\"", true)
            + &inner("name=\"b\" valueReference=\"-1\"", true)
            + &inner("name=\"c\" valueReference=\"4294967296\"", true)
            + &inner("name=\"d\" valueReference=\"1\"", false)
            + &inner("name=\"e\" valueReference=\"9\" causality=\"inner\"", true)
            + &inner("name=\"f\" valueReference=\"1\"", true)
            + &inner("name=\"f\" valueReference=\"2\"", true);
        described(&place, version, |text| {
            text.replace("</ModelVariables>", &format!("{slips}</ModelVariables>"))
        });
        let described = place.hil(&["describe", "stubborn.fmu"]).expect(0).stdout;
        for line in [
            "  a: `valueReference` of",
            "  b: `valueReference` of",
            "  c: `valueReference` of",
            "  d: `type` of",
            "  e: `causality` of",
            "  f: another variable has its name",
        ] {
            let mut lines = described.lines();
            assert!(
                lines.any(|one| one.starts_with(line)),
                "{line}: {described}"
            );
        }
        // `f` is the first output, and no name of the second.
        assert!(described.contains("Also f."), "{described}");
        let text = scenario("stubborn", "stubborn.fmu", 100.0, 10.0);
        let run = place.run(&text, "").expect(0);
        let out_p = Recording::open(&run.recording()).column("truth.out_p");
        assert_eq!(out_p.last(), Some(&5.0));
    }
}

#[test]
fn a_parameter_without_a_start_value_is_set_as_an_initial_value() {
    for version in [2, 3] {
        let Some(place) = Place::new() else { return };
        described(&place, version, |text| text.replace("start=\"1\"", ""));
        let describe = place.hil(&["describe", "stubborn.fmu"]).expect(0);
        describe.prints(&["q: it is a parameter without a start value; `initial` sets it"]);
        let text = scenario("stubborn", "stubborn.fmu", 100.0, 10.0);
        for (initial, expected) in [("", 0.0), ("[plant.initial]\nq = 3.5\n", 3.5)] {
            let run = place.run(&(text.clone() + initial), "").expect(0);
            let out_q = Recording::open(&run.recording()).column("truth.out_q");
            assert_eq!(out_q.last(), Some(&expected), "{initial}");
        }
        // One that the FMU does not take is refused as that of any parameter.
        let stubborn = with(
            stubborn(
                version,
                false,
                &["-DKEPT(value)=((value) > 5 ? 5 : (value))"],
            ),
            ".xml",
            |bytes| {
                let text = String::from_utf8(bytes).expect("text");
                text.replace("start=\"1\"", "").into_bytes()
            },
        );
        place.fmu("stubborn.fmu", &stubborn);
        let seven = text + "[plant.initial]\nq = 7\n";
        let refused = place.run(&seven, "").expect(2);
        refused.says(&["parameter `q` was set to 7, but the FMU has 5"]);
    }
}
