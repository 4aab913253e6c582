//! `[realtime]`.

use super::{Key, KeyKind, integer};

/// Highest number of a core that Linux can be asked for.
const MAX_CORE: i64 = 1023;
/// Highest priority: 99 is for the kernel's own threads.
const MAX_PRIORITY: i64 = 98;
/// Longest latency in us that makes a difference: no processor sleeps so deep.
const MAX_LATENCY_US: i64 = 1_000_000;

const CORE: KeyKind = KeyKind::Integer {
    min: 0,
    max: MAX_CORE,
    default: None,
};

/// `[realtime]`.
pub(crate) const REALTIME: &[Key] = &[
    Key::new(
        "plant_core",
        CORE,
        "The only core that the plant's loop may run on. Default: any.",
    ),
    Key::new(
        "controller_core",
        CORE,
        "The only core that the controller's loop may run on. Default: any.",
    ),
    Key::new(
        "recorder_core",
        CORE,
        "The only core that the recorder may run on. Default: any.",
    ),
    Key::new(
        "dma_latency_us",
        KeyKind::Integer {
            min: 0,
            max: MAX_LATENCY_US,
            default: None,
        },
        "Longest time in us that a core may need to wake up during the run; 0 keeps all cores awake. Default: as the system has it.",
    ),
    Key::new(
        "priority",
        integer(0, MAX_PRIORITY, 0),
        "SCHED_FIFO priority of the loops of plant and controller; 0: ordinary scheduling.",
    ),
    Key::new(
        "lock_memory",
        KeyKind::Boolean { default: false },
        "Keep the memory of plant and controller from being taken away once it is there.",
    ),
    Key::new(
        "prefault",
        KeyKind::Boolean { default: false },
        "Fetch all memory of plant and controller before step 0, by locking it.",
    ),
    Key::new(
        "wait",
        KeyKind::Text {
            choices: &["hybrid", "spin", "yield", "sleep"],
            default: Some("hybrid"),
        },
        "How each side waits for the other: hybrid polls, then gives the core away or sleeps, by what the waits before have shown; spin never gives the core away; yield gives it away after each poll; sleep sleeps until the other side sends.",
    ),
];
