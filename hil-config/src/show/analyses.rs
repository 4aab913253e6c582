//! An analysis as `[[metrics]]` of a scenario.

use std::fmt::Write;

use shared_types::time::Step;

use super::{Written, forgotten, section, string, toml_float};
use crate::expression::Expression;
use crate::keys::METRICS;
use crate::plan::{Analysis, AnalysisKind, Plan};

pub(super) fn analysis(text: &mut String, analysis: &Analysis, plan: &Plan) -> Written {
    let rate = plan.run.rate;
    writeln!(text, "\n[[metrics]]")?;
    writeln!(text, "name = {}", string(&analysis.name))?;
    writeln!(text, "kind = \"{}\"", analysis.kind.name())?;
    let of_kind = METRICS
        .iter()
        .find(|kind| kind.name == analysis.kind.name());
    let keys = of_kind.map_or(&[][..], |kind| kind.keys);
    let text_of = |expression: &Expression| Some(string(&expression.to_string()));
    match &analysis.kind {
        AnalysisKind::StepResponse(plan) => section(text, keys, |key| match key {
            "signal" => text_of(&plan.signal),
            "unit" => Some(string(&plan.unit)),
            "stimulus" => Some(string(&plan.stimulus)),
            "initial" => Some(toml_float(plan.initial)),
            "wanted" => Some(toml_float(plan.wanted)),
            "band" => Some(toml_float(plan.band)),
            "until_s" => Some(toml_float(rate.seconds(plan.last))),
            other => forgotten(other),
        }),
        AnalysisKind::FrequencyResponse(plan) => section(text, keys, |key| match key {
            "input" => text_of(&plan.input),
            "output" => text_of(&plan.output),
            "stimulus" => Some(string(&plan.stimulus)),
            other => forgotten(other),
        }),
        AnalysisKind::Detection(plan) => section(text, keys, |key| match key {
            "alarm" => text_of(&plan.alarm),
            "held_s" => Some(toml_float(rate.seconds(Step(plan.records - 1)))),
            "fault" => plan.fault.map(|fault| fault.to_string()),
            "recovered" => text_of(plan.recovered.as_ref()?),
            "effect" => text_of(&plan.effect.as_ref()?.0),
            "unit" => Some(string(&plan.effect.as_ref()?.1)),
            other => forgotten(other),
        }),
    }
}
