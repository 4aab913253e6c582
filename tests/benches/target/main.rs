//! Bench `target`: what does a controller on another machine cost?
//!
//! `cargo bench -p tests --bench target` runs the paper's scenario here and with `--target`, in turns, beside a bare exchange
//! of datagrams with as many bytes over the same wire, blocking and spinning. The target is this machine, reached by a
//! script in place of `ssh`, and the wire its loopback, or with `-- veth` that between two network namespaces, which needs
//! root: so both ends share the cores, and what is shown is the work of bridge and agent, not that of a network.
//! A third exchange measures the rejected design, with both sides on the wire themselves, without bridge and agent.
//! The share of answers that arrived as datagrams is printed too: on a clean wire the connection has almost none to
//! carry.
//! Each variant is measured idle and next to a busy loop on each core; medians of `HIL_BENCH_ROUNDS` (5) in turns.
//!
//! `-- strangers` measures a listening agent instead: the time of `hil target check` next to silent contacts, and the
//! memory and log that 100,000 contacts leave behind.

#[path = "../shared/busy.rs"]
mod busy;
mod direct;
#[path = "../shared/measure.rs"]
#[expect(dead_code, reason = "others beside it are part of what is measured")]
mod measure;
#[path = "../shared/programs.rs"]
#[expect(dead_code, reason = "its runs have a search path of their own")]
mod programs;
mod strangers;

use std::net::UdpSocket;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use busy::BusyLoop;
use measure::{machine, median};
use programs::Programs;

/// Size of a bare datagram in bytes: that of a sealed frame of the scenario.
const BYTES: usize = 400;
/// Time after which the other end of an exchange counts as missing.
const WATCHDOG: Duration = Duration::from_secs(60);
/// Variable that makes this program the other end of an exchange: it holds the address of this end and the kind of
/// exchange.
const ECHO: &str = "HIL_BENCH_ECHO";
/// Steps of the scenario, and number of exchanges.
const STEPS: u32 = 20_000;

