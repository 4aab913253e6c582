//! A run that can begin: everything that both sides, the recorder and the conclusion need. Starts only the recorder.

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

/// Run that is ready to start.
pub(super) struct PreparedRun {
    pub(super) plan: Plan,
    pub(super) binaries: Arc<Binaries>,
    pub(super) settings: Settings,
    pub(super) interruption: Interruption,
    pub(super) session: SessionInfo,
    /// Time of the run's start.
    pub(super) started_utc: String,
    /// Path of the run's folder.
    pub(super) folder: PathBuf,
    /// Disk space reserved for the summary.
    pub(super) reserve: Reserve,
    /// Effective scenario.
    pub(super) effective: String,
    pub(super) plant: plant_process::job::Job,
    pub(super) controller: controller_process::job::Job,
    pub(super) recording: Option<RecordingPlan>,
    /// Layout of the run's records, as both programs describe it.
    pub(super) layout: RecordLayout,
    /// Steps before which the state is saved.
    pub(super) checkpoints: Vec<Step>,
    /// Numbers of records after which an additional digest is taken.
    pub(super) marks: Vec<u64>,
    /// Records of the run that this run continues.
    pub(super) past: Option<PastRecords>,
    /// Checkpoint from which the run continues.
    pub(super) resumed: Option<Resumed>,
}

impl PreparedRun {
    /// Starts the recorder; the function returned by `attach` is called repeatedly until it finds the stream.
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

    /// Removes the folder of a run that was not started, so that the next attempt finds the same state.
    pub(super) fn leave_nothing(mut self) {
        self.reserve.release();
        leave(&self.folder);
    }

    /// Creates the progress display of the run, with the requested pause.
    pub(crate) fn progress(&self) -> Progress {
        let is_visible = !self.settings.is_one_of_many;
        let mut progress = Progress::new(self.plan.run.steps, self.plan.run.rate, is_visible);
        if let Some(pause_at_s) = self.settings.pause_at_s {
            progress.announce_pause(pause_at_s, &self.session.name);
        }
        progress
    }
}

/// Removes the folder of a run and the scenario in it, if there is nothing else in the folder.
pub(super) fn leave(folder: &Path) {
    let _ = std::fs::remove_file(folder.join(SCENARIO));
    let _ = std::fs::remove_dir(folder);
}
