//! Studies of FMUs: each case has the settings of its own scenario, in the campaign and when it is repeated.

use super::Place;
use super::start::{outputs, starts, starts_scenario};
use crate::support::mcap_reader::Recording;

#[test]
fn each_case_of_a_study_has_the_settings_of_its_own_scenario() {
    let Some(place) = Place::new() else { return };
    place.fmu("starts.fmu", &starts(3, ""));
    std::fs::create_dir(place.rig.path("data")).expect("a folder");
    place.rig.write("data/table.csv", "12345");
    let settings = "tolerance = 1e-6\nstart_time_s = 5\n[plant.texts]\nname = \"seven b\"\n\
                    [plant.files]\ntable = \"data/table.csv\"\n";
    (place.rig).write("scenario.toml", &starts_scenario(settings));
    place.rig.write(
        "study.toml",
        "schema = 1\nscenario = \"scenario.toml\"\nseed = 1\nsampling = \"grid\"\n\
         [[vary]]\nkey = \"plant.initial.body.x\"\nkind = \"list\"\nvalues = [1, 2]\n\
         [[variants]]\nname = \"fine\"\n\
         [[variants]]\nname = \"coarse\"\nset = [\"plant.tolerance=1e-2\", \"plant.texts.name=abc\"]\n",
    );
    let plan = ["campaign", "plan", "study.toml", "-o", "campaign"];
    place.hil(&plan).expect(0);
    // The folder of the campaign is self-contained.
    std::fs::remove_dir_all(place.rig.path("data")).expect("it is ours");
    let run = ["campaign", "run", "campaign", "--jobs", "1"];
    place.hil(&run).expect(0);
    for case in 0..4 {
        let (case_text, out) = (case.to_string(), format!("case-{case}"));
        // Its digest equals that of the campaign.
        let again = place
            .hil(&["campaign", "case", "campaign", &case_text, "--out", &out])
            .expect(0);
        let folder = place.rig.path(&out);
        let again = crate::support::harness::Run { folder, ..again };
        let (tolerance, length) = if case % 2 == 0 {
            (1e-6, 7.0)
        } else {
            (1e-2, 3.0)
        };
        let values = outputs(&again);
        let expected = [tolerance, 5.0, length, 5.0];
        assert_eq!([values[0], values[1], values[4], values[5]], expected);
        let x = Recording::open(&again.recording()).column("truth.body_x");
        assert_eq!(x[0], f64::from(1 + case / 2), "case {case}");
    }
}
