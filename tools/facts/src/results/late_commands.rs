//! Late commands of a recorded run, which `hil rerun` repeats in lockstep.
//!
//! Every record says which command its step met, and that command which samples were answered
//! before it. A sample that no command tells of was never seen by the controller.

use std::collections::BTreeMap;

use plant_process::repeat::Missed;
use shared_types::directive::Answered;
use shared_types::time::Step;

use hil_recording::reader::RunReader;

/// Steps of a run that missed their command, collected from one record after another.
#[derive(Debug)]
pub struct LateCommands {
    /// Places of the words in a record.
    held_steps: usize,
    answered: usize,
    /// The step of the last command met.
    last: Option<u64>,
    missed: BTreeMap<u64, Missed>,
}

impl LateCommands {
    /// Begins with the records of a run; `None` if they do not tell, as those of older versions.
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

    /// Takes in a record that a command answered.
    pub fn take(&mut self, step: u64, words: &[u64]) {
        let held_steps = words[self.held_steps];
        let command = step.saturating_sub(held_steps);
        if held_steps > 0 {
            self.missed.insert(
                step,
                Missed {
                    step,
                    held_steps: held_steps as u32,
                    answered: false, // until a command tells
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

    /// All of them, in the order of steps.
    pub fn missed(self) -> Vec<Missed> {
        self.missed.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps as they were met: the step of the command, and the answers before it.
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
    fn a_run_in_time_missed_nothing() {
        let first = Answered::default();
        let second = first.then(1);
        assert!(collected(&[(0, first), (1, second), (2, second.then(1))]).is_empty());
    }

    #[test]
    fn a_sample_that_no_command_tells_of_was_not_seen() {
        // 1 was answered late, after 3; 2 and 3 were never seen; then 4 in time.
        let (at_0, at_1) = (Answered::default(), Answered::default().then(1));
        let at_4 = at_1.then(3);
        let met = [(0, at_0), (0, at_0), (0, at_0), (1, at_1), (4, at_4)];
        assert_eq!(
            collected(&met),
            [(1, 1, true), (2, 2, false), (3, 2, false)]
        );
    }

    #[test]
    fn an_answer_that_was_overtaken_was_seen() {
        // 1 and 2 were answered before the plant looked at 3, which was there too.
        let at_0 = Answered::default();
        let at_3 = at_0.then(1).then(1).then(1);
        let met = [(0, at_0), (0, at_0), (0, at_0), (3, at_3)];
        assert_eq!(collected(&met), [(1, 1, true), (2, 2, true)]);
    }

    #[test]
    fn at_the_end_what_nobody_met_was_not_seen() {
        let at_0 = Answered::default();
        assert_eq!(collected(&[(0, at_0), (0, at_0)]), [(1, 1, false)]);
    }
}
