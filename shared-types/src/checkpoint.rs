//! Checkpoints: the steps at which each side saves its state, and the step at which a resumed run starts.
//!
//! The launcher puts both into the jobs. On reaching such a step, and before executing any of it, plant and controller
//! each write a file into the session's folder; the launcher collects them. A side asks [`Saves`] at each step whether
//! to save, which costs one comparison; only the steps that save do more.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::describe::Invalid;
use crate::side::Side;
use crate::state::State;
use crate::time::Step;

/// Leading bytes of a state file.
const MARK: &[u8] = b"hil state 1\n";
/// Step beyond the end of any run.
const NEVER: Step = Step(u64::MAX);

/// Checkpoints that a side writes, and the one from which it resumes, as stated in its job.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Checkpoints {
    /// Steps before which the state is saved, ascending.
    pub steps: Vec<Step>,
    /// Folder for the saved states: the session's folder.
    pub folder: PathBuf,
    /// Checkpoint that the run resumes from, if any.
    pub resume: Option<Resume>,
}

impl Checkpoints {
    /// Returns `true` if there is a state to save or to resume from.
    #[must_use]
    pub const fn any(&self) -> bool {
        !self.steps.is_empty() || self.resume.is_some()
    }

    /// Returns the first step that is exchanged.
    #[must_use]
    pub fn first_step(&self) -> Step {
        self.resume.as_ref().map_or(Step(0), |resume| resume.step)
    }
}

/// Starting point of a side in a resumed run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resume {
    /// First step that is exchanged.
    pub step: Step,
    /// File with this side's state before that step.
    pub state: PathBuf,
    /// State in memory, for sides in the launcher's own process; the file is then not read.
    #[serde(skip)]
    pub memory: Option<State>,
}

/// Header of a state file, followed by the state.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Head {
    /// Name of the plant or law.
    of: String,
    step: Step,
}

/// Remaining checkpoints of a side.
#[derive(Debug)]
pub struct Saves {
    side: Side,
    /// Name of the plant or law.
    of: String,
    checkpoints: Checkpoints,
    /// Step of the next checkpoint.
    next: Step,
}

impl Saves {
    /// Schedules the checkpoints of a job for a side that runs the named plant or law.
    #[must_use]
    pub fn new(side: Side, of: &str, checkpoints: Checkpoints) -> Self {
        let first = checkpoints.first_step();
        let mut saves = Self {
            side,
            of: of.into(),
            checkpoints,
            next: NEVER,
        };
        saves.look_beyond(first);
        saves
    }

    fn look_beyond(&mut self, step: Step) {
        let steps = &self.checkpoints.steps;
        self.next = (steps.iter().copied())
            .find(|next| *next > step)
            .unwrap_or(NEVER);
    }

    /// Returns `true` if the state before a step must be saved.
    #[inline]
    #[must_use]
    pub fn are_due(&self, step: Step) -> bool {
        step == self.next
    }

    /// Writes the state before a step; the file appears atomically.
    ///
    /// # Errors
    /// If the state cannot be serialised or the file cannot be written.
    pub fn write<S: Serialize>(&mut self, step: Step, state: &S) -> Result<(), String> {
        self.look_beyond(step);
        let path = self.checkpoints.folder.join(self.side.file(step));
        let head = Head {
            of: self.of.clone(),
            step,
        };
        let state = State::of(&(head, state)).map_err(|e| e.to_string())?;
        write_whole(&path, &[MARK, state.as_bytes()])
            .map_err(|error| format!("cannot write {}: {error}", path.display()))
    }
}

impl Resume {
    /// Reads the state of the named plant or law.
    ///
    /// # Errors
    /// If the file cannot be read, or belongs to another plant, law or step.
    pub fn read<S: DeserializeOwned>(&self, of: &str) -> Result<S, Invalid> {
        if let Some(state) = &self.memory {
            return state.read();
        }
        let path = self.state.display();
        let bytes = fs::read(&self.state)
            .map_err(|error| Invalid(format!("cannot read {path}: {error}")))?;
        let bytes = (bytes.strip_prefix(MARK))
            .ok_or_else(|| Invalid(format!("{path} is not a state written by this version")))?;
        let damaged = |error: &dyn std::fmt::Display| Invalid(format!("{path}: {error}"));
        let (head, rest): (Head, _) =
            postcard::take_from_bytes(bytes).map_err(|error| damaged(&error))?;
        if (head.of.as_str(), head.step) != (of, self.step) {
            let Head { of: theirs, step } = head;
            let expected_step = self.step;
            return Err(Invalid(format!(
                "{path} is the state of `{theirs}` before step {step}, not of `{of}` before step {expected_step}"
            )));
        }
        State::from(rest.to_vec())
            .read()
            .map_err(|error| damaged(&error))
    }
}

fn write_whole(path: &Path, parts: &[&[u8]]) -> std::io::Result<()> {
    let part = path.with_extension("part");
    let mut file = fs::File::create(&part)?;
    for bytes in parts {
        file.write_all(bytes)?;
    }
    fs::rename(&part, path)
}

#[cfg(test)]
mod tests {
    use tempfile::{TempDir, tempdir};

    use super::*;

    fn saves(folder: &TempDir, resume: Option<Resume>) -> Saves {
        let checkpoints = Checkpoints {
            steps: vec![Step(3), Step(7)],
            folder: folder.path().into(),
            resume,
        };
        Saves::new(Side::Plant, "tank", checkpoints)
    }

    fn resume(folder: &TempDir, step: u64) -> Resume {
        Resume {
            step: Step(step),
            state: folder.path().join("checkpoint-3-plant.state"),
            memory: None,
        }
    }

    #[test]
    fn each_requested_step_is_due_once() {
        let folder = tempdir().expect("a folder");
        let mut saves = saves(&folder, None);
        let due = |saves: &Saves| (0..10).filter(|step| saves.are_due(Step(*step))).collect();
        let first: Vec<u64> = due(&saves);
        saves.write(Step(3), &1.5).expect("written");
        let second: Vec<u64> = due(&saves);
        saves.write(Step(7), &1.5).expect("written");
        let third: Vec<u64> = due(&saves);
        assert_eq!((first, second, third), (vec![3], vec![7], vec![]));
    }

    #[test]
    fn a_side_that_resumes_from_a_checkpoint_does_not_save_it_again() {
        let folder = tempdir().expect("a folder");
        let resumed = saves(&folder, Some(resume(&folder, 3)));
        assert!(!resumed.are_due(Step(3)) && resumed.are_due(Step(7)));
    }

    #[test]
    fn a_saved_state_is_read_back_and_any_other_file_is_refused_by_name() {
        let folder = tempdir().expect("a folder");
        saves(&folder, None)
            .write(Step(3), &[0.25, -0.0])
            .expect("written");
        let read: [f64; 2] = resume(&folder, 3).read("tank").expect("the same");
        assert_eq!(read.map(f64::to_bits), [0.25, -0.0].map(f64::to_bits));

        let error_for = |step, of| {
            resume(&folder, step)
                .read::<[f64; 2]>(of)
                .expect_err("other")
                .0
        };
        assert!(error_for(4, "tank").contains("before step 3, not of `tank` before step 4"));
        assert!(error_for(3, "pump").contains("of `tank` before step 3, not of `pump`"));

        let path = resume(&folder, 3).state;
        let whole = fs::read(&path).expect("a saved state");
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).expect("written");
            let text = error_for(3, "tank");
            assert!(
                text.contains("checkpoint-3-plant.state"),
                "{length}: {text}"
            );
        }
    }
}
