//! A plant and a law that do nothing: the remaining time is the cost of engine, link, runner and record stream between
//! two processes.
//!
//! This program is also its own plant and controller process, distinguished by the name under which it was started.
//! A run by `hil run` is recorded. With the engine in this process, either nobody observes or N observers only read.

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use controller_process::controller::LawKind;
use hil_benchmark::null;
use hil_config::plan::Realtime;
use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::{Session, SessionInfo};
use hil_session::stream::{IceoryxSink, IceoryxSource};
use hil_session::supervision::Supervision;
use hil_session::waiter::Waiter;
use plant_process::engine::Engine;
use plant_process::plant::PlantKind;
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::{Backpressure, RecordSink, RecordSource};
use shared_types::wait::WaitLimit;
use tempfile::TempDir;

use crate::effort::shortened;
use crate::programs::Programs;

/// Signals in a sample; half as many commands answer them.
pub(crate) const SIZES: [usize; 4] = [8, 32, 128, 512];
/// Steps of a run.
const STEPS: u64 = 100_000;
/// Interval at which an observer reads records, short enough that its buffer never fills.
const LOOK: Duration = Duration::from_millis(1);
const RATE_HZ: f64 = 10_000.0;
/// Names under which this program is started.
const PLANT: &str = "null-plant";
const CONTROLLER: &str = "null-controller";

fn name(size: usize) -> String {
    format!("null{size}")
}

fn plant(size: usize) -> PlantKind {
    null::plant(&name(size), size, size / 2)
}

fn law(size: usize) -> LawKind {
    null::law(&name(size), size, size / 2, false)
}

/// Runs as the plant or the controller process, if this program was started as one.
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

/// Notes round trips, and publishes records if there are observers.
struct RoundTrips<'a> {
    layout: RecordLayout,
    taken_ns: &'a mut Vec<u64>,
    stream: Option<IceoryxSink>,
}

impl RecordSink for RoundTrips<'_> {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.layout = layout.clone();
        match &mut self.stream {
            Some(stream) => stream.open(layout),
            None => Ok(()),
        }
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        match &mut self.stream {
            Some(stream) => stream.has_room(),
            None => Ok(true),
        }
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        self.taken_ns
            .push(self.layout.view(words).timing.round_trip_ns);
        match &mut self.stream {
            Some(stream) => stream.record(words),
            None => Ok(()),
        }
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        match &mut self.stream {
            Some(stream) => stream.event(event),
            None => Ok(()),
        }
    }
}

/// Returns p50 and p99 of the round trip in ns, and the whole step in ns.
pub(crate) type Figures = [f64; 3];

/// A folder with this program under its other names.
pub(crate) struct Names(TempDir);

impl Names {
    pub(crate) fn given() -> Self {
        let folder = TempDir::new().expect("a folder");
        let own = std::env::current_exe().expect("a path to this program");
        for started_as in [PLANT, CONTROLLER] {
            symlink(&own, folder.path().join(started_as)).expect("a link");
        }
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

/// Reads the plant's records until the run is over, and discards them.
fn watch(session: &SessionInfo, is_over: &AtomicBool) {
    let mut source = IceoryxSource::open(session, false).expect("a stream");
    while !is_over.load(Ordering::Relaxed) {
        let taken = source.drain(&mut |item| {
            std::hint::black_box(item);
        });
        if taken.expect("a stream") == 0 {
            std::thread::sleep(LOOK);
        }
    }
}

/// A run with N observers and no recorder: the engine in this process, the controller in a process of its own, the
/// observers in threads.
pub(crate) fn watched(names: &Names, size: usize, observers: usize) -> Figures {
    let steps = shortened(STEPS);
    let mut session = Session::create(None).expect("a session");
    let info = &session.info().clone();
    let wait_limit_s = 30.0;
    let realtime = Realtime::default();
    let (plant_job, controller_job) =
        null::jobs(info, &name(size), None, steps, &realtime, wait_limit_s);
    (info.write_file(controller_process::job::JOB_FILE, &controller_job)).expect("writes");
    let mut controller = Command::new(names.path(CONTROLLER))
        .arg("--session")
        .arg(&info.folder)
        .stdin(Stdio::piped())
        .spawn()
        .expect("the controller");
    (session.add_controller(1, controller.id())).expect("noted");

    let mut taken_ns = Vec::with_capacity(steps as usize + 1);
    let stream = (observers > 0).then(|| IceoryxSink::create(info, Backpressure::None));
    let sink = RoundTrips {
        layout: RecordLayout::default(),
        taken_ns: &mut taken_ns,
        stream: stream.map(|stream| stream.expect("a stream")),
    };
    let link = IceoryxLink::create(info).expect("a link");
    let kind = plant(size);
    let mut engine = Engine::new(&kind, &[], plant_job, link, sink).expect("an engine");
    let waiter = Waiter::new(WaitLimit::from_seconds(wait_limit_s));
    let is_over = AtomicBool::new(false);
    let took_ns = std::thread::scope(|scope| {
        for _ in 0..observers {
            scope.spawn(|| watch(info, &is_over));
        }
        let since_ns = monotonic_ns();
        plant_process::program::drive(&mut engine, waiter, &Supervision::new()).expect("a run");
        let took_ns = monotonic_ns() - since_ns;
        is_over.store(true, Ordering::Relaxed);
        took_ns as f64
    });
    let reason = engine.end().and_then(|end| end.reason.clone());
    assert_eq!(reason, None, "the run ended early");
    drop(engine);
    assert!(controller.wait().expect("it was started").success());

    taken_ns.pop(); // the last record answers no sample
    taken_ns.sort_unstable();
    let at = |share: f64| taken_ns[(share * (taken_ns.len() - 1) as f64) as usize] as f64;
    [at(0.5), at(0.99), took_ns / steps as f64]
}

/// A run by `hil run` with these additional arguments.
pub(crate) fn run(programs: &Programs, names: &Names, size: usize, arguments: &[&str]) -> Figures {
    let steps = shortened(STEPS) as f64;
    let (null, duration_s) = (name(size), steps / RATE_HZ);
    let text = format!(
        "schema = 1\nname = \"{null}\"\n[run]\nduration_s = {duration_s:?}\nrate_hz = {RATE_HZ:?}\n\
         [plant]\nmodel = \"{null}\"\n[controller]\nlaw = \"{null}\"\n"
    );
    let paths = ["null.toml", PLANT, CONTROLLER].map(|name| names.path(name));
    let [scenario, plant, controller] =
        (paths.each_ref()).map(|path| path.to_str().expect("a path in UTF-8"));
    std::fs::write(scenario, text).expect("writes");
    let mut all = vec![
        scenario,
        "--plant-bin",
        plant,
        "--controller-bin",
        controller,
    ];
    all.extend(arguments);
    let summary = programs.run(&all);
    let number = |pointer: &str| {
        let value = summary.pointer(pointer).and_then(serde_json::Value::as_f64);
        value.unwrap_or_else(|| panic!("no {pointer} in {summary}"))
    };
    [
        number("/latency_ns/round_trip/p50"),
        number("/latency_ns/round_trip/p99"),
        1e9 * number("/wall_time_s") / steps,
    ]
}
