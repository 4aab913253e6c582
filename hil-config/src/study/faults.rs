//! Faults that a study tries one after the other: kinds, targets, sizes and onsets, and the flags of each.

use std::fmt;

use super::Item;

/// Name of the varied value that chooses the fault of a case, and of the metric that times its detection.
pub const FAULT: &str = "fault";
/// Key that appends the fault to the events of the scenario.
pub(super) const APPENDED_FAULT: &str = "faults[+]";
/// Key that appends the metric of its detection.
const APPENDED_METRIC: &str = "metrics[+]";
/// Name of the event.
const TRIED: &str = "tried";
/// Alarm of a variant without a detector.
pub(super) const NO_ALARM: &str = "none";

/// Faults of a study, each tried alone in every variant.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultTable {
    /// Expression that holds while a law sees the fault.
    pub detected: Option<String>,
    /// Time in s that the alarm must hold.
    pub held_s: f64,
    /// Expression that holds while the fault is overcome.
    pub recovered: Option<String>,
    /// Kinds, in the order of the study.
    pub kinds: Vec<FaultKindTable>,
}

/// Kind of fault with what is tried of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FaultKindTable {
    /// Kind.
    pub kind: String,
    /// Targets; `None` for every one on which the kind can act, except parameters.
    pub targets: Option<Vec<String>>,
    /// Sizes: keys of the effect as TOML, empty for a kind without any.
    pub sizes: Vec<String>,
    /// Onsets in s.
    pub onsets_s: Vec<f64>,
    /// Duration in s; `None` for a fault that stays.
    pub duration_s: Option<f64>,
}

/// Fault of a case.
#[derive(Clone, Debug, PartialEq)]
pub struct TriedFault {
    /// Index of its kind in the table.
    pub place: usize,
    /// Kind.
    pub kind: String,
    /// Target as in the table: a name, or the key of a part of the plant, such as `actuator = 1`; empty for the plant.
    pub target: String,
    /// Size as TOML.
    pub size: String,
    /// Onset in s.
    pub onset_s: f64,
    duration_s: Option<f64>,
}

impl FaultTable {
    /// Returns `true` if every kind has its targets.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.kinds.iter().all(|one| one.targets.is_some())
    }

    /// Lists the faults in the order of their cases: by kind, target, size and onset.
    #[must_use]
    pub fn tried(&self) -> Vec<TriedFault> {
        let mut all = Vec::new();
        for (place, one) in self.kinds.iter().enumerate() {
            for target in one.targets.iter().flatten() {
                for size in &one.sizes {
                    all.extend(one.onsets_s.iter().map(|onset_s| TriedFault {
                        place,
                        kind: one.kind.clone(),
                        target: target.clone(),
                        size: size.clone(),
                        onset_s: *onset_s,
                        duration_s: one.duration_s,
                    }));
                }
            }
        }
        all
    }

    /// Returns `true` if the cases have a metric of detection and recovery.
    #[must_use]
    pub const fn is_timed(&self) -> bool {
        self.detected.is_some() || self.recovered.is_some()
    }

    /// Returns the flag that adds the metric of detection and recovery, with the alarm of a variant; `None` if neither
    /// is declared. Without `has_fault` the metric is about the first fault of the scenario.
    pub(super) fn metric(&self, own_alarm: Option<&str>, has_fault: bool) -> Option<String> {
        if !self.is_timed() {
            return None;
        }
        let alarm = own_alarm.or(self.detected.as_deref());
        let alarm = alarm.filter(|alarm| *alarm != NO_ALARM).unwrap_or("0");
        let mut keys = vec![
            format!("name = \"{FAULT}\", kind = \"detection\""),
            format!("alarm = {}, held_s = {:?}", quoted(alarm), self.held_s),
        ];
        keys.extend(has_fault.then(|| format!("fault = \"{TRIED}\"")));
        let recovered = self.recovered.as_deref();
        keys.extend(recovered.map(|one| format!("recovered = {}", quoted(one))));
        Some(format!("{APPENDED_METRIC}={{ {} }}", keys.join(", ")))
    }
}

impl TriedFault {
    /// Returns the keys of the effect as TOML.
    fn effect(&self) -> String {
        effect(&self.target, &self.size)
    }

    /// Returns the item of the varied value that chooses the fault.
    pub(super) fn item(&self) -> Item {
        let duration =
            (self.duration_s).map_or_else(String::new, |s| format!(", duration_s = {s:?}"));
        let kind = quoted(&self.kind);
        Item::Table {
            label: self.to_string(),
            toml: format!(
                "{{ name = \"{TRIED}\", kind = {kind}, at_s = {:?}{duration}, effects = [{{ {} }}] }}",
                self.onset_s,
                self.effect()
            ),
        }
    }

    /// Returns the flag that adds the fault to a scenario.
    #[must_use]
    pub fn flag(&self) -> String {
        format!("{APPENDED_FAULT}={}", self.item().toml())
    }
}

impl fmt::Display for TriedFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {} at {:?} s", self.kind, self.effect(), self.onset_s)
    }
}

/// Returns `true` if a flag with this key is one of the table of faults.
pub(super) fn is_appended(key: &str) -> bool {
    [APPENDED_FAULT, APPENDED_METRIC].contains(&key)
}

/// Joins a target and a size to the keys of an effect.
pub(super) fn effect(target: &str, size: &str) -> String {
    let target = match target {
        "" => String::new(),
        part if part.contains('=') => part.to_owned(),
        name => format!("target = {}", quoted(name)),
    };
    let both = [target, size.to_owned()];
    let keys = both.iter().filter(|keys| !keys.is_empty());
    keys.map(String::as_str).collect::<Vec<_>>().join(", ")
}

fn quoted(text: &str) -> String {
    toml::Value::String(text.into()).to_string()
}
