//! Links with one flaw each, and the properties that each flaw violates; together all of them.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use super::{Iceoryx, InProcess};
use shared_types::conformance::link::{Fixture, Opener, sentences};
use shared_types::frame::{FrameKind, Header, MAX_SIGNALS, VALIDITY_WORDS};
use shared_types::link::{FrameSpec, Link, LinkError, Peer};
use shared_types::time::Step;
use shared_types::wait::Sleeper;

flaws! {
    a_link_that_loses_a_frame_is_found: Loses over InProcess =>
        each_of_many_samples_is_answered_once;
    a_link_that_repeats_an_old_frame_is_found: Repeats over InProcess =>
        frames_cross_both_ways, the_latest_frame_wins;
    a_link_that_delivers_an_older_frame_last_is_found: Reorders over InProcess =>
        the_latest_frame_wins, each_of_many_samples_is_answered_once;
    a_link_that_delivers_another_epochs_command_is_found: KeepsEpoch over InProcess =>
        another_controller_takes_over_from_the_active_one, another_controller_follows_a_dead_one;
    a_link_that_tells_the_next_controller_is_found: TellsTheNext over InProcess =>
        the_active_controller_is_told_while_another_is_expected;
    a_link_that_tears_a_frame_is_found: Tears over InProcess =>
        frames_cross_both_ways, each_of_many_samples_is_answered_once;
    a_link_between_processes_that_tears_a_frame_is_found: TearsApart over Iceoryx =>
        frames_are_whole_while_both_ends_work;
    a_link_that_hangs_at_its_close_is_found: HangsAtClose over InProcess =>
        an_end_that_closes_holds_nobody_up;
    a_link_that_waits_for_its_receiver_is_found: WaitsForReceiver over InProcess =>
        an_end_that_never_receives_holds_nobody_up;
    a_link_that_keeps_one_control_message_is_found: KeepsOneMessage over InProcess =>
        control_messages_arrive_in_order_and_once, eight_control_messages_may_wait;
    a_link_that_forgets_validity_is_found: ForgetsValidity over InProcess =>
        every_field_of_a_header_crosses;
    a_link_that_clears_the_buffer_is_found: ClearsBuffer over InProcess =>
        frames_without_values_leave_the_buffer_alone;
    a_link_that_delivers_negative_zero_is_found: NegatesZero over InProcess =>
        odd_numbers_arrive_canonical;
    a_link_that_fails_at_a_death_is_found: FailsAtDeath over InProcess =>
        a_dead_controller_is_silent_after_its_last_frame, a_dead_plant_is_silent_after_its_last_frame;
    a_link_that_trusts_nobody_is_found: TrustsNobody over InProcess =>
        the_peer_of_a_pair_is_no_stranger;
    a_link_that_delivers_refused_frames_is_found: DeliversRefused over InProcess =>
        a_frame_of_another_count_is_rejected_and_counted, frames_of_another_run_are_never_delivered;
    a_link_that_wakes_nobody_is_found: WakesNobody over Iceoryx =>
        what_is_sent_ends_an_announced_sleep, no_sleeper_is_left_asleep;
    a_link_that_forgets_what_came_before_a_sleep_is_found: AnnouncesLate over Iceoryx =>
        what_is_sent_ends_an_announced_sleep;
    a_link_that_is_always_open_is_found: IsAlwaysOpen over InProcess =>
        frames_before_opening_are_an_error, too_many_signals_are_refused;
}

/// State shared by both ends: a death, and an unread frame of each side.
#[derive(Default)]
struct Wire {
    has_death: Cell<bool>,
    waits: [Cell<bool>; 2],
}

/// Meeting point whose links have a flaw.
struct Broken<F, const FLAW: usize> {
    place: F,
    wire: Rc<Wire>,
}

impl<F: Fixture, const FLAW: usize> Fixture for Broken<F, FLAW> {
    type Link = BrokenLink<F::Link, FLAW>;
    const PATIENCE: Duration = match FLAW == Flaw::None as usize {
        true => F::PATIENCE,
        false => Duration::from_secs(1),
    };

    fn new() -> Self {
        let (place, wire) = (F::new(), Rc::default());
        Self { place, wire }
    }

    fn plant(&mut self) -> Self::Link {
        BrokenLink::new(self.place.plant(), 0, &self.wire)
    }

    fn controller(&mut self, epoch: u32) -> Self::Link {
        BrokenLink::new(self.place.controller(epoch), 1, &self.wire)
    }

    fn controller_elsewhere(&mut self) -> Option<Opener<Self::Link>> {
        let opens = self.place.controller_elsewhere()?;
        Some(Box::new(|| BrokenLink::new(opens(), 1, &Rc::default())))
    }
}

/// End of a flawed link.
struct BrokenLink<L, const FLAW: usize> {
    link: L,
    side: usize,
    wire: Rc<Wire>,
    sent: u64,
    /// Last frames sent and received.
    outgoing: Option<(Header, Vec<f64>)>,
    incoming: Option<(Header, Vec<f64>)>,
}

impl<L, const FLAW: usize> BrokenLink<L, FLAW> {
    fn new(link: L, side: usize, wire: &Rc<Wire>) -> Self {
        Self {
            link,
            side,
            wire: Rc::clone(wire),
            sent: 0,
            outgoing: None,
            incoming: None,
        }
    }

