//! A run that can begin: all that both sides, the recorder and the conclusion need of it. Starts nothing but the
//! recorder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hil_config::plan::Plan;
use hil_console::files::runs::SCENARIO;
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::progress::Progress;
use hil_facts::checkpoint::past::PastRecords;
use hil_facts::programs::binaries::Binaries;
use hil_facts::results::resumed::Resumed;
use hil_recording::reserve::Reserve;
use hil_session::session::SessionInfo;
use shared_types::record::RecordLayout;
use shared_types::stream::RecordSource;
use shared_types::time::Step;

use super::realtime::RecorderCore;
use super::settings::Settings;
use crate::recorder::{Recorder, RecordingPlan};

/// A run that can begin.
pub(super) struct PreparedRun {
    pub(super) plan: Plan,
    pub(super) binaries: Arc<Binaries>,
    pub(super) settings: Settings,
    pub(super) interruption: Interruption,
    pub(super) session: SessionInfo,
    /// Time at which the run was begun.
    pub(super) started_utc: String,
    /// Folder of the run.
    pub(super) folder: PathBuf,
    /// Room on its disk for the summary.
    pub(super) reserve: Reserve,
    /// The scenario as it is in effect.
    pub(super) effective: String,
    pub(super) plant: plant_process::job::Job,
    pub(super) controller: controller_process::job::Job,
    pub(super) recording: Option<RecordingPlan>,
    /// Content of its records, as both programs describe it.
    pub(super) layout: RecordLayout,
    /// Steps before which the state is saved.
    pub(super) checkpoints: Vec<Step>,
    /// Numbers of records after which the digest is wanted besides.
    pub(super) marks: Vec<u64>,
    /// The records that the run goes on from.
    pub(super) past: Option<PastRecords>,
    /// The checkpoint that it goes on from.
    pub(super) resumed: Option<Resumed>,
}

impl PreparedRun {
    /// Starts the recorder; the result of `attach` looks for the stream again and again.
    pub(crate) fn recorder<S, A>(
        &self,
        core: RecorderCore,
        attach: impl FnOnce() -> A + Send + 'static,
    ) -> Recorder
    where
        S: RecordSource,
        A: FnMut() -> Result<Option<(S, RecordLayout)>, String>,
    {
        let (plan, recording) = (self.plan.clone(), self.recording.clone());
        let (marks, past) = (self.marks.clone(), self.past.clone());
        let curve = self.settings.curve.clone();
        Recorder::start(plan, recording, marks, past, curve, move || {
            core.apply();
            attach()
        })
    }

    /// Removes the folder of a run of which nothing was started: the next try finds it as this one did.
    pub(super) fn leave_nothing(mut self) {
        self.reserve.release();
        leave(&self.folder);
    }

    /// Begins the progress of the run, with the hold that was asked for.
    pub(crate) fn progress(&self) -> Progress {
        let shown = !self.settings.is_one_of_many;
        let mut progress = Progress::new(self.plan.run.steps, self.plan.run.rate, shown);
        if let Some(pause_at_s) = self.settings.pause_at_s {
            progress.announce_pause(pause_at_s, &self.session.name);
        }
        progress
    }
}

/// Removes the folder of a run with the scenario in it, and nothing else.
pub(super) fn leave(folder: &Path) {
    let _ = std::fs::remove_file(folder.join(SCENARIO));
    let _ = std::fs::remove_dir(folder);
}
