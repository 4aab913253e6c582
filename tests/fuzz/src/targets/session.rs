//! Files of a session and lines of its socket: `session.json`, both jobs, `layout.json`, requests and
//! their answers, the states of a checkpoint.
//!
//! The first line of an input names the kind of file that follows. Accepted content is written back unchanged. A job
//! that fits its plant or law starts it, any other job is refused; the same holds for a state.

use std::cell::RefCell;
use std::fs;
use std::path::Path;

use hil_facts::checkpoint::Checkpoint;
use hil_session::session::SessionInfo;
use plant_process::engine::Engine;
use plant_process::faults::kinds;
use serde::Serialize;
use serde::de::DeserializeOwned;
use shared_types::checkpoint::{Checkpoints, Resume};
use shared_types::describe::Description;
use shared_types::live::{Request, Response};
use shared_types::record::RecordLayout;
use shared_types::time::Step;
use shared_types::{link, stream};
use tempfile::TempDir;

use super::rig::small_plan;

thread_local! {
    /// Folder for files that are read by path.
    static FOLDER: RefCell<TempDir> = RefCell::new(tempfile::tempdir().expect("a temporary folder"));
}

/// Runs the target.
pub fn run(bytes: &[u8]) {
    let end = bytes
        .iter()
        .position(|byte| *byte == b'\n')
        .unwrap_or(bytes.len());
    let (name, rest) = bytes.split_at(end);
    let rest = rest.get(1..).unwrap_or_default();
    match name {
        b"session.json" => session(rest),
        b"layout.json" => layout(rest),
        b"checkpoint.json" => same_again::<Checkpoint>(rest),
        b"description.json" => same_again::<Description>(rest),
        b"request" => same_again::<Request>(rest),
        b"response" => same_again::<Response>(rest),
        b"plant.json" => {
            if let Ok(job) = serde_json::from_slice::<plant_process::job::Job>(rest) {
                same_again::<plant_process::job::Job>(rest);
                start_plant(job);
            }
        }
        b"controller.json" => {
            if let Ok(job) = serde_json::from_slice::<controller_process::job::Job>(rest) {
                same_again::<controller_process::job::Job>(rest);
                start_controller(job);
            }
        }
        b"plant.state" => with_file(rest, |path| {
            start_plant(plant_process::job::Job {
                checkpoints: resume(path),
                ..plant_job()
            });
        }),
        b"controller.state" => with_file(rest, |path| {
            start_controller(controller_process::job::Job {
                checkpoints: resume(path),
                ..controller_job()
            });
        }),
        _ => {}
    }
}

/// Calls a function with a file that contains these bytes.
fn with_file(bytes: &[u8], work: impl FnOnce(&Path)) {
    FOLDER.with_borrow(|folder| {
        let path = folder.path().join("file");
        fs::write(&path, bytes).expect("written");
        work(&path);
    });
}

/// Checks that accepted content is written back unchanged.
fn same_again<T: Serialize + DeserializeOwned>(bytes: &[u8]) {
    let Ok(read) = serde_json::from_slice::<T>(bytes) else {
        return;
    };
    let written = serde_json::to_vec(&read).expect("plain data");
    let again: T = serde_json::from_slice(&written).unwrap_or_else(|error| {
        panic!("{error} in {}", String::from_utf8_lossy(&written));
    });
    assert_eq!(serde_json::to_vec(&again).expect("plain data"), written);
}

fn session(bytes: &[u8]) {
    same_again::<SessionInfo>(bytes);
    FOLDER.with_borrow(|folder| {
        let path = folder.path();
        fs::write(path.join("session.json"), bytes).expect("written");
        match SessionInfo::read(path) {
            Ok(info) => {
                let _ = info.iceoryx_config(); // a name that does not suit is refused
            }
            Err(error) => assert!(error.to_string().contains("session.json"), "{error}"),
        }
    });
}

fn layout(bytes: &[u8]) {
    same_again::<RecordLayout>(bytes);
    let Ok(layout) = serde_json::from_slice::<RecordLayout>(bytes) else {
        return;
    };
    let words = vec![u64::MAX; layout.words()];
    let view = layout.view(&words);
    assert_eq!(view.values.len(), layout.values());
    assert_eq!(view.hashed.len(), layout.hashed_words());
}

/// Starts a run from the state in this file.
fn resume(path: &Path) -> Checkpoints {
    Checkpoints {
        resume: Some(Resume {
            step: Step(3),
            state: path.to_owned(),
            memory: None,
        }),
        ..Checkpoints::default()
    }
}

/// Returns the job of the plant of the small scenario.
pub fn plant_job() -> plant_process::job::Job {
    plant_process::job::Job {
        observed: false,
        ..plant_process::job::Job::of(small_plan(), 7, 5.0)
    }
}

/// Returns the job of its controller.
pub fn controller_job() -> controller_process::job::Job {
    let (plant, rate) = (&small_plan().plant.model, small_plan().run.rate);
    let plan = small_plan().controller.clone();
    controller_process::job::Job {
        parameters: plan.parameters,
        model: plan.model,
        rate_divisor: plan.rate_divisor,
        command_delay_steps: plan.command_delay_steps,
        ..controller_process::job::Job::new(7, plant, &plan.law, rate, 5.0)
    }
}

/// Returns true for a state from outside the target: a path in the input may name any file.
fn is_foreign(checkpoints: &Checkpoints) -> bool {
    let is_ours =
        |resume: &Resume| FOLDER.with_borrow(|ours| resume.state.starts_with(ours.path()));
    (checkpoints.resume.as_ref()).is_some_and(|resume| !is_ours(resume))
}

/// Starts the plant of a job, or returns the reason of the refusal.
fn start_plant(job: plant_process::job::Job) {
    let plants = plant_process::models::all();
    let model = &job.plant.model;
    let Some(kind) = plants.iter().find(|kind| kind.description.name == *model) else {
        return;
    };
    if is_foreign(&job.checkpoints) {
        return;
    }
    let (link, _) = link::in_process::pair();
    let (sink, _) = stream::in_process::pair();
    if let Err(invalid) = Engine::new(kind, &kinds::all(), job, link, sink) {
        assert!(!invalid.0.is_empty());
    }
}

/// Starts the law of a job, or returns the reason of the refusal.
fn start_controller(job: controller_process::job::Job) {
    let laws = controller_process::laws::all();
    let Some(kind) = laws.iter().find(|kind| kind.description.name == job.law) else {
        return;
    };
    if is_foreign(&job.checkpoints) {
        return;
    }
    let (link, _) = link::in_process::pair();
    if let Err(invalid) = controller_process::runner::Runner::new(kind, job, link) {
        assert!(!invalid.0.is_empty());
    }
}