    const fn has(flaw: Flaw) -> bool {
        FLAW == flaw as usize
    }
}

impl<L, const FLAW: usize> Drop for BrokenLink<L, FLAW> {
    fn drop(&mut self) {
        self.wire.has_death.set(true);
        if Self::has(Flaw::HangsAtClose) {
            super::hang();
        }
    }
}

impl<L: Link, const FLAW: usize> Link for BrokenLink<L, FLAW> {
    shared_types::pass_on!(self => self.link; send_control expect rejected);

    fn tell(&mut self, message: &[u8]) -> Result<(), LinkError> {
        match Self::has(Flaw::TellsTheNext) {
            true => self.link.send_control(message),
            false => self.link.tell(message),
        }
    }

    fn receive_control(&mut self) -> Result<Option<Vec<u8>>, LinkError> {
        let mut message = self.link.receive_control()?;
        while Self::has(Flaw::KeepsOneMessage)
            && let Some(newer) = self.link.receive_control()?
        {
            message = Some(newer);
        }
        Ok(message)
    }

    fn peer(&self) -> Result<Peer, LinkError> {
        match Self::has(Flaw::TrustsNobody) {
            true => Ok(Peer::Stranger("somebody speaks".into())),
            false => self.link.peer(),
        }
    }

    fn open_frames(&mut self, spec: &FrameSpec) -> Result<(), LinkError> {
        let mut spec = *spec;
        if Self::has(Flaw::IsAlwaysOpen) {
            spec.outgoing = spec.outgoing.min(MAX_SIGNALS);
            spec.incoming = spec.incoming.min(MAX_SIGNALS);
        }
        self.link.open_frames(&spec)
    }

    fn take_over(&mut self) {
        if !Self::has(Flaw::KeepsEpoch) {
            self.link.take_over();
        }
    }

    fn send(&mut self, header: &Header, values: &[f64]) -> Result<(), LinkError> {
        self.sent += 1;
        if Self::has(Flaw::Loses) && self.sent.is_multiple_of(7) {
            return Ok(());
        }
        if self.wire.waits[self.side].replace(true) && Self::has(Flaw::WaitsForReceiver) {
            super::hang();
        }
        let result = self.link.send(header, values);
        let older = self.outgoing.replace((*header, values.to_vec()));
        if Self::has(Flaw::Reorders)
            && self.sent.is_multiple_of(5)
            && let Some((header, values)) = older
        {
            self.link.send(&header, &values)?;
        }
        match result {
            Err(LinkError::NotOpen) if Self::has(Flaw::IsAlwaysOpen) => Ok(()),
            result => result,
        }
    }

    fn receive(&mut self, values: &mut [f64]) -> Result<Option<Header>, LinkError> {
        self.wire.waits[1 - self.side].set(false);
        let before = self.link.rejected().total();
        let mut header = match self.link.receive(values) {
            Err(LinkError::NotOpen) if Self::has(Flaw::IsAlwaysOpen) => return Ok(None),
            received => received?,
        };
        if header.is_none() {
            if Self::has(Flaw::Repeats) {
                return Ok(self.incoming.take().map(|(header, _)| header));
            }
            if Self::has(Flaw::DeliversRefused) && self.link.rejected().total() > before {
                return Ok(Some(Header::new(FrameKind::Sample, Step(0))));
            }
            if Self::has(Flaw::FailsAtDeath) && self.wire.has_death.get() {
                let (service, reason) = ("wire".into(), "the other end is gone".into());
                return Err(LinkError::Transport { service, reason });
            }
        }
        if let Some(header) = &mut header {
            let older = self.incoming.replace((*header, values.to_vec()));
            if Self::has(Flaw::Tears) || Self::has(Flaw::TearsApart) {
                let half = values.len() / 2;
                let older = older.map_or_else(|| vec![0.0; values.len()], |(_, values)| values);
                values[half..].copy_from_slice(&older[half..]);
            }
            if Self::has(Flaw::ForgetsValidity) {
                header.invalid = [0; VALIDITY_WORDS];
            }
            if Self::has(Flaw::ClearsBuffer) && header.count == 0 {
                values.fill(0.0);
            }
            if Self::has(Flaw::NegatesZero) {
                let zeros = values.iter_mut().filter(|value| **value == 0.0);
                zeros.for_each(|value| *value = -0.0);
            }
        }
        Ok(header)
    }

    fn sleeper(&self) -> Option<Box<dyn Sleeper>> {
        let sleeper = self.link.sleeper()?;
        let is_broken = Self::has(Flaw::WakesNobody) || Self::has(Flaw::AnnouncesLate);
        Some(match is_broken {
            true => Box::new(BrokenSleeper(sleeper, Self::has(Flaw::WakesNobody))),
            false => sleeper,
        })
    }
}

/// Sleeps on a bell that is announced too late, or on no bell.
#[derive(Debug)]
struct BrokenSleeper(Box<dyn Sleeper>, bool);

impl Sleeper for BrokenSleeper {
    fn announce(&self) -> u32 {
        0
    }

    fn sleep(&self, _announced: u32, ns: u64) {
        let Self(sleeper, is_deaf) = self;
        if *is_deaf {
            std::thread::sleep(Duration::from_nanos(ns));
        } else {
            sleeper.sleep(sleeper.announce(), ns);
        }
    }

    fn retire(&self) {
        self.0.retire();
    }
}
