//! Plant and controller binaries: where they are, what they say of themselves, what they are.

use std::io::Read;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process_group};
use serde_json::Value;
use shared_types::describe::{
    Description, FaultKindDescription, LawDescription, PROTOCOL, PlantDescription,
};

use crate::cli::BinaryArguments;
use crate::exit::Failure;
use crate::interruption::Interruption;
use crate::output;

/// How long a binary may take to describe itself or to check a job.
const ANSWER_LIMIT: Duration = Duration::from_secs(10);

/// A binary and its answer to `--describe`.
#[derive(Clone, Debug)]
pub struct Binary {
    /// Where it is.
    pub path: PathBuf,
    /// What it says of itself.
    pub description: Description,
    /// Hash of the file.
    pub blake3: String,
}

/// Both binaries of a run.
#[derive(Clone, Debug)]
pub struct Binaries {
    /// The plant.
    pub plant: Binary,
    /// The controller.
    pub controller: Binary,
}

impl Binaries {
    /// Finds both and asks what they are.
    ///
    /// # Errors
    /// If one is missing, cannot be executed or does not speak the protocol.
    pub fn find(arguments: &BinaryArguments, interruption: &Interruption) -> Result<Self, Failure> {
        let plant = Binary::plant(arguments.plant_bin.as_deref(), interruption)?;
        let controller = Binary::controller(arguments.controller_bin.as_deref(), interruption)?;
        Ok(Self { plant, controller })
    }

    /// What scenarios are checked against: plants, laws and kinds of faults.
    #[must_use]
    pub fn described(
        &self,
    ) -> (
        &[PlantDescription],
        &[LawDescription],
        &[FaultKindDescription],
    ) {
        let plant = &self.plant.description;
        (
            &plant.plants,
            &self.controller.description.laws,
            &plant.faults,
        )
    }
}

impl Binary {
    /// Finds a plant and asks what it is.
    ///
    /// # Errors
    /// If it is missing, cannot be executed or does not speak the protocol.
    pub fn plant(given: Option<&Path>, interruption: &Interruption) -> Result<Self, Failure> {
        let plant = Self::find(given, "plant-process", "--plant-bin", interruption)?;
        if plant.description.plants.is_empty() {
            return Err(Failure::usage(format!(
                "{} describes no plant",
                plant.path.display()
            )));
        }
        Ok(plant)
    }

    /// Finds a controller and asks what it is.
    ///
    /// # Errors
    /// If it is missing, cannot be executed or does not speak the protocol.
    pub fn controller(given: Option<&Path>, interruption: &Interruption) -> Result<Self, Failure> {
        let name = "controller-process";
        let controller = Self::find(given, name, "--controller-bin", interruption)?;
        if controller.description.laws.is_empty() {
            let path = controller.path.display();
            return Err(Failure::usage(format!("{path} describes no control law")));
        }
        Ok(controller)
    }

    fn find(
        given: Option<&Path>,
        name: &str,
        flag: &str,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let path = match given {
            // Absolute, so that what is run is what is hashed: a bare name is looked for elsewhere.
            Some(path) => std::path::absolute(path).map_err(Failure::usage)?,
            None => beside(name)?,
        };
        let shown = path.display();
        let output = ask(&path, &["--describe"], interruption)?.map_err(|error| {
            let hint = if given.is_none() {
                format!("; build it with `cargo build --release`, or name one with {flag}")
            } else {
                String::new()
            };
            Failure::usage(format!("cannot run {shown}: {error}{hint}"))
        })?;
        let description: Description = serde_json::from_slice(&output.stdout).map_err(|error| {
            let said = String::from_utf8_lossy(&output.stderr);
            let said = said.lines().next().map_or(String::new(), |line| format!(" ({line})"));
            Failure::usage(format!(
                "{shown} does not speak the protocol: its answer to --describe is not a description: {error}{said}"
            ))
        })?;
        let described = serde_json::to_value(&description).map_err(Failure::infrastructure)?;
        if let Some(text) = unprintable(&described) {
            return Err(Failure::usage(format!(
                "{shown}: its answer to --describe has control characters in {text:?}"
            )));
        }
        if description.protocol != PROTOCOL {
            let theirs = description.protocol;
            return Err(Failure::usage(format!(
                "{shown} speaks protocol {theirs}, this hil {PROTOCOL}; rebuild it"
            )));
        }
        let content = std::fs::read(&path)
            .map_err(|error| Failure::usage(format!("cannot read {shown}: {error}")))?;
        let blake3 = blake3::hash(&content).to_hex().to_string();
        Ok(Self {
            path,
            description,
            blake3,
        })
    }

