//! Summary of a run made from its recording alone.
//!
//! Used by `hil recover`. Paths of binaries and settings of the recorder are not recorded; programs are identified by
//! their names, and unknown facts are left out.

use hil_recording::reader::{RECORDING, RunReader};
use shared_types::describe::Description;
use shared_types::realtime::{Granted, Report};

use super::{BY_HAND, Origin, Program, Summary};
use crate::results::ended::EndedRun;
use crate::results::handover::Laws;
use crate::results::recorded_run::RecordedRun;
use crate::results::settings::{Realtime, Recorder};
use crate::results::target::Target;

/// Levels of evidence as recorded in facts.
const EVIDENCE: [&str; 5] = ["in-process", "sil", "sil-emulated", "pil", "hil"];

impl Summary {
    /// Creates the summary of a run from its recording.
    pub(crate) fn of_recording(run: &RecordedRun, reader: &RunReader, ended: &EndedRun) -> Self {
        let plan = &run.plan;
        let fact = |name| reader.fact(name).unwrap_or_default();
        let evidence = fact("evidence");
        let evidence = EVIDENCE.into_iter().find(|level| *level == evidence);
        let program = |described: &Description, side: &str| Program {
            binary: described.program.clone(),
            blake3: reader
                .fact(&format!("{side}_blake3"))
                .unwrap_or_default()
                .to_owned(),
            host_blake3: reader
                .fact(&format!("{side}_host_blake3"))
                .map(str::to_owned),
            build: described.build.clone(),
            kind: None,
            simulated: Vec::new(),
        };
        let origin = Origin {
            session: fact("session").to_owned(),
            evidence: evidence.unwrap_or_default(),
            target: Target::recorded(|name| reader.fact(name)),
            plant: program(&run.plant_program, "plant").with_plant(Some(&run.plant)),
            controller: program(&run.controller_program, "controller"),
        };
        let report = |name| -> Option<Report> { serde_json::from_str(reader.fact(name)?).ok() };
        let plant = report("realtime_plant");
        let realtime = Realtime {
            wait: (plant.as_ref()).map_or(plan.realtime.wait, |plant| plant.wait.granted),
            plant,
            controller: report("realtime_controller"),
            recorder: Recorder {
                core: Granted::new(None, None, None),
            },
            dma_latency_us: Granted::new(None, None, None),
        };
        let mut summary = Self::of(plan, origin, Some(RECORDING), realtime, ended);
        summary.laws = Laws::of(&plan.controller.law, &ended.recorded.changes, |name| {
            reader.fact(name).map(Into::into)
        });
        let by_hand = fact(BY_HAND).split_ascii_whitespace();
        summary.started_by_hand = by_hand.map(Into::into).collect();
        summary.started_utc = reader.fact("started_utc").map(Into::into);
        let set = reader.fact("set").map(serde_json::from_str);
        summary.set = set.and_then(Result::ok).unwrap_or_default();
        summary.recording.unvouched = reader.unvouched().map(|unvouched| unvouched.text);
        summary
    }
}
