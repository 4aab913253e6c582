//! Mistakes in a study or a folder: reported with their location, without any loss.

use super::{Planned, STUDY, campaign, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::shipped;

#[test]
fn a_mistake_in_a_study_is_reported_at_its_location_with_the_nearest_name() {
    let rig = Rig::new();
    #[rustfmt::skip] // a table
    let rows = [
        ("cases = 30", "casse = 30", vec!["nearest: `cases`", "demo.toml:4:1"]),
        ("SCENARIO", "nowhere.toml", vec!["the scenario cannot be read", "nowhere.toml"]),
        (
            "key = \"plant.parameters.mass_kg\"",
            "name = \"mass_kg\"\nkey = \"plant.parameters.mas_kg\"",
            vec![
                "nearest: `mass_kg`",
                "demo.toml:10:7",
                "a case has plant.parameters.mas_kg=",
            ],
        ),
        (
            "mean = 1.0\ndeviation = 0.3\nmin = 0.2",
            "mean = -5.0\ndeviation = 0.3\nmin = -9.0",
            vec![
                "`plant.parameters.mass_kg` is -",
                "out of range",
                "demo.toml:9:7",
            ],
        ),
        ("set = [\"controller.law=hold\"]", "set = [\"controller.law=holt\"]", vec!["nearest: `hold`", "a case has controller.law=holt"]),
        ("set = [\"plant.substeps=4\"]", "set = [\"run.clock=paced\"]", vec!["run.clock = \"paced\"", "lockstep"]),
        (
            "set = [\"plant.substeps=4\"]",
            "set = [\"plant.parameters.mass_kg=3\"]",
            vec![
                "`plant.parameters.mass_kg` is already set by this study",
                "demo.toml:9:7",
            ],
        ),
        (
            "expression = \"sqrt(stiffness_n_per_m / mass_kg)\"",
            "expression = \"sqrt(stifness / mass_kg)\"",
            vec!["unknown value `stifness`", "demo.toml:25"],
        ),
        (
            "[[variants]]\nname = \"hold\"",
            "[[goals]]\nrequirement = \"setles\"\nprobability = 0.5\n\n[[variants]]\nname = \"hold\"",
            vec![
                "no requirement `setles`",
                "its requirements: settles",
                "demo.toml:31:15",
            ],
        ),
        ("[[variants]]\nname = \"hold\"", "[[variants]]\nname = \"pid\"", vec!["no name twice"]),
    ];
    for (from, to, expected) in rows {
        let wrong = STUDY.replace(from, to);
        assert_ne!(wrong, STUDY, "{from}");
        let path = study(&rig, &wrong);
        campaign(&rig, &["check", text(&path)])
            .expect(2)
            .says(&expected);
    }
}

#[test]
fn a_variation_that_changes_nothing_is_refused() {
    let rig = Rig::new();
    // Both variants are affected: the gains of the inactive law change nothing.
    let idle = STUDY
        .replace("[[variants]]\nname = \"pid\"\n", "")
        .replace("[[variants]]", "[[vary]]\nkey = \"controller.pid.proportional_n_per_m\"\nkind = \"uniform\"\nmin = 1\nmax = 2\n\n[[variants]]");
    let path = study(&rig, &idle);
    campaign(&rig, &["check", text(&path)])
        .expect(2)
        .says(&["`controller.pid.proportional_n_per_m` has no effect in the scenario that runs"]);
}

#[test]
fn a_folder_of_another_campaign_or_of_anything_else_is_refused() {
    let rig = Rig::new();
    let path = study(&rig, STUDY);
    let folder = planned(&rig, &path, "demo");
    let plan = |path| campaign(&rig, &["plan", text(path), "-o", text(&folder)]).expect(2);
    plan(&path).says(&["already holds this campaign; hil campaign run"]);
    let other = study(&rig, &STUDY.replace("seed = 3", "seed = 4"));
    plan(&other).says(&["holds another campaign, which differs in study: "]);
    std::fs::create_dir(rig.path("own")).expect("a folder");
    let own = rig.write("own/notes.txt", "mine");
    let run = campaign(
        &rig,
        &[
            "plan",
            text(&path),
            "-o",
            text(own.parent().expect("a folder")),
        ],
    );
    run.expect(2).says(&["is not empty"]);
    campaign(&rig, &["run", text(&rig.path("own"))])
        .expect(2)
        .says(&["is not a campaign folder", "hil campaign plan"]);
    std::fs::write(folder.join("scenario.toml"), "schema = 1").expect("written");
    folder
        .on("run")
        .expect(2)
        .says(&["scenario.toml has hash", "the campaign was planned with"]);
}

#[test]
fn the_folder_contains_copies_of_all_inputs() {
    let rig = Rig::new();
    rig.write("points.csv", "time_s,value\n0,0\n1,0.01\n3,0.02\n");
    let scenario = shipped("scenarios/spring-mass.toml");
    // The step of the reference comes from a table of points.
    let (before, after) = scenario.split_once("kind = \"step\"").expect("a step");
    let after = after.split_once("\n\n").expect("more").1;
    let table = format!("{before}kind = \"table\"\nfile = \"points.csv\"\n\n{after}");
    let own = rig.write("own.toml", &table);
    let path = study(
        &rig,
        &STUDY
            .replace("SCENARIO", text(&own))
            .replace("plant.substeps=4", "metrics=[]"),
    );
    let one = planned(&rig, &path, "one");
    let two = planned(&rig, &path, "two");
    one.on("run").expect(0);
    // The original files are removed.
    for path in [&own, &path, &rig.path("points.csv")] {
        std::fs::remove_file(path).expect("removed");
    }
    two.on("run").expect(0);
    assert_eq!(one.digest(), two.digest());
}

#[test]
fn an_unwritable_folder_is_an_error_and_nothing_is_lost() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    demo.on("work --shards 0").expect(0);
    // A file in the way blocks even users whom no mode blocks.
    let shard = demo.join("shards/00000001");
    std::fs::write(&shard, "").expect("written");
    demo.on("run")
        .expect(3)
        .says(&["cannot work on", "existing results are kept"]);
    std::fs::remove_file(&shard).expect("removed");
    demo.on("run").expect(0);
}

