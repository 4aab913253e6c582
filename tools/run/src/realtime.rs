//! Real-time settings of a run: checked in advance, applied to `hil` itself, and reported as requested and as granted.
//!
//! Plant and controller apply their own settings and write a [`Report`] to the session's folder. Refused settings are
//! reported once on standard error, with the command that fixes each; the run continues.

mod refusals;

use std::fs::File;
use std::io::{Read, Write};
use std::sync::{Arc, OnceLock};

use hil_config::plan;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::output;
use hil_doctor::cores::{CoreList, Cores};
use hil_doctor::tree::Root;
use hil_facts::arguments::run::LinkKind;
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::results::settings::{Realtime, Recorder};
use hil_session::realtime::{only_core, pin};
use hil_session::session::SessionInfo;
use shared_types::realtime::{CONTROLLER_FILE, Granted, PLANT_FILE, Report};
use shared_types::text;

use refusals::Refusals;

const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

/// Real-time settings of a run in progress.
pub(super) struct Watched {
    requested: plan::Realtime,
    session: SessionInfo,
    plant: Option<Report>,
    controller: Option<Report>,
    awaits_controller: bool,
    refusals: Refusals,
    has_told_sides: bool,
    recorder: RecorderCore,
    dma_latency_us: Granted<Option<u32>>,
    /// File that keeps the CPU latency low while open.
    _dma_latency: Option<File>,
}

/// Core of the recorder's thread, which moves to that core by itself.
#[derive(Clone)]
pub(crate) struct RecorderCore {
    requested: Option<u32>,
    granted: Arc<OnceLock<Granted<Option<u32>>>>,
}

impl RecorderCore {
    /// Moves the calling thread to the core.
    pub(crate) fn apply(&self) {
        let pinned = self.requested.map_or(Ok(()), pin);
        let refused = pinned.err().map(|error| error.to_string());
        let core = only_core();
        let requested = self.requested.or(core);
        let _ = self.granted.set(Granted::new(requested, core, refused)); // applied once
    }
}

/// Refuses cores that this machine does not have, and warns of settings that leave no core for other processes.
///
/// # Errors
/// If a core cannot be used; the error names the setting and the available cores.
pub fn check(
    requested: &plan::Realtime,
    link: LinkKind,
    target: Option<&Reached>,
) -> Result<(), Failure> {
    // The cores of a target are not this machine's: settings it refuses are reported during the run.
    let controller_core = requested.controller_core.filter(|_| target.is_none());
    if requested.priority == 0
        && [
            requested.plant_core,
            requested.controller_core,
            requested.recorder_core,
        ] == [None; 3]
    {
        return Ok(());
    }
    let cores = Cores::choose(&Root::machine(), None)?;
    for (key, core) in [
        ("plant_core", requested.plant_core),
        ("controller_core", controller_core),
        ("recorder_core", requested.recorder_core),
    ] {
        let Some(core) = core else { continue };
        // Trying is the only way to know: a container may have fewer cores than the machine.
        let usable = std::thread::spawn(move || pin(core)).join();
        if !matches!(usable, Ok(Ok(()))) {
            let there = &cores.online;
            return Err(Failure::usage(format!(
                "realtime.{key} = {core} cannot be used; the available cores of this machine are {there}"
            )));
        }
    }
    let are_both_here = target.is_none_or(Reached::is_here);
    let loops = match link {
        LinkKind::Iceoryx2 if are_both_here => {
            vec![requested.plant_core, requested.controller_core]
        }
        // One thread runs both sides with the settings of the plant.
        LinkKind::Iceoryx2 | LinkKind::InProcess => vec![requested.plant_core],
    };
    if requested.priority > 0 && may_take_all(&loops, &cores.allowed) {
        let cores = &cores.allowed;
        let priority = requested.priority;
        let loops = if are_both_here {
            "plant and controller"
        } else {
            "the plant"
        };
        let others = match target {
            None => "hil and its recorder",
            Some(_) => "hil, its recorder and the bridge to the target",
        };
        tell!(
            "warning: at priority {priority} {loops} may take all cores ({cores}); {others} then run only where a loop \
             sleeps or the kernel steps in. Leave a core to them, or use --priority 0"
        );
    }
    Ok(())
}

/// Returns `true` if loops on these cores, or on any cores, may occupy all allowed cores.
fn may_take_all(loops: &[Option<u32>], allowed: &CoreList) -> bool {
    let occupied: CoreList = loops.iter().copied().flatten().collect();
    let anywhere = loops.iter().filter(|core| core.is_none()).count();
    allowed.without(&occupied).len() <= anywhere
}

