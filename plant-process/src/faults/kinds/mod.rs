//! The built-in fault kinds, grouped into files.
//!
//! 1. [`offset`] adds to a number: bias, scale, drift, noise, spike;
//! 2. [`oscillation`]: oscillatory failures, additive and replacing;
//! 3. [`walk`] adds a wandering error: Gauss-Markov, random walk;
//! 4. [`coupling`] adds shares of other signals;
//! 5. [`hold`] shows the past: stuck, stuck-at, delay, sample and hold, dropout;
//! 6. [`lag`] smooths a number: lags of first and second order;
//! 7. [`drive`] makes a number follow its target as a drive would: rate limit, dead band, backlash;
//! 8. [`shape`] distorts a number: quantisation, saturation;
//! 9. [`link`] acts on messages: loss, delay, jitter, duplication, reordering, corruption;
//! 10. [`babble`] floods a network;
//! 11. [`timing`] acts on time: late, skip.
//!
//! The kinds that act on numbers are also the stages of [instruments](crate::instruments).
//!
//! The fault builder starts the kinds by name, and the layer calls them; the kinds depend on neither. `docs/faults.md`
//! is the reference for users.

pub mod babble;
pub mod coupling;
pub mod drive;
pub mod hold;
pub mod lag;
pub mod link;
pub mod offset;
pub mod oscillation;
pub mod shape;
pub mod timing;
pub mod walk;

use shared_types::describe::Invalid;
use shared_types::number::exact;

use super::kind::FaultKindEntry;

/// Returns every built-in kind.
#[must_use]
pub fn all() -> Vec<FaultKindEntry> {
    vec![
        FaultKindEntry::of::<offset::Bias>(),
        FaultKindEntry::of::<offset::Scale>(),
        FaultKindEntry::of::<offset::Drift>(),
        FaultKindEntry::of::<offset::Noise>(),
        FaultKindEntry::of::<offset::Spike>(),
        FaultKindEntry::of::<walk::GaussMarkov>(),
        FaultKindEntry::of::<walk::RandomWalk>(),
        FaultKindEntry::of::<coupling::CrossCoupling>(),
        FaultKindEntry::of::<oscillation::Additive>(),
        FaultKindEntry::of::<oscillation::Replacing>(),
        FaultKindEntry::of::<hold::Stuck>(),
        FaultKindEntry::of::<hold::StuckAt>(),
        FaultKindEntry::of::<hold::Delay>(),
        FaultKindEntry::of::<hold::SampleHold>(),
        FaultKindEntry::of::<hold::Dropout>(),
        FaultKindEntry::of::<lag::Lag>(),
        FaultKindEntry::of::<lag::SecondOrderLag>(),
        FaultKindEntry::of::<drive::RateLimit>(),
        FaultKindEntry::of::<drive::DeadBand>(),
        FaultKindEntry::of::<drive::Backlash>(),
        FaultKindEntry::of::<shape::Quantisation>(),
        FaultKindEntry::of::<shape::Saturation>(),
        FaultKindEntry::of::<link::Loss>(),
        FaultKindEntry::of::<link::Delay>(),
        FaultKindEntry::of::<link::Jitter>(),
        FaultKindEntry::of::<link::Duplication>(),
        FaultKindEntry::of::<link::Reordering>(),
        FaultKindEntry::of::<link::Corruption>(),
        FaultKindEntry::of::<babble::Babble>(),
        FaultKindEntry::of::<timing::Late>(),
        FaultKindEntry::of::<timing::Skip>(),
    ]
}

/// Largest size of a fault on a number, in the unit of the target: above every physical quantity, and far enough below
/// the largest double that products with a profile stay finite.
const LARGEST: f64 = 1e30;

/// Moves a value towards another: `x + (v - x) g`, and exactly `v` at g = 1, where rounding would leave a trace of `x`.
fn towards(x: f64, v: f64, gain: f64) -> f64 {
    if gain == 1.0 { v } else { x + (v - x) * gain }
}

/// Converts a parameter that must be a whole number.
fn whole(name: &str, value: f64) -> Result<u32, Invalid> {
    let whole = value as u32; // saturates; the ranges of the tables are far smaller
    if f64::from(whole) == value {
        Ok(whole)
    } else {
        Err(Invalid(format!(
            "`{name}` is {}, not a whole number",
            exact(value)
        )))
    }
}

#[cfg(test)]
mod tests;
