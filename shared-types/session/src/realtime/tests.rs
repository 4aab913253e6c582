//! Settings are granted as the system reports them afterwards. Each test has a thread of its own.

use rustix::thread::sched_getcpu;

use super::*;

/// Does something on a thread that ends with it.
fn aside<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> T {
    std::thread::spawn(work).join().expect("no panic")
}

/// The cores that tests may run on.
fn cores() -> Vec<u32> {
    let set = sched_getaffinity(None).expect("the cores of this thread");
    let all = 0..u32::try_from(CpuSet::MAX_CPU).expect("few cores");
    all.filter(|core| set.is_set(*core as usize)).collect()
}

/// Policy and priority of the calling thread, as the kernel tells them elsewhere than asked here:
/// the 41st and 40th field of its `stat`.
fn class() -> (u32, u32) {
    let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("reads");
    let (_, after_name) = stat.rsplit_once(')').expect("a name");
    let fields: Vec<&str> = after_name.split_ascii_whitespace().collect();
    let field = |number: usize| fields[number - 3].parse().expect("a number");
    (field(41), field(40))
}

#[test]
fn what_nobody_asks_for_is_not_changed() {
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
        let (report, found) = aside(move || (apply(&settings), sched_getcpu()));
        assert_eq!(report.core.granted, Some(core));
        assert_eq!(report.core.reason, None);
        assert_eq!(found, core as usize);
    }
}

#[test]
fn a_core_that_is_not_there_is_not_granted_and_the_reason_is_told() {
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
fn a_priority_is_granted_or_the_reason_is_told() {
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
fn nobody_spins_where_both_sides_have_one_core_together() {
    let cores = cores();
    let first = cores[0];
    let mut cases = vec![(Some(first), Some(first), WaitStrategy::Hybrid)];
    if let [first, second, ..] = cores[..] {
        // Alone on its core, but not alone with the other side.
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
fn a_reason_stands_only_where_something_differs() {
    let refused = || Some("no".to_owned());
    assert_eq!(Granted::new(3, 3, refused()).reason, None);
    assert_eq!(Granted::new(3, 0, refused()).refusal(&0), Some("no"));
    // More than was asked for is told, but is no refusal.
    let more = Granted::new(false, true, refused());
    assert_eq!(
        (more.reason.as_deref(), more.refusal(&false)),
        (Some("no"), None)
    );
}
