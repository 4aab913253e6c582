//! Damaged or incomplete folders, and full disks: each is reported, with advice.

use super::{Planned, STUDY, campaign, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{program, skip, works};

#[test]
fn a_damaged_table_of_results_is_named_with_the_command_to_rewrite_it() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let expected = demo.digest();
    let mend = format!("hil campaign collect {} rewrites it", text(&demo));
    for name in ["results.parquet", "circumstances.parquet"] {
        let table = demo.join(name);
        let whole = std::fs::read(&table).expect("a table");
        let middle = whole.len() / 2;
        let mut flipped = whole.clone();
        flipped[middle] ^= 1;
        for damaged in [&flipped[..], &whole[..middle], b""] {
            std::fs::write(&table, damaged).expect("written");
            let run = demo
                .on("show")
                .expect(3)
                .says(&[&format!("{name} is damaged"), &mend]);
            // The answers come from the shards, which are intact.
            assert!(run.stdout.contains(&expected), "{}", run.stdout);
        }
        demo.on("collect").expect(0);
        let run = demo.on("show").expect(0);
        assert!(!run.stderr.contains("parquet"), "{}", run.stderr);
    }
    // A missing table is not damage.
    std::fs::remove_file(demo.join("results.parquet")).expect("removed");
    demo.on("show").expect(0);
}

#[test]
fn a_damaged_manifest_is_named_and_loses_no_result() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let expected = demo.digest();
    let manifest = demo.join("manifest.json");
    let whole = std::fs::read_to_string(&manifest).expect("a manifest");
    let damaged = whole.replacen("\"schema\": 1", "\"schema\": 2", 1);
    assert_ne!(damaged, whole);
    std::fs::write(&manifest, damaged).expect("written");
    for verb in ["collect", "run", "show", "status"] {
        demo.on(verb).expect(3).says(&["manifest.json is damaged"]);
    }
    std::fs::write(&manifest, whole).expect("written");
    assert_eq!(demo.digest(), expected);
}

#[test]
fn an_outdated_table_is_named() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    demo.on("work --shards 0-3").expect(0);
    demo.on("collect --partial").expect(3);
    demo.on("work").expect(0);
    demo.on("show").expect(0).says(&[
        "results.parquet is older than the latest results",
        "hil campaign collect",
    ]);
}

#[test]
fn a_changed_study_is_refused_wherever_its_goals_matter() {
    let rig = Rig::new();
    let goal = format!("{STUDY}\n[[goals]]\nvariant = \"pid\"\nprobability = 0.99\n");
    let folder = planned(&rig, &study(&rig, &goal), "demo");
    folder.on("run").expect(1);
    let study = folder.join("study.toml");
    let planned = std::fs::read_to_string(&study).expect("a study");
    std::fs::write(&study, planned.replace("0.99", "0.5")).expect("written");
    let (page, path) = (rig.path("page.html"), text(&folder));
    for arguments in [
        vec!["campaign", "show", path],
        vec!["report", path, "-o", text(&page)],
    ] {
        let plan = format!("hil campaign plan {} -o OTHER", text(&study));
        rig.hil(&arguments)
            .expect(2)
            .says(&["study.toml has hash", "Restore it, or plan", &plan]);
    }
    std::fs::write(&study, planned).expect("written");
    campaign(&rig, &["show", path]).expect(1);
}

#[test]
fn a_missing_study_is_named_as_missing() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    std::fs::remove_file(demo.join("study.toml")).expect("removed");
    let run = demo.on("show").expect(2).says(&[
        "study.toml: No such file",
        "Restore the study",
        "BLAKE3",
    ]);
    assert!(!run.stderr.contains("campaign plan"), "{}", run.stderr);
}

