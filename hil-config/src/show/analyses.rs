//! An analysis as `[[metrics]]` of a scenario.

use std::fmt::Write;

use shared_types::time::Step;

use super::{Written, string, toml_float};
use crate::expression::Expression;
use crate::plan::{Analysis, AnalysisKind, Plan};

pub(super) fn analysis(text: &mut String, analysis: &Analysis, plan: &Plan) -> Written {
    let rate = plan.run.rate;
    writeln!(text, "\n[[metrics]]")?;
    writeln!(text, "name = {}", string(&analysis.name))?;
    writeln!(text, "kind = \"{}\"", analysis.kind.name())?;
    let expression = |text: &mut String, key: &str, expression: &Expression| {
        writeln!(text, "{key} = {}", string(&expression.to_string()))
    };
    match &analysis.kind {
        AnalysisKind::StepResponse(plan) => {
            expression(text, "signal", &plan.signal)?;
            writeln!(text, "unit = {}", string(&plan.unit))?;
            writeln!(text, "stimulus = {}", string(&plan.stimulus))?;
            writeln!(text, "initial = {}", toml_float(plan.initial))?;
            writeln!(text, "wanted = {}", toml_float(plan.wanted))?;
            writeln!(text, "band = {}", toml_float(plan.band))?;
            let until_s = toml_float(rate.seconds(plan.last));
            writeln!(text, "until_s = {until_s}")?;
        }
        AnalysisKind::FrequencyResponse(plan) => {
            expression(text, "input", &plan.input)?;
            expression(text, "output", &plan.output)?;
            writeln!(text, "stimulus = {}", string(&plan.stimulus))?;
        }
        AnalysisKind::Detection(plan) => {
            expression(text, "alarm", &plan.alarm)?;
            let held_s = toml_float(rate.seconds(Step(plan.records - 1)));
            writeln!(text, "held_s = {held_s}")?;
            if let Some(fault) = plan.fault {
                writeln!(text, "fault = {fault}")?;
            }
            if let Some(recovered) = &plan.recovered {
                expression(text, "recovered", recovered)?;
            }
            if let Some((effect, unit)) = &plan.effect {
                expression(text, "effect", effect)?;
                writeln!(text, "unit = {}", string(unit))?;
            }
        }
    }
    Ok(())
}
