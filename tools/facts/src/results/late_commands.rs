//! Late commands of a recorded run, which `hil rerun` repeats in lockstep.
//!
//! Every record states which command its step received, and that command states which samples were answered before it.
//! A sample that no command reports never reached the controller.

use std::collections::BTreeMap;

use plant_process::repeat::Missed;
use shared_types::directive::Answered;
use shared_types::time::Step;

use hil_recording::reader::RunReader;

/// Steps of a run that missed their command, collected record by record.
#[derive(Debug)]
pub struct LateCommands {
    /// Indices of the words in a record.
    held_steps: usize,
    answered: usize,
    /// Step of the last received command.
    last: Option<u64>,
    missed: BTreeMap<u64, Missed>,
}

impl LateCommands {
    /// Starts with the records of a run; `None` if they lack the necessary words, as in older versions.
    pub fn of(reader: &RunReader) -> Option<Self> {
        let places = (reader.place("held_steps")?, reader.place("answered")?);
        Some(Self::new(places.0, places.1))
    }

    const fn new(held_steps: usize, answered: usize) -> Self {
        Self {
            held_steps,
            answered,
            last: None,
            missed: BTreeMap::new(),
        }
    }

    /// Adds a record whose step received a command.
    pub fn take(&mut self, step: u64, words: &[u64]) {
        let held_steps = words[self.held_steps];
        let command = step.saturating_sub(held_steps);
        if held_steps > 0 {
            self.missed.insert(
                step,
                Missed {
                    step,
                    held_steps: held_steps as u32,
                    answered: false, // until a command reports it
                },
            );
        }
        if self.last == Some(command) {
            return;
        }
        let before: Vec<u64> = Answered::from_wire(words[self.answered])
            .steps(Step(command))
            .map(|step| step.0)
            .collect();
        let since = self.last.map_or(0, |last| last + 1);
        for step in since..=command {
            let answered = step == command || before.contains(&step);
            if let Some(missed) = self.missed.get_mut(&step) {
                missed.answered = answered;
            }
        }
        self.last = Some(command);
    }

    /// Returns all missed steps in order.
    pub fn missed(self) -> Vec<Missed> {
        self.missed.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Collects steps from the step of their command and the answers before it.
    fn collected(steps: &[(u64, Answered)]) -> Vec<(u64, u32, bool)> {
        let mut collector = LateCommands::new(0, 1);
        for (step, (command, answered)) in (0..).zip(steps) {
            collector.take(step, &[step - command, answered.to_wire()]);
        }
        (collector.missed().into_iter())
            .map(|missed| (missed.step, missed.held_steps, missed.answered))
            .collect()
    }

    #[test]
    fn a_punctual_run_missed_nothing() {
        let first = Answered::default();
        let second = first.then(1);
        assert!(collected(&[(0, first), (1, second), (2, second.then(1))]).is_empty());
    }

    #[test]
    fn a_sample_reported_by_no_command_was_not_seen() {
        // 1 was answered late, after 3; 2 and 3 were never seen; then 4 in time.
        let (at_0, at_1) = (Answered::default(), Answered::default().then(1));
        let at_4 = at_1.then(3);
        let steps = [(0, at_0), (0, at_0), (0, at_0), (1, at_1), (4, at_4)];
        assert_eq!(
            collected(&steps),
            [(1, 1, true), (2, 2, false), (3, 2, false)]
        );
    }

    #[test]
    fn a_sample_with_an_overtaken_answer_was_seen() {
        // 1 and 2 were answered before the plant looked at 3, which had arrived too.
        let at_0 = Answered::default();
        let at_3 = at_0.then(1).then(1).then(1);
        let steps = [(0, at_0), (0, at_0), (0, at_0), (3, at_3)];
        assert_eq!(collected(&steps), [(1, 1, true), (2, 2, true)]);
    }

    #[test]
    fn samples_without_a_command_at_the_end_were_not_seen() {
        let at_0 = Answered::default();
        assert_eq!(collected(&[(0, at_0), (0, at_0)]), [(1, 1, false)]);
    }
}
