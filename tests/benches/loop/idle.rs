//! Costs of a run that has nothing to do: held, or paced at ten steps a second.
//!
//! The processor time of `hil` and both its processes, as the kernel counts it in `/proc/PID/stat`,
//! over one long stretch of each run.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use hil_session::session::{self, SessionInfo};
use rustix::param::clock_ticks_per_second;
use serde_json::json;

use crate::effort::shortened;
use crate::measure::{Bystanders, machine};
use crate::programs::Programs;

/// Time for a run to settle before it is measured.
const SETTLE: Duration = Duration::from_secs(2);
/// Time for which a run is measured, in s.
const WATCH_S: u64 = 50;
/// Time limit of any operation, after which it counts as hanging.
const PATIENCE: Duration = Duration::from_secs(30);

/// Measures both runs and prints their costs.
pub(crate) fn compare(programs: &Programs) {
    let watch_s = shortened(WATCH_S) as f64;
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scenario = tests.join("../scenarios/spring-mass.toml");
    let scenario = scenario.to_str().expect("a path in UTF-8");
    let longer = format!("run.duration_s={}", watch_s + 3.0 * SETTLE.as_secs_f64());
    let bystanders = Bystanders::watch();
    let mut lines = Vec::new();
    let mut text = String::new();
    for (run, arguments) in [
        ("held", vec!["--pause-at", "0"]),
        (
            "paced, 10 steps a second",
            vec![
                "--pace",
                "1",
                "--set",
                "controller.law=hold",
                "--set",
                "run.rate_hz=10",
                "--set",
                &longer,
            ],
        ),
    ] {
        let mut watched = Watched::start(programs, scenario, &arguments);
        sleep(SETTLE);
        for (program, percent) in watched.percents(Duration::from_secs_f64(watch_s)) {
            text += &format!("{run:<26} {program:<20} {percent:>6.2} % of a core\n");
            lines.push(json!({ "run": run, "program": program, "percent": percent }));
        }
        watched.end();
    }
    let others = bystanders.share();
    println!(
        "processor time of idle runs over {watch_s} s, other programs took {:.0} % of the machine",
        100.0 * others
    );
    print!("{text}");
    let line = json!({
        "bench": "loop/idle",
        "machine": machine(),
        "seconds": watch_s,
        "others_share": others,
        "runs": lines,
    });
    println!("{line}\n");
}

/// A `hil run` with its two processes.
struct Watched {
    hil: Child,
    session: SessionInfo,
}

impl Watched {
    fn start(programs: &Programs, scenario: &str, arguments: &[&str]) -> Self {
        let name = format!("bench-{}", std::process::id());
        let hil = Command::new(&programs.hil)
            .args(["run", scenario, "--no-record", "--session", &name])
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("hil");
        let since = Instant::now();
        loop {
            let sessions = session::list().expect("the sessions");
            let own = sessions.into_iter().find(|session| session.name == name);
            match own {
                Some(session) if session.children.len() == 2 => break Self { hil, session },
                _ => assert!(since.elapsed() < PATIENCE, "no run {name}"),
            }
            sleep(Duration::from_millis(10));
        }
    }

    /// Returns each program and its share of a core over this time.
    fn percents(&self, watch: Duration) -> Vec<(String, f64)> {
        let children = self.session.children.iter().map(|child| child.pid);
        let all: Vec<u32> = [self.hil.id()].into_iter().chain(children).collect();
        let (since, before) = (Instant::now(), all.iter().map(|pid| ticks(*pid)));
        let before: Vec<u64> = before.collect();
        sleep(watch);
        let watched_ticks = since.elapsed().as_secs_f64() * clock_ticks_per_second() as f64;
        let taken = |(pid, before): (&u32, u64)| {
            let name = fs::read_to_string(format!("/proc/{pid}/comm")).expect("it still runs");
            let percent = 100.0 * (ticks(*pid) - before) as f64 / watched_ticks;
            (name.trim().to_owned(), percent)
        };
        all.iter().zip(before).map(taken).collect()
    }

    /// Stops the run, as Ctrl-C does, and waits for its end.
    fn end(&mut self) {
        let hil = rustix::process::Pid::from_child(&self.hil);
        rustix::process::kill_process(hil, rustix::process::Signal::INT).expect("it still runs");
        self.hil.wait().expect("it was started");
    }
}

/// Returns the processor time of a process so far, in ticks: user and system time of all its threads.
fn ticks(pid: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).expect("it still runs");
    let (_, fields) = stat.rsplit_once(')').expect("a name in parentheses");
    let times = fields.split_ascii_whitespace().skip(11).take(2);
    times
        .map(|ticks| ticks.parse::<u64>().expect("a number"))
        .sum()
}
