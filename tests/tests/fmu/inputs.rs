//! Inputs of an FMU that no law commands.

use super::{Place, reference};
use crate::support::mcap_reader::Recording;

#[test]
fn inputs_of_an_fmu_are_constants_courses_or_their_start_attributes() {
    let Some(place) = Place::new() else { return };
    place.fmu("feed.fmu", &reference("Feedthrough", 3));
    let base = "schema = 1\nname = \"feed\"\n[run]\nduration_s = 4.0\nrate_hz = 10\n[plant]\nmodel = \"Feedthrough\"\nprogram = \"feed.fmu\"\n\
                [controller]\nlaw = \"hold\"\n";
    let driven = "[plant.inputs]\nInt32_input = 7\nEnumeration_input = \"start\"\n\
                  [[stimuli]]\ntarget = \"plant.Float64_continuous_input\"\nkind = \"ramp\"\nduration_s = 4.0\nend = 8.0\n";
    let run = place.run(&format!("{base}{driven}"), "").expect(0);
    let recording = Recording::open(&run.recording());
    let input = recording.column("input.Float64_continuous_input");
    let output = recording.column("truth.Float64_continuous_output");
    for (step, value) in input.iter().enumerate() {
        assert_eq!(*value, 2.0 * (step as f64 / 10.0), "step {step}");
        // An FMU's output is that of the step before.
        if step > 0 {
            assert_eq!(output[step], input[step - 1], "step {step}");
        }
    }
    assert_eq!(recording.column("truth.Int32_output")[1..], [7.0; 40]);
    // The law `hold` begins with the start attribute, which is 1 for the enumeration.
    let run = place.run(base, "").expect(0);
    let recording = Recording::open(&run.recording());
    assert_eq!(
        recording.column("command.Enumeration_input")[..40],
        [1.0; 40]
    );
    assert_eq!(
        recording.column("command.Float64_continuous_input")[..40],
        [0.0; 40]
    );
    place
        .run(&format!("{base}[plant.inputs]\nInt33_input = 7\n"), "")
        .expect(2)
        .says(&["plant `Feedthrough` has no input `Int33_input`"]);
}
