//! `hil-port controller|plant FILE.port.toml`: the far end of a port as the program of a side, and the keeper of a plant.
//!
//! Started by `hil`, which passes the port file and otherwise treats it like any program of a side; `plant` starts
//! `hil-port keeper FILE.port.toml`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, OnceLock, PoisonError};

use controller_process::job::{JOB_FILE, Job};
use hil_config::port::counts::COUNTS_FILE;
use hil_config::port::{Carries, Port};
use hil_port::law::{self, Ledger, Run};
use hil_port::rig::program::RigProgram;
use hil_port::{keeper, wire};
use hil_session::program::{self, CHECKED, Program, UNUSABLE};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use shared_types::describe::Description;
use shared_types::local_map::LocalMap;
use shared_types::side::Side;

const NAME: &str = "hil-port";
const VERSION: &str = env!("CARGO_PKG_VERSION");
const USAGE: &str = "usage: hil-port controller|plant FILE.port.toml --describe | --check JOB.json | --session FOLDER; hil starts it for a scenario that names a port file";

fn main() -> ExitCode {
    let code = program::with_stack(|| {
        run().unwrap_or_else(|reason| {
            program::say(&format!("error: {reason}"));
            UNUSABLE
        })
    });
    ExitCode::from(code)
}

fn run() -> Result<u8, String> {
    let mut arguments = std::env::args_os();
    let own = arguments.next().unwrap_or_else(|| NAME.into());
    let (Some(side), Some(path)) = (arguments.next(), arguments.next()) else {
        return Err(USAGE.into());
    };
    let path = PathBuf::from(path);
    let arguments = std::iter::once(own).chain(arguments);
    match side.to_str() {
        Some(keeper::KEEPER) => keeper::main(&path).map(|()| program::COMPLETED),
        Some("plant") => {
            let rig = RigProgram::new(&path, read(&path)?, NAME, VERSION)?;
            Ok(program::answer(&rig, arguments))
        }
        Some("controller") => Ok(program::answer(&controller(&path)?, arguments)),
        _ => Err(USAGE.into()),
    }
}

fn read(path: &Path) -> Result<Arc<Port>, String> {
    let port = Port::read(path, None).map_err(|problems| problems.to_string())?;
    Ok(Arc::new(port))
}

fn controller(path: &Path) -> Result<PortProgram<impl Program + use<>>, String> {
    let port = read(path)?;
    let (run, ledger) = (Arc::new(OnceLock::new()), Ledger::default());
    let kind = law::law(&port, &run, &ledger).map_err(|error| in_file(path, &error))?;
    let inner = controller_process::program::of(NAME, VERSION, vec![kind]);
    Ok(PortProgram {
        inner,
        port,
        folder: path.parent().unwrap_or(Path::new("")).to_owned(),
        run,
        ledger,
    })
}

fn in_file(path: &Path, error: &dyn std::fmt::Display) -> String {
    format!("{}: {error}", path.display())
}

/// Controller program that gives the law of a port what it needs of its run.
struct PortProgram<P> {
    inner: P,
    port: Arc<Port>,
    /// Folder of the port file.
    folder: PathBuf,
    run: Arc<OnceLock<Run>>,
    ledger: Ledger,
}

impl<P: Program> Program for PortProgram<P> {
    fn description(&self) -> Description {
        self.inner.description()
    }

    fn side(&self) -> Side {
        Side::Controller
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        let job_content = program::read_job::<Job>(job)?;
        let period_s = job_content.rate.period_s() * f64::from(job_content.rate_divisor);
        wire::check(&self.port, Carries::Sample, period_s)?;
        self.inner.check(job)?;
        // A host says so, because a model could end its process.
        println!("{CHECKED}");
        Ok(())
    }

    fn linearise(&self, _question: &Path) -> Result<LocalMap, String> {
        Err("the law is behind the port, so its state is unknown and it has no linear model".into())
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        let job = program::read_job::<Job>(&session.folder.join(JOB_FILE))?;
        let run = Run {
            folder: self.folder.clone(),
            wait_limit_s: job.wait_limit_s,
            supervision: supervision.clone(),
        };
        // A program serves one session.
        let _ = self.run.set(run);
        let result = self.inner.serve(session, supervision);
        let counts = self.ledger.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(counts) = &*counts
            && let Err(error) = session.write_file(COUNTS_FILE, counts)
        {
            program::say(&format!("the counts of the port are lost: {error}"));
        }
        result
    }
}
