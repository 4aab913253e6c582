//! The real-time settings of a run: looked at before it, applied to what is `hil`'s own, and told as
//! asked for and as granted.
//!
//! Plant and controller apply theirs themselves and leave a [`Report`] in the session's folder. What
//! was not granted is said once on standard error, with the command that mends it; the run goes on.

use std::fs::File;
use std::io::{Read, Write};
use std::sync::{Arc, OnceLock};

use hil_config::plan;
use serde::Serialize;
use shared_types::realtime::{CONTROLLER_FILE, Granted, PLANT_FILE, Report, only_core, pin};
use shared_types::session::SessionInfo;
use shared_types::wait::WaitStrategy;

use crate::doctor::cores::{CoreList, Cores};
use crate::doctor::rights::LIMITS;
use crate::doctor::tree::Root;
use crate::exit::Failure;

const DMA_LATENCY: &str = "/dev/cpu_dma_latency";

/// What a run asked of the system and what it got, as `summary.json` has it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Realtime {
    /// How the sides waited for each other.
    pub(crate) wait: WaitStrategy,
    /// The plant's loop; of a run in one process that of both sides. Null if it never began.
    pub(crate) plant: Option<Report>,
    /// The controller's loop; null if it never began or has none of its own.
    pub(crate) controller: Option<Report>,
    /// The recorder.
    pub(crate) recorder: Recorder,
    /// How long a core may need to wake up, in us; null for no limit of ours.
    pub(crate) dma_latency_us: Granted<Option<u32>>,
}

/// What the recorder runs with.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Recorder {
    /// The only core that it may run on; null for several.
    pub(crate) core: Granted<Option<u32>>,
}

/// The settings of one run while it goes on.
pub(super) struct Watched {
    asked: plan::Realtime,
    session: SessionInfo,
    plant: Option<Report>,
    controller: Option<Report>,
    recorder: RecorderCore,
    dma_latency_us: Granted<Option<u32>>,
    /// Holds the latency down as long as it is open.
    _dma_latency: Option<File>,
}

/// The core of the recorder's thread, which moves there by itself.
#[derive(Clone)]
pub(super) struct RecorderCore {
    asked: Option<u32>,
    granted: Arc<OnceLock<Granted<Option<u32>>>>,
}

impl RecorderCore {
    /// Moves the calling thread there.
    pub(super) fn apply(&self) {
        let pinned = self.asked.map_or(Ok(()), pin);
        let refused = pinned.err().map(|error| error.to_string());
        let core = only_core();
        let asked = self.asked.or(core);
        let _ = self.granted.set(Granted::new(asked, core, refused)); // applied once
    }
}

/// Refuses cores that this machine does not have, and warns of settings that leave nothing to
/// anybody else.
///
/// # Errors
/// Which setting, and the cores that there are.
pub(super) fn check(asked: &plan::Realtime) -> Result<(), Failure> {
    let cores = Cores::choose(&Root::machine(), None)?;
    for (key, core) in [
        ("plant_core", asked.plant_core),
        ("controller_core", asked.controller_core),
        ("recorder_core", asked.recorder_core),
    ] {
        let Some(core) = core else { continue };
        // Asking is the only way to know: a container may have fewer cores than the machine.
        let usable = std::thread::spawn(move || pin(core)).join();
        if !matches!(usable, Ok(Ok(()))) {
            let there = &cores.online;
            return Err(Failure::usage(format!(
                "realtime.{key} is {core}, which cannot be used; the cores of this machine are {there}"
            )));
        }
    }
    if let Some(cores) = all_taken(asked, &cores.allowed) {
        let priority = asked.priority;
        eprintln!(
            "warning: at priority {priority} plant and controller may take all cores ({cores}); hil and its recorder then run \
             only where the loops sleep or the kernel steps in. Leave them a core, or take --priority 0"
        );
    }
    Ok(())
}

/// The cores, if loops of real-time priority may take all of them.
fn all_taken<'a>(asked: &plan::Realtime, allowed: &'a CoreList) -> Option<&'a CoreList> {
    let sides: CoreList = (asked.plant_core.into_iter())
        .chain(asked.controller_core)
        .collect();
    // One that was given no core takes any.
    let free = [asked.plant_core, asked.controller_core]
        .iter()
        .filter(|core| core.is_none())
        .count();
    (asked.priority > 0 && allowed.without(&sides).len() <= free).then_some(allowed)
}

impl Watched {
    /// Begins to hold what `hil` itself holds.
    pub(super) fn begin(asked: plan::Realtime, session: &SessionInfo) -> Self {
        let (dma_latency_us, held) = match asked.dma_latency_us {
            None => (Granted::new(None, None, None), None),
            Some(us) => match hold_latency(us) {
                Ok((granted, held)) => (Granted::new(Some(us), Some(granted), None), Some(held)),
                Err(error) => {
                    let refused = format!("{DMA_LATENCY}: {error}");
                    (Granted::new(Some(us), None, Some(refused)), None)
                }
            },
        };
        if let Some(reason) = dma_latency_us.refusal(&None) {
            let mend = format!("sudo chmod o+rw {DMA_LATENCY}");
            eprintln!("{}", refused("hil", "dma_latency_us", reason, Some(&mend)));
        }
        Self {
            asked,
            session: session.clone(),
            plant: None,
            controller: None,
            recorder: RecorderCore {
                asked: asked.recorder_core,
                granted: Arc::default(),
            },
            dma_latency_us,
            _dma_latency: held,
        }
    }

