//! A signal into which other signals leak.

use shared_types::describe::{ActsOn, Invalid, ListDescription};
use shared_types::state::StateOf;
use shared_types::table::Empty;

use crate::faults::kind::{FaultKind, Moment, Reading, Setup};

/// Shares of other signals.
pub struct CrossCoupling(Vec<(usize, f64)>);

impl FaultKind for CrossCoupling {
    const NAME: &'static str = "cross-coupling";
    const SUMMARY: &'static str = "Shares of other signals of the same message are added.";
    const EQUATION: &'static str = "y = x + g (c1 x1 + c2 x2 + ..), x1, x2, .. the other signals";
    const ACTS_ON: ActsOn = ActsOn::Signals;
    type Parameters = Empty;

    fn list() -> Option<ListDescription> {
        Some(ListDescription {
            key: "cross".into(),
            description: "Rows of two numbers: the place of another signal, from 1, and its factor. Places count measured and then reference signals, or commands, in the order of `hil describe`.".into(),
            columns: 2,
        })
    }

    fn state() -> Option<StateOf<Self>> {
        Some(StateOf::none())
    }

    fn start(setup: &Setup<'_, Empty>) -> Result<Self, Invalid> {
        let most = setup.signals;
        let share = |row: &[f64]| {
            let place = super::whole("cross", row[0])? as usize;
            if (1..=most).contains(&place) {
                return Ok((place - 1, row[1]));
            }
            Err(Invalid(format!(
                "`cross` names signal {place}, but there are only the signals 1 to {most}"
            )))
        };
        if setup.list.is_empty() {
            return Err(Invalid(
                "`cross` is missing: rows of a signal's place and its factor".into(),
            ));
        }
        let shares = setup.list.chunks_exact(2).map(share);
        Ok(Self(shares.collect::<Result<_, _>>()?))
    }

    fn coupled(&mut self, at: &Moment, x: Reading, row: &[f64]) -> Reading {
        let share = |(place, factor): &(usize, f64)| factor * row[*place];
        let sum: f64 = self.0.iter().map(share).sum();
        Reading {
            value: x.value + sum * at.gain,
            ..x
        }
    }
}
