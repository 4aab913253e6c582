//! Table of all checks, in the order of the report: name, and the reason why the observation matters.
//!
//! The module of a check has the files that it reads, its grades and its remedy.

use super::finding::Check;

macro_rules! checks {
    ($($check:ident: $name:literal, $why:literal;)*) => {
        $(pub(crate) const $check: Check = Check::new($name, $why);)*
    };
}

checks! {
    // The current state.
    LOAD: "load", "other work occupies the cores and their caches";
    CORES: "cores", "plant and controller each spin on a core; everything else needs another";
    SMT: "smt", "threads of one core take each other's time";
    ISOLATION: "isolation", "the scheduler and its tick put other work on cores that are not isolated";
    QUOTA: "quota", "the processes of a control group stop once its quota is used up";
    PREEMPTION: "preemption", "kernel code that cannot be preempted delays wake-ups";
    THROTTLING: "throttling", "the kernel interrupts real-time work that never sleeps, every second";
    CLOCK_SOURCE: "clock_source", "a clock outside the processor is slow to read and coarse";
    GOVERNOR: "governor", "a processor that changes its clock rate works at changing speed";
    IDLE_STATES: "idle_states", "a core that sleeps deeply takes long to wake up";
    PRIORITY: "priority", "without real-time priority other work may run first";
    LOCKED_MEMORY: "locked_memory", "unlocked memory may have to be paged in during a step";
    HUGE_PAGES: "huge_pages", "the kernel stalls a process while it merges its pages into huge ones";
    SWAP: "swap", "swapped-out memory takes milliseconds to return";
    SHARED_MEMORY: "shared_memory", "frames and records of a session live in /dev/shm";
    SESSIONS: "sessions", "other sessions occupy the cores; dead ones keep shared memory";

    // Counters over an interval.
    VIRTUALISATION: "virtualisation", "a host may pause the whole machine at any time: the longest delays are due to it";
    INTERRUPTS: "interrupts", "each device interrupt takes some microseconds from its core";

    // Measurements.
    CONTENTION: "company", "a step waits while another program uses its core; an exclusive core helps most";
    WAKE_UP_IDLE: "wake_up_idle", "a paced or real-time step starts as late as its thread wakes up";
    PING_PONG: "ping_pong", "no exchange between two processes is faster than memory between their cores";
    GAPS: "gaps", "time taken from a spinning thread is missing in some step";
    WAKE_UP_LOADED: "wake_up_loaded", "a busy machine must not make a step late";
}