    /// Asks whether the parameters of a job go together.
    ///
    /// # Errors
    /// What the binary has against them.
    pub fn check(&self, job: &Path, interruption: &Interruption) -> Result<(), Failure> {
        let arguments = ["--check".as_ref(), job.as_os_str()];
        let output = ask(&self.path, &arguments, interruption)?.map_err(|error| {
            let path = self.path.display();
            Failure::infrastructure(format!("{path} --check: {error}"))
        })?;
        if output.status.success() {
            return Ok(());
        }
        let said = String::from_utf8_lossy(&output.stderr);
        let said = said.trim().trim_start_matches("error: ");
        Err(Failure::usage(format!(
            "{}: {said}",
            self.description.program
        )))
    }
}

/// The first text of a description that a terminal would do something at.
fn unprintable(described: &Value) -> Option<&str> {
    match described {
        Value::String(text) => (output::printable(text) != *text).then_some(text),
        Value::Array(all) => all.iter().find_map(unprintable),
        Value::Object(all) => all.values().find_map(unprintable),
        Value::Null | Value::Bool(_) | Value::Number(_) => None,
    }
}

/// A binary beside this one.
fn beside(name: &str) -> Result<PathBuf, Failure> {
    let own = std::env::current_exe().map_err(Failure::infrastructure)?;
    Ok(own.with_file_name(name))
}

/// Runs a binary for a short answer; one that never answers is ended, and so is all that it started.
fn ask<S: AsRef<std::ffi::OsStr>>(
    path: &Path,
    arguments: &[S],
    interruption: &Interruption,
) -> Result<Result<Output, String>, Failure> {
    let child = Command::new(path)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .spawn();
    let mut child = match child {
        Ok(child) => child,
        Err(error) => return Ok(Err(error.to_string())),
    };
    // Read while it runs: a full pipe would stop it.
    let reader = |pipe: Option<Box<dyn Read + Send>>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(mut pipe) = pipe {
                // What was read before an error is all there is to show.
                let _ = pipe.read_to_end(&mut bytes);
            }
            bytes
        })
    };
    let stdout = reader(child.stdout.take().map(|pipe| Box::new(pipe) as _));
    let stderr = reader(child.stderr.take().map(|pipe| Box::new(pipe) as _));
    let since = Instant::now();
    let status = loop {
        match child.try_wait() {
            Err(error) => return Ok(Err(error.to_string())),
            Ok(Some(status)) => break status,
            Ok(None) if since.elapsed() > ANSWER_LIMIT || interruption.came() => {
                end_group(&child);
                let _ = child.wait(); // it was killed, or had ended just now
                if interruption.came() {
                    return Err(Failure::Interrupted);
                }
                let limit_s = ANSWER_LIMIT.as_secs();
                return Ok(Err(format!("it gave no answer within {limit_s} s")));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    // What it left running would hold the pipes open, and their readers with them.
    end_group(&child);
    let collected = |thread: std::thread::JoinHandle<Vec<u8>>| thread.join().unwrap_or_default();
    Ok(Ok(Output {
        status,
        stdout: collected(stdout),
        stderr: collected(stderr),
    }))
}

/// Kills a child that was started as a group of its own, with what it started.
pub(crate) fn end_group(child: &Child) {
    // There may be nobody left in it.
    let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_description_with_control_characters_is_found_wherever_they_are() {
        let sound = json!({"plants": [{"name": "a", "truth": [{"unit": "m", "text": "a\nb"}]}]});
        assert_eq!(unprintable(&sound), None);
        let wrong = json!({"protocol": 4, "plants": [{"truth": [{"unit": "m\u{1b}[2J"}]}]});
        assert_eq!(unprintable(&wrong), Some("m\u{1b}[2J"));
    }
}
