//! Bench `port`: what does a port cost beside its system calls, and how long is a round trip over UDP?
//!
//! `cargo bench -p tests --bench port` measures in one run, in turns:
//!
//! - the processor time of a step of [`Wire`] over UDP, less that of a loop with the same system calls and bytes;
//! - a round trip of a port as a law to a thread that answers, and of a bare ping-pong with the same bytes and the same
//!   blocking waits.
//!
//! There is no limit on any number. `HIL_BENCH_QUICK=1` only tries whether it works.

#[path = "../shared/effort.rs"]
mod effort;
#[path = "../shared/measure.rs"]
mod measure;
mod ping_pong;

use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use controller_process::controller::{Law, Row, Start};
use hil_codec::pack::Packer;
use hil_config::port::{Carries, Port};
use hil_port::law::{self, Ledger, Run};
use hil_port::wire::Wire;
use hil_session::supervision::Supervision;
use rustix::time::{ClockId, clock_gettime};
use serde_json::json;
use shared_types::describe::Settings;
use shared_types::quality::SignalSet;

use self::effort::{rounds, shortened};
use self::measure::{Bystanders, machine, median};
use self::ping_pong::{Bare, answer};

/// Signals of a sample and of a command.
const SIGNALS: [usize; 2] = [22, 4];
/// Bytes of a sample and of a command: a counter, then the signals.
const BYTES: [usize; 2] = [4 + 8 * SIGNALS[0], 4 + 8 * SIGNALS[1]];
/// Steps of a round in one thread, and trips of a round between two.
const STEPS: u64 = 200_000;
const TRIPS: u64 = 50_000;
/// Sampling period, in s.
const PERIOD_S: f64 = 0.001;

fn main() {
    // `cargo test --all-targets` starts benches too, without this argument.
    if !std::env::args().any(|argument| argument == "--bench") {
        println!("run me with `cargo bench -p tests --bench port`");
        return;
    }
    println!("machine: {}", machine());
    let [sample, command] = BYTES;
    println!("frames: {sample} bytes there, {command} bytes back\n");
    let bystanders = Bystanders::watch();
    let (mut costs, mut ports, mut bares) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..rounds() {
        costs.push(cost_ns(shortened(STEPS)));
        ports.push(port_trip_ns(shortened(TRIPS)));
        bares.push(bare_trip_ns(shortened(TRIPS)));
    }
    let ratios = ports.iter().zip(&bares).map(|(port, bare)| port / bare);
    let (to_bare, cost_ns) = (median(ratios), median(costs));
    let (port_ns, bare_ns) = (median(ports), median(bares));
    let others = bystanders.share();
    println!("a step of the port beside its system calls: {cost_ns:.0} ns of processor time");
    println!(
        "round trip over UDP, blocking: p50 {port_ns:.0} ns, bare {bare_ns:.0} ns, ratio {to_bare:.2}"
    );
    println!("other programs took {:.0} % of the machine", 100.0 * others);
    let line = json!({
        "bench": "port",
        "machine": machine(),
        "others_share": others,
        "cost_ns": cost_ns,
        "trips": [{ "trip": "port over UDP", "p50_ns": port_ns, "bare_p50_ns": bare_ns, "p50_to_bare": to_bare }],
    });
    println!("{line}\n");
}

/// Parses the port whose peer has an address.
fn port(peer: &UdpSocket) -> Port {
    let to = peer.local_addr().expect("an address");
    let frame = |name: &str, carries: &str, group: &str, count: usize| {
        let signals =
            (0..count).map(|index| format!("{{ signal = \"{group}.s{index}\", type = \"f64\" }}"));
        let counter = "{ kind = \"counter\", type = \"u32\" }".to_owned();
        let fields: Vec<String> = std::iter::once(counter).chain(signals).collect();
        format!(
            "[[frames]]\nname = \"{name}\"\ncarries = \"{carries}\"\nfields = [\n{}\n]\n",
            fields.join(",\n")
        )
    };
    let text = [
        "port = 1\n".to_owned(),
        format!("[[media]]\nkind = \"udp\"\nto = \"{to}\"\n"),
        frame("sample", "sample", "measured", SIGNALS[0]),
        frame("command", "command", "command", SIGNALS[1]),
    ];
    let port = Port::parse(&text.concat(), Path::new("bench.port.toml"), None);
    port.unwrap_or_else(|problems| panic!("{problems}"))
}

