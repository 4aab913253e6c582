//! Inputs that no law commands, of a plant in C.

use crate::foreign::{CLEAN, compiled, has};
use crate::support::harness::Rig;
use crate::support::programs::program_of_tests;

#[test]
fn a_plant_in_c_declares_starts_and_has_the_digest_of_its_twin_in_rust() {
    if !has("cc") {
        return;
    }
    let rig = Rig::new();
    let in_c = compiled(&rig, "cc", "tests/tests/foreign/room.c", "room", CLEAN);
    let in_rust = program_of_tests("heated-room");
    let base = "schema = 1\nname = \"room\"\n[run]\nduration_s = 1.0\nrate_hz = 1000\n[plant]\nmodel = \"heated-room\"\n\
                [controller]\nlaw = \"hold\"\n";
    let square = "[[stimuli]]\ntarget = \"plant.heating_w\"\nkind = \"square\"\namplitude = 50.0\nfrequency_hz = 10.0\n";
    for more in ["", "[plant.inputs]\nambient_k = \"start\"\n", square] {
        let scenario = rig.write("room.toml", &format!("{base}{more}"));
        let [one, other] = [&in_c, &in_rust].map(|plant| {
            let line = format!("{} --plant-bin {}", scenario.display(), plant.display());
            rig.run(&line).expect(0).digest()
        });
        assert_eq!(one, other, "{more}");
    }
    let scenario = rig.write(
        "room.toml",
        &format!("{base}[plant.inputs]\nheating_w = \"start\"\n"),
    );
    rig.run(&format!(
        "{} --plant-bin {}",
        scenario.display(),
        in_c.display()
    ))
    .expect(2)
    .says(&["plant `heated-room` declares no start for `heating_w`"]);
}
