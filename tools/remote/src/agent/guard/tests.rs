//! The table of the output: each state with each event, and each sequence of a few events.

use super::*;

/// Time without a sample after which samples count as missing.
const LIMIT_NS: u64 = 100;

const fn sample(step: u64, at_ns: u64) -> Sample {
    Sample { step, at_ns }
}

const GAP: Gap = Gap {
    since_ns: 300,
    after: 3,
};

const fn commanded(last: Option<Sample>) -> State {
    State::Commanded { last }
}

const fn returning(last: Option<Sample>) -> State {
    let (gap, first) = (GAP, 8);
    State::Returning { gap, first, last }
}

/// Every state, with and without each optional part.
const STATES: [State; 7] = [
    State::Closed,
    commanded(None),
    commanded(Some(sample(3, 190))),
    State::Missing(GAP),
    returning(Some(sample(9, 190))),
    returning(None),
    State::Ended,
];

/// Every event: commands that answer samples before and after the gap, and times before and after the limit.
const EVENTS: [Event; 10] = [
    Event::Opened,
    Event::Sampled(sample(10, 200)),
    Event::Held,
    answered(7, true),
    answered(7, false),
    answered(8, true),
    answered(8, false),
    Event::Passed { now_ns: 290 },
    Event::Passed { now_ns: 300 },
    Event::Ended,
];

const fn answered(step: u64, is_finite: bool) -> Event {
    Event::Answered { step, is_finite }
}

#[test]
fn every_event_in_every_state_has_the_consequence_of_the_table() {
    use Action::{Close, Keep, Put, Return, Secure, Switch};
    let [c, h, f, m, rf, rh, e] = STATES;
    let new = Some(sample(10, 200));
    let (n, rn) = (commanded(new), returning(new));
    let (gap, first, back) = (GAP, 10, commanded(Some(sample(9, 190))));
    let first = State::Returning {
        gap,
        first,
        last: new,
    };
    #[rustfmt::skip] // a row for each state, a column for each event, in their order
    let table = [
        [(h, Secure), (c, Keep), (c, Keep), (c, Keep), (c, Keep), (c, Keep), (c, Keep), (c, Keep), (c, Keep), (e, Close)],
        [(h, Keep), (n, Keep), (h, Keep), (h, Put), (h, Secure), (h, Put), (h, Secure), (h, Keep), (h, Keep), (e, Close)],
        [(f, Keep), (n, Keep), (h, Keep), (f, Put), (f, Secure), (f, Put), (f, Secure), (f, Keep), (m, Switch(gap)), (e, Close)],
        [(m, Keep), (first, Keep), (m, Keep), (m, Keep), (m, Keep), (m, Keep), (m, Keep), (m, Keep), (m, Keep), (e, Close)],
        [(rf, Keep), (rn, Keep), (rh, Keep), (rf, Keep), (rf, Keep), (back, Return(gap)), (rf, Secure), (rf, Keep), (rf, Keep), (e, Close)],
        [(rh, Keep), (rn, Keep), (rh, Keep), (rh, Keep), (rh, Keep), (h, Return(gap)), (rh, Secure), (rh, Keep), (rh, Keep), (e, Close)],
        [(e, Keep); 10],
    ];
    for (state, row) in STATES.into_iter().zip(table) {
        for (event, expected) in EVENTS.into_iter().zip(row) {
            let next = state.after(event, LIMIT_NS);
            assert_eq!(next, expected, "{event:?} in {state:?}");
        }
    }
}

/// Walks all sequences of events from a state, and checks the output that a driver would see. `step` is the step of the
/// next sample, and `fresh` that of the first sample after the last switch.
fn walk(state: State, fresh: Option<u64>, (step, now_ns): (u64, u64), left: u32) {
    if left == 0 {
        return;
    }
    let late_ns = now_ns + LIMIT_NS;
    let events = [
        Event::Opened,
        Event::Sampled(sample(step, now_ns)),
        Event::Held,
        answered(step - 2, true),
        answered(step - 1, true),
        answered(step - 1, false),
        Event::Passed { now_ns },
        Event::Passed { now_ns: late_ns },
        Event::Ended,
    ];
    for event in events {
        let (next, action) = state.after(event, LIMIT_NS);
        let fresh = match (action, event) {
            (Action::Put | Action::Return(_), Event::Answered { step, is_finite }) => {
                assert!(is_finite && fresh.is_none_or(|first| step >= first));
                assert!(!matches!(state, State::Closed | State::Ended));
                None
            }
            (Action::Put | Action::Return(_), _) => panic!("{event:?} puts a command"),
            (Action::Switch(_), _) => Some(step),
            (Action::Keep | Action::Secure | Action::Close, _) => fresh,
        };
        assert_eq!(
            next == State::Ended,
            matches!(event, Event::Ended) || state == State::Ended
        );
        let step = step + u64::from(matches!(event, Event::Sampled(_)));
        walk(next, fresh, (step, late_ns + 1), left - 1);
    }
}

#[test]
fn after_a_switch_only_an_answer_to_a_later_sample_acts_whatever_happens_in_between() {
    walk(State::Closed, None, (10, 1000), 7);
}
