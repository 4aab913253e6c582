//! Faults from another terminal: the same trajectory as from a scenario, at the step named in the answer, or a
//! refusal that changed nothing.

use std::collections::BTreeMap;
use std::time::Duration;

use hil_session::session::SessionInfo;
use serde_json::Value;
use shared_types::live::{Injected, Request, Response};
use shared_types::random::RandomStream;

use crate::support::harness::{EXPIRES_S, Rig, Run, until};
use crate::support::mcap_reader::Recording;
use crate::support::programs::shipped;

const SHORT: &str = "tests/scenarios/leakage.toml";
const LEAKAGE: &str = "inject leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5 --at 1";

fn inject(rig: &Rig, toml: &str) -> Result<Vec<Injected>, Vec<String>> {
    let toml = toml.to_owned();
    match rig.ask(&Request::Inject { toml }) {
        Response::Injected { faults } => Ok(faults),
        Response::Refused { problems } => Err(problems
            .into_iter()
            .map(|problem| problem.message)
            .collect()),
        other => panic!("{other:?}"),
    }
}

/// Returns the scenario without its faults.
fn healthy(rig: &Rig, scenario: &str) -> String {
    let text = shipped(scenario);
    let begin = text.find("[[faults]]").expect("it has faults");
    let end = begin
        + text[begin..]
            .find("[[derived]]")
            .expect("derived signals follow");
    let path = rig.write("healthy.toml", &(text[..begin].to_owned() + &text[end..]));
    path.display().to_string()
}

#[test]
fn a_fault_gives_one_trajectory_from_a_scenario_live_or_reconstructed() {
    let rig = Rig::new();
    let expected = rig.run(SHORT).expect(0).digest();

    let run = rig.start(&format!("{} --pause-at 0.5", healthy(&rig, SHORT)));
    rig.until_held_at(5000);
    rig.in_session(LEAKAGE).expect(0).prints(&["10000"]);
    rig.in_session("resume").expect(0);
    let live = run.finish().expect(0);
    assert_eq!(live.digest(), expected);
    let summary = live.summary();
    assert_eq!(summary["faults"][0]["source"], "cli", "{summary}");
    assert_eq!(summary["faults"][0]["effective_step"], 10_000);

    let written = rig.path("written.toml").display().to_string();
    let from = live.folder.display().to_string();
    rig.hil(&["scenario", "from", &from, "-o", &written])
        .expect(0);
    assert_eq!(rig.run(&written).expect(0).digest(), expected);
    rig.rerun(&live.folder, &[]).expect(0);
}

/// Generates a fault that a running plant must accept.
fn valid(random: &mut RandomStream, next_at_s: f64) -> String {
    let size = 1e-9 * (1.0 + random.uniform());
    let pick = |random: &mut RandomStream, list: &[&str]| {
        list[(random.uniform() * list.len() as f64) as usize].to_owned()
    };
    let signal = pick(
        random,
        &[
            "measured.surface_angle_rad",
            "measured.actuator1_velocity_mps",
            "reference.surface_angle_rad",
            "command.actuator2_valve_current_a",
        ],
    );
    let trigger = if random.uniform() < 0.5 {
        String::new()
    } else {
        format!("at_s = {}\n", next_at_s + 0.2 + random.uniform())
    };
    let action = match (random.uniform() * 6.0) as u32 {
        0 => format!(
            "kind = \"bias\"\n{trigger}[[faults.effects]]\ntarget = \"{signal}\"\nbias = {size}"
        ),
        1 => format!(
            "kind = \"scale\"\n{trigger}[[faults.effects]]\ntarget = \"{signal}\"\nfactor = {}",
            1.0 + size
        ),
        2 => format!(
            "kind = \"noise\"\n{trigger}[[faults.effects]]\ntarget = \"{signal}\"\nstandard_deviation = {size}"
        ),
        3 => format!(
            "kind = \"delay\"\n{trigger}[[faults.effects]]\ntarget = \"{signal}\"\nsteps = 1"
        ),
        4 => format!(
            "kind = \"late\"\n{trigger}[[faults.effects]]\ntarget = \"controller\"\nbusy_us = 5"
        ),
        _ => format!(
            "kind = \"leakage\"\n{trigger}[[faults.effects]]\nactuator = 1\ncoefficient_m3ps_per_sqrt_pa = {}\nspeed_per_s = 10",
            1e-9 * random.uniform()
        ),
    };
    // Short, so that a thousand do not act at once.
    action.replacen(
        "[[faults.effects]]",
        "duration_s = 0.01\n[[faults.effects]]",
        1,
    )
}