#[test]
fn unwritable_tables_point_to_the_command_that_writes_none() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    // A folder in the way blocks even users whom no mode blocks.
    let results = demo.join("results.parquet");
    std::fs::remove_file(&results).expect("removed");
    std::fs::create_dir(&results).expect("a folder");
    for verb in ["run", "collect"] {
        let expected = format!("hil campaign show {} reads them", text(&demo));
        demo.on(verb)
            .expect(3)
            .says(&["cannot join the results", &expected]);
    }
    demo.on("show").expect(0);
}

#[test]
fn wrong_arguments_are_refused_with_the_reason() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    #[rustfmt::skip] // a table
    let cases = [
        (vec!["case", text(&demo), "60"], "there is no case 60; the campaign has 60, counted from 0"),
        (vec!["work", text(&demo), "--shards", "x"], "expected numbers and ranges, for example 0-9,12"),
        (vec!["work", text(&demo), "--shards", "1000"], "there is no shard 1000"),
        (vec!["work", text(&demo), "--task", "3/3"], "for example 0/16"),
    ];
    for (arguments, expected) in cases {
        campaign(&rig, &arguments).expect(2).says(&[expected]);
    }
}

#[test]
fn workers_that_exit_normally_without_results_are_an_error_and_not_restarted_forever() {
    for code in [0, 1] {
        let rig = Rig::new();
        let demo = Planned::demo(&rig);
        demo.on("work --shards 0").expect(0);
        let (hil, manifest) = (demo.join("programs/hil"), demo.join("manifest.json"));
        let real = std::fs::read(&hil).expect("a program");
        let planned = std::fs::read_to_string(&manifest).expect("a manifest");
        let idle = format!("#!/bin/sh\nexit {code}\n");
        std::fs::write(&hil, &idle).expect("written");
        let mut other: serde_json::Value = serde_json::from_str(&planned).expect("JSON");
        other["hil"]["blake3"] = blake3::hash(idle.as_bytes()).to_hex().to_string().into();
        other.as_object_mut().expect("an object").remove("blake3");
        std::fs::write(&manifest, other.to_string()).expect("written");
        demo.on("run").expect(3).says(&[
            "computed nothing",
            "programs/hil",
            "existing results are kept",
        ]);
        std::fs::write(&hil, real).expect("written");
        std::fs::write(&manifest, planned).expect("written");
        demo.on("run").expect(0);
    }
}
