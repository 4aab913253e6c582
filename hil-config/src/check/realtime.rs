//! `[realtime]`: settings requested from the system. The existence of the cores is not checked, because a scenario may
//! be checked on another machine than the one on which it runs.

use shared_types::wait::WaitStrategy;

use crate::plan::Realtime;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Returns the settings; without the section nothing is requested.
pub(super) fn check(reader: &mut Reader, root: &Section<'_>) -> Option<Realtime> {
    let Some(section) = reader.section(root, "realtime") else {
        return Some(Realtime::default());
    };
    reader.refuse_unknown(&section, &[]);
    let mut optional = |name| {
        let is_present = section.table.get(name).is_some();
        let value = reader.integer(&section, name).map(as_u32);
        (value.is_some() || !is_present).then_some(value)
    };
    let plant_core = optional("plant_core");
    let controller_core = optional("controller_core");
    let recorder_core = optional("recorder_core");
    let dma_latency_us = optional("dma_latency_us");
    let priority = reader.integer(&section, "priority").map(as_u32);
    let lock_memory = reader.boolean(&section, "lock_memory");
    let prefault = reader.boolean(&section, "prefault");
    let wait = reader.text(&section, "wait").and_then(|name| {
        let mut strategies = WaitStrategy::ALL.into_iter();
        strategies.find(|strategy| strategy.name() == name)
    });
    let realtime = Realtime {
        plant_core: plant_core?,
        controller_core: controller_core?,
        recorder_core: recorder_core?,
        priority: priority?,
        lock_memory: lock_memory?,
        prefault: prefault?,
        dma_latency_us: dma_latency_us?,
        wait: wait?,
    };
    refuse_blocking(reader, &section, &realtime);
    Some(realtime)
}

/// Converts a value to `u32`: ranges begin at 0 and end far below the limit.
fn as_u32(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

/// Refuses settings under which one side would keep the other side from running on its core.
fn refuse_blocking(reader: &mut Reader, section: &Section<'_>, realtime: &Realtime) {
    let mut mismatch = |key, message: String, expected| {
        (reader.report_at(section, key, ProblemKind::Mismatch, message)).expected(expected);
    };
    if let (Some(core), WaitStrategy::Spin) = (realtime.plant_core, realtime.wait)
        && realtime.controller_core == Some(core)
    {
        mismatch(
            "wait",
            format!("plant and controller share core {core}, and neither would yield it"),
            "`yield` or `hybrid`, or a core for each side",
        );
    }
    let sides = [realtime.plant_core, realtime.controller_core];
    if let Some(core) = realtime.recorder_core
        && realtime.priority > 0
        && sides.contains(&Some(core))
    {
        mismatch(
            "recorder_core",
            format!(
                "core {core} is used by a loop of priority {}",
                realtime.priority
            ),
            "another core, because the recorder has ordinary priority and would hardly ever run",
        );
    }
}
