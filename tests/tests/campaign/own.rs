//! Campaigns of user programs: the digest of a single process, copies that a rebuild does not change, and cases
//! that kill their program.

use std::path::{Path, PathBuf};

use super::{Planned, STUDY, campaign, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{program, program_of_tests};

/// Returns a short study with four draws and one variant.
fn short() -> String {
    let study = STUDY.replace("cases = 30", "cases = 4");
    study
        .split("[[variants]]")
        .next()
        .expect("a study")
        .to_owned()
}

/// Returns a study with twelve cases of the plant `case-plant`, at the positions 0 to 11.
fn twelve(rig: &Rig, model: &str, more: &str) -> PathBuf {
    rig.scenario(0.01, model, "hold");
    let study = format!(
        "schema = 1\nscenario = \"scenario.toml\"\nseed = 1\nsampling = \"grid\"\n{more}\n\
         [[vary]]\nkey = \"plant.parameters.position_m\"\nkind = \"list\"\n\
         values = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]\n"
    );
    rig.write("twelve.toml", &study)
}

/// Plans a campaign with these programs.
fn with_programs<'r>(rig: &'r Rig, name: &str, plant: &str) -> Planned<'r> {
    let study = study(rig, &format!("fresh_processes = true\n{}", short()));
    with_plant(rig, name, &study, plant)
}

fn with_plant<'r>(rig: &'r Rig, name: &str, study: &Path, plant: &str) -> Planned<'r> {
    let folder = rig.path(name);
    let controller = program("controller-process");
    let plan = ["plan", text(study), "-o", text(&folder)];
    let programs = ["--plant-bin", plant, "--controller-bin", text(&controller)];
    campaign(rig, &[plan, programs].concat()).expect(0);
    Planned { rig, folder }
}

#[test]
fn user_programs_give_the_digest_of_one_process() {
    let rig = Rig::new();
    let built_in = planned(&rig, &study(&rig, &short()), "in");
    built_in.on("run").expect(0);
    let plant = program("plant-process");
    let kept = with_plant(&rig, "kept", &study(&rig, &short()), text(&plant));
    let fresh = with_programs(&rig, "fresh", text(&plant));
    let envelopes = super::page::data(&rig, &built_in)["envelopes"].clone();
    assert!(envelopes.is_object(), "{envelopes}");
    for own in [kept, fresh] {
        own.on("run").expect(0);
        assert_eq!(own.digest(), built_in.digest());
        assert_eq!(super::page::data(&rig, &own)["envelopes"], envelopes);
    }
    assert!(rig.processes().is_empty(), "{:?}", rig.processes());
}

#[test]
fn processes_are_reused_between_cases_unless_the_study_says_otherwise() {
    let rig = Rig::new();
    let script = format!(
        "#!/bin/sh\ncase \"$1\" in --session) echo >> '{}';; esac\nexec '{}' \"$@\"\n",
        text(&rig.path("starts")),
        text(&program_of_tests("case-plant"))
    );
    let plant = rig.script("counted", &script);
    // One start for all cases, and one for each case repeated as a check: the second, fourth, seventh and twelfth.
    for (name, more, starts) in [("kept", "", 5), ("fresh", "fresh_processes = true", 12)] {
        let folder = with_plant(&rig, name, &twelve(&rig, "behaves", more), text(&plant));
        rig.write("starts", "");
        folder.on("run --jobs 1").expect(0);
        let counted = std::fs::read_to_string(rig.path("starts")).expect("written");
        assert_eq!(counted.lines().count(), starts, "{name}");
    }
}

#[test]
fn a_plant_with_state_leaking_between_cases_is_detected_and_named() {
    let rig = Rig::new();
    let plant = program_of_tests("case-plant");
    let kept = with_plant(&rig, "kept", &twelve(&rig, "leaks", ""), text(&plant));
    kept.on("run --jobs 1").expect(1).says(&[
        "case 1: digest is",
        "in new ones",
        "fresh_processes = true",
    ]);
    // The first case ran in new processes; the second was never counted.
    let status = kept.on("status --json").expect(1);
    let status = status.json();
    assert_eq!(
        (&status["published"], &status["begun"]),
        (&1.into(), &0.into())
    );
    assert_eq!(status["conflicts"][0]["case"], 1);
    let study = twelve(&rig, "leaks", "fresh_processes = true");
    let fresh = with_plant(&rig, "fresh", &study, text(&plant));
    fresh.on("run --jobs 1").expect(0);
}

#[test]
fn a_case_that_kills_persistent_processes_is_set_aside_and_the_others_complete() {
    let rig = Rig::new();
    let plant = program_of_tests("case-plant");
    let study = twelve(&rig, "dies", "");
    let folder = with_plant(&rig, "kept", &study, text(&plant));
    let run = folder
        .on("run --json")
        .expect(3)
        .says(&["case 3 is set aside", "plant was killed by SIGABRT"]);
    let answers = run.json();
    assert_eq!(answers["lost"], serde_json::json!([3]));
    assert_eq!(
        answers["variants"][0]["classes"],
        serde_json::json!([11, 0, 0, 0, 1, 0, 0])
    );
    assert!(rig.processes().is_empty(), "{:?}", rig.processes());
}