fn main() -> ExitCode {
    if busy::burned() || echoed() {
        return ExitCode::SUCCESS;
    }
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench target`");
        return ExitCode::SUCCESS;
    }
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    words.retain(|word| word != "--bench");
    let is_veth = words == ["veth"];
    let is_strangers = words == ["strangers"];
    if !is_veth && !is_strangers && !words.is_empty() {
        println!(
            "unknown: {}; `-- veth` is a wire between network namespaces, `-- strangers` contacts an agent that listens",
            words.join(" ")
        );
        return ExitCode::FAILURE;
    }
    let rounds = std::env::var("HIL_BENCH_ROUNDS")
        .ok()
        .and_then(|rounds| rounds.parse().ok());
    let rounds: usize = rounds.unwrap_or(5);
    let programs = Programs::built();
    let folder = tempfile::tempdir().expect("a folder");
    if is_strangers {
        strangers::measure(&programs, folder.path());
        return ExitCode::SUCCESS;
    }
    let wire = if is_veth {
        Wire::veth()
    } else {
        Wire::loopback()
    };
    let path = ssh_in(folder.path(), &wire);
    println!(
        "{}\n{}; us a step, p50 of round trips in us; medians of {rounds}\n",
        machine(),
        wire.name
    );
    println!(
        "{:<28} {:<34} {:>9} {:>9} {:>7}",
        "beside", "what", "us/step", "p50", "spread"
    );
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let mut digests = std::collections::BTreeSet::new();
    for busy in [false, true] {
        let start = |core| BusyLoop::start(0, Some(core), true).expect("a busy loop");
        let _loops: Vec<BusyLoop> = if busy {
            (0..cores).map(start).collect()
        } else {
            Vec::new()
        };
        let beside = if busy {
            "a busy loop on each core"
        } else {
            "nobody"
        };
        let mut rows: [Vec<[f64; 2]>; 5] = Default::default();
        let mut shares = Vec::new();
        for _ in 0..rounds {
            for (row, exchange) in Exchange::ALL.into_iter().enumerate() {
                rows[row].push(exchanged(&wire, exchange));
            }
            for (row, target) in [(3, None), (4, Some("board"))] {
                let run = run(&programs, &path, target);
                rows[row].push(run.figures);
                digests.insert(run.digest);
                shares.extend(run.datagrams);
            }
        }
        let names = Exchange::ALL.map(Exchange::name).into_iter();
        let names = names.chain(["hil run", "hil run --target"]);
        for (name, figures) in names.zip(&rows) {
            let of = |place: usize| {
                figures
                    .iter()
                    .map(|figures| figures[place])
                    .collect::<Vec<f64>>()
            };
            let steps = of(0);
            let most = steps
                .iter()
                .copied()
                .fold(0.0, |most, one| if one > most { one } else { most });
            let least =
                steps.iter().copied().fold(
                    f64::INFINITY,
                    |least, one| if one < least { one } else { least },
                );
            let (step, p50) = (median(steps.iter().copied()), median(of(1)));
            println!(
                "{beside:<28} {name:<34} {step:>9.1} {p50:>9.1} {:>7.2}",
                most / least
            );
        }
        let least = shares.iter().copied().min_by(f64::total_cmp);
        let share = 1e2 * median(shares);
        println!(
            "{beside:<28} answers that arrived as datagrams: {share:.2} %, least {:.2} %",
            1e2 * least.expect("runs with a target")
        );
    }
    println!("\n{} digest", digests.len());
    if digests.len() == 1 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Wire between the desk and the board.
struct Wire {
    name: &'static str,
    desk: &'static str,
    board: &'static str,
    /// Process in the board's network namespace, which exists as long as this process.
    holder: Option<Ended>,
}

impl Wire {
    const fn loopback() -> Self {
        Self {
            name: "loopback",
            desk: "127.0.0.1",
            board: "127.0.0.1",
            holder: None,
        }
    }

    fn veth() -> Self {
        let mut holder = Command::new("unshare");
        holder.args(["--net", "cat"]).stdin(Stdio::piped());
        let mut holder = Ended(holder.spawn().expect("unshare starts"));
        let board = holder.0.id();
        let space = |process: &str| std::fs::read_link(format!("/proc/{process}/ns/net"));
        let own = space("self").expect("own files");
        let since = Instant::now();
        while space(&board.to_string()).map_or(true, |other| other == own) {
            let is_there = matches!(holder.0.try_wait(), Ok(None));
            assert!(
                is_there && since.elapsed() < WATCHDOG,
                "no network namespace: are you root?"
            );
        }
        let wire = Self {
            name: "veth",
            desk: "10.77.9.1",
            board: "10.77.9.2",
            holder: Some(holder),
        };
        let desk = format!("hil{board}");
        let here = [
            format!("ip link add {desk} type veth peer name eth0 netns {board}"),
            format!("ip address add {}/24 dev {desk}", wire.desk),
            format!("ip link set {desk} up"),
        ];
        let there = [
            format!("ip address add {}/24 dev eth0", wire.board),
            "ip link set eth0 up".to_owned(),
        ];
        let there = there.map(|line| format!("{} {line}", wire.there().join(" ")));
        for line in here.iter().chain(&there) {
            let words: Vec<&str> = line.split(' ').collect();
            let status = Command::new(words[0]).args(&words[1..]).status();
            assert!(status.is_ok_and(|status| status.success()), "{line}");
        }
        wire
    }

    /// Returns the words that precede a command on the board.
    fn there(&self) -> Vec<String> {
        let Some(holder) = &self.holder else {
            return vec!["env".to_owned()];
        };
        let holder = holder.0.id().to_string();
        ["nsenter", "--net", "--target", &holder]
            .map(str::to_owned)
            .into()
    }
}

/// Creates a script in place of `ssh`; returns the search path with it.
fn ssh_in(folder: &Path, wire: &Wire) -> String {
    let script = folder.join("ssh");
    let text = format!(
        "#!/bin/sh\nwhile [ \"$1\" != -- ]; do shift; done\nexport XDG_CACHE_HOME={}\n\
         export SSH_CONNECTION='{} 1 {} 2'\nexec {} /bin/sh -c \"$3\"\n",
        folder.display(),
        wire.desk,
        wire.board,
        wire.there().join(" ")
    );
    std::fs::write(&script, text).expect("written");
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).expect("own files");
    format!(
        "{}:{}",
        folder.display(),
        std::env::var("PATH").unwrap_or_default()
    )
}

/// A run of the paper's scenario.
struct Run {
    /// Returns the time of a step and p50 of the round trips, in us.
    figures: [f64; 2],
    digest: String,
    /// Share of answers that arrived as datagrams, with a target.
    datagrams: Option<f64>,
}

fn run(programs: &Programs, path: &str, target: Option<&str>) -> Run {
    let duration_s = f64::from(STEPS) / 10_000.0;
    let mut hil = Command::new(&programs.hil);
    hil.args([
        "run",
        "scenarios/severe-leakage.toml",
        "--no-record",
        "--json",
        "--set",
        "metrics=[]",
    ]);
    hil.args([
        "--set",
        "requirements=[]",
        "--set",
        "faults[0].at_s=1",
        "--set",
        &format!("run.duration_s={duration_s}"),
    ]);
    hil.current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .env("PATH", path);
    hil.args(target.map(|target| ["--target", target]).iter().flatten());
    let out = tempfile::tempdir().expect("a folder");
    let output = hil.arg("--out").arg(out.path()).output().expect("hil runs");
    let said = String::from_utf8_lossy(&output.stderr);
    let summary: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_else(|| panic!("{said}"));
    let step_us = 1e6 * number(&summary["wall_time_s"]) / f64::from(STEPS);
    let p50_us = number(&summary["latency_ns"]["round_trip"]["p50"]) / 1e3;
    let log = std::fs::read_to_string(out.path().join("controller.log")).unwrap_or_default();
    let datagrams = target.map(|_| share(&log).unwrap_or_else(|| panic!("{log}")));
    Run {
        figures: [step_us, p50_us],
        digest: summary["digest"].as_str().expect("a digest").to_owned(),
        datagrams,
    }
}

/// Reads the share of answers that arrived as datagrams from the log of a run.
fn share(log: &str) -> Option<f64> {
    let line = log
        .lines()
        .find(|line| line.contains("arrived as datagrams"))?;
    let (counts, _) = line.split_once(" answers arrived")?;
    let (datagrams, all) = counts.split_once(" of ")?;
    let datagrams: f64 = datagrams.rsplit(' ').next()?.parse().ok()?;
    Some(datagrams / all.parse::<f64>().ok()?)
}

/// Exchange of datagrams between two processes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exchange {
    Blocking,
    Spinning,
    Direct,
}

impl Exchange {
    const ALL: [Self; 3] = [Self::Blocking, Self::Spinning, Self::Direct];

    const fn name(self) -> &'static str {
        match self {
            Self::Blocking => "bare datagrams, blocking",
            Self::Spinning => "bare datagrams, spinning",
            Self::Direct => "sealed frames, no bridge or agent",
        }
    }
}

/// Exchanges with another process; returns the mean time of an exchange and p50 in us.
fn exchanged(wire: &Wire, exchange: Exchange) -> [f64; 2] {
    let socket = UdpSocket::bind((wire.desk, 0)).expect("a socket");
    let address = socket.local_addr().expect("an address");
    let there = wire.there();
    let mut other = Ended(
        Command::new(&there[0])
            .args(&there[1..])
            .arg(std::env::current_exe().expect("this"))
            .env(ECHO, format!("{address} {}", exchange.name()))
            .stdin(Stdio::null())
            .spawn()
            .expect("it starts"),
    );
    let mut bytes = [0; BYTES];
    socket.set_read_timeout(Some(WATCHDOG)).expect("set");
    let (length, peer) = socket.recv_from(&mut bytes).expect("it is there");
    socket.connect(peer).expect("connected");
    let trips = if exchange == Exchange::Direct {
        direct::lead(socket, &bytes[..length], STEPS)
    } else {
        bare(&socket, exchange == Exchange::Spinning)
    };
    other.0.kill().expect("it is there");
    let each_us = trips.iter().sum::<f64>() / f64::from(STEPS);
    [each_us, median(trips)]
}

/// Times of bare exchanges in us.
fn bare(socket: &UdpSocket, spins: bool) -> Vec<f64> {
    socket.set_nonblocking(spins).expect("set");
    let mut bytes = [0; BYTES];
    let trip = |_| {
        let sent = Instant::now();
        socket.send(&bytes).expect("sent");
        receive(socket, &mut bytes);
        sent.elapsed().as_secs_f64() * 1e6
    };
    (0..STEPS).map(trip).collect()
}

/// A process that is terminated when it is dropped.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill(); // it may have ended
        let _ = self.0.wait();
    }
}

fn receive(socket: &UdpSocket, bytes: &mut [u8]) {
    let since = Instant::now();
    loop {
        match socket.recv(bytes) {
            Ok(_) => return,
            Err(error)
                if error.kind() == std::io::ErrorKind::WouldBlock && since.elapsed() < WATCHDOG =>
            {
                std::hint::spin_loop();
            }
            Err(error) => panic!("the other end: {error}"),
        }
    }
}

/// Answers datagrams until this process is terminated, if it was started as the other end, and then returns true.
fn echoed() -> bool {
    let Ok(asked) = std::env::var(ECHO) else {
        return false;
    };
    let (address, name) = asked.split_once(' ').expect("two words");
    let mut all = Exchange::ALL.into_iter();
    let exchange = all.find(|exchange| exchange.name() == name);
    let exchange = exchange.expect("an exchange");
    let socket = UdpSocket::bind("0.0.0.0:0").expect("a socket");
    socket.connect(address).expect("connected");
    if exchange == Exchange::Direct {
        direct::follow(socket);
        return true;
    }
    socket.set_read_timeout(Some(WATCHDOG)).expect("set");
    socket.send(&[0; BYTES]).expect("sent");
    socket
        .set_nonblocking(exchange == Exchange::Spinning)
        .expect("set");
    let mut bytes = [0; BYTES];
    loop {
        receive(&socket, &mut bytes);
        if socket.send(&bytes).is_err() {
            return true;
        }
    }
}
