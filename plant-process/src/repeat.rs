//! Repetition of a real-time run in lockstep: the samples that its controller missed, and the command that each step
//! used.
//!
//! Consulted by the engine at each step. The controller immediately answers the samples that it received in the
//! original run; its commands wait here until the step at which they arrived in the original run.

use serde::{Deserialize, Serialize};
use shared_types::frame::Header;
use shared_types::time::Step;

/// Step of the original run at which its controller was late.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missed {
    /// The step.
    pub step: u64,
    /// Number of steps between this step and the earlier one at which its command was sent.
    pub held_steps: u32,
    /// `true` if the step's sample was answered, at that step or later.
    pub answered: bool,
}

/// Maximum number of waiting commands: each answer can be overtaken by at most two before the plant takes one
/// ([`Answered`](shared_types::directive::Answered)).
const WAITING: usize = 4;

/// Commands of a repeated run.
#[derive(Debug)]
pub(crate) struct Repetition {
    missed: Vec<Missed>,
    next: usize,
    waiting: [Waiting; WAITING],
    /// Number of commands taken; each is stored at its number modulo the capacity.
    received: usize,
}

#[derive(Clone, Debug)]
struct Waiting {
    header: Header,
    frame: Vec<f64>,
}

impl Repetition {
    /// Creates the repetition of a run with these late steps, in order, and this number of values per command frame.
    pub(crate) fn new(missed: Vec<Missed>, values: usize) -> Self {
        let nothing = Waiting {
            header: Header::new(shared_types::frame::FrameKind::Command, Step(0)),
            frame: vec![0.0; values],
        };
        Self {
            missed,
            next: 0,
            waiting: std::array::from_fn(|_| nothing.clone()),
            received: 0,
        }
    }

    /// Returns `true` if the controller received the sample of a step. Steps are queried in order.
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

    /// Stores the answer to a step and replaces it by the command that the step used.
    ///
    /// # Errors
    /// If there is no such command, because the late steps are inconsistent.
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
            self.received += 1;
            let place = &mut self.waiting[self.received % WAITING];
            place.header = header;
            place.frame.copy_from_slice(frame);
        }
        if answered && held_steps == 0 {
            return Ok(header);
        }
        let sequence = step.0.checked_sub(u64::from(held_steps));
        let match_found = (self.waiting.iter())
            .find(|waiting| waiting.header.sequence > 0 && Some(waiting.header.step) == sequence);
        let match_found = match_found.ok_or_else(|| {
            format!(
                "step {step} must use a command from {held_steps} steps before, which is missing"
            )
        })?;
        frame.copy_from_slice(&match_found.frame);
        Ok(match_found.header)
    }
}

#[cfg(test)]
mod tests {
    use shared_types::frame::FrameKind;

    use super::*;

    /// Returns the commands used by the steps of a repeated run; the command of step k is k. Unseen samples are
    /// answered with -1.
    fn repeated(missed: &[(u64, u32, bool)], steps: u64) -> Vec<Result<f64, String>> {
        let missed = missed
            .iter()
            .map(|&(step, held_steps, is_answered)| Missed {
                step,
                held_steps,
                answered: is_answered,
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
    fn a_late_command_arrives_at_its_original_step() {
        // The command of step 2 arrived at step 4 only; the samples of 3 and 4 were missed.
        let missed = [(2, 1, true), (3, 2, false), (4, 2, false)];
        let commands: Result<Vec<f64>, String> = repeated(&missed, 6).into_iter().collect();
        assert_eq!(commands, Ok(vec![0.0, 1.0, 1.0, 1.0, 2.0, 5.0]));
    }

    #[test]
    fn overtaken_answers_are_not_applied() {
        // 1 was late; then 2 and 3 were answered before the plant polled: it received 3.
        let missed = [(1, 1, true), (2, 2, true)];
        let commands: Result<Vec<f64>, String> = repeated(&missed, 5).into_iter().collect();
        assert_eq!(commands, Ok(vec![0.0, 0.0, 0.0, 3.0, 4.0]));
    }

    #[test]
    fn inconsistent_late_steps_are_refused() {
        assert!(repeated(&[(3, 9, true)], 4)[3].is_err());
        assert!(repeated(&[(1, 0, false)], 2)[1].is_err());
    }
}
