//! Start of an instance: settings of the scenario that apply before or during initialisation, other than parameters.
//!
//! Names may be those of the FMU or the corresponding names here. A variable may be set where the standard allows it:
//! inputs, variables whose `initial` is `exact` or `approx`, and parameters without a start value, which have no
//! column.

use std::collections::BTreeMap;
use std::ffi::CString;
use std::path::Path;

use shared_types::describe::{Invalid, ModelSettings};
use shared_types::failure::Failure;
use shared_types::spelling::spelled;
use shared_types::table::{Field, listed, nearest};

use super::description::{ModelDescription, Variable, VariableType};
use super::settable::{is_settable_text, may_be_set, with_initial_value};
use super::tables::Column;

/// Maximum number of names that a message lists.
const MOST_LISTED: usize = 12;
/// Relative excess over the stop time that counts as rounding.
const ROUNDING: f64 = 1e-6;

/// Start settings, checked against the model.
#[derive(Clone, Debug, Default)]
pub(super) struct Start {
    pub(super) tolerance: Option<f64>,
    /// Time at step 0, in s.
    pub(super) time_s: f64,
    pub(super) stop_s: Option<f64>,
    /// Structural parameters.
    pub(super) structural: Preset,
    /// Initial values.
    pub(super) initial: Preset,
    /// Texts, by value reference.
    pub(super) texts: Vec<(u32, CString)>,
}

/// Columns with the values to set.
#[derive(Clone, Debug, Default)]
pub(super) struct Preset {
    pub(super) columns: Vec<Column>,
    pub(super) row: Vec<f64>,
}

impl Preset {
    fn push(&mut self, variable: usize, element: usize, name: &str, value: f64) {
        self.columns.push(Column {
            field: Field::signal(name, "1", ""),
            variable,
            element,
        });
        self.row.push(value);
    }
}

impl Start {
    /// Builds the start from these settings; missing times and tolerance are taken from the model's default experiment.
    ///
    /// # Errors
    /// If a name is unknown, a variable may not be set, or a value is invalid.
    pub(super) fn of(model: &ModelDescription, settings: &ModelSettings) -> Result<Self, Invalid> {
        let time_s = settings.start_time_s.or(model.experiment.start_s);
        let time_s = time_s.unwrap_or(0.0);
        if let Some(stop_s) = settings.stop_time_s.filter(|stop_s| *stop_s <= time_s) {
            return Err(Invalid(format!(
                "`stop_time_s` is {stop_s}, which is not after the start at {time_s}"
            )));
        }
        Ok(Self {
            tolerance: settings.tolerance.or(model.experiment.tolerance),
            time_s,
            stop_s: settings.stop_time_s,
            structural: structural(model, &settings.structural),
            initial: initial(model, &settings.initial)?,
            texts: texts(model, settings)?,
        })
    }

    /// Checks that a run ends before the stop time passed to the FMU.
    ///
    /// # Errors
    /// If the run is longer.
    pub(super) fn check_run(&self, length_s: f64) -> Result<(), Invalid> {
        match self.stop_passed_by(self.time_s, length_s) {
            None => Ok(()),
            Some(stop_s) => Err(Invalid(format!(
                "`stop_time_s` is {stop_s} s, but a run of {length_s} s that starts at {} s lasts until {} s",
                self.time_s,
                self.time_s + length_s
            ))),
        }
    }

    /// Checks the same for a step, because a law does not know the length of its run.
    ///
    /// # Errors
    /// If the step would end later.
    pub(super) fn check_step(&self, at_s: f64, length_s: f64) -> Result<(), Failure> {
        match self.stop_passed_by(at_s, length_s) {
            None => Ok(()),
            Some(stop_s) => Err(Failure::lost(format!(
                "`stop_time_s` is {stop_s}, but the step of {length_s} s from {at_s} would exceed it"
            ))),
        }
    }

    /// Returns the stop time, if this interval ends after it.
    fn stop_passed_by(&self, at_s: f64, length_s: f64) -> Option<f64> {
        let is_passed = |stop_s: &f64| at_s + length_s > stop_s + ROUNDING * length_s;
        self.stop_s.filter(is_passed)
    }
}

/// Builds the preset of structural parameters, whose names and values were checked when the description was read.
fn structural(model: &ModelDescription, settings: &BTreeMap<String, u64>) -> Preset {
    let mut preset = Preset::default();
    for (place, variable) in model.variables.iter().enumerate() {
        if let (true, [value]) = (settings.contains_key(&variable.name), &variable.start[..]) {
            preset.push(place, 0, &variable.name, *value);
        }
    }
    preset
}

