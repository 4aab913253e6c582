//! Folders that another user made or can change: their programs are not run.

use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt, chown, symlink};
use std::path::Path;

use rustix::process::geteuid;

use super::{Planned, STUDY, campaign, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{program, skip};

/// ID of another user, who need not exist.
const ANOTHER: u32 = 12345;

fn set(path: &Path, mode: u32) {
    std::fs::set_permissions(path, Permissions::from_mode(mode)).expect("it is ours");
}

/// Checks that no command runs anything from a folder, and that reading it remains possible.
fn refused(rig: &Rig, folder: &Path, reason: &str) {
    let out = rig.path("out");
    for arguments in [
        vec!["run", text(folder)],
        vec!["work", text(folder)],
        vec!["grow", text(folder), "--cases", "40"],
        vec![
            "case",
            text(folder),
            "3",
            "--in-process",
            "--out",
            text(&out),
        ],
        vec!["submit", text(folder), "--slurm", "--dry-run"],
    ] {
        campaign(rig, &arguments)
            .expect(2)
            .says(&[reason, "refusing to run", "cp -r"]);
        assert!(!rig.path("ran").exists(), "{arguments:?} ran it");
    }
    campaign(rig, &["status", text(folder)]).expect(0);
}

#[test]
fn no_command_runs_programs_that_others_can_write() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    let hil = demo.join("programs/hil");
    #[rustfmt::skip] // a table
    let cases = [
        (&hil, 0o777, "programs/hil can be written by others"),
        (&demo.join("programs"), 0o777, "programs can be written by others"),
        (&demo.folder, 0o777, "demo can be written by others"),
        (&demo.join("manifest.json"), 0o666, "manifest.json can be written by others"),
        (&demo.join("scenario.toml"), 0o666, "scenario.toml can be written by others"),
        (&hil, 0o4755, "runs as another user or group"),
    ];
    for (path, mode, reason) in cases {
        let before = std::fs::metadata(path).expect("there").permissions().mode();
        set(path, mode);
        refused(&rig, &demo, reason);
        set(path, before);
    }
    demo.on("work --shards 0").expect(0);
}

#[test]
fn a_link_to_a_program_that_others_can_write_is_not_followed() {
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    let (open, hil) = (rig.path("open"), demo.join("programs/hil"));
    std::fs::create_dir(&open).expect("a folder");
    std::fs::rename(&hil, open.join("hil")).expect("moved");
    symlink(open.join("hil"), &hil).expect("a link");
    set(&open, 0o777);
    refused(&rig, &demo, "open can be written by others");
}

#[test]
fn the_folder_of_another_user_is_not_run_until_it_is_copied() {
    if !geteuid().is_root() {
        return skip("only root gives a folder away", "HIL_TEST_ROOT");
    }
    let rig = Rig::new();
    let demo = Planned::demo(&rig);
    // As prepared by a user who wants others to run it: every hash is right.
    let script = rig.script(
        "script",
        &format!("#!/bin/sh\ntouch '{}'\n", text(&rig.path("ran"))),
    );
    let hil = demo.join("programs/hil");
    std::fs::copy(&script, &hil).expect("copied");
    let manifest = demo.join("manifest.json");
    let old = std::fs::read_to_string(&manifest).expect("a manifest");
    let old: serde_json::Value = serde_json::from_str(&old).expect("JSON");
    let hash = blake3::hash(&std::fs::read(&hil).expect("a program")).to_hex();
    let mut new = old.clone();
    new["hil"]["blake3"] = hash.to_string().into();
    new.as_object_mut().expect("an object").remove("blake3");
    std::fs::write(&manifest, new.to_string()).expect("written");
    for path in [&hil, &demo.join("programs"), &manifest, &demo.folder] {
        chown(path, Some(ANOTHER), None).expect("as root");
    }
    refused(&rig, &demo, "belongs to another user (12345)");
    // A copy belongs to the user, as does the decision.
    let copy = rig.path("copy");
    let copied = std::process::Command::new("cp")
        .arg("-r")
        .args([&demo.folder, &copy])
        .status();
    assert!(copied.expect("cp runs").success());
    let copy = Planned {
        rig: &rig,
        folder: copy,
    };
    copy.on("work").expect(0);
    assert!(rig.path("ran").exists());
}

#[test]
fn user_programs_in_a_folder_are_checked_too() {
    let rig = Rig::new();
    let (study, folder) = (study(&rig, STUDY), rig.path("own"));
    let sides = ["plant-process", "controller-process"].map(program);
    let options = [
        "--plant-bin",
        text(&sides[0]),
        "--controller-bin",
        text(&sides[1]),
    ];
    let plan = ["plan", text(&study), "-o", text(&folder)];
    campaign(&rig, &[&plan[..], &options[..]].concat()).expect(0);
    for name in ["plant", "controller"] {
        let path = folder.join("programs").join(name);
        set(&path, 0o757);
        refused(
            &rig,
            &folder,
            &format!("programs/{name} can be written by others"),
        );
        set(&path, 0o755);
    }
}

#[test]
fn a_campaign_is_not_planned_where_it_could_not_run() {
    let rig = Rig::new();
    let open = rig.path("open");
    std::fs::create_dir(&open).expect("a folder");
    set(&open, 0o777);
    let (study, folder) = (study(&rig, STUDY), open.join("demo"));
    campaign(&rig, &["plan", text(&study), "-o", text(&folder)])
        .expect(2)
        .says(&["could not be run", "open can be written by others"]);
    assert!(!folder.exists());
}