    /// For the recorder's thread.
    pub(super) fn recorder_core(&self) -> RecorderCore {
        self.recorder.clone()
    }

    /// Looks whether the sides have told what they run with; what they were refused, once.
    pub(super) fn look(&mut self) -> Vec<String> {
        let mut told = Vec::new();
        for (side, file, report) in [
            ("plant", PLANT_FILE, &mut self.plant),
            ("controller", CONTROLLER_FILE, &mut self.controller),
        ] {
            if report.is_none()
                && let Ok(found) = self.session.read_file::<Report>(file)
            {
                told.extend(refusals(side, &found));
                *report = Some(found);
            }
        }
        told
    }

    /// What came of it.
    pub(super) fn end(mut self) -> Realtime {
        self.look()
            .iter()
            .for_each(|refused| eprintln!("{refused}"));
        let unset = || {
            Granted::new(
                self.asked.recorder_core,
                None,
                Some("it never began".into()),
            )
        };
        let core = self.recorder.granted.get().cloned().unwrap_or_else(unset);
        if let Some(reason) = core.refusal(&None) {
            eprintln!("{}", refused("recorder", "core", reason, None));
        }
        Realtime {
            wait: (self.plant.as_ref()).map_or(self.asked.wait, |plant| plant.wait.granted),
            plant: self.plant,
            controller: self.controller,
            recorder: Recorder { core },
            dma_latency_us: self.dma_latency_us,
        }
    }
}

/// Opens the kernel's file, which holds the latency down while it is open; what it says then.
fn hold_latency(us: u32) -> std::io::Result<(u32, File)> {
    let mut file = File::options().read(true).write(true).open(DMA_LATENCY)?;
    file.write_all(&us.to_ne_bytes())?;
    let mut granted = [0; 4];
    file.read_exact(&mut granted)?;
    Ok((u32::from_ne_bytes(granted), file))
}

/// What a side was refused.
fn refusals(side: &str, report: &Report) -> Vec<String> {
    // A hybrid wait becomes a yielding one on one core, as it should.
    let spin = report.wait.asked == WaitStrategy::Spin;
    [
        ("core", report.core.refusal(&None), None),
        ("priority", report.priority.refusal(&0), Some(LIMITS)),
        (
            "lock_memory",
            report.lock_memory.refusal(&false),
            Some(LIMITS),
        ),
        ("prefault", report.prefault.refusal(&false), Some(LIMITS)),
        ("wait", report.wait.reason.as_deref().filter(|_| spin), None),
    ]
    .into_iter()
    .filter_map(|(setting, reason, mend)| Some(refused(side, setting, reason?, mend)))
    .collect()
}

fn refused(who: &str, setting: &str, reason: &str, mend: Option<&str>) -> String {
    let mend = mend.map_or_else(String::new, |mend| format!("\n  mend: {mend}"));
    format!("warning: {who}: realtime.{setting} was not granted: {reason}{mend}")
}

impl Realtime {
    /// As a person reads it.
    #[must_use]
    pub(crate) fn told(&self) -> String {
        let mut text = format!("{} waits", self.wait.name());
        for (side, report) in [("plant", &self.plant), ("controller", &self.controller)] {
            let Some(report) = report else { continue };
            let core = report.core.granted.map(|core| format!("core {core}"));
            let priority = report.priority.granted;
            let fifo = (priority > 0).then(|| format!("FIFO {priority}"));
            let locked = (report.lock_memory.granted).then(|| "memory locked".to_owned());
            let fetched = report.prefault.granted.then(|| "prefaulted".to_owned());
            let all: Vec<String> = [core, fifo, locked, fetched]
                .into_iter()
                .flatten()
                .collect();
            if !all.is_empty() {
                text += &format!("; {side}: {}", all.join(", "));
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_of_real_time_priority_take_all_cores_unless_one_is_left() {
        for (priority, plant, controller, allowed, all) in [
            (0, None, None, "0", false),
            (1, None, None, "0-1", true),
            (1, None, None, "0-2", false),
            (1, Some(0), Some(1), "0-1", true),
            (1, Some(0), Some(0), "0-1", false),
            (1, Some(0), None, "0-1", true),
            (1, Some(0), None, "0-2", false),
            (1, Some(2), Some(3), "0-1", false),
        ] {
            let asked = plan::Realtime {
                priority,
                plant_core: plant,
                controller_core: controller,
                ..plan::Realtime::default()
            };
            let allowed = CoreList::parse(allowed);
            let taken = all_taken(&asked, &allowed).is_some();
            assert_eq!(taken, all, "{priority} {plant:?} {controller:?} {allowed}");
        }
    }
}
