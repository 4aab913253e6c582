//! Quality of the sample's signals for the bound law: invalid ones in the law's order, and ages.
//!
//! Updated by every sample that the runner receives, whether the law runs at it or not. Where all signals are valid and
//! new, that is one comparison.

use serde::{Deserialize, Serialize};
use shared_types::connection::{Connection, renamed};
use shared_types::frame::{Header, VALIDITY_WORDS};
use shared_types::layout::{Signal, SignalKind, SignalTable};
use shared_types::quality::{Quality, SignalSet, age_signal};
use shared_types::table::Field;
use shared_types::time::Step;

/// Quality of the last sample.
#[derive(Clone, Debug)]
pub(super) struct Tracked {
    measured: SignalSet,
    reference: SignalSet,
    age_steps: Vec<u32>,
    /// Measured signals of the law whose age the plant sends: index, and place of the age in the sample.
    age_signals: Vec<(usize, usize)>,
    /// `true` if everything is valid and all ages are 0, so that another such sample changes nothing.
    is_clean: bool,
    last: Option<Step>,
}

/// State for a checkpoint.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct SavedQuality {
    measured: SignalSet,
    reference: SignalSet,
    age_steps: Vec<u32>,
    last: Option<Step>,
}

impl Tracked {
    /// Creates the quality of a law's signals before the first sample.
    pub(super) fn new(law: &[Field], connections: &[Connection], sample: &SignalTable) -> Self {
        let sent = sample.fields(SignalKind::Measured);
        let place = |name: &str| {
            let index = age_signal(&sent, name)?;
            let is_it = |signal: &Signal| {
                signal.kind == SignalKind::Measured && signal.field.name == sent[index].name
            };
            sample.0.iter().position(is_it)
        };
        let own = renamed(SignalKind::Measured, law, connections);
        let age_signals: Vec<(usize, usize)> = (own.iter().enumerate())
            .filter_map(|(index, field)| Some((index, place(&field.name)?)))
            .collect();
        Self {
            measured: SignalSet::EMPTY,
            reference: SignalSet::EMPTY,
            age_steps: vec![0; law.len()],
            is_clean: age_signals.is_empty(),
            age_signals,
            last: None,
        }
    }

    /// Takes in the sample of a step, whose signals the law has at these places.
    pub(super) fn note(
        &mut self,
        step: Step,
        header: &Header,
        sample: &[f64],
        (measured, reference): (&[usize], &[usize]),
    ) {
        if !(self.is_clean && header.invalid == [0; VALIDITY_WORDS] && header.age_steps == 0) {
            self.update(step, header, sample, (measured, reference));
        }
        self.last = Some(step);
    }

    #[cold]
    fn update(
        &mut self,
        step: Step,
        header: &Header,
        sample: &[f64],
        (measured, reference): (&[usize], &[usize]),
    ) {
        self.measured = invalid(header, measured);
        self.reference = invalid(header, reference);
        // A signal that never was valid is as old as the run.
        let elapsed_steps = |age_steps: u32| match self.last {
            Some(last) => u64::from(age_steps) + (step.0 - last.0),
            None => step.0 + 1,
        };
        for (index, age_steps) in self.age_steps.iter_mut().enumerate() {
            *age_steps = if self.measured.contains(index) {
                let elapsed_steps = elapsed_steps(*age_steps);
                u32::try_from(elapsed_steps).unwrap_or(u32::MAX)
            } else {
                header.age_steps
            };
        }
        for &(index, place) in &self.age_signals {
            if header.is_valid(place) {
                // Saturates, and takes a negative one as 0.
                let plant_age_steps = (sample[place] as u32).saturating_add(header.age_steps);
                self.age_steps[index] = self.age_steps[index].max(plant_age_steps);
            }
        }
        self.is_clean = self.age_signals.is_empty()
            && !self.measured.any()
            && !self.reference.any()
            && header.age_steps == 0;
    }

    /// Returns `true` if all signals of the law are valid.
    pub(super) const fn is_valid(&self) -> bool {
        !self.measured.any() && !self.reference.any()
    }

    /// Returns the quality for the law.
    pub(super) fn view(&self) -> Quality<'_> {
        Quality {
            measured: &self.measured,
            reference: &self.reference,
            age_steps: &self.age_steps,
        }
    }

    /// Returns the state.
    pub(super) fn save(&self) -> SavedQuality {
        SavedQuality {
            measured: self.measured,
            reference: self.reference,
            age_steps: self.age_steps.clone(),
            last: self.last,
        }
    }

    /// Restores a saved state of the same law.
    pub(super) fn restore(&mut self, saved: SavedQuality) {
        (self.measured, self.reference) = (saved.measured, saved.reference);
        self.age_steps = saved.age_steps;
        self.is_clean = false; // found out at the next sample
        self.last = saved.last;
    }
}

/// Returns the invalid ones among the signals at these places, in their order.
fn invalid(header: &Header, places: &[usize]) -> SignalSet {
    let mut invalid = SignalSet::EMPTY;
    for (index, place) in places.iter().enumerate() {
        if !header.is_valid(*place) {
            invalid.insert(index);
        }
    }
    invalid
}
