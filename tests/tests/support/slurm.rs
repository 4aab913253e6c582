//! Cluster of two nodes on this machine with a real Slurm; created by `tests/hosts/slurm.py`, and entirely removed
//! with it.

use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

use crate::support::harness::WATCHDOG;
use crate::support::hosts::lines;
use crate::support::programs::{program, skip, works, workspace};

/// Time limit for the cluster to end by itself.
const END: Duration = Duration::from_secs(20);

/// Running cluster; ended when dropped.
pub(crate) struct Cluster {
    process: Child,
    /// Closing it ends the cluster.
    orders: Option<ChildStdin>,
    answers: Receiver<String>,
    /// Value of `SLURM_CONF`.
    conf: String,
    _folder: TempDir,
}

impl Cluster {
    /// Starts a cluster, or reports what this machine lacks for that.
    pub(crate) fn begin() -> Option<Self> {
        if let Some(why) = lacking() {
            skip(why, "HIL_TEST_SLURM");
            return None;
        }
        // Not in a test's folder, whose name must be in no command line after a run.
        let folder = TempDir::with_prefix("hil-slurm-").expect("a temporary folder");
        let mut process = Command::new("python3");
        process
            .arg(workspace().join("tests/hosts/slurm.py"))
            .arg(folder.path());
        process
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .process_group(0);
        let mut process = process.spawn().expect("python3 starts");
        let mut cluster = Self {
            orders: process.stdin.take(),
            answers: lines(process.stdout.take().expect("piped")),
            process,
            conf: String::new(),
            _folder: folder,
        };
        let ready: Value = serde_json::from_str(&cluster.answer()).expect("JSON");
        cluster.conf = ready["conf"].as_str().expect("a path").to_owned();
        Some(cluster)
    }

    fn answer(&self) -> String {
        let answer = self.answers.recv_timeout(WATCHDOG);
        answer.expect("watchdog: the cluster has ended or does not answer")
    }

    /// Sends a command to the cluster, such as `kill n1`.
    pub(crate) fn order(&mut self, order: &str) {
        let orders = self.orders.as_mut().expect("open until it is dropped");
        writeln!(orders, "{order}").expect("the cluster listens");
        assert_eq!(self.answer(), "done", "{order}");
    }

    /// Returns a `hil` that submits to this cluster.
    pub(crate) fn hil(&self, arguments: &[&str]) -> Command {
        let mut hil = self.client(program("hil"), arguments);
        hil.current_dir(workspace());
        hil
    }

    /// Returns a program that queries this cluster.
    pub(crate) fn client(&self, program: impl AsRef<Path>, arguments: &[&str]) -> Command {
        let mut client = Command::new(program.as_ref());
        client.args(arguments).env("SLURM_CONF", &self.conf);
        client
    }
}

/// Returns the missing requirement, if there is one.
fn lacking() -> Option<&'static str> {
    let there = |name: &str| Path::new("/usr/sbin").join(name).exists();
    if !["slurmctld", "slurmd", "munged"].into_iter().all(there) {
        Some("there is no Slurm, or no munge")
    } else if !works(&["python3", "--version"]) {
        Some("there is no python3")
    } else if !works(&["unshare", "--pid", "--mount-proc", "--fork", "true"]) {
        Some("this user may not make a namespace of processes")
    } else {
        None
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        drop(self.orders.take());
        let since = Instant::now();
        while since.elapsed() < END && matches!(self.process.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(10));
        }
        let group = rustix::process::Pid::from_child(&self.process);
        if matches!(self.process.try_wait(), Ok(None)) {
            // All processes of its namespace end with its first one.
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL); // it may have ended
            let _ = self.process.wait();
        }
    }
}