fn initial(model: &ModelDescription, settings: &BTreeMap<String, f64>) -> Result<Preset, Invalid> {
    let mut preset = Preset::default();
    let mut rest = settings.clone();
    let mut values: BTreeMap<(VariableType, u32, usize), (String, f64)> = BTreeMap::new();
    for (place, variable) in model.variables.iter().enumerate() {
        if rest.is_empty() {
            break;
        }
        let mut row: Vec<Option<f64>> = vec![None; variable.elements()];
        for (element, value) in row.iter_mut().enumerate() {
            let foreign = variable.element_name(element);
            let own = spelled(&foreign).ok();
            for name in [Some(&foreign), own.as_ref()].into_iter().flatten() {
                let Some(number) = rest.remove(name) else {
                    continue;
                };
                may_be_set(variable)
                    .map_err(|why| Invalid(format!("`initial.{name}`: it {why}")))?;
                check_value(variable, name, number)?;
                let key = (variable.kind, variable.reference, element);
                let before = values.insert(key, (name.clone(), number));
                if let Some((other, before)) = before.filter(|(_, before)| *before != number) {
                    return Err(Invalid(format!(
                        "`initial.{other}` is {before} and `initial.{name}` is {number}, but both name the same variable"
                    )));
                }
                *value = Some(number);
            }
        }
        if row.iter().all(Option::is_none) {
            continue;
        }
        // An array is set as a whole.
        for (element, value) in row.into_iter().enumerate() {
            let name = variable.element_name(element);
            let value = value.or_else(|| variable.start.get(element).copied());
            let value = value.ok_or_else(|| {
                Invalid(format!(
                    "`initial.{name}` is missing: an array must be set as a whole, and the FMU has no start value for it"
                ))
            })?;
            preset.push(place, element, &name, value);
        }
    }
    match rest.into_keys().next() {
        None => Ok(preset),
        Some(name) => {
            let known: Vec<&str> = with_initial_value(model)
                .map(|one| one.name.as_str())
                .collect();
            Err(unknown("initial", &name, &known))
        }
    }
}

fn check_value(variable: &Variable, name: &str, value: f64) -> Result<(), Invalid> {
    if variable.kind.range().is_none() {
        let kind = variable.kind.name();
        return Err(Invalid(format!(
            "`initial.{name}` is a {kind}, not a number"
        )));
    }
    let (min, max) = variable.bounds();
    if !(min..=max).contains(&value) {
        return Err(Invalid(format!(
            "`initial.{name}` is {value}; expected {min} to {max}"
        )));
    }
    let is_item = variable.items.is_empty() || variable.items.contains(&value);
    if !is_item || (!variable.kind.is_float() && value.fract() != 0.0) {
        let kind = variable.kind.name();
        return Err(Invalid(format!(
            "`initial.{name}` is {value}, which is not a value of its type, {kind}"
        )));
    }
    Ok(())
}

fn texts(
    model: &ModelDescription,
    settings: &ModelSettings,
) -> Result<Vec<(u32, CString)>, Invalid> {
    let mut texts = Vec::new();
    let mut before: BTreeMap<u32, (&str, &str, &str)> = BTreeMap::new();
    if let Some(name) = (settings.texts.keys()).find(|name| settings.files.contains_key(*name)) {
        return Err(Invalid(format!(
            "`{name}` is given as a text and as a file"
        )));
    }
    let files = settings.files.iter().map(|entry| ("files", entry));
    let all = settings.texts.iter().map(|entry| ("texts", entry));
    for (key, (name, text)) in all.chain(files) {
        let is_text = |one: &&Variable| one.kind == VariableType::String;
        let is_named = |one: &&Variable| {
            one.name == *name || spelled(&one.name).is_ok_and(|spelled| spelled == *name)
        };
        let Some(variable) = model.variables.iter().filter(is_text).find(is_named) else {
            let known = model.variables.iter().filter(is_text);
            let known = known.filter(|one| is_settable_text(one));
            let known: Vec<&str> = known.map(|one| one.name.as_str()).collect();
            return Err(unknown(key, name, &known));
        };
        if !is_settable_text(variable) {
            return Err(Invalid(format!(
                "`{key}.{name}` is neither a parameter nor an input, and its `initial` is neither exact nor approx"
            )));
        }
        if !variable.dimensions.is_empty() {
            return Err(Invalid(format!(
                "`{key}.{name}` is an array of texts, which cannot be set"
            )));
        }
        if key == "files" && !Path::new(text).exists() {
            return Err(Invalid(format!(
                "`files.{name}` is {text}, which does not exist (paths in a scenario are relative to its folder)"
            )));
        }
        let other = before.insert(variable.reference, (key, name, text));
        if let Some((other_key, other, value)) = other.filter(|(.., value)| value != text) {
            return Err(Invalid(format!(
                "`{other_key}.{other}` is {value:?} and `{key}.{name}` is {text:?}, but both name the same variable"
            )));
        }
        let bytes = CString::new(text.as_str());
        let bytes = bytes.map_err(|_| Invalid(format!("`{key}.{name}` contains a zero byte")))?;
        texts.push((variable.reference, bytes));
    }
    Ok(texts)
}

fn unknown(key: &str, name: &str, known: &[&str]) -> Invalid {
    let near = nearest(name, known.iter().copied());
    let advice = match known.len() {
        0 => "; none can be set".to_owned(),
        _ if !near.is_empty() => format!("; nearest: {}", listed(&near)),
        count if count <= MOST_LISTED => format!("; there are {}", listed(known)),
        _ => "; list them with `hil describe`".to_owned(),
    };
    Invalid(format!(
        "`{key}.{name}` is not a variable of the FMU{advice}"
    ))
}
