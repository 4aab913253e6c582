//! Takeover by another controller during a run.
//!
//! Answers `hil controller swap`. The `hil` that runs the session listens on a socket in the session's folder, because
//! only this `hil` starts processes. It checks the new controller against the scenario as at the start, starts the
//! controller, and answers once the plant has accepted or refused it.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use controller_process::job::Job;
use hil_config::plan::{ControllerPlan, Permissions, Plan};
use hil_config::scenario::{Advice, Scenario};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::programs::binaries::host::ModelKind;
use hil_facts::programs::binaries::reached::Reached;
use hil_facts::programs::binaries::{Binaries, Binary};
use hil_facts::programs::scenario::{self, kept};
use hil_session::asking;
use hil_session::live::{self, Listening};
use hil_session::session::SessionInfo;
use hil_target::name::Target;
use serde::{Deserialize, Serialize};
use shared_types::describe::{LawDescription, ModelSettings};
use shared_types::live::Refusal;
use shared_types::table::Field;
use toml_edit::{DocumentMut, Item, TableLike};

use super::jobs;

/// Name of the socket in the session's folder.
pub const SOCKET: &str = "hil";
/// Additional time for an answer beyond the wait limit: the binary describes itself, checks its job and starts.
const BESIDES: Duration = Duration::from_secs(25);

/// Request for another controller.
#[derive(Debug, Serialize, Deserialize)]
pub struct Request {
    /// Path of the binary; `None` for the active one.
    pub binary: Option<PathBuf>,
    /// Values of the scenario's `[controller]` to change.
    pub set: Vec<String>,
    /// Time limit in s for each part of the swap, if longer than the run's own limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wait_limit_s: Option<f64>,
}

/// Response to a request.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "response", rename_all = "kebab-case")]
pub enum Response {
    /// The controller took over.
    Swapped(Swapped),
    /// The request was refused; the run continues with the active controller.
    Refused {
        /// Reason for the refusal.
        reason: String,
    },
}

/// Controller that took over.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Swapped {
    /// Number of the controller in the session.
    pub epoch: u32,
    /// First step that the controller answers.
    pub step: u64,
    /// Name of its control law.
    pub law: String,
    /// File of its program.
    pub binary: PathBuf,
    /// Keys of the running scenario that were left out because no law of the controller has them.
    pub left_out: Vec<String>,
}

/// Checked controller that waits to be started.
pub(crate) struct SwapRequest {
    pub(crate) binary: Binary,
    /// Controller part of the scenario.
    pub(crate) law: ControllerPlan,
    /// Values of the scenario changed for the controller.
    pub(crate) set: Vec<String>,
    /// Keys of the scenario that no law of the controller has.
    pub(crate) left_out: Vec<String>,
    pub(crate) answer: Sender<Result<Swapped, String>>,
}

/// Context against which a new controller is checked.
pub(crate) struct SwapContext {
    pub(crate) plan: Plan,
    pub(crate) binaries: Arc<Binaries>,
    pub(crate) job: Job,
    pub(crate) saves: bool,
    pub(crate) interruption: Interruption,
    pub(crate) wait_limit_s: f64,
}

/// Listener for swap requests, until it is dropped.
pub(crate) struct SwapListener {
    pub(crate) requests: Receiver<SwapRequest>,
    _listening: Listening,
}

