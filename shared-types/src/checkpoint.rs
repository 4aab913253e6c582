//! Checkpoints: when each side of a run saves its state, and where it begins in a run that goes on
//! from one.
//!
//! The launcher puts both into the jobs. Plant and controller each write their own file into the
//! session's folder when they reach the step, before anything of that step happens; the launcher
//! collects them. A side asks [`Saves`] at each step whether it is time, which is one comparison; only
//! the step at which it is does more.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::describe::Invalid;
use crate::side::Side;
use crate::state::State;
use crate::time::Step;

/// First bytes of a state's file.
const MARK: &[u8] = b"hil state 1\n";
/// A step that no run reaches.
const NEVER: Step = Step(u64::MAX);

/// Checkpoints that a side writes and the one that it begins from, as its job says.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Checkpoints {
    /// The steps, before which the state is saved; rising.
    pub steps: Vec<Step>,
    /// Folder for the saved states: the session's.
    pub folder: PathBuf,
    /// The checkpoint that the run goes on from, if it does.
    pub resume: Option<Resume>,
}

impl Checkpoints {
    /// Checks whether there is anything to save or to go on from.
    #[must_use]
    pub const fn any(&self) -> bool {
        !self.steps.is_empty() || self.resume.is_some()
    }

    /// The first step that is exchanged.
    #[must_use]
    pub fn first_step(&self) -> Step {
        self.resume.as_ref().map_or(Step(0), |resume| resume.step)
    }
}

/// Start of a side in a run that goes on from a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Resume {
    /// The first step that is exchanged.
    pub step: Step,
    /// The file with this side's state before it.
    pub state: PathBuf,
}

/// Head of a state's file; the state follows.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Head {
    /// Name of the plant or law.
    of: String,
    step: Step,
}

/// The checkpoints of a side that are still to come.
#[derive(Debug)]
pub struct Saves {
    side: Side,
    /// Name of the plant or law.
    of: String,
    checkpoints: Checkpoints,
    /// The next of them.
    next: Step,
}

impl Saves {
    /// Takes the checkpoints of a job, for a side that runs the plant or law of this name.
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

    /// Checks whether the state before a step is to be saved.
    #[inline]
    #[must_use]
    pub fn are_due(&self, step: Step) -> bool {
        step == self.next
    }

    /// Writes the state before a step, at once as seen by readers.
    ///
    /// # Errors
    /// If it has no form as bytes or cannot be written.
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
    /// Reads the state of the plant or law of a name.
    ///
    /// # Errors
    /// If the file cannot be read, or is not the state of that before that step.
    pub fn read<S: DeserializeOwned>(&self, of: &str) -> Result<S, Invalid> {
        let shown = self.state.display();
        let bytes = fs::read(&self.state)
            .map_err(|error| Invalid(format!("cannot read {shown}: {error}")))?;
        let bytes = (bytes.strip_prefix(MARK))
            .ok_or_else(|| Invalid(format!("{shown} is no state that this version wrote")))?;
        let damaged = |error: &dyn std::fmt::Display| Invalid(format!("{shown}: {error}"));
        let (head, rest): (Head, _) =
            postcard::take_from_bytes(bytes).map_err(|error| damaged(&error))?;
        if (head.of.as_str(), head.step) != (of, self.step) {
            let Head { of: theirs, step } = head;
            let wanted = self.step;
            return Err(Invalid(format!(
                "{shown} is the state of `{theirs}` before step {step}, not of `{of}` before step {wanted}"
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
        }
    }

    #[test]
    fn each_step_that_was_asked_for_is_due_once() {
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
    fn a_side_that_begins_at_a_checkpoint_does_not_save_it_again() {
        let folder = tempdir().expect("a folder");
        let resumed = saves(&folder, Some(resume(&folder, 3)));
        assert!(!resumed.are_due(Step(3)) && resumed.are_due(Step(7)));
    }

    #[test]
    fn what_was_saved_is_read_and_anything_else_refused_by_name() {
        let folder = tempdir().expect("a folder");
        saves(&folder, None)
            .write(Step(3), &[0.25, -0.0])
            .expect("written");
        let read: [f64; 2] = resume(&folder, 3).read("tank").expect("the same");
        assert_eq!(read.map(f64::to_bits), [0.25, -0.0].map(f64::to_bits));

        let refused = |step, of| {
            resume(&folder, step)
                .read::<[f64; 2]>(of)
                .expect_err("other")
                .0
        };
        assert!(refused(4, "tank").contains("before step 3, not of `tank` before step 4"));
        assert!(refused(3, "pump").contains("of `tank` before step 3, not of `pump`"));

        let path = resume(&folder, 3).state;
        let whole = fs::read(&path).expect("it is there");
        for length in 0..whole.len() {
            fs::write(&path, &whole[..length]).expect("written");
            let told = refused(3, "tank");
            assert!(
                told.contains("checkpoint-3-plant.state"),
                "{length}: {told}"
            );
        }
    }
}
