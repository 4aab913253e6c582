//! State of the controller in a checkpoint: the law and its pending commands.
//!
//! The runner saves this state between two samples and starts from it in a resumed run. All other data follows from the
//! job or is overwritten by every sample before it is read.

use serde::{Deserialize, Serialize};
use shared_types::checkpoint::Saves;
use shared_types::describe::Invalid;
use shared_types::directive::Answered;
use shared_types::link::Link;
use shared_types::state::State;
use shared_types::time::Step;

use super::answering::{Held, Made};
use super::quality::SavedQuality;
use super::tuning::SavedTuning;
use super::{Bound, Runner};

/// State of the controller between two samples.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SavedController {
    pub(super) law: State,
    answer: Vec<f64>,
    frame: Vec<f64>,
    late: Vec<f64>,
    made: Made,
    held: Held,
    quality: SavedQuality,
    late_until: Option<Step>,
    last: Option<Step>,
    /// Answered samples, encoded as on the wire.
    answered: u64,
    pub(super) tuning: SavedTuning,
}

impl<K, L: Link> Runner<K, L> {
    /// Returns the state of the law and of its pending commands, between two samples.
    ///
    /// # Errors
    /// If the law cannot save its state, or the run has not begun.
    pub fn state(&self) -> Result<State, Invalid> {
        let bound = self.bound.as_ref();
        let bound = bound.ok_or_else(|| Invalid("the run has not begun".into()))?;
        State::of(&bound.save()?)
    }
}

/// Saves the state before a sample, while the plant prepares that sample.
pub(super) fn save(bound: &Bound, saves: &mut Saves, step: Step) -> Result<(), String> {
    let saved = bound.save().map_err(|e| e.to_string())?;
    saves.write(step, &saved)
}

impl Bound {
    /// Returns the state of the law and of the pending commands.
    pub(super) fn save(&self) -> Result<SavedController, Invalid> {
        Ok(SavedController {
            law: self.law.save()?,
            answer: self.answer.clone(),
            frame: self.frame.clone(),
            late: self.late.clone(),
            made: self.made,
            held: self.held,
            quality: self.quality.save(),
            late_until: self.late_until,
            last: self.last,
            answered: self.answered.to_wire(),
            tuning: self.tuning.save(),
        })
    }

    /// Restores a saved state.
    pub(super) fn restore(&mut self, saved: SavedController) -> Result<(), Invalid> {
        let rows = [
            (&mut self.answer, saved.answer),
            (&mut self.frame, saved.frame),
            (&mut self.late, saved.late),
        ];
        for (row, saved) in rows {
            if row.len() != saved.len() {
                let (theirs, ours) = (saved.len(), row.len());
                return Err(Invalid(format!(
                    "commands had {theirs} signals when the state was saved, but have {ours} now"
                )));
            }
            *row = saved;
        }
        self.made = saved.made;
        self.held = saved.held;
        self.quality.restore(saved.quality);
        self.late_until = saved.late_until;
        self.last = saved.last;
        self.answered = Answered::from_wire(saved.answered);
        self.tuning.restore(&saved.tuning, self.law.as_mut())?;
        self.law.restore(&saved.law)
    }
}
