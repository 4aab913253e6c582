//! Campaigns of programs of their own: the digest of one process, copies that a rebuild does not change, and cases
//! that kill their program.

use std::path::PathBuf;

use super::{STUDY, campaign, digest, json, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::program;

/// A short study with four draws and one variant.
fn short() -> String {
    let study = STUDY.replace("cases = 30", "cases = 4");
    study
        .split("[[variants]]")
        .next()
        .expect("a study")
        .to_owned()
}

/// Plans a campaign with these programs.
fn with_programs(rig: &Rig, name: &str, plant: &str) -> PathBuf {
    let folder = rig.path(name);
    let controller = program("controller-process");
    let path = study(rig, &short());
    campaign(
        rig,
        &[
            "plan",
            text(&path),
            "-o",
            text(&folder),
            "--plant-bin",
            plant,
            "--controller-bin",
            text(&controller),
        ],
    )
    .expect(0);
    folder
}

#[test]
fn programs_of_their_own_have_the_digest_of_one_process() {
    let rig = Rig::new();
    let built_in = planned(&rig, &study(&rig, &short()), "in");
    campaign(&rig, &["run", text(&built_in)]).expect(0);
    let plant = program("plant-process");
    let own = with_programs(&rig, "own", text(&plant));
    campaign(&rig, &["run", text(&own)]).expect(0);
    assert_eq!(digest(&rig, &own), digest(&rig, &built_in));
}

#[test]
fn a_program_that_is_rebuilt_under_a_planned_campaign_changes_nothing() {
    let rig = Rig::new();
    let plant = rig.path("plant");
    std::fs::copy(program("plant-process"), &plant).expect("copied");
    let folder = with_programs(&rig, "own", text(&plant));
    std::fs::remove_file(&plant).expect("removed");
    rig.script("plant", "#!/bin/sh\nexit 9\n");
    campaign(&rig, &["run", text(&folder)]).expect(0);
}

#[test]
fn cases_that_kill_their_program_are_set_aside_by_name_and_the_others_go_on() {
    let rig = Rig::new();
    let plant = program("plant-process");
    // It dies of the job of one case.
    let script = format!(
        "#!/bin/sh\nif [ \"$1\" = --session ] && [ -e '{flag}' ] && grep -q \"$(cat '{flag}')\" \"$2/plant.json\"; then kill -9 $$; fi\nexec '{plant}' \"$@\"\n",
        flag = text(&rig.path("mass")),
        plant = text(&plant)
    );
    let wrapper = rig.script("wrapper", &script);
    let folder = with_programs(&rig, "own", text(&wrapper));
    let shown = campaign(&rig, &["case", text(&folder), "2", "--show"]).expect(0);
    let mass = shown
        .stdout
        .lines()
        .find_map(|line| line.strip_prefix("mass_kg = "));
    let mass = mass
        .and_then(|rest| rest.split(' ').next())
        .expect("a mass")
        .to_owned();
    rig.write("mass", &mass);
    let run = campaign(&rig, &["run", text(&folder), "--json"]).expect(3);
    assert!(run.stderr.contains("case 2 is set aside"), "{}", run.stderr);
    assert!(
        run.stderr.contains("signal 9") || run.stderr.contains("SIGKILL"),
        "{}",
        run.stderr
    );
    let answers = json(&run);
    assert_eq!(answers["lost"], serde_json::json!([2]));
    assert_eq!(
        answers["variants"][0]["passes"]["bounds"],
        serde_json::Value::Null
    );
    // What made it die is mended.
    std::fs::remove_file(rig.path("mass")).expect("removed");
    campaign(&rig, &["run", text(&folder), "--again"]).expect(0);
}
