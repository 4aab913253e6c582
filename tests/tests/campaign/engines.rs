//! Engines that know nothing of campaigns: the commands of the page about clusters, with another folder.

use std::process::Command;

use super::{STUDY, planned, study, text};
use crate::support::harness::Rig;
use crate::support::programs::{shipped, skip};

/// Number of tasks in the page's commands.
const TASKS: u32 = 64;

/// Returns the line of the page that contains this text.
fn line(part: &str) -> String {
    let page = shipped("docs/clusters.md");
    let hit = page.lines().find(|line| line.contains(part));
    hit.expect("a line").trim().to_owned()
}

/// Runs a campaign with a shell command that names a folder; returns its digest and that of one worker.
fn digests(rig: &Rig, run: impl FnOnce(&str)) -> [String; 2] {
    let study = study(rig, STUDY);
    let [one, other] = ["one", "with space"].map(|name| planned(rig, &study, name));
    one.on("run --jobs 1").expect(0);
    run(text(&other));
    [one, other].map(|folder| folder.digest())
}

#[test]
fn gnu_parallel_runs_a_campaign_with_the_documented_command() {
    let version = Command::new("parallel").arg("--version").output();
    if !version.is_ok_and(|version| version.stdout.starts_with(b"GNU parallel")) {
        return skip("there is no GNU parallel", "HIL_TEST_PARALLEL");
    }
    let command = line("| parallel");
    assert!(command.contains(&format!("seq 0 {} ", TASKS - 1)));
    let rig = Rig::new();
    let [one, other] = digests(&rig, |folder| {
        let folder = format!("'\"{folder}\"'");
        let local = command.replace("--sshloginfile nodes ", "");
        let command = local.replace("/shared/runs/common-mode/", &format!("{folder}/"));
        let command = command.replace("/shared/runs/common-mode", &folder);
        let mut shell = rig.command("sh");
        shell.args(["-c", &command]);
        rig.program(shell).expect(0);
    });
    assert_eq!(one, other);
}

#[test]
fn pods_of_an_indexed_job_run_a_campaign_with_the_documented_command() {
    let listed = line("JOB_COMPLETION_INDEX").replace("command: ", "");
    let words: Vec<String> = serde_json::from_str(&listed).expect("a list");
    let [shell, flag, command] = &*words else {
        panic!("{words:?}");
    };
    assert!(line("completions:").ends_with(&TASKS.to_string()));
    let rig = Rig::new();
    let [one, other] = digests(&rig, |folder| {
        let command = command.replace("/campaign", &format!("'{folder}'"));
        // One pod was started twice, as Kubernetes sometimes does.
        for index in (0..TASKS).chain([3]) {
            let mut pod = rig.command(shell);
            pod.args([flag, &command])
                .env("JOB_COMPLETION_INDEX", index.to_string());
            rig.program(pod).expect(0);
        }
    });
    assert_eq!(one, other);
}
