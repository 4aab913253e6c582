//! Cells of the table: busy loops, cores, priorities and quotas.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use hil_session::realtime::{apply, pin};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use shared_types::realtime::Settings;

use crate::busy::BusyLoop;
use crate::measure::cores;

/// Cores' worth of processor time in a cell with a quota.
const QUOTA_CORES: f64 = 1.5;

/// Situation in which a run is measured.
pub(crate) struct Cell {
    pub(crate) name: String,
    /// Busy loops, by nice value and core.
    loops: Vec<(i32, Option<usize>)>,
    /// True if the busy loops have a session of their own.
    elsewhere: bool,
    /// True if everything in the cell shares one core.
    one_core: bool,
    /// `SCHED_FIFO` priority of both sides.
    pub(crate) priority: u32,
    /// Version of the control groups whose quota covers everything in the cell, if any.
    quota_version: Option<u32>,
    /// Number of runs at once.
    pub(crate) sessions: usize,
}

/// Lists all cells.
pub(crate) fn cells() -> Vec<Cell> {
    let cores = cores();
    let each = |count: usize| -> Vec<(i32, Option<usize>)> {
        let cores = cores
            .iter()
            .flat_map(|core| std::iter::repeat_n(*core, count));
        cores.map(|core| (0, Some(core))).collect()
    };
    let plain = |name: &str| Cell {
        name: name.into(),
        loops: Vec::new(),
        elsewhere: false,
        one_core: false,
        priority: 0,
        quota_version: None,
        sessions: 1,
    };
    let mut cells = vec![plain("idle")];
    for (name, loops, one_core) in [
        ("a busy loop of nice 19", vec![(19, None)], false),
        ("a busy loop", vec![(0, None)], false),
        ("a busy loop on each core", each(1), false),
        ("two busy loops on each core", each(2), false),
        ("one core and a busy loop there", vec![(0, None)], true),
    ] {
        for elsewhere in [false, true] {
            let session = if elsewhere { "other" } else { "same" };
            cells.push(Cell {
                loops: loops.clone(),
                elsewhere,
                one_core,
                ..plain(&format!("{name}, {session} session"))
            });
        }
    }
    cells.push(Cell {
        one_core: true,
        ..plain("one core")
    });
    cells.push(Cell {
        priority: 10,
        ..plain("SCHED_FIFO for both")
    });
    for version in [1, 2] {
        cells.push(Cell {
            quota_version: Some(version),
            ..plain(&format!(
                "quota of {QUOTA_CORES} CPUs, control groups v{version}"
            ))
        });
    }
    cells.push(Cell {
        sessions: 4,
        ..plain("4 sessions at once")
    });
    cells
}

/// An established situation, which ends when it is dropped.
pub(crate) struct Within {
    loops: Vec<BusyLoop>,
    free: CpuSet,
    group: Option<(PathBuf, PathBuf)>,
}

impl Cell {
    /// Returns true if no other load runs in the cell.
    pub(crate) const fn is_alone(&self) -> bool {
        self.loops.is_empty() && self.sessions == 1
    }

    /// Establishes the situation for all processes started from now on.
    pub(crate) fn enter(&self) -> Result<Within, String> {
        let free = sched_getaffinity(None).map_err(|e| e.to_string())?;
        let mut within = Within {
            loops: Vec::new(),
            free,
            group: None,
        };
        if self.priority > 0 {
            let settings = Settings {
                priority: self.priority,
                ..Settings::default()
            };
            let applied = std::thread::spawn(move || apply(&settings)).join();
            let report = applied.map_err(|_| "a panic")?;
            if report.priority.granted != self.priority {
                return Err(report.priority.reason.unwrap_or_default());
            }
        }
        if self.one_core {
            pin(cores()[0] as u32).map_err(|e| e.to_string())?;
        }
        if let Some(version) = self.quota_version {
            within.group = Some(limited(version)?);
        }
        for (nice, core) in &self.loops {
            let busy = BusyLoop::start(*nice, *core, self.elsewhere);
            within.loops.push(busy.map_err(|e| e.to_string())?);
        }
        std::thread::sleep(Duration::from_millis(300)); // until all of them are at work
        Ok(within)
    }
}

impl Drop for Within {
    fn drop(&mut self) {
        self.loops.clear();
        let _ = sched_setaffinity(None, &self.free);
        if let Some((group, before)) = &self.group {
            let _ = join(before);
            let _ = fs::remove_dir(group);
        }
    }
}

/// Moves this process into a new control group (version 1 or 2) with the quota; returns that group and the one
/// before.
fn limited(version: u32) -> Result<(PathBuf, PathBuf), String> {
    const PERIOD_US: f64 = 100_000.0;
    let own = fs::read_to_string("/proc/self/cgroup").map_err(|e| e.to_string())?;
    let quota_us = (QUOTA_CORES * PERIOD_US) as u64;
    let name = format!("hil-bench-{}", std::process::id());
    let find = |wanted: fn(&str) -> bool| {
        own.lines().find_map(|line| {
            let mut parts = line.splitn(3, ':').skip(1);
            wanted(parts.next()?).then(|| parts.next().unwrap_or_default().to_owned())
        })
    };
    let first = find(|names| names.split(',').any(|name| name == "cpu"));
    let owner = if first.is_some() { 1 } else { 2 };
    if version != owner {
        return Err(format!(
            "processor time belongs to control groups v{owner} here"
        ));
    }
    let (root, path, file, text) = match first {
        Some(path) => (
            "/sys/fs/cgroup/cpu",
            path,
            "cpu.cfs_quota_us",
            quota_us.to_string(),
        ),
        None => (
            "/sys/fs/cgroup",
            find(str::is_empty).ok_or("no control group of processor time")?,
            "cpu.max",
            format!("{quota_us} {PERIOD_US}"),
        ),
    };
    let before = Path::new(root).join(path.trim_start_matches('/'));
    let group = before.join(name);
    let failed = |error: std::io::Error| {
        let _ = fs::remove_dir(&group);
        format!("no group with a quota below {}: {error}", before.display())
    };
    fs::create_dir(&group).map_err(failed)?;
    fs::write(group.join(file), text).map_err(failed)?;
    join(&group).map_err(failed)?;
    Ok((group, before))
}

fn join(group: &Path) -> std::io::Result<()> {
    fs::write(group.join("cgroup.procs"), std::process::id().to_string())
}
