//! Tests that take minutes: many runs over a disturbed wire, many cuts, whole scenarios on another processor.
//! `.ci/run long`.

use std::time::Duration;

use shared_types::random::RandomStream;

use super::processor::on_another_processor;
use super::wire::nothing_left_on_board;
use super::{SHORT, log, text, under_way};
use crate::support::guest::Guest;
use crate::support::harness::Rig;
use crate::support::hosts::Hosts;

const ALL_OF_IT: &str = "scenarios/spring-mass.toml --no-record";

#[test]
#[ignore = "long: .ci/run long"]
fn a_hundred_runs_over_a_disturbed_wire_have_one_digest() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let here = rig.run(ALL_OF_IT).expect(0).summary();
    for seed in 0..100 {
        hosts.order(&format!("spoil 5 {seed}"));
        let there = hosts.start(&rig, ALL_OF_IT);
        assert_eq!(
            there.finish().expect(0).summary()["digest"],
            here["digest"],
            "seed {seed}"
        );
    }
    nothing_left_on_board(&hosts);
}

#[test]
#[ignore = "long: .ci/run long"]
fn the_papers_severe_leakage_over_a_disturbed_wire_has_its_digest() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let severe = "scenarios/severe-leakage.toml --no-record";
    let here = rig.run(severe).expect(0).summary();
    hosts.order("spoil 5 1");
    let there = hosts.start(&rig, severe);
    assert_eq!(
        there.finish_late().expect(0).summary()["digest"],
        here["digest"]
    );
    nothing_left_on_board(&hosts);
}

#[test]
#[ignore = "long: .ci/run long"]
fn two_hundred_random_cuts_cause_no_hang_and_no_stale_command() {
    let Some(mut hosts) = Hosts::new() else {
        return;
    };
    let rig = Rig::new();
    let paced = "scenarios/spring-mass.toml --no-record --set run.duration_s=0.8 --set metrics=[] --set requirements=[] --pace 0.5";
    let here = rig.run(paced).expect(0).summary();
    let mut random = RandomStream::new(1, "cuts");
    let (mut whole, mut cut) = (0, 0);
    for number in 0..200 {
        let running = hosts.start(&rig, &format!("{paced} --wait-limit 1"));
        // Some cuts before the first step, most of them while steps are exchanged.
        if number % 8 > 0 {
            under_way(&rig);
        }
        std::thread::sleep(Duration::from_millis((random.uniform() * 800.0) as u64));
        hosts.order("cut");
        // Every second cut is repaired before a timeout.
        if number % 2 == 0 {
            std::thread::sleep(Duration::from_millis((random.uniform() * 500.0) as u64));
            hosts.order("mend");
        }
        let run = running.finish();
        match run.code {
            // A complete run equals that of the desk: no command of another step was ever accepted.
            Some(0) => {
                assert_eq!(run.summary()["digest"], here["digest"], "cut {number}");
                whole += 1;
            }
            Some(3) => cut += 1,
            code => panic!("cut {number}: {code:?}\n{}{}", run.stderr, log(&run)),
        }
        hosts.order("mend");
        nothing_left_on_board(&hosts);
    }
    assert!(whole > 20 && cut > 20, "{whole} whole, {cut} cut");
}

#[test]
#[ignore = "long: .ci/run long"]
fn the_papers_severe_leakage_on_another_processor_has_its_digests() {
    on_another_processor("scenarios/severe-leakage.toml");
}

#[test]
#[ignore = "long: .ci/run long"]
fn a_separate_kernel_is_evidence_of_pil_and_in_real_time_of_hil() {
    // Eighty steps: a frame takes milliseconds to an emulated processor and back.
    let few = format!("{SHORT} --set run.rate_hz=100");
    let rig = Rig::new();
    // Not in the test's folder, because the guest outlives a run.
    let folder = tempfile::tempdir().expect("a folder");
    let key = folder.path().join("board.key");
    rig.hil(&["target", "key", text(&key)]).expect(0);
    let Some(guest) = Guest::new(folder.path(), &key) else {
        return;
    };
    let here = rig.run(&few).expect(0).summary();
    let there = rig
        .run(&format!("{few} --wait-limit 60 {}", guest.target))
        .expect(0);
    let summary = there.summary();
    assert_eq!(summary["digest"], here["digest"]);
    assert_eq!(summary["evidence"], "pil", "{summary}");
    let kernel = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").expect("it is there");
    assert_ne!(summary["target"]["boot_id"], kernel.trim());
    let result = summary["target"]["kernel"].as_str().expect("its kernel");
    assert_eq!(result.split(' ').next(), Some(&*guest.kernel));
    let clock = "--clock realtime --wait-limit 60";
    let there = rig
        .run(&format!("{few} {clock} {}", guest.target))
        .expect(0);
    assert_eq!(there.summary()["evidence"], "hil");
    rig.rerun(&there.folder, &[]).expect(0);
}