#[test]
fn a_thousand_live_faults_take_hold_at_the_answered_steps() {
    let rig = Rig::new();
    let scenario = healthy(&rig, SHORT);
    // Slow motion, in which no more steps are recorded than the answers need, and the sides sleep.
    let run = rig.start(&format!(
        "{scenario} --set run.duration_s=100000 --set controller.law=pid --pace 0.02"
    ));
    let mut random = RandomStream::new(1, "valid faults");
    let mut answered = BTreeMap::new();
    for number in 0..1000 {
        let toml = format!("[[faults]]\n{}\n", valid(&mut random, rig.status().time_s));
        let faults = inject(&rig, &toml).unwrap_or_else(|e| panic!("{number}: {toml}: {e:?}"));
        for fault in faults {
            answered.insert(fault.id, fault.effective_step.expect("known"));
        }
    }
    let last = *answered.values().max().expect("a thousand");
    until("the last has taken effect", || rig.status().step > last + 2);
    run.signal(rustix::process::Signal::INT);
    let run = run.finish().expect(130);
    let recording = Recording::open(&run.recording());
    let taken: BTreeMap<u32, u64> = (recording.events.iter())
        .filter(|event| event["event"] == "fault")
        .map(|event| {
            let id = event["id"].as_u64().expect("a number") as u32;
            (id, event["step"].as_u64().expect("a number"))
        })
        .collect();
    assert_eq!(answered.len(), 1000);
    assert_eq!(taken, answered);
    assert_eq!(recording.digest(|_| ()), run.digest());
}

/// Generates a fault that must be refused, for one of a dozen reasons.
fn invalid(random: &mut RandomStream) -> String {
    let odd = format!("x{}", (random.uniform() * 1e6) as u32);
    let effect = |kind: &str, effect: &str| {
        format!("[[faults]]\nkind = \"{kind}\"\n[[faults.effects]]\n{effect}\n")
    };
    let angle = "target = \"measured.surface_angle_rad\"";
    match (random.uniform() * 12.0) as u32 {
        0 => effect(&odd, angle),
        1 => effect("bias", &format!("target = \"measured.{odd}\"\nbias = 1")),
        2 => effect("bias", &format!("{angle}\nbias = \"{odd}\"")),
        3 => effect("bias", &format!("{angle}\n{odd} = 1\nbias = 1")),
        4 => effect(
            "leakage",
            "actuator = 3\ncoefficient_m3ps_per_sqrt_pa = 1e-7\nspeed_per_s = 1",
        ),
        5 => effect(
            "leakage",
            &format!(
                "actuator = 1\ncoefficient_m3ps_per_sqrt_pa = {}\nspeed_per_s = 1",
                -1.0 - random.uniform()
            ),
        ),
        6 => effect(
            "bias",
            "target = \"parameter.actuator1.piston_mass_kg\"\nbias = 1",
        ),
        7 => effect("message-loss", angle),
        8 => effect("bias", &format!("{angle}\nbias = 1")).replacen("kind", "at_s = 0.0\nkind", 1),
        9 => effect("bias", &format!("{angle}\nbias = 1")).replacen("kind", "at_s = 1e9\nkind", 1),
        10 => effect("bias", &format!("{angle}\nbias = 1")).replacen(
            "kind",
            "when = \"truth.x >\"\nkind",
            1,
        ),
        _ => odd,
    }
}

#[test]
fn a_thousand_impossible_faults_are_refused_with_a_reason_and_change_nothing() {
    let rig = Rig::new();
    let scenario = healthy(&rig, SHORT);
    let expected = rig.run(&scenario).expect(0).digest();
    let run = rig.start(&format!("{scenario} --pause-at 0.5"));
    rig.until_held_at(5000);
    let mut random = RandomStream::new(2, "invalid faults");
    for number in 0..1000 {
        let toml = invalid(&mut random);
        let reasons = inject(&rig, &toml).expect_err(&toml);
        assert!(
            !reasons.is_empty() && reasons.iter().all(|reason| reason.len() > 5),
            "{toml}"
        );
        if number % 100 == 99 {
            // The others arrive while the loop is running.
            rig.ask(&Request::Advance { steps: 500 });
        }
    }
    rig.ask(&Request::Resume);
    let run = run.finish().expect(0);
    assert_eq!(run.digest(), expected);
    assert_eq!(run.summary()["faults"], Value::Array(vec![]));
}

#[test]
fn a_pause_of_any_length_changes_nothing() {
    let rig = Rig::new();
    let expected = rig.run(SHORT).expect(0).digest();
    // Paused for longer than the controller's wait limit, which every frame of the pause renews.
    let run = rig.start(&format!("{SHORT} --pause-at 0.5 --wait-limit {EXPIRES_S}"));
    rig.until_held_at(5000);
    std::thread::sleep(Duration::from_secs_f64(1.5 * EXPIRES_S));
    rig.in_session("step 3").expect(0).prints(&["5003"]);
    rig.until_held_at(5003);
    rig.in_session("resume").expect(0);
    assert_eq!(run.finish().expect(0).digest(), expected);
}

