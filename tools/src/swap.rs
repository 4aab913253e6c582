//! `hil controller swap`: another controller takes over while the run goes on.
//!
//! The `hil` that runs the session listens on a socket of its own in the session's folder: it alone
//! starts processes. It checks the new controller against the scenario as at the start, starts it, and
//! answers once the plant has taken it, or has not.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use controller_process::job::Job;
use hil_config::plan::{ControllerPlan, Plan};
use hil_config::scenario::Scenario;
use serde::{Deserialize, Serialize};
use shared_types::live::{self, Listening, LiveError, Refusal};
use shared_types::session::SessionInfo;

use crate::binaries::{Binaries, Binary};
use crate::cli::swap::SwapArguments;
use crate::exit::{Exit, Failure};
use crate::interruption::Interruption;
use crate::live::Unmet;
use crate::replay::original::kept;
use crate::{config, output};

/// Name of the socket in the session's folder.
const SOCKET: &str = "hil";
/// How much longer than the wait limit an answer may take: the binary describes itself, checks its
/// job and starts.
const BESIDES: Duration = Duration::from_secs(25);

/// How long `hil` may take to answer: one that is stopped never does.
const ANSWER_LIMIT: Duration = Duration::from_secs(120);

/// What is asked.
#[derive(Debug, Serialize, Deserialize)]
struct Request {
    /// The binary; the one in office if `None`.
    binary: Option<PathBuf>,
    /// Values of the scenario's `[controller]` to change.
    set: Vec<String>,
}

/// What is answered.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
enum Response {
    /// It took over.
    Swapped(Swapped),
    /// No; the run goes on with the one that it had.
    Refused {
        /// Why.
        reason: String,
    },
}

/// A controller that took over.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Swapped {
    /// Which of the session it is.
    pub(crate) epoch: u32,
    /// The first step that it answers.
    pub(crate) step: u64,
    pub(crate) law: String,
    pub(crate) binary: PathBuf,
}

/// A controller that is checked and waits to be started.
pub(crate) struct Wanted {
    pub(crate) binary: Binary,
    pub(crate) law: Law,
    pub(crate) answer: Sender<Result<Swapped, String>>,
}

/// A controller's part of the scenario.
pub(crate) struct Law(ControllerPlan);

impl Law {
    /// The job of the one in office, for this law.
    pub(crate) fn onto(self, job: Job) -> Job {
        let plan = self.0;
        Job {
            law: plan.law,
            parameters: plan.parameters,
            model: plan.model,
            rate_divisor: plan.rate_divisor,
            command_delay_steps: plan.command_delay_steps,
            ..job
        }
    }
}

/// Runs the command.
///
/// # Errors
/// If there is no session to ask, or it refuses.
pub fn swap(arguments: &SwapArguments) -> Result<Exit, Failure> {
    let json = arguments.session.json;
    let swapped = ask(arguments).map_err(|unmet| unmet.tell(json))?;
    output::write(&if json {
        crate::live::to_json(&Response::Swapped(swapped))?
    } else {
        let Swapped {
            epoch,
            step,
            law,
            binary,
        } = swapped;
        format!(
            "controller {epoch} ({law}, {}) took over at step {step}\n",
            binary.display()
        )
    })?;
    Ok(Exit::Pass)
}

fn ask(arguments: &SwapArguments) -> Result<Swapped, Unmet> {
    let session = crate::live::find(&arguments.session)?;
    let absolute = |path: &PathBuf| std::path::absolute(path).map_err(Failure::usage);
    let request = Request {
        binary: arguments.bin.as_ref().map(absolute).transpose()?,
        set: arguments.set.clone(),
    };
    match live::ask_at(&session, SOCKET, &request, ANSWER_LIMIT) {
        Ok(Response::Swapped(swapped)) => Ok(swapped),
        Ok(Response::Refused { reason }) => Err(Refusal::new(reason).into()),
        Err(LiveError::Absent(name)) => Err(Refusal::new(format!(
            "session `{name}` has no controller process to swap: it is starting, has ended, or runs in one process"
        ))
        .into()),
        Err(error) => Err(Failure::infrastructure(error).into()),
    }
}