/// Starts listening; requests that passed every check are sent to the returned listener's channel.
///
/// # Errors
/// If the socket cannot be created.
pub(crate) fn listen(session: &SessionInfo, ground: SwapContext) -> Result<SwapListener, Failure> {
    let (sender, receiver) = channel();
    let theirs = session.clone();
    let listening = live::listen(session, SOCKET, move |client| {
        // A client that disconnected needs no answer.
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
    Ok(SwapListener {
        requests: receiver,
        _listening: listening.map_err(Failure::infrastructure)?,
    })
}

impl SwapContext {
    fn swap(
        &self,
        session: &SessionInfo,
        request: &Request,
        requests: &Sender<SwapRequest>,
    ) -> Result<Swapped, String> {
        if self.saves {
            return Err(
                "this run makes checkpoints or continues from one, so its controller cannot change"
                    .into(),
            );
        }
        let reason_of = |failure: Failure| failure.reason();
        let longer_s = (request.wait_limit_s).filter(|limit_s| *limit_s > self.wait_limit_s);
        let limit_s = longer_s.unwrap_or(self.wait_limit_s);
        asking::allow_seconds(limit_s);
        // Where the first runs, the next does too.
        let at = self.binaries.controller.at.as_ref();
        if let Some(target) = at
            .map(Reached::target)
            .filter(|target| matches!(target, Target::Serve(_)))
        {
            return Err(format!(
                "{target} serves one session at a time, so a second controller cannot start there"
            ));
        }
        let of_fmu = self.settings(&request.set).map_err(reason_of)?;
        let ask = |path| Binary::asked_for(path, "--bin", of_fmu.clone(), at, &self.interruption);
        let binary = match &request.binary {
            Some(path) => ask(path).map_err(reason_of)?,
            None => {
                let first = &self.binaries.controller;
                let mut binary = ask(&first.path).map_err(|failure| {
                    format!("{}; use --bin PATH for another", reason_of(failure))
                })?;
                binary.by = first.by.clone();
                if binary.blake3 != first.blake3 {
                    let (path, now, then) = (first.path.display(), &binary.blake3, &first.blake3);
                    return Err(format!(
                        "{path} has changed since the run began: its hash was {then} and is now {now}; use --bin {path} to accept the new file"
                    ));
                }
                binary
            }
        };
        let (law, left_out) = self.law(&binary, &request.set).map_err(reason_of)?;
        // Written beside the job of the active one, which may not have read it yet.
        let job = jobs::with_law(self.job.clone(), law.clone());
        jobs::check(&binary, session, "swap.json", &job, &self.interruption).map_err(reason_of)?;
        let (answer, receiver) = channel();
        const ENDED: &str = "the run has ended";
        requests
            .send(SwapRequest {
                binary,
                law,
                set: request.set.clone(),
                left_out,
                answer,
            })
            .map_err(|_| ENDED)?;
        match Duration::try_from_secs_f64(limit_s) {
            Ok(limit) => match receiver.recv_timeout(limit.saturating_add(BESIDES)) {
                Ok(answer) => answer,
                Err(_) => Err("the run has ended, or did not accept the controller in time".into()),
            },
            Err(_) => receiver.recv().map_err(|_| ENDED)?, // no time limit
        }
    }

    /// Returns the permissions and settings of an FMU as the controller, from the running scenario with these
    /// changes.
    fn settings(&self, set: &[String]) -> Result<(Permissions, ModelSettings), Failure> {
        let text = scenario::show(&self.plan, &self.binaries)?;
        let programs = Scenario::parse(&text, "the running scenario")?
            .set(set)
            .programs();
        Ok((
            programs.controller_permissions,
            programs.controller_settings,
        ))
    }

    /// Returns the controller part of the scenario for this binary, and its keys that none of the binary's laws
    /// has.
    fn law(
        &self,
        binary: &Binary,
        set: &[String],
    ) -> Result<(ControllerPlan, Vec<String>), Failure> {
        if let Some(other) = set.iter().find(|set| !set.starts_with("controller.")) {
            return Err(Failure::usage(format!(
                "--set {other}: a swap can only change keys that begin with `controller.`"
            )));
        }
        let effective = scenario::show(&self.plan, &self.binaries)?;
        let mut document = kept(&effective).map_err(Failure::infrastructure)?;
        let is_fmu = { binary.host.as_ref() }.is_some_and(|host| host.kind == ModelKind::Fmu);
        let set_for_fmu = set
            .iter()
            .find(|set| keys_of_fmus().any(|key| is_at(set, key)));
        if let (false, Some(other)) = (is_fmu, set_for_fmu) {
            let path = binary.path.display();
            return Err(Failure::usage(format!(
                "--set {other} has no effect, because {path} is not an FMU"
            )));
        }
        let left_out = leave_out(&mut document, &binary.description.laws, is_fmu);
        let text = document.to_string();
        let advice = Advice {
            law: binary.advice("law", "--bin PATH"),
            ..Advice::default()
        };
        let plant = &self.binaries.plant.description;
        let scenario = Scenario::parse(&text, "the running scenario");
        let scenario = scenario.map(|scenario| scenario.set(set).advise(advice));
        let laws = &binary.description.laws;
        let plan =
            scenario.and_then(|scenario| scenario.check(&plant.plants, laws, &plant.faults))?;
        Ok((plan.controller, left_out))
    }
}

/// Lists the keys of `[controller]` that only an FMU has.
fn keys_of_fmus() -> impl Iterator<Item = &'static str> {
    const SETTINGS: [&str; 7] = [
        "tolerance",
        "start_time_s",
        "stop_time_s",
        "initial",
        "texts",
        "files",
        "structural",
    ];
    Permissions::KEYS.into_iter().chain(SETTINGS)
}

/// Returns `true` if a flag sets this key of `[controller]`, or a value below it.
fn is_at(set: &str, key: &str) -> bool {
    let path = set.split('=').next().unwrap_or_default().trim();
    path.split('.').nth(1) == Some(key)
}

/// Removes from a scenario the keys that none of these laws has, and returns their names; `is_fmu` is `true` if the
/// laws belong to an FMU.
fn leave_out(scenario: &mut DocumentMut, laws: &[LawDescription], is_fmu: bool) -> Vec<String> {
    let mut removed = Vec::new();
    if let Some(connect) = scenario
        .get_mut("connect")
        .and_then(Item::as_array_of_tables_mut)
    {
        connect.retain(|one| {
            let path = one.get("law").and_then(Item::as_str).unwrap_or_default();
            let is_known = laws.iter().any(|law| has_signal(law, path));
            if !is_known {
                removed.push(format!("connect {path}"));
            }
            is_known
        });
    }
    let Some(controller) = scenario
        .get_mut("controller")
        .and_then(Item::as_table_like_mut)
    else {
        return removed;
    };
    if !is_fmu {
        for key in keys_of_fmus() {
            if controller.remove(key).is_some() {
                removed.push(format!("controller.{key}"));
            }
        }
    }
    let tables = controller
        .iter()
        .filter(|(name, item)| item.is_table_like() && !keys_of_fmus().any(|key| key == *name));
    let tables: Vec<String> = tables.map(|(name, _)| name.to_owned()).collect();
    for name in tables {
        let path = format!("controller.{name}");
        let of_law = laws.iter().filter(|law| law.name == name);
        let valid: Vec<&str> = match name.as_str() {
            "model" => laws.iter().flat_map(|law| &law.model).collect::<Vec<_>>(),
            _ => of_law.clone().flat_map(|law| &law.parameters).collect(),
        }
        .into_iter()
        .flat_map(Field::names)
        .collect();
        if name != "model" && of_law.count() == 0 {
            controller.remove(&name);
            removed.push(path);
        } else if let Some(table) = controller.get_mut(&name).and_then(Item::as_table_like_mut) {
            prune(table, &path, "", &valid, &mut removed);
        }
    }
    removed
}

/// Returns `true` if a law has a signal, given with its kind as prefix.
fn has_signal(law: &LawDescription, path: &str) -> bool {
    let commands = law.commands.as_deref().unwrap_or_default();
    let tables = [
        ("measured", &law.measured[..]),
        ("reference", &law.reference),
        ("command", commands),
    ];
    path.split_once('.').is_some_and(|(kind, name)| {
        let mut of_kind = tables.iter().filter(|(of, _)| *of == kind);
        of_kind.any(|(_, fields)| fields.iter().any(|field| field.is_called(name)))
    })
}

/// Removes unknown names from a table; `below` is its path relative to `path`.
fn prune(
    table: &mut dyn TableLike,
    path: &str,
    below: &str,
    names: &[&str],
    removed: &mut Vec<String>,
) {
    let keys: Vec<String> = table.iter().map(|(key, _)| key.to_owned()).collect();
    for key in keys {
        let name = format!("{below}{key}");
        match table.get_mut(&key).and_then(Item::as_table_like_mut) {
            Some(inner) => {
                prune(inner, path, &format!("{name}."), names, removed);
                if inner.is_empty() {
                    table.remove(&key);
                }
            }
            None if names.contains(&name.as_str()) => {}
            None => {
                table.remove(&key);
                removed.push(format!("{path}.{name}"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_keys_that_no_law_has_are_left_out() {
        let mut laws = controller_process::laws::all();
        laws.retain(|law| law.description.name == "pid");
        let mut laws: Vec<LawDescription> = laws.into_iter().map(|law| law.description).collect();
        let parameter = laws[0].parameters[0].name.clone();
        let unit = laws[0].parameters[0].clone();
        for law in &mut laws {
            law.model = vec![shared_types::table::Field {
                name: "rod.mass_kg".into(),
                ..unit.clone()
            }];
        }
        let text = format!(
            "[run]\nduration_s = 1.0\n[controller]\nlaw = \"pid\"\nprogram = \"/a\"\nrate_hz = 10.0\n\
             [controller.pid]\n{parameter} = 1.0\nolder = 2.0\nown.older = 3.0\n\
             [controller.lqr]\ngain = 1.0\n[controller.model]\nrod.mass_kg = 1.0\nrod.length_m = 2.0\n"
        );
        let mut scenario: DocumentMut = text.parse().expect("TOML");
        let removed = leave_out(&mut scenario, &laws, false);
        let expected = [
            "controller.pid.older",
            "controller.pid.own.older",
            "controller.lqr",
            "controller.model.rod.length_m",
        ];
        assert_eq!(removed, expected);
        let remaining = format!(
            "[run]\nduration_s = 1.0\n[controller]\nlaw = \"pid\"\nprogram = \"/a\"\nrate_hz = 10.0\n\
             [controller.pid]\n{parameter} = 1.0\n[controller.model]\nrod.mass_kg = 1.0\n"
        );
        assert_eq!(scenario.to_string(), remaining);
        assert_eq!(leave_out(&mut scenario, &laws, false), [""; 0]);
    }
}
