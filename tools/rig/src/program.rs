//! The program `hil-rig`: a port as a plant program, or its keeper.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, PoisonError};

use hil_config::port::Port;
use hil_session::program::{self, CHECKED, PLANT_JOB, Program, UNUSABLE};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use plant_process::job::Job;
use plant_process::plant::PlantKind;
use shared_types::describe::Description;
use shared_types::side::Side;

use crate::description::describe;
use crate::keeper;
use crate::media::Socket;
use crate::model::{PortIo, PortModel, Shared};

const NAME: &str = "hil-rig";
const VERSION: &str = env!("CARGO_PKG_VERSION");
const USAGE: &str = "usage: hil-rig plant RIG.port.toml --describe | --check JOB.json | --session FOLDER; hil starts it for a scenario whose plant is behind a port";
/// Part of the wait limit after which a silent peer is lost, so that the peer is named and not this process.
const PART_OF_LIMIT: f64 = 0.8;

/// Runs the program as its command-line arguments request.
#[must_use]
pub fn main() -> ExitCode {
    let code = program::with_stack(|| {
        run(std::env::args_os()).unwrap_or_else(|reason| {
            program::say(&format!("error: {reason}"));
            UNUSABLE
        })
    });
    ExitCode::from(code)
}

fn run(mut arguments: impl Iterator<Item = OsString>) -> Result<u8, String> {
    let own = arguments.next().unwrap_or_else(|| NAME.into());
    let (Some(role), Some(path)) = (arguments.next(), arguments.next()) else {
        return Err(USAGE.into());
    };
    let path = PathBuf::from(path);
    match role.to_str() {
        Some(keeper::KEEPER) => keeper::main(&path).map(|()| program::COMPLETED),
        Some("plant") => {
            let rig = Rig::new(&path)?;
            Ok(program::answer(&rig, std::iter::once(own).chain(arguments)))
        }
        _ => Err(USAGE.into()),
    }
}

/// Plant program of a port.
struct Rig {
    path: PathBuf,
    port: Arc<Port>,
    io: Shared,
    inner: Box<dyn Program>,
}

impl Rig {
    fn new(path: &Path) -> Result<Self, String> {
        let port = Arc::new(Port::read(path, None).map_err(|problems| problems.to_string())?);
        let name = path
            .file_name()
            .unwrap_or(path.as_os_str())
            .to_string_lossy();
        let described = describe(&port).map_err(|reason| format!("{name}: {reason}"))?;
        let io = Shared::default();
        let (own_port, own_io) = (Arc::clone(&port), Arc::clone(&io));
        let kind = PlantKind::from_tables(described, move |_| {
            let (port, io) = (Arc::clone(&own_port), Arc::clone(&own_io));
            Ok(Box::new(PortModel::new(port, io)))
        });
        let kind = kind.map_err(|invalid| format!("{name}: {invalid}"))?;
        Ok(Self {
            path: path.into(),
            port,
            io,
            inner: Box::new(plant_process::program::of(NAME, VERSION, vec![kind])),
        })
    }
}

impl Program for Rig {
    fn side(&self) -> Side {
        Side::Plant
    }

    fn description(&self) -> Description {
        self.inner.description()
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        for medium in &self.port.media {
            Socket::open(medium)?;
        }
        self.inner.check(job)?;
        // As of every host of a model: its end alone does not say that the check was done.
        let said = writeln!(std::io::stdout(), "{CHECKED}");
        said.map_err(|error| format!("cannot write to standard output: {error}"))
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let job: Job = program::read_job(&session.folder.join(PLANT_JOB))?;
        let mut io = PortIo::open(&self.port, &self.path, PART_OF_LIMIT * job.wait_limit_s)?;
        let result = io.wait_for_peer(&|| supervision.wants_stop());
        let lock = || self.io.lock().unwrap_or_else(PoisonError::into_inner);
        *lock() = Some(io);
        let result = result.and_then(|()| self.inner.serve(session, supervision));
        if let Some(io) = lock().take() {
            io.end();
        }
        result
    }
}
