//! `[realtime]`.

use super::{Key, KeyKind, choice, integer, integer_or};

/// Highest core number that Linux accepts.
const MAX_CORE: i64 = 1023;
/// Highest priority: 99 is for the kernel's own threads.
const MAX_PRIORITY: i64 = 98;
/// Longest latency in us that makes a difference: no processor has a slower wake-up.
const MAX_LATENCY_US: i64 = 1_000_000;

const CORE: KeyKind = integer(0, MAX_CORE);

/// `[realtime]`.
pub(crate) const REALTIME: &[Key] = keys! {
    plant_core: CORE, "The only core that the plant's loop may run on. Default: any.";
    controller_core: CORE, "The only core that the controller's loop may run on. Default: any.";
    recorder_core: CORE, "The only core that the recorder may run on. Default: any.";
    dma_latency_us: integer(0, MAX_LATENCY_US),
        "Longest allowed wake-up time of a core during the run, in us; 0 keeps all cores awake. Default: the setting of the system.";
    priority: integer_or(0, MAX_PRIORITY, 0),
        "SCHED_FIFO priority of the loops of plant and controller; 0: ordinary scheduling.";
    lock_memory: KeyKind::Boolean { default: false },
        "Lock the memory of plant and controller in RAM once it is in use.";
    prefault: KeyKind::Boolean { default: false },
        "Load all memory of plant and controller into RAM before step 0, by locking it.";
    wait: choice(&["hybrid", "spin", "yield", "sleep"]),
        "Waiting strategy of both sides: hybrid polls, then yields the core or sleeps, depending on earlier waits; spin polls and never yields the core; yield yields the core after each poll; sleep sleeps until the other side sends.";
};