#[test]
fn a_paced_run_continues_at_its_pace_after_a_pause() {
    let rig = Rig::new();
    let expected = rig.run(SHORT).expect(0).digest();
    let run = rig.start(&format!("{SHORT} --pace 4"));
    let Response::Status(held) = rig.ask(&Request::Pause) else {
        panic!("not held");
    };
    until("the run is held", || rig.status().paused);
    assert!(rig.status().step <= held.step + 1);
    rig.ask(&Request::Resume);
    assert_eq!(run.finish().expect(0).digest(), expected);
}

#[test]
fn a_paused_run_ends_on_an_interruption_or_the_loss_of_its_controller() {
    let rig = Rig::new();
    let run = rig.start(&format!("{SHORT} --pause-at 0.5"));
    rig.until_held_at(5000);
    run.signal(rustix::process::Signal::INT);
    run.finish().expect(130);

    let run = rig.start(&format!("{SHORT} --pause-at 0.5"));
    rig.until_held_at(5000);
    let session = SessionInfo::read(&rig.session_folder()).expect("the session is there");
    session.children[1].kill();
    run.finish().expect(3).says(&["controller"]);
}

fn refused(run: Run, fragments: &[&str]) {
    run.expect(2).says(fragments);
}

#[test]
fn without_a_session_injection_is_refused() {
    let rig = Rig::new();
    refused(
        rig.hil(&["inject", "bias", "measured.x", "1"]),
        &["no session", "hil run"],
    );
}

#[test]
fn an_impossible_injection_is_refused_with_the_possible_ones() {
    let rig = Rig::new();
    let run = rig.start(&format!("{SHORT} --pause-at 0.5"));
    rig.until_held_at(5000);
    let inject = |arguments: &str| rig.in_session(&format!("inject {arguments}"));
    refused(
        inject("bais measured.surface_angle_rad 1"),
        &["bais", "bias"],
    );
    refused(
        inject("bias measured.surface_angel_rad 1"),
        &["surface_angel_rad", "surface_angle_rad"],
    );
    refused(
        inject("leakage --actuator 3 --coefficient 1e-7 --speed 1"),
        &["3", "1"],
    );
    refused(
        inject("leakage --actuator 1 --coefficient 1 --speed 1"),
        &["coefficient", "m3/s/sqrt(Pa)"],
    );
    refused(
        inject("bias measured.surface_angle_rad 1 --at 0.2"),
        &["past", "step 5000"],
    );
    refused(inject("bias measured.surface_angle_rad"), &["bias"]);
    refused(inject("--clear 77"), &["77"]);
    let listed = inject("--list").expect(0).stdout;
    for kind in ["leakage", "bias", "message-loss", "late", "hard-over"] {
        assert!(listed.contains(kind), "no {kind} in {listed}");
    }

    inject("bias measured.surface_angle_rad 0.001 --ramp 50ms")
        .expect(0)
        .prints(&["step 5000"]);
    rig.ask(&Request::Advance { steps: 10 });
    assert!(inject("--active").expect(0).stdout.contains("bias"));
    inject("--clear all").expect(0);
    let ended = inject("--active").expect(0).stdout;
    assert!(!ended.contains("bias"), "{ended}");
    rig.ask(&Request::Resume);
    let summary = run.finish().expect(0).summary();
    let bias = &summary["faults"].as_array().expect("a list")[1];
    assert_eq!(
        (&bias["kind"], &bias["effective_step"]),
        (&"bias".into(), &5000.into())
    );
    let effect = &bias["effects"][0];
    assert_eq!(effect["ended_step"], 5010);
    // 10 steps of a ramp of 500: the last is 9 / 500 of the size.
    let largest = effect["max_effect"].as_f64().expect("a number");
    assert!((largest - 0.001 * 9.0 / 500.0).abs() < 1e-12, "{largest}");
}

#[test]
fn a_thousand_ended_faults_use_little_memory_in_the_plant() {
    const FAULTS: u32 = 1000;
    let rig = Rig::new();
    let run = rig.held();
    let [plant, _] = run.children_at_once();
    let resident_kib = || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", plant.pid)).expect("lives");
        let line = status.lines().find(|line| line.starts_with("VmRSS:"));
        let number =
            line.and_then(|line| line.split_ascii_whitespace().nth(1)?.parse::<u64>().ok());
        number.expect("a number")
    };
    let fault = "[[faults]]\nkind = \"message-delay\"\n\
                 [[faults.effects]]\ntarget = \"link.sample\"\nsteps = 1\n";
    let pass = |times: u32| {
        for _ in 0..times {
            let faults = inject(&rig, fault).expect("it can be");
            let id = Some(faults[0].id);
            assert!(matches!(
                rig.ask(&Request::Clear { id }),
                Response::Cleared { .. }
            ));
        }
    };
    pass(50); // allocates everything that is allocated once
    let before = resident_kib();
    pass(FAULTS);
    let each_kib = (resident_kib().saturating_sub(before)) as f64 / f64::from(FAULTS);
    println!("{each_kib:.2} KiB each");
    assert!(each_kib < 4.0, "{each_kib} KiB each");
    run.signal(rustix::process::Signal::INT);
    run.finish().expect(130);
}
