//! A step makes no system calls, except to sample its thread's statistics now and then, and allocates nothing.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use controller_process::laws;
use controller_process::runner::{Runner, choose};
use hil_session::clock::monotonic_ns;
use hil_session::link::iceoryx::IceoryxLink;
use hil_session::session::Session;
use hil_session::stream::{IceoryxSink, IceoryxSource};
use plant_process::engine::{Engine, Progress};
use plant_process::faults::kinds;
use plant_process::models;
use shared_types::link::{Link, in_process};
use shared_types::stream::{self, Backpressure, Item, RecordSink, RecordSource};

use crate::requirements::plan;
use crate::support::harness::Rig;
use crate::support::mcap_reader::Recording;
use crate::support::programs::{program, skip, works};

const SCENARIO: &str = "tests/scenarios/leakage.toml";
/// System calls of a wait: yielding the core, sleeping or waking the other side, and reading a clock outside the
/// vDSO.
const WAITING: [&str; 3] = ["sched_yield", "futex", "clock_gettime"];
/// System calls that sample the thread's statistics: every 1,024 steps, and after a step that took far too long.
const LOOKING: [&str; 2] = ["getcpu", "getrusage"];

/// Returns a program that traces itself once it is started for a run.
fn traced(rig: &Rig, name: &str) -> String {
    let (log, program) = (rig.path(&format!("{name}.strace")), program(name));
    let (log, program) = (log.display(), program.display());
    let text = format!(
        "#!/bin/sh\n\
         case \"$1\" in --session) exec strace -f --seccomp-bpf -ttt -e 'trace=!sched_yield' -o {log} '{program}' \"$@\" ;; esac\n\
         exec '{program}' \"$@\"\n"
    );
    let script = rig.script(&format!("traced-{name}"), &text);
    script.display().to_string()
}

/// Returns the time of each call in s since 1970, and its name. A call that waited counts at its start.
fn calls(log: &Path) -> Vec<(f64, String)> {
    let text = std::fs::read_to_string(log).unwrap_or_else(|e| panic!("{}: {e}", log.display()));
    let call = |line: &str| {
        let (_thread, rest) = line.split_once(' ')?;
        let (time_s, call) = rest.trim_start().split_once(' ')?;
        let (name, _) = call.split_once('(').filter(|_| !call.starts_with("<..."))?;
        Some((time_s.parse().ok()?, name.to_owned()))
    };
    text.lines().filter_map(call).collect()
}

#[test]
fn neither_process_makes_system_calls_between_the_first_and_the_last_step() {
    if !works(&["strace", "-V"]) {
        return skip("strace is missing", "HIL_TEST_STRACE");
    }
    let rig = Rig::new();
    let (plant, controller) = (
        traced(&rig, "plant-process"),
        traced(&rig, "controller-process"),
    );
    let binaries = format!("--plant-bin {plant} --controller-bin {controller}");
    let run = rig.run(&format!("{SCENARIO} {binaries}")).expect(0);

    let recording = Recording::open(&run.recording());
    let place = recording.place("published_ns");
    let times: Vec<u64> = recording
        .records()
        .map(|record| record.words[place])
        .collect();
    let since_1970 = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .expect("after 1970");
    let offset_s = since_1970.as_secs_f64() - monotonic_ns() as f64 / 1e9;
    let at_s = |time_ns: u64| offset_s + time_ns as f64 / 1e9;
    // Both clocks are read one after the other, a trace has microsecond resolution, and on a loaded machine a side
    // may take long to open the memory of the other's first sample: the ends are excluded.
    let (slack_s, ends) = (1e-3, 100);
    let begin_s = at_s(times[ends]) + slack_s;
    let end_s = at_s(times[times.len() - 1 - ends]) - slack_s;
    assert!(end_s - begin_s > 10.0 * slack_s);

    for name in ["plant-process", "controller-process"] {
        let calls = calls(&rig.path(&format!("{name}.strace")));
        // The trace works: it contains calls before and after.
        assert!(
            calls
                .iter()
                .any(|(time_s, name)| *time_s < begin_s && name == "mmap")
        );
        assert!(
            calls
                .iter()
                .any(|(time_s, name)| *time_s > end_s && name == "munmap")
        );
        let within = || {
            (calls.iter())
                .filter(|(time_s, _)| (begin_s..end_s).contains(time_s))
                .map(|(_, name)| name.as_str())
        };
        assert!(within().filter(|name| *name == "getrusage").count() > 10);
        let within: Vec<_> = within()
            .filter(|name| !WAITING.contains(name) && !LOOKING.contains(name))
            .collect();
        assert!(within.is_empty(), "{name}: {within:?}");
    }
}

