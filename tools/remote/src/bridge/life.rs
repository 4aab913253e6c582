//! The life of the controller behind a bridge, as states and events without input, output or clock.

use super::{PARTING_NS, STOPPING_NS};

/// Exit of the controller's program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Exit {
    pub(super) code: Option<i32>,
    /// Description of the program's end, if it was abnormal.
    pub(super) fate: Option<String>,
    /// Number of its last frame.
    pub(super) said: u64,
}

/// State of the controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Life {
    Running,
    /// Told to stop at that time, but the channel had no room for the order.
    StopDue {
        since_ns: u64,
    },
    /// Ordered to stop at that time.
    Stopping {
        since_ns: u64,
    },
    /// Ended; the last frames may be in transit.
    Ended {
        since_ns: u64,
        exit: Exit,
    },
}

/// Event in the life of a controller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// `hil` requests a stop.
    StopWanted { now_ns: u64 },
    /// The order to stop is in the channel.
    StopSent,
    /// The agent reports the controller's end.
    Exited { now_ns: u64, exit: Exit },
    /// Time has passed. `is_silent` if the target has sent nothing for the limit; `given` is the number of its last
    /// frame passed to the plant, `None` without frames.
    Passed {
        now_ns: u64,
        is_silent: bool,
        delivered: Option<u64>,
    },
}

/// Consequence of an event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Action {
    Nothing,
    /// Send the order to stop.
    SendStop,
    /// End in the same way as the program.
    Finish(Exit),
    /// Give up: the controller was told to stop, but nothing shows that it did.
    GiveUpStop,
    /// Give up: nothing arrives from the target.
    GiveUpSilent,
}

impl Life {
    /// Returns the state after an event, and its consequence.
    pub(super) fn after(self, event: Event) -> (Self, Action) {
        match (self, event) {
            (Self::Running, Event::StopWanted { now_ns: since_ns }) => {
                (Self::StopDue { since_ns }, Action::SendStop)
            }
            (state @ Self::StopDue { .. }, Event::StopWanted { .. }) => (state, Action::SendStop),
            (Self::StopDue { since_ns }, Event::StopSent) => {
                (Self::Stopping { since_ns }, Action::Nothing)
            }
            (state, Event::StopWanted { .. } | Event::StopSent) => (state, Action::Nothing),
            (_, Event::Exited { now_ns, exit }) => {
                let since_ns = now_ns;
                (Self::Ended { since_ns, exit }, Action::Nothing)
            }
            (
                state,
                Event::Passed {
                    now_ns,
                    is_silent,
                    delivered,
                },
            ) => {
                let is_over = |since_ns: u64, most_ns| now_ns.saturating_sub(since_ns) > most_ns;
                let action = match &state {
                    Self::Ended { since_ns, exit }
                        if delivered.is_none_or(|delivered| delivered >= exit.said)
                            || is_over(*since_ns, PARTING_NS) =>
                    {
                        Action::Finish(exit.clone())
                    }
                    // Nobody may be left to end this process.
                    Self::StopDue { since_ns } | Self::Stopping { since_ns }
                        if is_over(*since_ns, STOPPING_NS) =>
                    {
                        Action::GiveUpStop
                    }
                    _ if is_silent => Action::GiveUpSilent,
                    _ => Action::Nothing,
                };
                (state, action)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_event_in_every_state_has_the_consequence_of_the_table() {
        use Action::{Finish, GiveUpSilent, GiveUpStop, Nothing, SendStop};
        let (since_ns, now_ns) = (7, 7);
        let exit = |code, said| Exit {
            code,
            fate: None,
            said,
        };
        let (first, second) = (exit(Some(0), 5), exit(None, 6));
        let [running, due, stopping] = [
            Life::Running,
            Life::StopDue { since_ns },
            Life::Stopping { since_ns },
        ];
        let ended = |exit: &Exit| Life::Ended {
            since_ns,
            exit: exit.clone(),
        };
        let states = || [Life::Running, due.clone(), stopping.clone(), ended(&first)];
        let exited = Event::Exited {
            now_ns,
            exit: second.clone(),
        };
        #[rustfmt::skip] // an event, and for each state in their order the next one and the consequence
        let mut table = vec![
            (Event::StopWanted { now_ns }, [(due.clone(), SendStop), (due.clone(), SendStop), (stopping.clone(), Nothing), (ended(&first), Nothing)]),
            (Event::StopSent, [(running, Nothing), (stopping.clone(), Nothing), (stopping.clone(), Nothing), (ended(&first), Nothing)]),
            (exited, [(); 4].map(|()| (ended(&second), Nothing))),
        ];
        let finish = || Finish(first.clone());
        #[rustfmt::skip] // after a time, with a silent target and so many frames delivered: the consequence in each state
        let times = [
            (PARTING_NS, false, Some(4), [Nothing, Nothing, Nothing, Nothing]),
            (PARTING_NS + 1, false, Some(4), [Nothing, Nothing, Nothing, finish()]),
            (0, false, Some(5), [Nothing, Nothing, Nothing, finish()]),
            (0, false, None, [Nothing, Nothing, Nothing, finish()]),
            (STOPPING_NS, false, Some(5), [Nothing, Nothing, Nothing, finish()]),
            (STOPPING_NS + 1, false, Some(4), [Nothing, GiveUpStop, GiveUpStop, finish()]),
            (STOPPING_NS + 1, true, Some(5), [GiveUpSilent, GiveUpStop, GiveUpStop, finish()]),
            (0, true, Some(4), [GiveUpSilent, GiveUpSilent, GiveUpSilent, GiveUpSilent]),
        ];
        for (after_ns, is_silent, delivered, actions) in times {
            let now_ns = since_ns + after_ns;
            let [a, b, c, d] = states();
            let [i, j, k, l] = actions;
            let row = [(a, i), (b, j), (c, k), (d, l)];
            table.push((
                Event::Passed {
                    now_ns,
                    is_silent,
                    delivered,
                },
                row,
            ));
        }
        for (event, row) in table {
            for (state, expected) in states().into_iter().zip(row) {
                let next = state.clone().after(event.clone());
                assert_eq!(next, expected, "{event:?} in {state:?}");
            }
        }
    }
}
