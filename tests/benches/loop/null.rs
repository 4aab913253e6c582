//! A plant and a law that do nothing: what engine, link and runner cost between two processes.
//!
//! This program is its own plant and controller process, told apart by the name it is started
//! under. Measured without an observer, with the engine in this process, and with the recorder, by
//! `hil run`.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

use controller_process::controller::{Law, LawKind, Row};
use hil_config::plan::{Clock, PlantPlan, Run};
use plant_process::engine::Engine;
use plant_process::plant::{Model, PlantKind};
use serde_json::json;
use shared_types::describe::{LawDescription, PROTOCOL, PlantDescription, Settings};
use shared_types::link::LinkError;
use shared_types::link::iceoryx::IceoryxLink;
use shared_types::pacer::OverrunPolicy;
use shared_types::record::{Event, RecordLayout};
use shared_types::session::Session;
use shared_types::stream::RecordSink;
use shared_types::supervision::Supervision;
use shared_types::table::Field;
use shared_types::time::{Interval, Rate};
use shared_types::wait::{WaitLimit, Waiter};
use tempfile::TempDir;

use crate::ROUNDS;
use crate::measure::{Bystanders, machine, median};
use crate::programs::Programs;

/// Signals in a sample; half as many commands answer them.
const SIZES: [usize; 2] = [8, 32];
/// Steps of a run.
const STEPS: u64 = 100_000;
const RATE_HZ: f64 = 10_000.0;
/// Names that this program is started under.
const PLANT: &str = "null-plant";
const CONTROLLER: &str = "null-controller";

struct NullPlant;

impl Model for NullPlant {
    fn retune(&mut self, _parameters: &[f64]) {}

    fn measure(&self, measured: &mut [f64]) {
        measured.fill(1.0);
    }

    fn truth(&self, _time_s: f64, _command: &[f64], _truth: &mut [f64]) {}

    fn advance(&mut self, _interval: &Interval, _command: &[f64]) {}
}

struct NullLaw;

impl Law for NullLaw {
    fn step(&mut self, _sample: &Row<'_>, command: &mut [f64], _internals: &mut [f64]) {
        command.fill(1.0);
    }
}

fn fields(stem: &str, count: usize) -> Vec<Field> {
    let name = |i| format!("{stem}{i}_m");
    let field = |i| Field::signal(&name(i), "m", "Nothing.");
    (0..count).map(field).collect()
}

fn name(size: usize) -> String {
    format!("null{size}")
}

fn plant(size: usize) -> PlantKind {
    PlantKind {
        description: PlantDescription {
            name: name(size),
            summary: "Does nothing.".into(),
            parameters: Vec::new(),
            truth: Vec::new(),
            measured: fields("measured", size),
            commands: fields("command", size / 2),
            faults: Vec::new(),
        },
        start: |_| Ok(Box::new(NullPlant)),
    }
}

fn law(size: usize) -> LawKind {
    LawKind {
        description: LawDescription {
            name: name(size),
            summary: "Does nothing.".into(),
            plants: vec![name(size)],
            parameters: Vec::new(),
            model: Vec::new(),
            measured: fields("measured", size),
            reference: Vec::new(),
            commands: Some(fields("command", size / 2)),
            internals: Vec::new(),
        },
        start: |_| Ok(Box::new(NullLaw)),
    }
}

/// Is the plant or the controller process, if this program was started as one.
pub(crate) fn answered() -> Option<ExitCode> {
    let started_as = std::env::args().next()?;
    match Path::new(&started_as).file_name()?.to_str()? {
        PLANT => Some(plant_process::program::run(
            PLANT,
            "0",
            SIZES.map(plant).into(),
        )),
        CONTROLLER => Some(controller_process::program::run(
            CONTROLLER,
            "0",
            SIZES.map(law).into(),
        )),
        _ => None,
    }
}

/// Round trips instead of records.
struct RoundTrips<'a> {
    layout: RecordLayout,
    taken_ns: &'a mut Vec<u64>,
}

impl RecordSink for RoundTrips<'_> {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.layout = layout.clone();
        Ok(())
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        Ok(true)
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.taken_ns
            .push(self.layout.view(words).timing.round_trip_ns);
        Ok(())
    }

    fn event(&mut self, _event: &Event) -> Result<(), LinkError> {
        Ok(())
    }
}

/// p50 and p99 of the round trip in ns, and the whole step in ns.
type Figures = [f64; 3];