/// Faults of every class that act at every step from 0.01 s on.
const FAULTS: &str = r#"
[[faults]]
kind = "noise"
at_s = 0.01
effects = [
  { target = "measured.surface_angle_rad", standard_deviation = 1e-6 },
  { target = "parameter.actuator1.bulk_modulus_pa", standard_deviation = 1e3 },
]

[[faults]]
kind = "delay"
at_s = 0.01
effects = [{ target = "command.actuator1_valve_current_a", steps = 3 }]

[[faults]]
kind = "dropout"
at_s = 0.01
effects = [{ target = "measured.actuator2_velocity_mps", profile = { kind = "intermittent", period_s = 0.001, duty = 0.1 } }]

[[faults]]
kind = "message-jitter"
at_s = 0.01
effects = [{ target = "link.sample", steps = 2 }]

[[faults]]
kind = "message-corruption"
at_s = 0.01
effects = [{ target = "link.command", probability = 0.5 }]

[[faults]]
kind = "skip"
at_s = 0.01
effects = [{ target = "controller", steps = 1, period_steps = 10 }]

[[faults]]
kind = "late"
at_s = 0.01
effects = [{ target = "plant", busy_us = 1 }]

[[faults]]
kind = "bias"
when = "tracking_error_rad > 1e9"
effects = [{ target = "reference.surface_angle_rad", bias = 1 }]
"#;

/// Returns the scenario's jobs for both sides.
fn jobs(session: u64) -> (plant_process::job::Job, controller_process::job::Job) {
    // Faults act while allocations are counted, but none begins then.
    let plan = plan(
        SCENARIO,
        FAULTS,
        &["faults[0].at_s=0.01", "controller.law=pid"],
    );
    let plant = plant_process::job::Job::of(&plan, session, 5.0);
    let (model, rate, plan) = (&plan.plant.model, plan.run.rate, plan.controller);
    let controller = controller_process::job::Job {
        parameters: plan.parameters,
        model: plan.model,
        rate_divisor: plan.rate_divisor,
        command_delay_steps: plan.command_delay_steps,
        ..controller_process::job::Job::new(session, model, &plan.law, rate, 5.0)
    };
    (plant, controller)
}

/// Counts allocations of engine, runner, link and sink in N steps, after as many for warm-up.
fn allocations_in<L: Link>(
    steps: u64,
    session: u64,
    (plant_link, controller_link): (L, L),
    (sink, mut source): (impl RecordSink, impl RecordSource),
) -> u64 {
    let (plant, controller) = jobs(session);
    let (plants, laws) = (models::all(), laws::all());
    let kind = plants
        .iter()
        .find(|kind| kind.description.name == plant.plant.model);
    let law = choose(&laws, &controller.law, &controller.plant).expect("a law");
    let mut engine = Engine::new(
        kind.expect("a plant"),
        &kinds::all(),
        plant,
        plant_link,
        sink,
    )
    .expect("starts");
    let mut runner = Runner::new(law, controller, controller_link).expect("starts");
    runner.begin().expect("says hello");

    // Records arrive one step late.
    let mut records = 0;
    let mut run_to = |step: u64| {
        while records < step {
            let progress = engine.poll().expect("the engine works");
            assert_ne!(progress, Progress::Over);
            runner.poll().expect("the runner works");
            // The recorder runs in another process and may allocate.
            allocation_counter::opt_out(|| {
                let mut count =
                    |item: Item<'_>| records += u64::from(matches!(item, Item::Record(_)));
                source.drain(&mut count).expect("the stream works");
            });
        }
    };
    run_to(steps);
    allocation_counter::measure(|| run_to(2 * steps)).count_total
}

#[test]
fn a_step_allocates_nothing() {
    let allocations = allocations_in(2000, 1, in_process::pair(), stream::in_process::pair());
    assert_eq!(allocations, 0);
}

/// iceoryx2 0.10.0 allocates once when a sample is loaned, which happens for every record. Frames, which use its
/// blackboard, allocate nothing.
#[test]
fn over_shared_memory_the_loan_of_a_record_is_the_only_allocation_of_a_step() {
    let _rig = Rig::new();
    let mut session = Session::create(None).expect("a session");
    (session.add_controller(1, std::process::id())).expect("noted");
    let info = session.info();
    let plant = IceoryxLink::create(info).expect("a link");
    let controller = IceoryxLink::open(info, 1).expect("a link");
    let sink = IceoryxSink::create(info, Backpressure::Always).expect("a stream");
    let source = IceoryxSource::open(info, true).expect("a stream");
    let allocations = allocations_in(2000, info.id, (plant, controller), (sink, source));
    assert_eq!(allocations, 2000);
}

#[test]
fn the_counter_sees_an_allocation() {
    let boxed = || drop(std::hint::black_box(Box::new(7)));
    assert_eq!(allocation_counter::measure(boxed).count_total, 1);
}
