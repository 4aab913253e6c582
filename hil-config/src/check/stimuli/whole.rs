//! Stimuli of signals that take whole numbers only: integers, enumerations and Booleans of FMUs.

use shared_types::number::exact as number;
use shared_types::time::Step;

use super::super::run::Grid;
use crate::plan::Stimulus;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};
use crate::stimulus::evaluate;

/// Maximum number of steps that are looked at; a fraction at a later step ends the run.
const MOST_STEPS: u64 = 100_000;

/// Reports the first step at which a stimulus of a signal of whole numbers has a fraction.
pub(super) fn refuse_fractions(
    reader: &mut Reader,
    section: &Section<'_>,
    stimulus: &Stimulus,
    grid: Option<Grid>,
) {
    let Some(grid) = grid.filter(|_| stimulus.is_whole) else {
        return;
    };
    let mut row = vec![0.0; 1 + stimulus.waveform.derivatives()];
    for step in 0..grid.steps.min(MOST_STEPS) {
        let time_s = grid.rate.seconds(Step(step));
        evaluate(&stimulus.waveform, time_s, &mut row);
        if row[0].fract() == 0.0 {
            continue;
        }
        let message = format!(
            "`{}`: `{}` takes whole numbers only, but is {} at {} s",
            section.path,
            stimulus.target,
            number(row[0]),
            number(time_s)
        );
        reader
            .report_at(section, "kind", ProblemKind::OutOfRange, message)
            .expected("whole numbers, as of a step or of a table with interpolation = \"hold\"");
        return;
    }
}
