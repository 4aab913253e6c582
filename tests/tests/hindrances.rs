//! Machines without usable shared memory: the cause and the remedy are reported.

use std::process::Output;

use crate::support::harness::Rig;
use crate::support::programs::{program, skip, works};

/// Runs `hil` with a separate file system with these options at `/dev/shm`.
fn hil(rig: &Rig, options: &str, arguments: &[&str]) -> Output {
    let script = format!(
        "mount -t tmpfs -o mode=1777,{options} tmpfs /dev/shm && exec timeout 100 \"$0\" \"$@\""
    );
    let mut unshare = rig.command("unshare");
    unshare
        .args(["-m", "sh", "-c", &script])
        .arg(program("hil"));
    unshare.args(arguments).output().expect("unshare runs")
}

#[test]
fn unusable_shared_memory_is_reported_with_a_remedy() {
    if !works(&["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/dev/shm"]) {
        let why = "this user may not mount file systems";
        return skip(why, "HIL_TEST_UNSHARE");
    }
    let rig = Rig::new();
    for (options, expected) in [
        ("ro", "mount -o remount,rw /dev/shm"),
        ("nr_inodes=1", "mount -o remount,nr_inodes="),
        // iceoryx2 gets as far as its nodes, services and ports.
        ("nr_inodes=8", "mount -o remount,nr_inodes="),
        ("nr_inodes=20", "mount -o remount,nr_inodes="),
        ("nr_inodes=40", "mount -o remount,nr_inodes="),
        ("nr_inodes=60", "mount -o remount,nr_inodes="),
    ] {
        let out = rig.path(options);
        let out = out.to_str().expect("text");
        let scenario = "scenarios/spring-mass.toml";
        let run = hil(
            &rig,
            options,
            &["run", scenario, "--wait-limit", "10", "--out", out],
        );
        let text = [run.stdout, run.stderr].concat();
        let text = String::from_utf8_lossy(&text);
        assert_eq!(run.status.code(), Some(3), "{options}: {text}");
        assert!(text.contains(expected), "{options}: {text}");

        let doctor = hil(&rig, options, &["doctor", "--quick"]);
        let text = String::from_utf8_lossy(&doctor.stdout);
        let checks = text.lines().find(|line| line.contains("shared_memory"));
        assert!(
            checks.is_some_and(|line| line.starts_with("poor")),
            "{text}"
        );
        assert!(text.contains(expected), "{options}: {text}");
    }
}
