//! `[[metrics]]` that are analyses: their signals, and the stimulus or fault that they need.

use shared_types::number::exact as number;

use super::run::Grid;
use super::signals::{self, Analysed};
use crate::document::Value;
use crate::expression::{Columns, Expression};
use crate::plan::{
    Analysis, AnalysisKind, DetectionPlan, FaultEvent, FrequencyResponsePlan, StepResponsePlan,
    Stimulus, Sweep, Waveform,
};
use crate::problem::{ProblemKind, listed};
use crate::reader::{Reader, Section};

/// Samples needed per turn of a chirp to separate sine and cosine despite noise.
const SAMPLES_PER_TURN: f64 = 8.0;

/// Context of analyses; `None` for each part that is itself faulty.
pub(super) struct AnalysisContext<'a> {
    pub(super) columns: Option<&'a Columns>,
    pub(super) grid: Option<Grid>,
    pub(super) stimuli: Option<&'a [Stimulus]>,
    pub(super) faults: Option<&'a [FaultEvent]>,
}

/// Returns the valid analyses and reports the others.
pub(super) fn check(
    reader: &mut Reader,
    analysed: &[Analysed<'_>],
    context: &AnalysisContext<'_>,
) -> Vec<Analysis> {
    let one = |analysed: &Analysed<'_>| {
        let section = &analysed.section;
        let kind = match analysed.kind {
            "step-response" => AnalysisKind::StepResponse(context.step_response(reader, section)?),
            "frequency-response" => {
                AnalysisKind::FrequencyResponse(context.frequency_response(reader, section)?)
            }
            "detection" => AnalysisKind::Detection(context.detection(reader, section)?),
            _ => unreachable!("every kind is read"),
        };
        Some(Analysis {
            name: analysed.name.into(),
            kind,
        })
    };
    analysed.iter().filter_map(one).collect()
}

