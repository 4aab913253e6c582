//! The program `hil-port plant FILE.port.toml`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use hil_config::port::Port;
use hil_config::port::counts::PLANT_COUNTS_FILE;
use hil_session::program::{self, CHECKED, PLANT_JOB, Program};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use plant_process::job::Job;
use plant_process::plant::PlantKind;
use shared_types::describe::Description;
use shared_types::side::Side;

use super::description::describe;
use super::model::{Rig, RigModel, Shared, lock};
use crate::far_end::Opening;

/// Plant program of a port.
pub struct RigProgram {
    path: PathBuf,
    port: Arc<Port>,
    rig: Shared,
    inner: Box<dyn Program>,
}

impl RigProgram {
    /// Creates the program of a port file that was read, under a name and version of the host.
    ///
    /// # Errors
    /// If the port cannot be a plant.
    pub fn new(
        path: &Path,
        port: Arc<Port>,
        name: &'static str,
        version: &'static str,
    ) -> Result<Self, String> {
        let in_file = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let folder = path.parent().unwrap_or(Path::new(""));
        let described = describe(&port, folder).map_err(|error| in_file(&error))?;
        let rig = Shared::default();
        let (own_port, own_rig) = (Arc::clone(&port), Arc::clone(&rig));
        let kind = PlantKind::from_tables(described, move |_| {
            let (port, rig) = (Arc::clone(&own_port), Arc::clone(&own_rig));
            Ok(Box::new(RigModel::new(port, rig)))
        });
        let kind = kind.map_err(|invalid| in_file(&invalid))?;
        Ok(Self {
            path: path.into(),
            port,
            rig,
            inner: Box::new(plant_process::program::of(name, version, vec![kind])),
        })
    }

    fn open(&self, job: &Job, supervision: &Supervision) -> Result<Rig, String> {
        let opening = Opening {
            folder: self.path.parent().unwrap_or(Path::new("")),
            wait_limit_s: job.wait_limit_s,
            supervision,
        };
        Rig::open(&self.port, &self.path, job.run.rate.period_s(), &opening)
    }
}

impl Program for RigProgram {
    fn side(&self) -> Side {
        Side::Plant
    }

    fn description(&self) -> Description {
        self.inner.description()
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        self.inner.check(job)?;
        // A host says so, because a model could end its process.
        println!("{CHECKED}");
        Ok(())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let job: Job = program::read_job(&session.folder.join(PLANT_JOB))?;
        let mut rig = self.open(&job, supervision)?;
        let result = rig.await_peer(&|| supervision.wants_stop());
        *lock(&self.rig) = Some(rig);
        let result = result.and_then(|()| self.inner.serve(session, supervision));
        if let Some(rig) = lock(&self.rig).take() {
            let counts = rig.end();
            if let Err(error) = session.write_file(PLANT_COUNTS_FILE, &counts) {
                program::say(&format!("the counts of the port are lost: {error}"));
            }
        }
        result
    }
}
