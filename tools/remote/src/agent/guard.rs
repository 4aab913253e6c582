//! The rule that determines the output of a target: states and events without file or clock, and the [file](Output)
//! that follows them.
//!
//! ```text
//! Closed -> Commanded -> Missing -> Returning -> Commanded
//!              any of them -> Ended
//! ```
//!
//! The agent's [run](super::run) reports each event as it happens. Nothing here waits. Once the output has switched to
//! the safe command, only a command that answers a later sample can replace it.

use hil_session::clock::monotonic_ns;

use super::output::Output;
use crate::message::{Missed, ToDesk};

/// A sample of the plant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sample {
    pub(super) step: u64,
    pub(super) at_ns: u64,
}

/// Gap in the samples, during which the output is the safe command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gap {
    /// Time of the switch.
    since_ns: u64,
    /// Step of the last sample before the gap.
    after: u64,
}

/// State of the output. `last` is the last sample while another must follow: not before the first sample, and not while
/// the run is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// No output: the signals are unknown, or the plant waits for commands.
    Closed,
    /// Each command takes effect.
    Commanded { last: Option<Sample> },
    /// Samples are missing: no command takes effect.
    Missing(Gap),
    /// Samples are back from step `first` on: only an answer to one of them takes effect.
    Returning {
        gap: Gap,
        first: u64,
        last: Option<Sample>,
    },
    /// The output remains the safe command.
    Ended,
}

/// Event that may change the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// The signals are known, and the plant does not wait for commands.
    Opened,
    /// A new sample arrived.
    Sampled(Sample),
    /// The run is held: no sample follows for now.
    Held,
    /// The controller answered the sample of a step.
    Answered { step: u64, is_finite: bool },
    /// Time has passed.
    Passed { now_ns: u64 },
    /// Plant, controller or run has ended.
    Ended,
}

/// Change of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Action {
    /// Leave it.
    Keep,
    /// Apply the safe command until the next event.
    Secure,
    /// Apply the command of the controller.
    Put,
    /// Apply the safe command, count the switch and report it.
    Switch(Gap),
    /// Apply the command of the controller, and report the end of the gap.
    Return(Gap),
    /// Apply the safe command and close the file.
    Close,
}

impl State {
    /// Returns the state after an event, and the change of the output; samples count as missing after `limit_ns`.
    pub(super) fn after(self, event: Event, limit_ns: u64) -> (Self, Action) {
        use Action::{Close, Keep, Put, Return, Secure, Switch};
        use State::{Closed, Commanded, Missing, Returning};
        match (self, event) {
            (State::Ended, _) => (State::Ended, Keep),
            (_, Event::Ended) => (State::Ended, Close),

            (Closed, Event::Opened) => (Commanded { last: None }, Secure),
            (Closed, _) | (_, Event::Opened) => (self, Keep),

            (Commanded { .. }, Event::Sampled(sample)) => (Commanded { last: Some(sample) }, Keep),
            (Commanded { .. }, Event::Held) => (Commanded { last: None }, Keep),
            (Commanded { .. }, Event::Answered { is_finite, .. }) => {
                (self, if is_finite { Put } else { Secure })
            }
            (Commanded { last }, Event::Passed { now_ns }) => match last {
                Some(last) if now_ns.saturating_sub(last.at_ns) > limit_ns => {
                    let (since_ns, after) = (now_ns, last.step);
                    let gap = Gap { since_ns, after };
                    (Missing(gap), Switch(gap))
                }
                _ => (self, Keep),
            },

            (Missing(gap), Event::Sampled(sample)) => {
                let (first, last) = (sample.step, Some(sample));
                (Returning { gap, first, last }, Keep)
            }
            (Missing(_), Event::Held | Event::Answered { .. } | Event::Passed { .. }) => {
                (self, Keep)
            }

            (Returning { gap, first, .. }, Event::Sampled(sample)) => {
                let last = Some(sample);
                (Returning { gap, first, last }, Keep)
            }
            (Returning { gap, first, .. }, Event::Held) => {
                let last = None;
                (Returning { gap, first, last }, Keep)
            }
            (Returning { first, .. }, Event::Answered { step, .. }) if step < first => (self, Keep),
            (Returning { gap, last, .. }, Event::Answered { is_finite, .. }) => match is_finite {
                true => (Commanded { last }, Return(gap)),
                false => (self, Secure),
            },
            (Returning { .. }, Event::Passed { .. }) => (self, Keep),
        }
    }
}

/// The output of a run and its state.
pub(super) struct Guard {
    state: State,
    /// The file, unless the state is `Closed` or `Ended`.
    output: Option<Output>,
    missed: Missed,
    switches: u32,
}

impl Guard {
    /// Creates the guard of a run that has no output yet.
    pub(super) const fn new(missed: Missed) -> Self {
        Self {
            state: State::Closed,
            output: None,
            missed,
            switches: 0,
        }
    }

    /// Records that the signals are known, and opens the output.
    pub(super) fn open(&mut self, output: Output) {
        self.output = Some(output);
        self.note(Event::Opened);
    }

    /// Records an event other than an answer; returns a report for the desk, if one is due.
    pub(super) fn note(&mut self, event: Event) -> Option<ToDesk> {
        self.apply(event, 0, &[])
    }

    /// Records the controller's answer to the sample of a step; returns a report for the desk, if one is due.
    pub(super) fn answer(&mut self, step: u64, row: &[f64]) -> Option<ToDesk> {
        let is_finite = self.output.as_ref()?.is_finite(row);
        self.apply(Event::Answered { step, is_finite }, step, row)
    }

    fn apply(&mut self, event: Event, step: u64, row: &[f64]) -> Option<ToDesk> {
        let Missed { period_s, periods } = self.missed;
        let limit_ns = (period_s * f64::from(periods) * 1e9) as u64;
        let action;
        (self.state, action) = self.state.after(event, limit_ns);
        if matches!(self.state, State::Ended) {
            self.output = None; // puts the safe command
        }
        let output = self.output.as_mut()?;
        let what = match action {
            Action::Keep | Action::Close => return None,
            Action::Secure => {
                output.switch();
                return None;
            }
            Action::Put => {
                output.put(step, row);
                return None;
            }
            Action::Switch(Gap { after, .. }) => {
                output.switch();
                self.switches += 1;
                format!(
                    "no sample after step {after} for {periods} periods, so its output is the safe command"
                )
            }
            Action::Return(Gap { since_ns, after }) => {
                output.put(step, row);
                let for_s = monotonic_ns().saturating_sub(since_ns) as f64 / 1e9;
                format!(
                    "no sample after step {after} for {periods} periods, so its output was the safe command for {for_s:.3} s and is the controller's again from step {step}"
                )
            }
        };
        Some(ToDesk::Output {
            what,
            switches: self.switches,
            is_back: matches!(action, Action::Return(_)),
        })
    }
}

#[cfg(test)]
mod tests;