impl Watched {
    /// Applies the settings of `hil` itself.
    pub(crate) fn begin(requested: plan::Realtime, link: LinkKind, session: &SessionInfo) -> Self {
        let mut refusals = Refusals::default();
        let (granted, reason, held) = match requested.dma_latency_us.map(hold_latency) {
            None => (None, None, None),
            // It may be lower than requested, if another process needs that.
            Some(Ok((granted, held))) => (Some(granted), None, Some(held)),
            Some(Err(error)) => {
                let reason = format!("{DMA_LATENCY}: {error}");
                let mend = format!("sudo chmod o+rw {DMA_LATENCY}");
                refusals.add("hil", "dma_latency_us", &reason, Some(&mend));
                (None, Some(reason), None)
            }
        };
        Self {
            requested,
            session: session.clone(),
            plant: None,
            controller: None,
            awaits_controller: link == LinkKind::Iceoryx2,
            refusals,
            has_told_sides: false,
            recorder: RecorderCore {
                requested: requested.recorder_core,
                granted: Arc::default(),
            },
            dma_latency_us: Granted::new(requested.dma_latency_us, granted, reason),
            _dma_latency: held,
        }
    }

    /// Returns the settings of the recorder's thread.
    pub(crate) fn recorder_core(&self) -> RecorderCore {
        self.recorder.clone()
    }

    /// Reads the reports of the sides; once all have reported, returns the refusals as text.
    pub(crate) fn look(&mut self) -> Option<String> {
        for (file, report, is_awaited) in [
            (PLANT_FILE, &mut self.plant, true),
            (
                CONTROLLER_FILE,
                &mut self.controller,
                self.awaits_controller,
            ),
        ] {
            if report.is_none() && is_awaited {
                *report = self.session.read_file(file).ok();
            }
        }
        let all = self.plant.is_some() && (self.controller.is_some() || !self.awaits_controller);
        if all { self.refused() } else { None }
    }

    /// Returns the unreported refusals as text.
    fn refused(&mut self) -> Option<String> {
        // In a fixed order, whichever side reported first.
        if !std::mem::replace(&mut self.has_told_sides, true) {
            for (side, report) in [("plant", &self.plant), ("controller", &self.controller)] {
                if let Some(report) = report {
                    self.refusals.add_side(side, report);
                }
            }
        }
        let refusals = std::mem::take(&mut self.refusals);
        // The reports of the sides are included.
        (!refusals.is_empty()).then(|| text::printable(&refusals.to_string()).into_owned())
    }

    /// Reports the remaining refusals; returns the settings as requested and as granted.
    pub(crate) fn end(mut self) -> Realtime {
        let requested = self.requested.recorder_core;
        let core = self.recorder.granted.get().cloned();
        let core = core.unwrap_or_else(|| Granted::new(requested, None, None));
        if let Some(reason) = core.refusal(&None) {
            self.refusals.add("recorder", "core", reason, None);
        }
        if let Some(refused) = self.look().or_else(|| self.refused()) {
            output::tell(&refused);
        }
        Realtime {
            wait: (self.plant.as_ref()).map_or(self.requested.wait, |plant| plant.wait.granted),
            plant: self.plant,
            controller: self.controller,
            recorder: Recorder { core },
            dma_latency_us: self.dma_latency_us,
        }
    }
}

/// Returns the facts about the settings for a recording: the reports of both sides, which exist when their stream
/// begins.
pub(crate) fn facts(session: &SessionInfo) -> impl Iterator<Item = (String, String)> {
    let files = [
        ("realtime_plant", PLANT_FILE),
        ("realtime_controller", CONTROLLER_FILE),
    ];
    files.into_iter().filter_map(|(name, file)| {
        let report: Report = session.read_file(file).ok()?;
        let json = serde_json::to_string(&report).ok()?;
        Some((name.to_owned(), json))
    })
}

/// Opens the kernel's file that limits the latency while open; returns the latency in effect.
fn hold_latency(us: u32) -> std::io::Result<(u32, File)> {
    let mut file = File::options().read(true).write(true).open(DMA_LATENCY)?;
    file.write_all(&us.to_ne_bytes())?;
    let mut granted = [0; 4];
    file.read_exact(&mut granted)?;
    Ok((u32::from_ne_bytes(granted), file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_take_all_cores_unless_one_is_left() {
        for (loops, allowed, all) in [
            (&[None, None][..], "0", true),
            (&[None, None], "0-1", true),
            (&[None, None], "0-2", false),
            (&[Some(0), Some(1)], "0-1", true),
            (&[Some(0), Some(0)], "0-1", false),
            (&[Some(0), None], "0-1", true),
            (&[Some(0), None], "0-2", false),
            (&[Some(2), Some(3)], "0-1", false),
            (&[None], "0-1", false),
            (&[Some(0)], "0", true),
        ] {
            let result = may_take_all(loops, &CoreList::parse(allowed));
            assert_eq!(result, all, "{loops:?} {allowed}");
        }
    }
}
