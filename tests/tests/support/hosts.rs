//! Two hosts on one machine, each with a network of its own, joined by a wire that can be disturbed and cut; `sshd`
//! on the board, which has its own processes and `/dev/shm` too. Created by `tests/hosts/hosts.py`.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};

use tempfile::TempDir;

use crate::support::harness::{Rig, Running, WATCHDOG};
use crate::support::programs::{path_from, program, skip, works, workspace};

/// Both hosts; removed when dropped.
pub(crate) struct Hosts {
    wire: Child,
    orders: ChildStdin,
    answers: Receiver<String>,
    /// Processes whose namespaces are entered.
    desk: String,
    board: String,
    /// Keys and configuration. Not in a test's folder, because `sshd` outlives a run.
    folder: TempDir,
}

impl Hosts {
    /// Creates both, or reports what this machine lacks for that.
    pub(crate) fn new() -> Option<Self> {
        if !works(&[
            "unshare", "--net", "--mount", "--pid", "--fork", "ip", "link", "show", "lo",
        ]) {
            skip(
                "this user may not make hosts, or `ip` is missing",
                "HIL_TEST_NETNS",
            );
            return None;
        }
        if !Path::new("/usr/sbin/sshd").exists() || !works(&["python3", "--version"]) {
            skip("there is no sshd or no python3", "HIL_TEST_SSHD");
            return None;
        }
        let folder = TempDir::with_prefix("hil-hosts-").expect("a temporary folder");
        let place = folder.path().to_str().expect("plain text").to_owned();
        for key in ["host", "own", "other"] {
            let file = format!("{place}/{key}");
            assert!(works(&[
                "ssh-keygen",
                "-q",
                "-t",
                "ed25519",
                "-N",
                "",
                "-f",
                &file
            ]));
        }
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written")
        };
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("read");
        write(
            "sshd_config",
            &format!(
                "HostKey {place}/host\nAuthorizedKeysFile {place}/own.pub\nStrictModes no\nUsePAM no\n\
                 PidFile none\nSetEnv XDG_CACHE_HOME={place}/cache\n"
            ),
        );
        write("known", &format!("10.77.0.2 {}", read("host.pub")));
        write("unknown", "");
        let user = |name: &str, key: &str, known: &str| {
            format!(
                "Host {name}\n HostName 10.77.0.2\n User root\n IdentityFile {place}/{key}\n IdentitiesOnly yes\n \
                 UserKnownHostsFile {place}/{known}\n GlobalKnownHostsFile none\n"
            )
        };
        write(
            "ssh_config",
            &[
                user("board", "own", "known"),
                user("stranger", "other", "known"),
                user("impostor", "own", "unknown"),
                "Host elsewhere\n HostName 10.77.0.9\n".into(),
            ]
            .concat(),
        );
        std::fs::create_dir(folder.path().join("bin")).expect("a folder");
        let ssh = folder.path().join("bin/ssh");
        let result = which("ssh");
        std::fs::write(
            &ssh,
            format!(
                "#!/bin/sh\nexec {} -F {place}/ssh_config \"$@\"\n",
                result.display()
            ),
        )
        .expect("written");
        assert!(works(&["chmod", "755", ssh.to_str().expect("plain text")]));
        let mut wire = Command::new("python3");
        wire.arg(workspace().join("tests/hosts/hosts.py"))
            .arg(folder.path());
        wire.stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .process_group(0);
        let mut wire = wire.spawn().expect("python3 starts");
        let orders = wire.stdin.take().expect("piped");
        let mut hosts = Self {
            orders,
            answers: lines(wire.stdout.take().expect("piped")),
            wire,
            desk: String::new(),
            board: String::new(),
            folder,
        };
        let ready = hosts.answer();
        let mut words = ready.split_ascii_whitespace().skip(1).map(str::to_owned);
        hosts.desk = words.next().expect("the desk");
        hosts.board = words.next().expect("the board");
        Some(hosts)
    }

    fn answer(&mut self) -> String {
        let answer = self.answers.recv_timeout(WATCHDOG);
        answer.expect("watchdog: the wire has ended or does not answer")
    }

    /// Sends a command to the wire.
    pub(crate) fn order(&mut self, order: &str) -> String {
        writeln!(self.orders, "{order}").expect("the wire listens");
        self.answer()
    }

    /// Starts a run whose controller is on the board.
    pub(crate) fn start<'r>(&self, rig: &'r Rig, arguments: &str) -> Running<'r> {
        rig.start_with(self.hil(), &format!("{arguments} --target board"))
    }

    /// Returns a `hil` at the desk.
    pub(crate) fn hil(&self) -> Command {
        let mut hil = Command::new("nsenter");
        hil.args(["-t", &self.desk, "-n"]).arg(program("hil"));
        hil.env("PATH", path_from(&self.folder.path().join("bin")));
        hil.current_dir(workspace());
        hil
    }

    /// Returns the board's output as read by a driver: step, `true` for the safe command, and the values.
    pub(crate) fn output(&self) -> Option<(u64, bool, Vec<f64>)> {
        let inside = Command::new("nsenter")
            .args(["-t", &self.board, "-m", "-p", "sh", "-c"])
            .arg("cat /dev/shm/hil-*/*/output")
            .output();
        let bytes = inside.expect("nsenter runs").stdout;
        let (content, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
        // Read during a write: the next poll succeeds.
        if blake3::hash(content).as_bytes()[..8] != *sum {
            return None;
        }
        let words = content.chunks_exact(8);
        let words: Vec<u64> = words
            .map(|word| u64::from_le_bytes(word.try_into().expect("8 bytes")))
            .collect();
        let values = words.get(3..)?.iter().copied().map(f64::from_bits);
        Some((words[1], words[2] == 1, values.collect()))
    }

    /// Lists the files in the board's shared memory, and its processes except those of `sshd`.
    pub(crate) fn left_on_board(&self) -> Vec<String> {
        let script =
            "find /dev/shm -mindepth 1 -type f && ps -eo args= | sed -n '/[h]il-target\\//p'";
        let inside = Command::new("nsenter")
            .args(["-t", &self.board, "-m", "-p", "sh", "-c", script])
            .output();
        let inside = inside.expect("nsenter runs");
        assert!(inside.status.success(), "{inside:?}");
        let text = String::from_utf8_lossy(&inside.stdout);
        text.lines().map(str::to_owned).collect()
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        let group = rustix::process::Pid::from_child(&self.wire);
        // Both hosts are in its group, and processes on the board end with its init process.
        let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL); // it may have ended
        let _ = self.wire.wait();
    }
}

/// Reads lines on a thread of its own, so that a waiting test can give up.
pub(crate) fn lines(from: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, lines) = channel();
    std::thread::spawn(move || {
        let read = BufReader::new(from).lines().map_while(Result::ok);
        // Reads to the end, even without a receiver, so that the writer never blocks.
        read.for_each(|line| drop(sender.send(line)));
    });
    lines
}

fn which(name: &str) -> PathBuf {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let hit = std::env::split_paths(&path)
        .map(|folder| folder.join(name))
        .find(|file| file.exists());
    hit.unwrap_or_else(|| name.into())
}
