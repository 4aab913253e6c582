//! `hil-fmu plant|controller MODEL.fmu`: an FMU as a plant or controller program.
//!
//! Started by `hil`, which passes the FMU and otherwise treats it like any plant or controller program.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use glob::Pattern;
use hil_foreign::fmi::{
    Fmu, Model, Permissions, begin_trial, end_trial, leave, share_calls, sides,
};
use hil_session::program::{self, Program, UNUSABLE};
use hil_session::session::SessionInfo;
use hil_session::supervision::Supervision;
use plant_process::job::Job;
use shared_types::describe::{Description, Imported, ModelSettings};
use shared_types::local_map::LocalMap;
use shared_types::side::Side;
use shared_types::time::Step;

const NAME: &str = "hil-fmu";
const VERSION: &str = env!("CARGO_PKG_VERSION");
const USAGE: &str = "usage: hil-fmu plant|controller MODEL.fmu [--truth PATTERN].. [--settings JSON] [--trust-archive] [--allow-execution-tool] [--load] --describe | --check JOB.json | --session FOLDER; hil starts it for a scenario that names an FMU";

fn main() -> ExitCode {
    let (code, needs_tool) = program::with_stack(|| {
        run().unwrap_or_else(|reason| {
            program::say(&format!("error: {reason}"));
            (UNUSABLE, false)
        })
    });
    if needs_tool {
        leave(code);
    }
    ExitCode::from(code)
}

/// Executes the arguments; returns the exit code, and `true` if the FMU needs its tool.
fn run() -> Result<(u8, bool), String> {
    let mut arguments = std::env::args_os();
    let own = arguments.next().unwrap_or_else(|| NAME.into());
    let (Some(side), Some(path)) = (arguments.next(), arguments.next()) else {
        return Err(USAGE.into());
    };
    let path = PathBuf::from(path);
    let mut arguments = arguments.peekable();
    let mut patterns = Vec::new();
    while arguments.next_if(|one| one == "--truth").is_some() {
        patterns.push(pattern(arguments.next())?);
    }
    let mut settings = ModelSettings::default();
    if arguments.next_if(|one| one == "--settings").is_some() {
        let text = arguments.next().ok_or(USAGE)?;
        settings = ModelSettings::parse(&text.to_string_lossy())
            .map_err(|error| format!("--settings: {error}"))?;
    }
    let mut flag = |name: &str| arguments.next_if(|one| one == name).is_some();
    let permissions = Permissions {
        trust_archive: flag("--trust-archive"),
        allow_execution_tool: flag("--allow-execution-tool"),
        is_of_controller: side == "controller",
    };
    let is_loaded = flag("--load");
    let rest = std::iter::once(own).chain(arguments);
    let with_name = |error: &dyn std::fmt::Display| describe(&path, error);
    let fmu = Arc::new(
        Fmu::open(&path, &patterns, permissions, &settings).map_err(|error| with_name(&error))?,
    );
    let mut imported = fmu.model().tables.imported.clone();
    if is_loaded {
        imported.library = Some(fmu.needs().map_err(|error| with_name(&error))?);
    }
    let model = fmu.model();
    let (imported, needs_tool) = (&imported, model.description.needs_tool);
    let code = match side.to_str() {
        Some("plant") => {
            let kind = sides::plant(&fmu).map_err(|error| with_name(&error))?;
            let inner = plant_process::program::of(NAME, VERSION, vec![kind]);
            program::answer(
                &Described {
                    inner,
                    imported,
                    model,
                },
                rest,
            )
        }
        Some("controller") => {
            let kind = sides::law(&fmu).map_err(|error| with_name(&error))?;
            let inner = controller_process::program::of(NAME, VERSION, vec![kind]);
            program::answer(
                &Described {
                    inner,
                    imported,
                    model,
                },
                rest,
            )
        }
        _ => return Err(USAGE.into()),
    };
    Ok((code, needs_tool))
}

fn pattern(text: Option<OsString>) -> Result<Pattern, String> {
    let text = text.ok_or(USAGE)?;
    let text = text.to_string_lossy();
    Pattern::new(&text).map_err(|error| format!("{text:?} is not a valid pattern: {error}"))
}

fn describe(path: &Path, error: &dyn std::fmt::Display) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    format!("{}: {error}", name.to_string_lossy())
}

/// Program with the facts of the FMU added to its description.
struct Described<'a, P> {
    inner: P,
    imported: &'a Imported,
    model: &'a Model,
}

impl<P: Program> Program for Described<'_, P> {
    fn description(&self) -> Description {
        Description {
            imported: Some(Box::new(self.imported.clone())),
            ..self.inner.description()
        }
    }

    fn side(&self) -> Side {
        self.inner.side()
    }

    fn check(&self, job: &Path) -> Result<(), String> {
        if self.side() == Side::Plant {
            let run = program::read_job::<Job>(job)?.run;
            let length_s = run.rate.seconds(Step(run.steps));
            (self.model.check_run(length_s)).map_err(|invalid| invalid.to_string())?;
        }
        begin_trial();
        self.inner.check(job)?;
        end_trial();
        Ok(())
    }

    fn linearise(&self, question: &Path) -> Result<LocalMap, String> {
        self.inner.linearise(question)
    }

    fn serve(&self, session: &SessionInfo, supervision: &Supervision) -> Result<u8, String> {
        // Without it a kill names no call.
        let _ = share_calls(&session.folder);
        self.inner.serve(session, supervision)
    }
}