/// A run that nobody observes: the engine here, the controller in a process of its own.
fn unobserved(programs: &Path, size: usize) -> Figures {
    let session = Session::create(None).expect("a session");
    let info = session.info();
    let rate = Rate::new(RATE_HZ).expect("a rate");
    let wait_limit_s = 30.0;
    let controller_job = controller_process::job::Job {
        protocol: PROTOCOL,
        session: info.id,
        plant: name(size),
        law: name(size),
        parameters: Settings::default(),
        model: Settings::default(),
        rate,
        rate_divisor: 1,
        command_delay_steps: 0,
        realtime: shared_types::realtime::Settings::default(),
        wait_limit_s,
    };
    (info.write_file(controller_process::job::JOB_FILE, &controller_job)).expect("writes");
    let plant_job = plant_process::job::Job {
        protocol: PROTOCOL,
        session: info.id,
        run: Run {
            rate,
            steps: STEPS,
            seed: 1,
            clock: Clock::Lockstep,
            overrun: OverrunPolicy::CatchUp,
            deadline: 0.8,
        },
        plant: PlantPlan {
            model: name(size),
            substeps: 1,
            parameters: Settings::default(),
            limits: Vec::new(),
        },
        stimuli: Vec::new(),
        faults: Vec::new(),
        derived: Vec::new(),
        missed: Vec::new(),
        pause_at_s: None,
        observed: false,
        realtime: shared_types::realtime::Settings::default(),
        wait_limit_s,
    };
    let mut controller = Command::new(programs.join(CONTROLLER))
        .arg("--session")
        .arg(&info.folder)
        .stdin(Stdio::piped())
        .spawn()
        .expect("the controller");

    let mut taken_ns = Vec::with_capacity(STEPS as usize + 1);
    let sink = RoundTrips {
        layout: RecordLayout::default(),
        taken_ns: &mut taken_ns,
    };
    let link = IceoryxLink::create(info).expect("a link");
    let kind = plant(size);
    let mut engine = Engine::new(&kind, &[], plant_job, link, sink).expect("an engine");
    let supervision = Supervision::new();
    let limit = WaitLimit::from_seconds(wait_limit_s);
    let since_ns = shared_types::clock::monotonic_ns();
    plant_process::program::drive(&mut engine, Waiter::new(limit), &supervision).expect("a run");
    let took_ns = (shared_types::clock::monotonic_ns() - since_ns) as f64;
    let reason = engine.end().and_then(|end| end.reason.clone());
    assert_eq!(reason, None, "the run ended early");
    drop(engine);
    assert!(controller.wait().expect("it was started").success());

    taken_ns.pop(); // the last record answers no sample
    taken_ns.sort_unstable();
    let at = |share: f64| taken_ns[(share * (taken_ns.len() - 1) as f64) as usize] as f64;
    [at(0.5), at(0.99), took_ns / STEPS as f64]
}

/// A run by `hil run`, which records it.
fn recorded(programs: &Programs, folder: &Path, size: usize) -> Figures {
    let scenario = folder.join("null.toml");
    let (null, duration_s) = (name(size), STEPS as f64 / RATE_HZ);
    let text = format!(
        "schema = 1\nname = \"{null}\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = {RATE_HZ:?}\n\
         [plant]\nmodel = \"{null}\"\n[controller]\nlaw = \"{null}\"\n"
    );
    std::fs::write(&scenario, text).expect("writes");
    let text = |path: &Path| path.to_str().expect("a path in UTF-8").to_owned();
    let summary = programs.run(&[
        &text(&scenario),
        "--plant-bin",
        &text(&folder.join(PLANT)),
        "--controller-bin",
        &text(&folder.join(CONTROLLER)),
    ]);
    let number = |pointer: &str| {
        let value = summary.pointer(pointer).and_then(serde_json::Value::as_f64);
        value.unwrap_or_else(|| panic!("no {pointer} in {summary}"))
    };
    [
        number("/latency_ns/round_trip/p50"),
        number("/latency_ns/round_trip/p99"),
        1e9 * number("/wall_time_s") / STEPS as f64,
    ]
}

/// Measures both in turns and prints them.
pub(crate) fn compare(programs: &Programs) {
    let folder = TempDir::new().expect("a folder");
    let own = std::env::current_exe().expect("a path to this program");
    for started_as in [PLANT, CONTROLLER] {
        symlink(&own, folder.path().join(started_as)).expect("a link");
    }
    let bystanders = Bystanders::watch();
    let mut done: Vec<(String, Vec<Figures>)> = (SIZES.iter())
        .flat_map(|size| {
            ["unobserved", "recorded, lz4"].map(|how| format!("{size} signals, {how}"))
        })
        .map(|name| (name, Vec::new()))
        .collect();
    for _ in 0..ROUNDS {
        for (size, pair) in SIZES.into_iter().zip(done.chunks_exact_mut(2)) {
            pair[0].1.push(unobserved(folder.path(), size));
            pair[1].1.push(recorded(programs, folder.path(), size));
        }
    }
    let others = bystanders.share();

    println!(
        "null plant and controller, two processes, medians of {ROUNDS} runs of {STEPS} steps, \
         other programs took {:.0} % of the machine",
        100.0 * others
    );
    println!(
        "{:<29} {:>14} {:>14} {:>12}",
        "", "round trip p50", "round trip p99", "whole step"
    );
    let mut lines = Vec::new();
    for (name, figures) in done {
        let [p50, p99, step] = [0, 1, 2].map(|i| median(figures.iter().map(|f| f[i])));
        println!("{name:<29} {p50:>11.0} ns {p99:>11.0} ns {step:>9.0} ns");
        lines.push(json!({
            "run": name,
            "round_trip_p50_ns": p50,
            "round_trip_p99_ns": p99,
            "step_ns": step,
        }));
    }
    let line = json!({
        "bench": "loop/null",
        "machine": machine(),
        "rounds": ROUNDS,
        "others_share": others,
        "runs": lines,
    });
    println!("{line}\n");
}