#[test]
fn a_changed_or_removed_scenario_is_named_and_answers_are_unaffected() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let expected = demo.digest();
    let scenario = demo.join("scenario.toml");
    let planned = std::fs::read_to_string(&scenario).expect("a scenario");
    std::fs::write(&scenario, format!("{planned}# edited\n")).expect("written");
    let show = || demo.on("show");
    let run = show()
        .expect(3)
        .says(&["scenario.toml has hash", "as planned"]);
    assert!(run.stdout.contains(&expected), "{}", run.stdout);
    std::fs::remove_file(&scenario).expect("removed");
    show().expect(3).says(&["scenario.toml: No such file"]);
    std::fs::write(&scenario, planned).expect("written");
    show().expect(0);
}

#[test]
fn a_truncated_foreign_or_missing_table_of_cases_is_named_and_rewritten() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    let other = STUDY.replace("seed = 3", "seed = 4");
    let other = planned(&rig, &study(&rig, &other), "other");
    demo.on("run").expect(0);
    let table = demo.join("cases.parquet");
    let whole = std::fs::read(&table).expect("a table");
    let foreign = std::fs::read(other.join("cases.parquet")).expect("a table");
    for (bytes, why) in [
        (Some(&whole[..whole.len() / 2]), "cases.parquet is damaged"),
        (
            Some(&foreign[..]),
            "cases.parquet belongs to another campaign",
        ),
        (None, "cases.parquet is missing"),
    ] {
        match bytes {
            Some(bytes) => std::fs::write(&table, bytes).expect("written"),
            None => std::fs::remove_file(&table).expect("removed"),
        }
        let anew = format!("hil campaign collect {} rewrites it", text(&demo));
        demo.on("show").expect(3).says(&[why, &anew]);
        demo.on("case 3 --show").expect(2).says(&[why]);
        demo.on("collect")
            .expect(0)
            .says(&[why, "it will be rewritten"]);
        assert_eq!(std::fs::read(&table).expect("a table"), whole);
        demo.on("show").expect(0);
    }
}

#[test]
fn the_cases_of_a_damaged_shard_are_not_published() {
    let rig = Rig::new();
    let demo = Planned::completed(&rig);
    let status = || demo.on("status --json");
    let before = status().expect(0).json();
    let part = demo.join("shards/00000001/part.parquet");
    let mut bytes = std::fs::read(&part).expect("a part");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&part, bytes).expect("written");
    let after = status().expect(3).json();
    assert_eq!(before["published"], 60, "{before}");
    let (published, missing) = (&after["published"], &after["missing"]);
    assert_eq!(
        published.as_u64().zip(missing.as_u64()).map(|(a, b)| a + b),
        Some(60)
    );
    assert_ne!(*missing, 0, "{after}");
    assert_eq!(after["shards_damaged"]["1"], "its checksum does not match");
    demo.on("status")
        .expect(3)
        .prints(&["shard 1: its checksum does not match", "hil campaign run"]);
    demo.on("run").expect(0);
    assert_eq!(status().expect(0).json()["published"], 60);
}

#[test]
fn a_full_disk_is_named_and_does_not_count_as_an_interruption() {
    if !works(&["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]) {
        return skip("this user may not mount anything", "HIL_TEST_UNSHARE");
    }
    let rig = Rig::new();
    let study = study(&rig, STUDY);
    let room = rig.path("room");
    std::fs::create_dir(&room).expect("a folder");
    // The space left after planning suffices for some claims of shards, but not for their rows.
    let script = "set -e\nmount -t tmpfs -o mode=0755 tmpfs \"$2\"\n\"$1\" campaign plan \"$3\" -o \"$2/demo\"\n\
        used=$(df --output=used -k \"$2\" | tail -1)\nmount -o remount,size=$((used + 64))k \"$2\"\n\
        exec \"$1\" campaign run \"$2/demo\" --jobs 2";
    let mut run = rig.command("unshare");
    run.args(["-m", "sh", "-c", script, "sh"]);
    run.args([&program("hil"), &room, &study]);
    let run = rig.program(run).expect(3).says(&[
        "No space left on device",
        "the same command continues",
        "df -h",
    ]);
    for never in ["interrupted", "exit code"] {
        assert!(!run.stderr.contains(never), "{}", run.stderr);
    }
    assert_eq!(run.stderr.matches("error:").count(), 1, "{}", run.stderr);
}
