//! Received commands, on time or late.
//!
//! Used by the exchange of each step; never accesses the values, which are in the [rows](crate::rows::Rows).

use shared_types::frame::{FrameKind, Header};
use shared_types::pacer::Streaks;
use shared_types::time::Step;
use shared_types::wait::WaitLimit;

use crate::repeat::Repetition;

/// Latest command as used by a step.
#[derive(Clone, Copy)]
pub(super) struct Met {
    /// Steps since the step for which the command was sent.
    pub held_steps: u32,
    /// Age of the command's content in steps, on arrival at the plant.
    pub age_steps: u32,
    /// As in [`Command`].
    pub round_trip_ns: u64,
    /// As in [`Command`].
    pub work_ns: u64,
}

/// Latest command, and bookkeeping about earlier ones.
#[derive(Default)]
pub(super) struct Commands {
    pub newest: Command,
    /// Time of the last arrival of a command, in ns of the monotonic clock.
    pub heard_ns: u64,
    /// Steps whose command missed its deadline.
    pub missed: Streaks,
    /// Commands used by a recorded real-time run, if one is being repeated.
    pub repetition: Option<Repetition>,
}

/// Newest command.
#[derive(Clone, Copy)]
pub(super) struct Command {
    pub header: Header,
    /// Steps since the step for which the command was sent, at the last step that used it.
    pub held_steps: u32,
    /// Time from sending the command's sample, or from its due time, to the command's arrival; 0 if no command arrived
    /// at this step. If a late command and its successor arrive together, the time of the late one.
    pub round_trip_ns: u64,
    /// Time that the controller worked on the command; 0 likewise.
    pub work_ns: u64,
}

impl Default for Command {
    fn default() -> Self {
        Self::new(Header::new(FrameKind::Command, Step(0)))
    }
}

impl Command {
    /// Creates a command that no controller sent.
    pub(super) const fn new(header: Header) -> Self {
        Self {
            header,
            held_steps: 0,
            round_trip_ns: 0,
            work_ns: 0,
        }
    }
}

impl Commands {
    /// Stores an arrived command as the latest one.
    pub(super) fn came(&mut self, header: &Header, received_ns: u64, round_trip_ns: u64) {
        self.heard_ns = received_ns;
        let newest = &mut self.newest;
        newest.header = *header;
        if round_trip_ns > newest.round_trip_ns {
            (newest.round_trip_ns, newest.work_ns) = (round_trip_ns, header.work_ns);
        }
    }

    /// Assigns the latest command to a step; the step counts as missed if the command belongs to an earlier step
    /// although there is a controller.
    pub(super) fn meet(&mut self, step: Step, is_alone: bool) -> Met {
        let newest = &mut self.newest;
        let held_steps = (step.0 - newest.header.step) as u32;
        newest.held_steps = held_steps;
        if held_steps > 0 && !is_alone {
            self.missed.note(step);
        }
        Met {
            held_steps,
            age_steps: newest.header.age_steps.saturating_add(held_steps),
            round_trip_ns: std::mem::take(&mut newest.round_trip_ns),
            work_ns: std::mem::take(&mut newest.work_ns),
        }
    }

    /// Resumes after a hold: excludes the hold from the time without commands.
    pub(super) const fn resume(&mut self, since_ns: u64, now_ns: u64) {
        self.heard_ns = now_ns - since_ns.saturating_sub(self.heard_ns);
    }

    /// Returns `true` if no command arrived within the wait limit.
    pub(super) const fn are_silent(&self, now_ns: u64, limit: WaitLimit) -> bool {
        now_ns - self.heard_ns >= limit.ns()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hold_is_not_counted_as_silence() {
        for (heard_ns, after_ns) in [(10, 40), (20, 50), (30, 50), (50, 50)] {
            let mut commands = Commands {
                heard_ns,
                ..Commands::default()
            };
            commands.resume(20, 50);
            assert_eq!(commands.heard_ns, after_ns, "{heard_ns}");
        }
    }
}
