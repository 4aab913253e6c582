//! Strangers at a listening agent: how long does an honest check take next to silent contacts, and what do very many
//! contacts leave behind?

use std::fs::File;
use std::io::ErrorKind;
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rustix::net::sockopt::set_socket_linger;

use crate::measure::median;
use crate::programs::Programs;
use crate::{Ended, WATCHDOG};

/// Number of silent contacts at any time.
const SILENT: usize = 50;
/// Number of contacts that send nothing and leave.
const CONTACTS: u32 = 100_000;
/// Number of checks of each kind.
const CHECKS: u32 = 9;

/// A listening agent, with its log in a file.
struct Agent {
    process: Ended,
    address: String,
    key: String,
    log: std::path::PathBuf,
}

impl Agent {
    fn start(programs: &Programs, folder: &Path) -> Self {
        let (key, log) = (folder.join("board.key"), folder.join("serve.log"));
        let key = key.display().to_string();
        let made = Command::new(&programs.hil)
            .args(["target", "key", &key])
            .status();
        assert!(made.is_ok_and(|status| status.success()), "a key is made");
        let mut serve = Command::new(&programs.hil);
        serve.args([
            "target",
            "serve",
            "--listen",
            "127.0.0.1:0",
            "--key-file",
            &key,
            "--allow",
        ]);
        serve.arg(programs.hil.with_file_name("controller-process"));
        serve
            .stdin(Stdio::null())
            .stderr(File::create(&log).expect("a log"));
        let process = Ended(serve.spawn().expect("hil starts"));
        let since = Instant::now();
        let address = loop {
            let text = std::fs::read_to_string(&log).expect("a log");
            if let Some((line, _)) = text.split_once('\n') {
                let address = line.strip_prefix("listening on ");
                break address.unwrap_or_else(|| panic!("{text}")).to_owned();
            }
            assert!(since.elapsed() < WATCHDOG, "it says where it listens");
        };
        Self {
            process,
            address,
            key,
            log,
        }
    }

    /// Times of checks in ms; `None` for a failed check.
    fn checks(&self, programs: &Programs) -> Vec<Option<f64>> {
        let target = format!("serve://{}", self.address);
        let check = |_| {
            let since = Instant::now();
            let mut hil = Command::new(&programs.hil);
            hil.args(["target", "check", &target, "--key-file", &self.key]);
            let output = hil.output().expect("hil runs");
            (output.status.success()).then(|| since.elapsed().as_secs_f64() * 1e3)
        };
        (0..CHECKS).map(check).collect()
    }

    /// Memory in kB, threads and open files of the agent.
    fn holds(&self) -> (u64, u64, usize) {
        let folder = format!("/proc/{}", self.process.0.id());
        let status = std::fs::read_to_string(format!("{folder}/status")).expect("it runs");
        let number = |name: &str| {
            let line = status.lines().find(|line| line.starts_with(name));
            let number = line.and_then(|line| line.split_ascii_whitespace().nth(1));
            number
                .and_then(|number| number.parse().ok())
                .expect("a number")
        };
        let files = std::fs::read_dir(format!("{folder}/fd"))
            .expect("it runs")
            .count();
        (number("VmRSS:"), number("Threads:"), files)
    }
}

/// Measures all kinds, and prints a line for each.
pub(crate) fn measure(programs: &Programs, folder: &Path) {
    let agent = Agent::start(programs, folder);
    let show = |beside: &str, checks: &[Option<f64>]| {
        let failed = checks.iter().filter(|check| check.is_none()).count();
        let ms = checks.iter().flatten().copied();
        let worst = ms.clone().max_by(f64::total_cmp).unwrap_or(f64::NAN);
        let p50 = if failed < checks.len() {
            median(ms)
        } else {
            f64::NAN
        };
        let (rss_kb, threads, files) = agent.holds();
        println!(
            "{beside:<40} {p50:>9.0} {worst:>9.0} {failed:>7} {rss_kb:>9} {threads:>8} {files:>6} {:>10}",
            std::fs::metadata(&agent.log).expect("a log").len()
        );
    };
    println!(
        "{:<40} {:>9} {:>9} {:>7} {:>9} {:>8} {:>6} {:>10}",
        "check beside", "p50 ms", "max ms", "failed", "RSS kB", "threads", "files", "log bytes"
    );
    show("nobody", &agent.checks(programs));
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| stay_silent(&agent.address, &is_over));
        std::thread::sleep(Duration::from_millis(200)); // they are there
        show(
            &format!("{SILENT} silent contacts"),
            &agent.checks(programs),
        );
        let contacts = scope.spawn(|| {
            for _ in 0..CONTACTS {
                let contact = TcpStream::connect(&agent.address).expect("it listens");
                // Reset, not closed: so many closed ones would use up the ports of this machine.
                set_socket_linger(&contact, Some(Duration::ZERO)).expect("set");
            }
        });
        let since = Instant::now();
        let checks = agent.checks(programs);
        contacts.join().expect("contacts");
        let each_us = since.elapsed().as_secs_f64() * 1e6 / f64::from(CONTACTS);
        let beside = format!("those and {CONTACTS} that leave ({each_us:.0} us)");
        show(&beside, &checks);
        is_over.store(true, Ordering::Relaxed);
    });
}

/// Maintains silent contacts: a closed contact is opened again.
fn stay_silent(address: &str, is_over: &AtomicBool) {
    let contact = || {
        let contact = TcpStream::connect(address).expect("it listens");
        contact.set_nonblocking(true).expect("set");
        contact
    };
    let mut silent: Vec<TcpStream> = (0..SILENT).map(|_| contact()).collect();
    while !is_over.load(Ordering::Relaxed) {
        for one in &mut silent {
            let peeked = one.peek(&mut [0]);
            let is_open = matches!(&peeked, Err(error) if error.kind() == ErrorKind::WouldBlock);
            if !is_open {
                *one = contact();
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}