/// What a new controller is checked against.
pub(crate) struct Ground {
    pub(crate) plan: Plan,
    pub(crate) binaries: Binaries,
    pub(crate) job: Job,
    pub(crate) saves: bool,
    pub(crate) interruption: Interruption,
    pub(crate) wait_limit_s: f64,
}

/// Controllers that are wanted, as long as it is kept.
pub(crate) struct Door {
    pub(crate) wanted: Receiver<Wanted>,
    _listening: Listening,
}

/// Listens from now on; what passed every check comes out.
///
/// # Errors
/// If the socket cannot be made.
pub(crate) fn listen(session: &SessionInfo, ground: Ground) -> Result<Door, Failure> {
    let (sender, wanted) = channel();
    let theirs = session.clone();
    let listening = live::listen(session, SOCKET, move |client| {
        // A client that went away needs no answer.
        let _ = live::answer(client, |request: Result<Request, Refusal>| {
            let swapped = request
                .map_err(|refusal| refusal.message)
                .and_then(|request| ground.swap(&theirs, &request, &sender));
            match swapped {
                Ok(swapped) => Response::Swapped(swapped),
                Err(reason) => Response::Refused { reason },
            }
        });
    });
    Ok(Door {
        wanted,
        _listening: listening.map_err(Failure::infrastructure)?,
    })
}

impl Ground {
    fn swap(
        &self,
        session: &SessionInfo,
        request: &Request,
        wanted: &Sender<Wanted>,
    ) -> Result<Swapped, String> {
        if self.saves {
            return Err(
                "this run makes checkpoints, or went on from one: its controller stays".into(),
            );
        }
        let told = |failure: Failure| failure.to_string().trim_start_matches("error: ").to_owned();
        let binary = match &request.binary {
            Some(path) => Binary::controller(Some(path), &self.interruption).map_err(told)?,
            None => self.binaries.controller.clone(),
        };
        let law = self.law(&binary, &request.set).map_err(told)?;
        // Beside the job of the one in office, which may not have read it yet.
        let job = Law(law.clone()).onto(self.job.clone());
        session
            .write_file("swap.json", &job)
            .map_err(|error| error.to_string())?;
        let checked = binary.check(&session.folder.join("swap.json"), &self.interruption);
        checked.map_err(told)?;
        let (answer, answered) = channel();
        let law = Law(law);
        let ended = |_| "the run has ended".to_owned();
        wanted
            .send(Wanted {
                binary,
                law,
                answer,
            })
            .map_err(|_| "the run has ended".to_owned())?;
        if self.wait_limit_s.is_finite() {
            let limit = Duration::from_secs_f64(self.wait_limit_s).saturating_add(BESIDES);
            match answered.recv_timeout(limit) {
                Ok(answer) => answer,
                Err(_) => Err("the run has ended, or did not take the controller in time".into()),
            }
        } else {
            answered.recv().map_err(ended)?
        }
    }

    /// The controller's part of the scenario as it is for this binary.
    fn law(&self, binary: &Binary, set: &[String]) -> Result<ControllerPlan, Failure> {
        if let Some(other) = set.iter().find(|set| !set.starts_with("controller.")) {
            return Err(Failure::usage(format!(
                "--set {other}: a swap changes keys that begin with `controller.`"
            )));
        }
        let effective = config::show(&self.plan, &self.binaries)?;
        let text = kept(&effective).map_err(Failure::infrastructure)?;
        let plant = &self.binaries.plant.description;
        let scenario = Scenario::parse(&text, "the running scenario");
        let scenario = scenario.map(|scenario| scenario.set(set));
        let laws = &binary.description.laws;
        let plan = scenario
            .and_then(|scenario| scenario.check(&plant.plants, laws, &plant.faults))
            .map_err(|problems| Failure::Usage(problems.to_string()))?;
        Ok(plan.controller)
    }
}
