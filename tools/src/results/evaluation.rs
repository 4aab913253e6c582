//! The evaluation of recorded rows: the same that the recorder fed while the run went on, so that metrics
//! and requirements come out to the last bit as they did then.

use std::ops::Range;
use std::path::Path;

use hil_config::evaluation::Evaluation;
use hil_config::expression::{Columns, ExpressionError, Group};
use hil_config::plan::Plan;
use hil_config::scenario::read_regular;
use shared_types::describe::Description;
use shared_types::number::exact_in;
use shared_types::record::Validity;
use shared_types::table::Field;
use shared_types::time::Step;

use crate::programs::checked::checked;
use crate::recording::reader::{ReadError, RunReader};
use crate::recording::validity;
use crate::terminal::exit::Failure;

/// The plan of the run, with what is computed and judged by another scenario if one is given.
pub(crate) fn plan(
    reader: &RunReader,
    plant: &Description,
    run: &Path,
    by: Option<&Path>,
) -> Result<Plan, Failure> {
    let refused = |error: ReadError| Failure::usage(error);
    let controller: Description = reader
        .enclosed("controller-description.json")
        .map_err(refused)?;
    let text = reader.enclosure("scenario.toml").map_err(refused)?;
    let own = checked(text, run, plant, &controller)?;
    let Some(by) = by else {
        return Ok(own);
    };
    let shown = by.display();
    let text = read_regular(by)
        .map_err(|error| Failure::usage(format!("cannot read {shown}: {error}")))?;
    let other = checked(&text, by, plant, &controller)?;
    let (rate, others) = (own.run.rate, other.run.rate);
    if rate != others {
        let (rate, others) = (rate.hz(), others.hz());
        return Err(Failure::usage(format!(
            "{shown} is at {} and the run at {}: their steps are not the same times",
            exact_in(others, "Hz"),
            exact_in(rate, "Hz")
        )));
    }
    Ok(Plan {
        name: other.name,
        derived: other.derived,
        metrics: other.metrics,
        analyses: other.analyses,
        requirements: other.requirements,
        plots: other.plots,
        ..own
    })
}

/// An evaluation that is fed with the records of a recording.
pub(crate) struct RecordedEvaluation {
    pub(crate) evaluation: Evaluation,
    /// Where the signals are in a record.
    values: Range<usize>,
    validity: Validity,
    row: Vec<f64>,
}

impl RecordedEvaluation {
    /// That of a plan, for the records of a run, which have these columns there.
    ///
    /// # Errors
    /// If the plan does not fit the columns.
    pub(crate) fn new(
        reader: &RunReader,
        plan: &Plan,
        columns: &Columns,
        values: Range<usize>,
    ) -> Result<Self, ExpressionError> {
        Ok(Self {
            evaluation: Evaluation::new(plan, columns)?,
            validity: validity::of(reader, plan),
            row: vec![f64::NAN; columns.len()],
            values,
        })
    }

    /// Takes a record; the derived signals at its step.
    pub(crate) fn observe(&mut self, record: &[u64]) -> &[f64] {
        for (value, word) in self.row.iter_mut().zip(&record[self.values.clone()]) {
            *value = f64::from_bits(*word);
        }
        let invalid = self.validity.invalid(record);
        (self.evaluation).observe(Step(record[0]), &self.row, invalid);
        self.evaluation.derived()
    }
}

/// The columns of a recording that are signals, and where they are among the words of a record.
pub(crate) fn columns(
    reader: &RunReader,
    plant: &Description,
) -> Result<(Columns, Range<usize>), Failure> {
    let parameters = || plant.plants.iter().flat_map(|plant| &plant.parameters);
    let mut columns = Columns::default();
    let words = reader.columns();
    let first = words.iter().position(|word| word.is_signal()).unwrap_or(0);
    for word in words[first..].iter().take_while(|word| word.is_signal()) {
        let (prefix, name) = word.name.split_once('.').unwrap_or_default();
        let group = (Group::ALL
            .into_iter()
            .find(|group| group.prefix() == prefix))
        .ok_or_else(|| Failure::usage(format!("the recording has a group `{prefix}`")))?;
        // The schema of a recording has no word for the dots of parameters.
        let is_it =
            |field: &&Field| group == Group::Parameter && field.name.replace('.', "_") == name;
        columns.push(
            group,
            parameters().find(is_it).map_or(name, |field| &field.name),
        );
    }
    let values = first..first + columns.len();
    Ok((columns, values))
}
