//! An FMU that takes over as controller: its start settings from the scenario and the flags of the swap.

use super::Place;
use crate::support::fmus::entries;
use crate::support::mcap_reader::Recording;
use crate::support::programs::program;

/// Law whose force equals its tolerance setting, in `tests/fmus/starts.c`.
const LAW: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"3.0\" modelName=\"starts\" \
    instantiationToken=\"starts\"><CoSimulation modelIdentifier=\"starts\"/><ModelVariables>\
    <Float64 name=\"force_n\" valueReference=\"1\" causality=\"output\" unit=\"N\"/>\
    <Float64 name=\"body.x\" valueReference=\"7\" causality=\"local\" initial=\"exact\" start=\"0\"/>\
    <Float64 name=\"position_m\" valueReference=\"8\" causality=\"input\" unit=\"m\" start=\"0\"/>\
    </ModelVariables><ModelStructure><Output valueReference=\"1\"/></ModelStructure></fmiModelDescription>";

#[test]
fn an_fmu_that_takes_over_has_the_settings_of_the_scenario_and_of_the_swap() {
    let Some(place) = Place::new() else { return };
    let law = entries("starts", 3, LAW.as_bytes().to_vec(), &[]);
    let law = place.fmu("law.fmu", &law);
    let text = "schema = 1\nname = \"takeover\"\n[run]\nduration_s = 3.0\nrate_hz = 1000\n\
                [plant]\nmodel = \"spring-mass\"\n[controller]\nlaw = \"starts\"\nprogram = \"law.fmu\"\n\
                tolerance = 0.25\n[controller.initial]\nbody.x = 1\n";
    let scenario = place.rig.write("scenario.toml", text);
    let arguments = format!("{} --pause-at 2.5 --wait-limit 60", scenario.display());
    let running = place.rig.start_with(place.command(), &arguments);
    place.rig.until_held_at(2500);
    let swap = |arguments: &[&str]| {
        let session = ["--session", place.rig.session()];
        (place.rig).beside(&[&["controller", "swap"], arguments, &session].concat())
    };
    let law = law.to_str().expect("text");
    let swapped = swap(&["--bin", law]).expect(0).stdout;
    assert!(!swapped.contains("left out"), "{swapped}");
    place.rig.in_session("step 10").expect(0);
    swap(&["--set", "controller.tolerance=0.5"]).expect(0);
    place.rig.in_session("step 10").expect(0);
    let native = program("controller-process");
    let native = [
        "--bin",
        native.to_str().expect("text"),
        "--set",
        "controller.law=hold",
    ];
    let refused = [&native[..], &["--set", "controller.tolerance=0.1"]].concat();
    (swap(&refused).expect(2)).says(&["has no effect, because"]);
    let swapped = swap(&native).expect(0).stdout;
    let left_out =
        "left out, because none of its laws has them: controller.tolerance, controller.initial\n";
    assert!(swapped.contains(left_out), "{swapped}");
    place.rig.in_session("resume").expect(0);
    let run = running.finish().expect(0);
    let force_n = Recording::open(&run.recording()).column("command.force_n");
    assert!(
        force_n[..2510]
            .iter()
            .skip(1)
            .all(|force_n| *force_n == 0.25)
    );
    assert!(force_n[2511..2520].iter().all(|force_n| *force_n == 0.5));
}
