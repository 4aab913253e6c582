//! Parts of a step, for a side that sends and receives at different times.

use shared_types::quality::SignalSet;

use super::refusals::report_saturated;
use super::{Wire, WireError, gone};
use crate::medium::Outlet;

impl Wire {
    /// Begins the step of the received row.
    pub fn begin(&mut self) {
        self.row.advance();
        self.has_arrived.fill(false);
    }

    /// Returns `true` if a frame was accepted since the step [began](Self::begin).
    #[must_use]
    pub fn has_heard(&self) -> bool {
        self.has_arrived.contains(&true)
    }

    /// Sends the frames that are due at a step.
    ///
    /// # Errors
    /// If a medium is gone.
    pub fn transmit(
        &mut self,
        step: u64,
        values: &[f64],
        invalid: &SignalSet,
    ) -> Result<(), WireError> {
        for incoming in &mut self.media {
            incoming.medium.forget_lost();
        }
        for one in &mut self.outgoing {
            if !step.is_multiple_of(one.divider) {
                continue;
            }
            one.bytes.clear();
            (one.bytes).extend_from_slice(one.packer.pack(values, invalid));
            report_saturated(&self.port, one.frame, &one.packer, &one.bytes);
            let result = self.media[one.medium].medium.send(one.id, &one.bytes);
            one.is_sent = result.map_err(|error| gone(&self.port, one.medium, error))?;
            one.sent += u64::from(one.is_sent);
        }
        Ok(())
    }

    /// Returns the counter of the next frame of each sent one, 0 for one without a counter.
    pub fn counters(&self) -> impl Iterator<Item = u64> {
        let counters = self.outgoing.iter().map(|one| one.packer.counter());
        counters.map(Option::unwrap_or_default)
    }

    /// Returns each medium on which frames are sent, by its place in the port file, with its present end.
    pub fn outlets(&self) -> impl Iterator<Item = (usize, Option<Outlet<'_>>)> {
        let is_sent_on = |medium: usize| self.outgoing.iter().any(|one| one.medium == medium);
        { self.media.iter().enumerate() }
            .filter(move |(medium, _)| is_sent_on(*medium))
            .map(|(medium, incoming)| (medium, incoming.medium.outlet()))
    }
}
