//! Unusable targets: another protocol, no shared memory, no space.

use super::{ON_BOARD, SHORT, hil, run};
use crate::support::board::Board;
use crate::support::harness::Rig;
use crate::support::programs::{program, skip, works};

/// Creates a board whose `ssh` changes the file systems seen by the remote command, and no others.
fn behind_mounts(rig: &Rig, mounts: &str) -> Board {
    let inside = format!("set -e; {mounts}; exec /bin/sh -c \"$0\"");
    let script = rig.write("mounts", &inside);
    let script = script.display();
    Board::reached_by(
        rig,
        &format!("exec unshare --mount /bin/sh -c \". {script}\" \"$command\""),
    )
}

#[test]
fn a_target_without_shared_memory_or_room_is_named_and_nothing_is_started() {
    if !works(&["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"]) {
        return skip("this user may not mount", "HIL_TEST_NETNS");
    }
    let rig = Rig::new();
    let agent = program("hil-target");
    // For the agent, and not for the program beside it.
    let bytes = std::fs::metadata(&agent).expect("there").len();
    let room = bytes.div_ceil(1 << 20) + 1;
    let agent = agent.to_str().expect("plain text");
    let device = "d=$HOME/dev; mkdir -p $d; mount -t tmpfs none $d; for n in null zero urandom random; \
                  do : >$d/$n; mount --bind /dev/$n $d/$n; done; mount --rbind $d /dev";
    let cache = |size: &str| {
        format!("mkdir -p $HOME/.cache; mount -t tmpfs -o size={size} none $HOME/.cache")
    };
    #[rustfmt::skip] // a table
    let cases = [
        (device, "it has no /dev/shm"),
        ("mount -t tmpfs -o size=64k none /dev/shm", "/dev/shm has only 0 MiB free, and a run needs at least 8"),
        ("mount -t tmpfs -o ro none /dev/shm", "/dev/shm is read-only"),
        ("mount -t tmpfs -o nr_inodes=9 none /dev/shm", "free inodes, and a run takes up to"),
        ("mkdir -p $HOME/.cache; mount -t tmpfs -o noexec none $HOME/.cache", "Permission denied"),
        (&cache("1m"), "the agent was not copied completely"),
        (&cache(&format!("{room}m")), "no room for a program of"),
    ];
    for (mounts, expected) in cases {
        let board = behind_mounts(&rig, mounts);
        let run = run(
            &rig,
            &board,
            &format!("{SHORT} {ON_BOARD} --target-agent {agent}"),
        )
        .expect(3);
        assert!(!run.folder.exists(), "{mounts}");
        run.says(&["target me@board", expected]);
        let check = ["target", "check", "me@board", "--target-agent", agent];
        hil(&rig, &board, &check).expect(3);
    }
}

#[test]
fn an_agent_of_another_protocol_is_refused() {
    let rig = Rig::new();
    let machine = rustix::system::uname();
    let machine = machine.machine().to_string_lossy();
    let here = format!(
        r#"{{"message":"here","protocol":1,"findings":{{"host":"old","machine":"{machine}","kernel":"6","boot_id":"","cores":1,"most_priority":0,"emulates":[],"free_bytes":1}}}}"#
    );
    let mut frame = (here.len() as u32 + 1).to_le_bytes().to_vec();
    frame.push(1);
    frame.extend(here.bytes());
    let output = rig.path("said");
    std::fs::write(&output, frame).expect("written");
    let board = Board::reached_by(
        &rig,
        &format!(
            "echo 'HIL-TARGET 1 {machine}'; read -r it; echo have; exec cat {} -",
            output.display()
        ),
    );
    let run = run(&rig, &board, &format!("{SHORT} {ON_BOARD}")).expect(2);
    assert!(!run.folder.exists());
    run.says(&["target me@board: its agent speaks protocol 1, but this hil"]);
}