#[test]
fn a_hanging_plant_is_ended_by_the_wait_limit_and_its_case_retried() {
    let rig = Rig::new();
    let flag = rig.path("flag");
    let script = format!(
        "#!/bin/sh\nCASE_PLANT_HANGS='{}' exec '{}' \"$@\"\n",
        text(&flag),
        text(&program_of_tests("case-plant"))
    );
    let plant = rig.script("hanging", &script);
    let folder = with_plant(&rig, "kept", &twelve(&rig, "hangs", ""), text(&plant));
    rig.write("flag", "");
    let run = folder.on("run --jobs 1 --json").expect(0);
    assert!(!flag.exists(), "no case hung");
    assert_eq!(
        run.json()["variants"][0]["classes"],
        serde_json::json!([12, 0, 0, 0, 0, 0, 0])
    );
    assert!(rig.processes().is_empty(), "{:?}", rig.processes());
}

/// Plant that dies in a case once for each line of a file, and records each of its starts in another.
fn mortal(rig: &Rig) -> PathBuf {
    let script = format!(
        "#!/bin/sh\ncase \"$1\" in --session) echo >> '{}';; esac\nCASE_PLANT_DIES='{}' exec '{}' \"$@\"\n",
        text(&rig.path("starts")),
        text(&rig.path("deaths")),
        text(&program_of_tests("case-plant"))
    );
    rig.script("mortal", &script)
}

#[test]
fn a_death_between_two_cases_does_not_count_as_an_attempt_of_the_next() {
    let rig = Rig::new();
    let plant = mortal(&rig);
    let study = twelve(&rig, "stumbles", "");
    // Two deaths in the case itself leave it its third attempt; three do not.
    for (deaths, code, classes) in [
        (2, 0, [12, 0, 0, 0, 0, 0, 0]),
        (3, 3, [11, 0, 0, 0, 1, 0, 0]),
    ] {
        let folder = with_plant(&rig, &format!("kept{deaths}"), &study, text(&plant));
        rig.write("deaths", &"once more\n".repeat(deaths));
        let run = folder.on("run --jobs 1 --json").expect(code);
        assert!(run.stderr.contains("between two runs: "), "{}", run.stderr);
        let answers = run.json();
        assert_eq!(
            answers["variants"][0]["classes"],
            serde_json::json!(classes)
        );
        let left = std::fs::read_to_string(rig.path("deaths")).expect("a file");
        assert_eq!(left, "");
    }
    assert!(rig.processes().is_empty(), "{:?}", rig.processes());
}

#[test]
fn a_retried_case_runs_without_the_others_of_its_shard() {
    let rig = Rig::new();
    let plant = mortal(&rig);
    let twelve = std::fs::read_to_string(twelve(&rig, "mortal", "")).expect("a study");
    // Enough cases that a shard has three.
    let all: Vec<String> = (0..130).map(|case| case.to_string()).collect();
    let study = twelve.replace(
        "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]",
        &format!("[{}]", all.join(", ")),
    );
    let study = rig.write("study.toml", &study);
    let folder = with_plant(&rig, "kept", &study, text(&plant));
    // The first death precedes the first record of a persistent pair, and does not count as an attempt of the case.
    rig.write("deaths", &"once more\n".repeat(4));
    folder
        .on("run --jobs 1")
        .expect(3)
        .says(&["case 3 is set aside"]);
    rig.write("starts", "");
    folder
        .on("run --jobs 1 --again")
        .expect(0)
        .says(&["retrying 1 case"]);
    // A second case would have been repeated in new processes.
    let starts = std::fs::read_to_string(rig.path("starts")).expect("written");
    assert_eq!(starts.lines().count(), 1);
    let whole = with_plant(&rig, "whole", &study, text(&plant));
    whole.on("run").expect(0);
    assert_eq!(folder.digest(), whole.digest());
}

#[test]
fn rebuilding_a_program_does_not_affect_a_planned_campaign() {
    let rig = Rig::new();
    let plant = rig.path("plant");
    std::fs::copy(program("plant-process"), &plant).expect("copied");
    let folder = with_programs(&rig, "own", text(&plant));
    std::fs::remove_file(&plant).expect("removed");
    rig.script("plant", "#!/bin/sh\nexit 9\n");
    folder.on("run").expect(0);
}

#[test]
fn cases_that_kill_their_program_are_set_aside_by_name_and_the_others_continue() {
    let rig = Rig::new();
    let plant = program("plant-process");
    // It dies from the job of one case.
    let script = format!(
        "#!/bin/sh\nif [ \"$1\" = --session ] && [ -e '{flag}' ] && grep -q \"$(cat '{flag}')\" \"$2/plant.json\"; then kill -9 $$; fi\nexec '{plant}' \"$@\"\n",
        flag = text(&rig.path("mass")),
        plant = text(&plant)
    );
    let wrapper = rig.script("wrapper", &script);
    let folder = with_programs(&rig, "own", text(&wrapper));
    let view = folder.on("case 2 --show").expect(0);
    let mass = view
        .stdout
        .lines()
        .find_map(|line| line.strip_prefix("mass_kg = "));
    let mass = mass
        .and_then(|rest| rest.split(' ').next())
        .expect("a mass")
        .to_owned();
    rig.write("mass", &mass);
    let run = folder.on("run --json").expect(3);
    assert!(run.stderr.contains("case 2 is set aside"), "{}", run.stderr);
    assert!(
        run.stderr.contains("signal 9") || run.stderr.contains("SIGKILL"),
        "{}",
        run.stderr
    );
    let answers = run.json();
    assert_eq!(answers["lost"], serde_json::json!([2]));
    assert_eq!(
        answers["variants"][0]["passes"]["bounds"],
        serde_json::Value::Null
    );
    // The cause of death is fixed.
    std::fs::remove_file(rig.path("mass")).expect("removed");
    folder.on("run --again").expect(0);
}
