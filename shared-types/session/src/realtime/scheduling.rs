//! Core and scheduling priority of a thread.

use std::io;

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id, thread_schedule_policy_param,
};

const FIFO: ThreadSchedulePolicy =
    ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);

/// Pins the calling thread to one core.
///
/// # Errors
/// If the core does not exist or may not be used.
pub fn pin(core: u32) -> io::Result<()> {
    if core as usize >= CpuSet::MAX_CPU {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    let mut only = CpuSet::new();
    only.set(core as usize);
    Ok(sched_setaffinity(None, &only)?)
}

/// Returns the only core on which the calling thread may run; `None` if there are several.
#[must_use]
pub fn only_core() -> Option<u32> {
    let set = sched_getaffinity(None).ok()?;
    if set.count() != 1 {
        return None;
    }
    let core = (0..CpuSet::MAX_CPU).find(|core| set.is_set(*core))?;
    u32::try_from(core).ok()
}

/// Gives the calling thread a `SCHED_FIFO` priority.
pub(super) fn run_at(priority: u32) -> Result<(), String> {
    let value = u8::try_from(priority).ok();
    let value = value.and_then(|value| ThreadPriorityValue::try_from(value).ok());
    let value = value.ok_or_else(|| format!("there is no priority {priority}"))?;
    let value = ThreadPriority::Crossplatform(value);
    set_thread_priority_and_policy(thread_native_id(), value, FIFO).map_err(|error| match error {
        Error::OS(code) => io::Error::from_raw_os_error(code).to_string(),
        other => other.to_string(),
    })
}

/// Returns the `SCHED_FIFO` priority of the calling thread; 0 in any other class.
pub(super) fn priority() -> u32 {
    match thread_schedule_policy_param(thread_native_id()) {
        Ok((policy, parameters)) if policy == FIFO => parameters.sched_priority.unsigned_abs(),
        _ => 0,
    }
}
