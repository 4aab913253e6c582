//! Curve of a run for the envelopes of its campaign, computed from its records as they arrive.

use std::sync::Arc;

use crate::results::curve::{Curve, Grid};
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use shared_types::record::RecordLayout;
use shared_types::time::{Rate, Step};

/// Recorder of a curve.
#[derive(Clone)]
pub struct CurveTaker {
    grid: Arc<Grid>,
    rate: Rate,
    /// Source of each signal: an index among the words of a record or among the derived signals; `None` if the run
    /// lacks it.
    places: Vec<Option<Place>>,
    curve: Curve,
}

#[derive(Clone, Copy)]
enum Place {
    Word(usize),
    Derived(usize),
}

impl CurveTaker {
    /// Starts the curve of a plan's run, whose records have this layout.
    pub fn new(grid: Arc<Grid>, plan: &Plan, layout: &RecordLayout) -> Self {
        let columns = Columns::from(layout);
        let first = layout.values_start();
        let derived = |name: &str| plan.derived.iter().position(|one| one.name == name);
        let places = grid.signals.iter().map(|(name, _)| {
            let word = columns.index_of(name).map(|place| first + place);
            word.map(Place::Word)
                .or_else(|| derived(name).map(Place::Derived))
        });
        Self {
            rate: plan.run.rate,
            places: places.collect(),
            curve: Curve::new(&grid),
            grid,
        }
    }

    /// Adds a record and its derived values.
    pub fn record(&mut self, words: &[u64], derived: &[f64]) {
        let grid = &*self.grid;
        let time_s = self.rate.seconds(Step(words[0]));
        let bin = ((time_s / grid.bin_s) as usize).clamp(0, grid.bins - 1);
        for (signal, place) in self.places.iter().enumerate() {
            let value = match place {
                Some(Place::Word(place)) => f64::from_bits(words[*place]),
                Some(Place::Derived(place)) => derived.get(*place).copied().unwrap_or(f64::NAN),
                None => continue,
            };
            self.curve.take(grid, signal, bin, value);
        }
    }

    /// Returns the curve.
    pub fn finish(self) -> Curve {
        self.curve
    }
}
