//! A run in real time, repeated in lockstep: which samples its controller did not see, and
//! which command each step had to do with.
//!
//! The engine asks it at each step. The controller answers the samples that it saw then, at once; its
//! commands wait here until the step at which they were there in the repeated run.

use serde::{Deserialize, Serialize};
use shared_types::frame::Header;
use shared_types::time::Step;

/// A step of the repeated run at which its controller was not in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missed {
    /// The step.
    pub step: u64,
    /// Number of steps before this one at which the command was sent that this step had to do with.
    pub held_steps: u32,
    /// True if the step's sample was answered, at that step or later.
    pub answered: bool,
}

/// Commands that may wait: each answer can be overtaken by two at most before the plant takes one
/// ([`Answered`](shared_types::directive::Answered)).
const WAITING: usize = 4;

/// The commands of a repeated run.
#[derive(Debug)]
pub(crate) struct Repetition {
    missed: Vec<Missed>,
    next: usize,
    waiting: [Waiting; WAITING],
    /// Commands taken so far; the last one is in the place of its number.
    taken: usize,
}

#[derive(Clone, Debug)]
struct Waiting {
    header: Header,
    frame: Vec<f64>,
}

impl Repetition {
    /// A repetition of a run that missed this, in the order of steps, whose command frames carry so
    /// many values.
    pub(crate) fn new(missed: Vec<Missed>, values: usize) -> Self {
        let nothing = Waiting {
            header: Header::new(shared_types::frame::FrameKind::Command, Step(0)),
            frame: vec![0.0; values],
        };
        Self {
            missed,
            next: 0,
            waiting: std::array::from_fn(|_| nothing.clone()),
            taken: 0,
        }
    }

    /// Returns true if the controller saw the sample of a step. Steps are asked for in order.
    pub(crate) fn is_seen(&mut self, step: Step) -> bool {
        while (self.missed.get(self.next)).is_some_and(|missed| missed.step < step.0) {
            self.next += 1;
        }
        self.at(step).answered
    }

    fn at(&self, step: Step) -> Missed {
        let here = self.missed.get(self.next).copied();
        here.filter(|missed| missed.step == step.0)
            .unwrap_or(Missed {
                step: step.0,
                held_steps: 0,
                answered: true,
            })
    }

    /// Takes the answer to a step and puts into its place the command that the step had to do with.
    ///
    /// # Errors
    /// If there is no such command: what was missed does not fit together.
    pub(crate) fn exchange(
        &mut self,
        step: Step,
        header: Header,
        frame: &mut [f64],
    ) -> Result<Header, String> {
        let Missed {
            held_steps,
            answered,
            ..
        } = self.at(step);
        if answered {
            self.taken += 1;
            let place = &mut self.waiting[self.taken % WAITING];
            place.header = header;
            place.frame.copy_from_slice(frame);
        }
        if answered && held_steps == 0 {
            return Ok(header);
        }
        let wanted = step.0.checked_sub(u64::from(held_steps));
        let found = (self.waiting.iter())
            .find(|waiting| waiting.header.sequence > 0 && Some(waiting.header.step) == wanted);
        let found = found.ok_or_else(|| {
            format!(
                "step {step} is to hold a command of {held_steps} steps before, which is not there"
            )
        })?;
        frame.copy_from_slice(&found.frame);
        Ok(found.header)
    }
}

#[cfg(test)]
mod tests {
    use shared_types::frame::FrameKind;

    use super::*;

    /// Returns the commands that the steps of a repeated run had to do with; the command of step k is k.
    /// Unseen samples are answered with -1.
    fn repeated(missed: &[(u64, u32, bool)], steps: u64) -> Vec<Result<f64, String>> {
        let missed = missed.iter().map(|&(step, held_steps, answered)| Missed {
            step,
            held_steps,
            answered,
        });
        let mut repetition = Repetition::new(missed.collect(), 1);
        (0..steps)
            .map(|step| {
                let is_seen = repetition.is_seen(Step(step));
                let mut frame = [if is_seen { step as f64 } else { -1.0 }];
                let header = Header {
                    sequence: step + 1,
                    ..Header::new(FrameKind::Command, Step(step))
                };
                let header = repetition.exchange(Step(step), header, &mut frame)?;
                assert_eq!(header.step as f64, frame[0]);
                Ok(frame[0])
            })
            .collect()
    }

    #[test]
    fn a_late_command_comes_when_it_came() {
        // The command of step 2 was there at step 4 only, the samples of 3 and 4 were not seen.
        let missed = [(2, 1, true), (3, 2, false), (4, 2, false)];
        let commands: Result<Vec<f64>, String> = repeated(&missed, 6).into_iter().collect();
        assert_eq!(commands, Ok(vec![0.0, 1.0, 1.0, 1.0, 2.0, 5.0]));
    }

    #[test]
    fn answers_that_were_overtaken_are_not_applied() {
        // 1 was late; then 2 and 3 were answered before the plant looked: 3 is what it found.
        let missed = [(1, 1, true), (2, 2, true)];
        let commands: Result<Vec<f64>, String> = repeated(&missed, 5).into_iter().collect();
        assert_eq!(commands, Ok(vec![0.0, 0.0, 0.0, 3.0, 4.0]));
    }

    #[test]
    fn what_does_not_fit_together_is_refused() {
        assert!(repeated(&[(3, 9, true)], 4)[3].is_err());
        assert!(repeated(&[(1, 0, false)], 2)[1].is_err());
    }
}