/// Packs the command frames of a peer.
fn commands(port: &Port) -> Packer {
    let table = port.table(Carries::Command);
    Packer::new(&port.frames[1].frame, &table).expect("a sound frame")
}

fn peer() -> UdpSocket {
    UdpSocket::bind("127.0.0.1:0").expect("a socket")
}

/// Returns the processor time of this thread, in ns.
fn processor_ns() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e9 + time.tv_nsec as f64
}

/// Measures the processor time of a step of the port, less that of its system calls, in ns. The peer is in the same
/// thread, so that nothing waits.
fn cost_ns(steps: u64) -> f64 {
    let end = peer();
    let port = port(&end);
    let mut wire = Wire::open(&port, Carries::Sample, PERIOD_S, Path::new("")).expect("opened");
    let mut packer = commands(&port);
    let (mut values, none) = (vec![0.5; SIGNALS[0]], SignalSet::default());
    let mut buffer = [0; 512];
    let begin = processor_ns();
    for step in 0..steps {
        values[step as usize % SIGNALS[0]] += 0.01;
        wire.send(step, &values, &none).expect("sent");
        wire.receive().expect("nothing yet");
        let (_, own) = end.recv_from(&mut buffer).expect("a sample");
        let answer = packer.pack(&values[..SIGNALS[1]], &none);
        end.send_to(answer, own).expect("answered");
        wire.wait(Instant::now() + Duration::from_secs(1))
            .expect("waited");
        wire.receive().expect("received");
        assert_eq!(wire.awaited(step), None);
    }
    let of_port = processor_ns() - begin;
    let bare = Bare::to(&end);
    let begin = processor_ns();
    for step in 0..steps {
        values[step as usize % SIGNALS[0]] += 0.01;
        bare.receive(&mut buffer);
        bare.send(&buffer[..BYTES[0]]);
        bare.receive(&mut buffer);
        let (_, own) = end.recv_from(&mut buffer).expect("a sample");
        let answer = packer.pack(&values[..SIGNALS[1]], &none);
        end.send_to(answer, own).expect("answered");
        bare.wait();
        assert!(bare.receive(&mut buffer));
        assert!(!bare.receive(&mut buffer));
    }
    (of_port - (processor_ns() - begin)) / steps as f64
}

/// Measures the median round trip of a port as a law, in ns.
fn port_trip_ns(trips: u64) -> f64 {
    let end = peer();
    let port = Arc::new(port(&end));
    let run = Arc::new(OnceLock::new());
    let _ = run.set(Run {
        folder: PathBuf::new(),
        wait_limit_s: 5.0,
        supervision: Supervision::default(),
    });
    let kind = law::law(&port, &run, &Ledger::default()).expect("sound tables");
    let nothing = Settings::default();
    let start = Start {
        parameters: &nothing,
        model: &nothing,
        period_s: PERIOD_S,
        commands: kind.description.commands.as_deref().unwrap_or_default(),
    };
    let mut law = (kind.start)(&start).expect("opened");
    let mut packer = commands(&port);
    let none = SignalSet::default();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            answer(&end, trips, || {
                packer.pack(&[1.0; SIGNALS[1]], &none).to_vec()
            })
        });
        let mut command = [0.0; SIGNALS[1]];
        let mut measured = [0.5; SIGNALS[0]];
        median((0..trips).map(|trip| {
            measured[trip as usize % SIGNALS[0]] += 0.01;
            let row = Row {
                time_s: trip as f64 * PERIOD_S,
                measured: &measured,
                reference: &[],
                valid: true,
                held_steps: 0,
            };
            let begin = Instant::now();
            Law::step(&mut *law, &row, &mut command, &mut []).expect("answered");
            begin.elapsed().as_nanos() as f64
        }))
    })
}

/// Measures the median round trip of a bare ping-pong, in ns.
fn bare_trip_ns(trips: u64) -> f64 {
    let end = peer();
    let bare = Bare::to(&end);
    std::thread::scope(|scope| {
        scope.spawn(|| answer(&end, trips, || vec![1; BYTES[1]]));
        let mut buffer = [0; 512];
        median((0..trips).map(|_| {
            let begin = Instant::now();
            bare.send(&buffer[..BYTES[0]]);
            while !bare.receive(&mut buffer) {
                bare.wait();
            }
            begin.elapsed().as_nanos() as f64
        }))
    })
}
