//! Granted settings match what the system reports. Each test uses its own thread.

use rustix::thread::sched_getcpu;

use super::*;

/// Runs work on a short-lived thread.
fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    std::thread::spawn(work).join().expect("no panic")
}

/// Returns the cores on which tests may run.
fn cores() -> Vec<u32> {
    let set = sched_getaffinity(None).expect("the cores of this thread");
    let all = 0..u32::try_from(CpuSet::MAX_CPU).expect("few cores");
    all.filter(|core| set.is_set(*core as usize)).collect()
}

/// Reads policy and priority of the calling thread independently of the code under test: fields 41 and 40 of its
/// `stat`.
fn class() -> (u32, u32) {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("reads");
    let (_, after_name) = stat.rsplit_once(')').expect("a name");
    let fields: Vec<&str> = after_name.split_ascii_whitespace().collect();
    let field = |number: usize| fields[number - 3].parse().expect("a number");
    (field(41), field(40))
}

#[test]
fn settings_that_are_not_requested_stay_unchanged() {
    let (before, report, after) = aside(|| {
        let before = (class(), cores());
        (before, apply(&Settings::default()), (class(), cores()))
    });
    assert_eq!(before, after);
    assert_eq!((report.core.reason, report.priority.reason), (None, None));
    assert_eq!((report.priority.granted, report.timer_slack_ns), (0, 1));
    assert_eq!(
        (report.lock_memory.granted, report.prefault.granted),
        (false, false)
    );
}

#[test]
fn a_loop_runs_on_its_core() {
    for core in cores() {
        let settings = Settings {
            core: Some(core),
            ..Settings::default()
        };
        let (report, actual_core) = aside(move || (apply(&settings), sched_getcpu()));
        assert_eq!(report.core.granted, Some(core));
        assert_eq!(report.core.reason, None);
        assert_eq!(actual_core, core as usize);
    }
}

#[test]
fn a_missing_core_is_refused_with_the_reason() {
    for core in [1023, 5000] {
        let settings = Settings {
            core: Some(core),
            ..Settings::default()
        };
        let report = aside(move || apply(&settings));
        assert_ne!(report.core.granted, Some(core));
        let reason = report.core.refusal(&None).expect("a reason").to_owned();
        assert!(reason.to_lowercase().contains("invalid"), "{reason}");
    }
}

#[test]
fn a_priority_is_granted_or_refused_with_the_reason() {
    const FIFO: u32 = 1;
    let settings = Settings {
        priority: 7,
        ..Settings::default()
    };
    let (report, class) = aside(move || (apply(&settings), class()));
    if report.priority.granted == 7 {
        assert_eq!(class, (FIFO, 7));
        assert_eq!(report.priority.reason, None);
    } else {
        assert_eq!((class, report.priority.granted), ((0, 0), 0));
        let reason = report.priority.refusal(&0).expect("a reason");
        assert!(reason.contains("Operation not permitted"), "{reason}");
    }
}

#[test]
fn no_side_spins_if_both_share_one_core() {
    let cores = cores();
    let first = cores[0];
    let mut cases = vec![(Some(first), Some(first), WaitStrategy::Hybrid)];
    if let [first, second, ..] = cores[..] {
        // A core of its own, but shared with the other side.
        cases.push((Some(first), Some(second), WaitStrategy::Spin));
        cases.push((Some(first), None, WaitStrategy::Spin));
        cases.push((None, Some(first), WaitStrategy::Spin));
    }
    for (core, peer_core, wait) in cases {
        let settings = Settings {
            core,
            peer_core,
            wait: WaitStrategy::Spin,
            ..Settings::default()
        };
        let report = aside(move || apply(&settings));
        assert_eq!(report.wait.granted, wait, "{core:?} {peer_core:?}");
        let shared = wait != WaitStrategy::Spin;
        assert_eq!(report.wait.reason.is_some(), shared);
    }
}

#[test]
fn a_reason_is_given_only_for_a_difference() {
    let reason = || Some("no".to_owned());
    assert_eq!(Granted::new(3, 3, reason()).reason, None);
    assert_eq!(Granted::new(3, 0, reason()).refusal(&0), Some("no"));
    // More than requested is reported, but is no refusal.
    let more = Granted::new(false, true, reason());
    assert_eq!(
        (more.reason.as_deref(), more.refusal(&false)),
        (Some("no"), None)
    );
}
