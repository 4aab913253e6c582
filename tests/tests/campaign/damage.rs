//! Folders in which something is not as it was, and disks without room: named, with what to do.

use super::{STUDY, campaign, digest, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{program, skip, works};

#[test]
fn a_damaged_table_of_results_is_named_with_the_command_that_writes_it_anew() {
    let rig = Rig::new();
    let folder = planned(&rig, &study(&rig, STUDY), "demo");
    campaign(&rig, &["run", text(&folder)]).expect(0);
    let expected = digest(&rig, &folder);
    let mend = format!("hil campaign collect {} writes it anew", text(&folder));
    for name in ["results.parquet", "circumstances.parquet"] {
        let table = folder.join(name);
        let whole = std::fs::read(&table).expect("a table");
        let middle = whole.len() / 2;
        let mut flipped = whole.clone();
        flipped[middle] ^= 1;
        for damaged in [&flipped[..], &whole[..middle], b""] {
            std::fs::write(&table, damaged).expect("written");
            let run = campaign(&rig, &["show", text(&folder)])
                .expect(3)
                .says(&[&format!("{name} is damaged"), &mend]);
            // The answers come from the shards, which are whole.
            assert!(run.stdout.contains(&expected), "{}", run.stdout);
        }
        campaign(&rig, &["collect", text(&folder)]).expect(0);
        let run = campaign(&rig, &["show", text(&folder)]).expect(0);
        assert!(!run.stderr.contains("parquet"), "{}", run.stderr);
    }
    // None is no damage.
    std::fs::remove_file(folder.join("results.parquet")).expect("removed");
    campaign(&rig, &["show", text(&folder)]).expect(0);
}

#[test]
fn a_table_that_is_older_than_the_results_is_named() {
    let rig = Rig::new();
    let folder = planned(&rig, &study(&rig, STUDY), "demo");
    campaign(&rig, &["work", text(&folder), "--shards", "0-3"]).expect(0);
    campaign(&rig, &["collect", text(&folder), "--partial"]).expect(3);
    campaign(&rig, &["work", text(&folder)]).expect(0);
    campaign(&rig, &["show", text(&folder)]).expect(0).says(&[
        "results.parquet is older than the last results",
        "hil campaign collect",
    ]);
}

#[test]
fn a_study_that_was_changed_is_refused_wherever_its_goals_count() {
    let rig = Rig::new();
    let goal = format!("{STUDY}\n[[goals]]\nvariant = \"pid\"\nprobability = 0.99\n");
    let folder = planned(&rig, &study(&rig, &goal), "demo");
    campaign(&rig, &["run", text(&folder)]).expect(1);
    let study = folder.join("study.toml");
    let planned = std::fs::read_to_string(&study).expect("a study");
    std::fs::write(&study, planned.replace("0.99", "0.5")).expect("written");
    let (page, shown) = (rig.path("page.html"), text(&folder));
    for arguments in [
        vec!["campaign", "show", shown],
        vec!["report", shown, "-o", text(&page)],
    ] {
        let plan = format!("hil campaign plan {} -o OTHER", text(&study));
        rig.hil(&arguments).expect(2).says(&[
            "study.toml has hash",
            "Put the study back as it was",
            &plan,
        ]);
    }
    std::fs::write(&study, planned).expect("written");
    campaign(&rig, &["show", shown]).expect(1);
}

#[test]
fn a_full_disk_is_named_and_nobody_was_interrupted() {
    if !works(&["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]) {
        return skip("this user may not mount anything", "HIL_TEST_UNSHARE");
    }
    let rig = Rig::new();
    let study = study(&rig, STUDY);
    let room = rig.path("room");
    std::fs::create_dir(&room).expect("a folder");
    // What is left after the plan has room for the claims of some shards and not for their rows.
    let script = "set -e\nmount -t tmpfs -o mode=0755 tmpfs \"$2\"\n\"$1\" campaign plan \"$3\" -o \"$2/demo\"\n\
        used=$(df --output=used -k \"$2\" | tail -1)\nmount -o remount,size=$((used + 64))k \"$2\"\n\
        exec \"$1\" campaign run \"$2/demo\" --jobs 2";
    let mut run = rig.command("unshare");
    run.args(["-m", "sh", "-c", script, "sh"]);
    run.args([&program("hil"), &room, &study]);
    let run = rig.program(run).expect(3).says(&[
        "No space left on device",
        "the same command goes on",
        "df -h",
    ]);
    for never in ["interrupted", "exit code"] {
        assert!(!run.stderr.contains(never), "{}", run.stderr);
    }
    assert_eq!(run.stderr.matches("error:").count(), 1, "{}", run.stderr);
}
