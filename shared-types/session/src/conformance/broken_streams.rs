//! Record streams with one flaw each, and the properties that each flaw violates; together all of them.

use std::sync::{Arc, Weak};
use std::time::Duration;

use super::InProcess;
use shared_types::conformance::stream::{Fixture, sentences};
use shared_types::link::LinkError;
use shared_types::record::{Event, RecordLayout};
use shared_types::stream::{Item, RecordSink, RecordSource};

flaws! {
    a_stream_that_loses_a_record_is_found: Loses over InProcess =>
        records_and_events_arrive_in_order_and_once, records_are_whole_while_both_ends_work;
    a_stream_that_tears_a_record_is_found: Tears over InProcess =>
        records_are_whole_while_both_ends_work;
    a_stream_that_always_has_room_is_found: NeverWaits over InProcess =>
        a_plant_without_credit_waits_and_loses_nothing;
    a_stream_that_never_credits_is_found: NeverCredits over InProcess =>
        credit_counts_what_was_taken;
    a_stream_that_hangs_at_its_close_is_found: HangsAtClose over InProcess =>
        a_dead_plant_is_silent_after_its_last_record;
    a_stream_that_needs_a_recorder_is_found: NeedsRecorder over InProcess =>
        a_dead_recorder_holds_nobody_up;
}

/// Meeting point whose stream has a flaw.
struct Broken<F, const FLAW: usize>(F);

impl<F: Fixture, const FLAW: usize> Fixture for Broken<F, FLAW> {
    type Sink = BrokenSink<F::Sink, FLAW>;
    type Source = BrokenSource<F::Source>;
    const PATIENCE: Duration = match FLAW == Flaw::None as usize {
        true => F::PATIENCE,
        false => Duration::from_secs(1),
    };

    fn new() -> Self {
        Self(F::new())
    }

    fn connect(&mut self) -> (Self::Sink, impl FnOnce() -> Self::Source + Send + 'static) {
        let (sink, opens) = self.0.connect();
        let alive = Arc::new(());
        let recorder = Arc::downgrade(&alive);
        let sink = BrokenSink {
            sink,
            sent: 0,
            recorder,
        };
        (sink, move || BrokenSource(opens(), alive))
    }
}

/// The plant's end of a flawed stream.
struct BrokenSink<S, const FLAW: usize> {
    sink: S,
    sent: u64,
    recorder: Weak<()>,
}

impl<S, const FLAW: usize> BrokenSink<S, FLAW> {
    const fn has(flaw: Flaw) -> bool {
        FLAW == flaw as usize
    }
}

impl<S, const FLAW: usize> Drop for BrokenSink<S, FLAW> {
    fn drop(&mut self) {
        if Self::has(Flaw::HangsAtClose) {
            super::hang();
        }
    }
}

impl<S: RecordSink, const FLAW: usize> RecordSink for BrokenSink<S, FLAW> {
    fn open(&mut self, layout: &RecordLayout) -> Result<(), LinkError> {
        self.sink.open(layout)
    }

    fn has_room(&mut self) -> Result<bool, LinkError> {
        let has_room = self.sink.has_room()?;
        Ok(has_room || Self::has(Flaw::NeverWaits))
    }

    fn sent_and_taken(&mut self) -> Result<(u64, u64), LinkError> {
        match Self::has(Flaw::NeverCredits) {
            true => Ok((self.sent, 0)),
            false => self.sink.sent_and_taken(),
        }
    }

    fn record(&mut self, words: &[u64]) -> Result<(), LinkError> {
        if Self::has(Flaw::NeedsRecorder) && self.recorder.strong_count() == 0 {
            return Err(LinkError::NotOpen);
        }
        self.sent += 1;
        if Self::has(Flaw::Loses) && self.sent.is_multiple_of(2) {
            return Ok(());
        }
        let mut words = words.to_vec();
        if Self::has(Flaw::Tears) && self.sent.is_multiple_of(1000) {
            *words.last_mut().expect("a record has words") -= 1;
        }
        self.sink.record(&words)
    }

    fn event(&mut self, event: &Event) -> Result<(), LinkError> {
        self.sink.event(event)
    }
}

/// The recorder's end, which lives as long as the value it holds.
struct BrokenSource<S>(S, #[expect(dead_code, reason = "held, never read")] Arc<()>);

impl<S: RecordSource> RecordSource for BrokenSource<S> {
    fn drain(&mut self, take: &mut dyn FnMut(Item<'_>)) -> Result<usize, LinkError> {
        self.0.drain(take)
    }
}
