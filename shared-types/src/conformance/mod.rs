//! Properties that every link and record stream must have, for authors of new implementations.
//!
//! A suite is a list of properties, each a function that is generic over a fixture and panics where the property does
//! not hold. [`conformance!`](crate::conformance!) makes a `#[test]` of each; each runs on its own thread, and a
//! watchdog names the one that hangs. Runs do not use this module, and the module depends on no implementation.
//! `hil-session` runs the suite over both links and both streams, and over broken ones that must fail.
//!
//! 1. Implement [`Link`](crate::link::Link), or [`RecordSink`](crate::stream::RecordSink) and
//!    [`RecordSource`](crate::stream::RecordSource).
//! 2. Implement [`link::Fixture`] or [`stream::Fixture`], which creates a connected pair.
//! 3. Write `conformance!(link: MyFixture)` or `conformance!(stream: MyFixture)` in a test module.

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

pub mod link;
pub mod stream;

/// Time after which a property counts as hanging: ample for a busy machine.
pub const WATCHDOG: Duration = Duration::from_secs(60);

/// Property of one implementation.
#[derive(Clone, Copy, Debug)]
pub struct Sentence {
    /// Name of its function.
    pub name: &'static str,
    /// Function that panics where the property does not hold.
    pub check: fn(),
}

impl Sentence {
    /// Checks the property on its own thread, which is abandoned if it hangs.
    ///
    /// # Errors
    /// The panic message, or a note that the check did not end within the limit.
    pub fn holds(self, limit: Duration) -> Result<(), String> {
        let Self { name, check } = self;
        let (alive, ended) = channel::<()>();
        let thread = std::thread::spawn(move || {
            let _alive = alive;
            check();
        });
        if ended.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) {
            return Err(format!("`{name}` hangs: no end within {limit:?}"));
        }
        thread.join().map_err(|panic| {
            let text = (panic.downcast_ref::<String>().map(String::as_str))
                .or_else(|| panic.downcast_ref::<&str>().copied());
            format!("`{name}` does not hold: {}", text.unwrap_or_default())
        })
    }
}

/// Makes a `#[test]` of every property: `conformance!(link: Fixture)` or `conformance!(stream: Fixture)`.
#[macro_export]
macro_rules! conformance {
    ($suite:ident: $fixture:ty) => {
        $crate::conformance! { @$suite tests $fixture }
    };
    (@link $form:ident $fixture:ty) => {
        $crate::conformance! { @$form link $fixture:
            control_messages_arrive_in_order_and_once
            eight_control_messages_may_wait
            frames_cross_both_ways
            every_field_of_a_header_crosses
            each_of_many_samples_is_answered_once
            the_latest_frame_wins
            an_end_that_never_receives_holds_nobody_up
            frames_are_whole_while_both_ends_work
            frames_without_values_leave_the_buffer_alone
            odd_numbers_arrive_canonical
            a_frame_of_another_count_is_rejected_and_counted
            frames_of_another_run_are_never_delivered
            frames_before_opening_are_an_error
            too_many_signals_are_refused
            the_peer_of_a_pair_is_no_stranger
            another_controller_takes_over_from_the_active_one
            the_active_controller_is_told_while_another_is_expected
            a_dead_controller_is_silent_after_its_last_frame
            another_controller_follows_a_dead_one
            a_dead_plant_is_silent_after_its_last_frame
            an_end_that_closes_holds_nobody_up
            what_is_sent_ends_an_announced_sleep
            no_sleeper_is_left_asleep
        }
    };
    (@stream $form:ident $fixture:ty) => {
        $crate::conformance! { @$form stream $fixture:
            records_and_events_arrive_in_order_and_once
            a_plant_without_credit_waits_and_loses_nothing
            credit_counts_what_was_taken
            records_are_whole_while_both_ends_work
            a_dead_plant_is_silent_after_its_last_record
            a_dead_recorder_holds_nobody_up
        }
    };
    (@tests $suite:ident $fixture:ty: $($name:ident)+) => {
        $(
            #[test]
            fn $name() {
                let check = $crate::conformance::$suite::$name::<$fixture>;
                let sentence = $crate::conformance::Sentence { name: stringify!($name), check };
                if let Err(reason) = sentence.holds($crate::conformance::WATCHDOG) {
                    panic!("{reason}");
                }
            }
        )+
    };
    (@list $suite:ident $fixture:ty: $($name:ident)+) => {
        vec![$($crate::conformance::Sentence {
            name: stringify!($name),
            check: $crate::conformance::$suite::$name::<$fixture>,
        }),+]
    };
}