impl AnalysisContext<'_> {
    fn step_response(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
    ) -> Option<StepResponsePlan> {
        let signal = self.expression(reader, section, "signal");
        let unit = (signal.as_ref()).and_then(|signal| self.unit(reader, section, signal));
        let initial = reader.optional_number(section, "initial");
        let target = reader.optional_number(section, "wanted");
        let band = reader.number(section, "band");
        let until_s = reader.optional_number(section, "until_s");
        let stimulus = self.stimulus(reader, section, "step", |waveform| {
            matches!(waveform, Waveform::Step { .. })
        });
        let (stimulus, grid) = (stimulus?, self.grid?);
        let Waveform::Step {
            at_s,
            before,
            after,
        } = stimulus.waveform
        else {
            return None;
        };
        let (initial, target) = (initial?.unwrap_or(before), target?.unwrap_or(after));
        if initial == target {
            let message = format!(
                "the step of `{}` has no height, so there is no response to analyse",
                section.path
            );
            reader
                .report(
                    ProblemKind::OutOfRange,
                    &section.path,
                    section.place,
                    message,
                )
                .expected("`initial` and `wanted` that differ");
            return None;
        }
        let end_s = grid.end_s();
        let until_s = until_s?.unwrap_or(end_s);
        if !(until_s > at_s && until_s <= end_s) {
            let path = section.path_of("until_s");
            let message = format!("`{path}` is {}", number(until_s));
            reader
                .report_at(section, "until_s", ProblemKind::OutOfRange, message)
                .expected(format!(
                    "a time after the step at {} and up to {} in s",
                    number(at_s),
                    number(end_s)
                ));
            return None;
        }
        Some(StepResponsePlan {
            signal: signal?,
            unit: unit?,
            stimulus: stimulus.target.clone(),
            at_s,
            initial,
            wanted: target,
            band: band?,
            last: grid.rate.step_at_or_before(until_s)?,
        })
    }

    fn frequency_response(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
    ) -> Option<FrequencyResponsePlan> {
        let output = self.expression(reader, section, "output");
        let input_signal = match section.table.get("input") {
            Some(_) => self.expression(reader, section, "input").map(Some),
            None => Some(None),
        };
        let stimulus = self.stimulus(reader, section, "chirp", |waveform| {
            matches!(waveform, Waveform::Chirp { .. })
        });
        let (stimulus, grid) = (stimulus?, self.grid?);
        let Waveform::Chirp {
            start_hz,
            end_hz,
            duration_s,
            sweep,
            ..
        } = stimulus.waveform
        else {
            return None;
        };
        let target = &stimulus.target;
        let turns = duration_s
            * match sweep {
                Sweep::Linear => 0.5 * (start_hz + end_hz),
                Sweep::Logarithmic => (end_hz - start_hz) / libm::log(end_hz / start_hz),
            };
        let highest_hz = grid.rate.hz() / SAMPLES_PER_TURN;
        let wrong = if end_hz <= start_hz {
            Some(format!(
                "`end_hz` of the chirp `{target}` is not above `start_hz`"
            ))
        } else if end_hz > highest_hz {
            Some(format!(
                "the chirp `{target}` ends at {} Hz; at this exchange rate at most {} Hz can be analysed",
                number(end_hz),
                number(highest_hz)
            ))
        } else if duration_s > grid.end_s() {
            Some(format!(
                "the chirp `{target}` extends beyond the end of the run"
            ))
        } else if turns < 2.0 {
            Some(format!("the chirp `{target}` has fewer than two periods"))
        } else {
            None
        };
        if let Some(message) = wrong {
            reader
                .report_at(section, "stimulus", ProblemKind::Mismatch, message)
                .expected("a chirp from a low to a high frequency, within the run");
            return None;
        }
        let input = match input_signal? {
            Some(input) => input,
            None => Expression::parse(&format!("reference.{target}")).ok()?,
        };
        Some(FrequencyResponsePlan {
            input,
            output: output?,
            stimulus: target.clone(),
            start_hz,
            end_hz,
            duration_s,
            sweep,
        })
    }

    fn detection(&self, reader: &mut Reader, section: &Section<'_>) -> Option<DetectionPlan> {
        let alarm = self.expression(reader, section, "alarm");
        let held_s = reader.number(section, "held_s");
        let fault = self.fault(reader, section);
        let optional = |reader: &mut Reader, key| match section.table.get(key) {
            Some(_) => self.expression(reader, section, key).map(Some),
            None => Some(None),
        };
        let recovered = optional(reader, "recovered");
        let effect = match optional(reader, "effect") {
            Some(Some(effect)) => self
                .unit(reader, section, &effect)
                .map(|unit| Some((effect, unit))),
            Some(None) => Some(None),
            None => None,
        };
        let records = self.grid?.rate.step_at_or_after(held_s?).0;
        Some(DetectionPlan {
            alarm: alarm?,
            // That time spans the first to the last of them.
            records: records + 1,
            fault: fault?,
            recovered: recovered?,
            effect: effect?,
        })
    }

    fn expression(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        key: &'static str,
    ) -> Option<Expression> {
        signals::signal(reader, section, key, self.columns)
    }

    fn unit(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        expression: &Expression,
    ) -> Option<String> {
        let context = self.columns.map(|columns| (expression, columns));
        signals::unit(reader, section, context, "")
    }

    /// Finds the stimulus by name, or the only one of its kind.
    fn stimulus(
        &self,
        reader: &mut Reader,
        section: &Section<'_>,
        kind: &str,
        is_of_kind: impl Fn(&Waveform) -> bool,
    ) -> Option<&Stimulus> {
        let stimuli = self.stimuli?;
        let fitting: Vec<&Stimulus> = (stimuli.iter())
            .filter(|stimulus| is_of_kind(&stimulus.waveform))
            .collect();
        let names = || fitting.iter().map(|stimulus| stimulus.target.as_str());
        let named = match section.table.get("stimulus") {
            Some(_) => Some(reader.text(section, "stimulus")?),
            None => None,
        };
        let candidate = match (named, &fitting[..]) {
            (Some(name), _) => fitting.iter().find(|stimulus| stimulus.target == name),
            (None, [only]) => Some(only),
            (None, _) => None,
        };
        if candidate.is_none() {
            let path = section.path_of("stimulus");
            let (problem, message) = match named {
                Some(name) => (
                    ProblemKind::UnknownName,
                    format!("there is no stimulus `{name}` of kind {kind}"),
                ),
                None => (
                    ProblemKind::MissingKey,
                    format!(
                        "`{path}` is missing, and the scenario has {} stimuli of kind {kind}",
                        fitting.len()
                    ),
                ),
            };
            let expected = match fitting.len() {
                0 => format!("a scenario with a stimulus of kind {kind}"),
                _ => format!("one of {}", listed(names())),
            };
            let report = reader.report_at(section, "stimulus", problem, message);
            let report = report.expected(expected);
            if let Some(name) = named {
                report.nearest(name, names());
            }
        }
        candidate.copied()
    }

    /// Returns the number of the intended fault event; `Some(None)` if none is named.
    fn fault(&self, reader: &mut Reader, section: &Section<'_>) -> Option<Option<u32>> {
        let Some(entry) = section.table.get("fault") else {
            return Some(None);
        };
        let faults = self.faults?;
        let id = match &entry.node.value {
            Value::Text(name) => (faults.iter())
                .find(|event| event.name.as_ref() == Some(name))
                .ok_or_else(|| format!("there is no fault event `{name}`")),
            Value::Integer(number) => (faults.iter())
                .find(|event| i64::from(event.id) == *number)
                .ok_or_else(|| format!("there is no fault event {number}")),
            _ => {
                let path = section.path_of("fault");
                reader.wrong_type(&path, &entry.node, "the name or number of a fault event");
                return None;
            }
        };
        match id {
            Ok(event) => Some(Some(event.id)),
            Err(message) => {
                let names = faults.iter().filter_map(|event| event.name.as_deref());
                let expected = match (faults.len(), names.clone().count()) {
                    (0, _) => "an event of this scenario, which has none".into(),
                    (last, 0) => format!("a number from 1 to {last}"),
                    (last, _) => format!(
                        "one of {}, or a number from 1 to {last}",
                        listed(names.clone())
                    ),
                };
                let path = section.path_of("fault");
                let report =
                    reader.report(ProblemKind::UnknownName, path, &entry.node.place, message);
                let report = report.expected(expected);
                if let Value::Text(name) = &entry.node.value {
                    report.nearest(name, names);
                }
                None
            }
        }
    }
}
