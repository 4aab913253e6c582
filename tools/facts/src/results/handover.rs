//! Fates of a run's controllers, for the summary and for observers.

use std::fmt::{self, Write as _};
use std::path::Path;

use serde::Serialize;
use shared_types::record::{ControllerChange, ControllerFate};
use shared_types::time::{Rate, Step};

use crate::results::ended::Started;

/// Controller of a run that had several controllers, or lost its only one.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ActiveController {
    epoch: u32,
    /// Path of the binary; null, as is the hash, if only a recording reports the controller.
    binary: Option<String>,
    blake3: Option<String>,
    law: Option<String>,
    /// Values changed for the controller.
    set: Vec<String>,
    /// First step that the controller answered; null if it never became active.
    from_step: Option<u64>,
    /// First step without the controller; null if it was active to the end.
    until_step: Option<u64>,
    until_s: Option<f64>,
    /// `lost`, `replaced` or `refused`.
    end: Option<&'static str>,
    reason: Option<String>,
    /// Continuation of the run without the controller.
    then: Option<&'static str>,
}

/// Laws of a run, each with the first step that it answers; `None` stands for no controller.
#[derive(Clone, Debug, Default)]
pub struct Laws(Vec<(u64, Option<Law>)>);

/// Law of one of a run's controllers.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Law {
    name: String,
    /// Differences from the run's first controller: values, and the program.
    other: Vec<String>,
}

impl Law {
    /// Returns the law of a later controller, from these facts of a recording.
    fn of(name: &str, epoch: u32, fact: &dyn Fn(&str) -> Option<String>) -> Self {
        let its = |what| fact(&format!("controller_{epoch}_{what}"));
        let set: Vec<String> = its("set")
            .and_then(|set| serde_json::from_str(&set).ok())
            .unwrap_or_default();
        let set = set.iter().filter_map(|set| set.strip_prefix("controller."));
        let set = set.filter(|set| !set.starts_with("law="));
        let mut other: Vec<String> = set.map(Into::into).collect();
        if let (Some(first), Some(hash)) = (fact("controller_blake3"), its("blake3"))
            && first != hash
        {
            let path = its("binary").unwrap_or_default();
            let file = Path::new(&path).file_name().unwrap_or_default();
            let hash = hash.get(..8).unwrap_or_default();
            other.push(format!("{} {hash}", file.to_string_lossy()));
        }
        let name = name.into();
        Self { name, other }
    }
}

impl fmt::Display for Law {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)?;
        if self.other.is_empty() {
            return Ok(());
        }
        write!(f, " ({})", self.other.join(", "))
    }
}

impl Laws {
    /// Returns the laws of a run that began with this law, from these facts about its controllers.
    pub fn of(
        first: &str,
        changes: &[ControllerChange],
        fact: impl Fn(&str) -> Option<String>,
    ) -> Self {
        let first = Law {
            name: first.into(),
            other: Vec::new(),
        };
        let mut laws = vec![(0, Some(first))];
        for ControllerChange {
            epoch,
            step,
            change,
        } in changes
        {
            let law = match change {
                ControllerFate::Joined { law } => Some(Law::of(law, *epoch, &fact)),
                ControllerFate::Lost { .. } => None,
                ControllerFate::Refused { .. } => continue,
            };
            laws.retain(|(from, _)| from < step);
            if laws.last().is_none_or(|(_, last)| *last != law) {
                laws.push((*step, law));
            }
        }
        Self(laws)
    }

    /// Returns the names of all laws.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let laws = self.0.iter().filter_map(|(_, law)| law.as_ref());
        laws.map(|law| law.name.as_str())
    }

    /// Returns the law that answered every step of a window in s, both ends included, if it had the values of the
    /// scenario and the program of the run's start.
    pub(crate) fn during(&self, [from_s, until_s]: [f64; 2], rate: Rate) -> Option<&str> {
        let [from, until] = [from_s, until_s].map(|time_s| rate.step_at_or_after(time_s).0);
        let place = self.0.iter().rposition(|(step, _)| *step <= from)?;
        let next = self.0.get(place + 1);
        let is_whole = next.is_none_or(|(step, _)| *step > until);
        let law = self.0[place].1.as_ref()?;
        (is_whole && law.other.is_empty()).then_some(&law.name)
    }

    /// Describes the controllers: the first, and each later one with its start time.
    pub fn describe(&self, rate: Rate) -> String {
        let parts = self.0.iter().map(|(step, law)| {
            let law = (law.as_ref()).map_or_else(|| "no controller".into(), Law::to_string);
            match step {
                0 => law,
                step => format!("{law} from {} s", rate.seconds(Step(*step))),
            }
        });
        parts.collect::<Vec<_>>().join(", ")
    }
}

/// Returns the controllers of a run; empty if the run kept its first controller.
pub(crate) fn active_controllers(
    started: &[Started],
    changes: &[ControllerChange],
    rate: Rate,
) -> Vec<ActiveController> {
    if changes.is_empty() {
        return Vec::new();
    }
    let last = started.iter().map(|one| one.epoch);
    let last = last.chain(changes.iter().map(|change| change.epoch)).max();
    let mut active: Vec<ActiveController> = (1..=last.unwrap_or(0))
        .map(|epoch| {
            let started = started.iter().find(|one| one.epoch == epoch);
            ActiveController {
                epoch,
                binary: started.map(|one| one.binary.path.display().to_string()),
                blake3: started.map(|one| one.binary.blake3.clone()),
                law: started.map(|one| one.law.clone()),
                set: started.map_or_else(Vec::new, |one| one.set.clone()),
                from_step: (epoch == 1).then_some(0),
                until_step: None,
                until_s: None,
                end: None,
                reason: None,
                then: None,
            }
        })
        .collect();
    for ControllerChange {
        epoch,
        step,
        change,
    } in changes
    {
        for one in &mut active {
            let is_meant = one.epoch == *epoch;
            let (end, reason, then) = match change {
                ControllerFate::Joined { law } if is_meant => {
                    one.from_step = Some(*step);
                    one.law = Some(law.clone());
                    continue;
                }
                ControllerFate::Joined { .. } if one.from_step.is_some() && one.end.is_none() => {
                    ("replaced", None, None)
                }
                ControllerFate::Lost { reason, policy } if is_meant => {
                    // The plant's observation, and the fate of the process.
                    let started = started.iter().find(|one| one.epoch == *epoch);
                    let fate = started.and_then(|one| one.fate.as_deref());
                    let fate = fate.map_or_else(String::new, |fate| format!("; {fate}"));
                    ("lost", Some(format!("{reason}{fate}")), Some(policy.name()))
                }
                ControllerFate::Refused { reason } if is_meant => {
                    ("refused", Some(reason.clone()), None)
                }
                _ => continue,
            };
            one.until_step = Some(*step);
            one.until_s = Some(rate.seconds(Step(*step)));
            one.end = Some(end);
            one.reason = reason;
            one.then = then;
        }
    }
    active
}

impl ActiveController {
    /// Describes the controller.
    pub(crate) fn describe(&self) -> String {
        let Self { epoch, law, .. } = self;
        let mut text = format!("controller {epoch}");
        let law = law.iter().chain(&self.set).map(String::as_str);
        let law: Vec<&str> = law.collect();
        if !law.is_empty() {
            text += &format!(" ({})", law.join(", "));
        }
        // Writing to a string cannot fail.
        if let Some(from) = self.from_step.filter(|from| *from > 0) {
            let _ = write!(text, " took over at step {from}");
        }
        if let (Some(until), Some(end)) = (self.until_step, self.end) {
            let comma = if self.from_step.is_some_and(|from| from > 0) {
                ","
            } else {
                ""
            };
            let _ = write!(text, "{comma} {end} at step {until}");
        }
        if let Some(reason) = &self.reason {
            let _ = write!(text, ": {reason}");
        }
        if let Some(then) = self.then {
            let _ = write!(text, "; {then}");
        }
        text
    }
}

/// Describes a change as reported during the run.
pub fn describe(change: &ControllerChange) -> String {
    let ControllerChange {
        epoch,
        step,
        change,
    } = change;
    match change {
        ControllerFate::Lost { reason, policy } => {
            format!(
                "controller {epoch} lost at step {step}: {reason}; {}",
                policy.name()
            )
        }
        ControllerFate::Joined { law } => {
            format!("controller {epoch} ({law}) took over at step {step}")
        }
        ControllerFate::Refused { reason } => {
            format!("controller {epoch} refused at step {step}: {reason}")
        }
    }
}

#[cfg(test)]
mod tests {
    use shared_types::lockstep::OnLoss;

    use super::*;

    fn change(epoch: u32, step: u64, change: ControllerFate) -> ControllerChange {
        ControllerChange {
            epoch,
            step,
            change,
        }
    }

    fn joined(epoch: u32, step: u64, law: &str) -> ControllerChange {
        change(epoch, step, ControllerFate::Joined { law: law.into() })
    }

    fn lost(epoch: u32, step: u64) -> ControllerChange {
        let (reason, policy) = (String::new(), OnLoss::Hold);
        change(epoch, step, ControllerFate::Lost { reason, policy })
    }

    #[test]
    fn the_law_of_a_window_is_the_one_active_throughout() {
        let rate = Rate::new(1000.0).expect("a rate");
        let laws = [joined(2, 2500, "hold"), lost(2, 4000)];
        let laws = Laws::of("pid", &laws, |_| None);
        assert_eq!(
            laws.describe(rate),
            "pid, hold from 2.5 s, no controller from 4 s"
        );
        for (window_s, law) in [
            ([0.0, 2.499], Some("pid")),
            ([0.0, 2.5], None),
            ([2.5, 3.999], Some("hold")),
            ([2.4, 3.0], None),
            ([3.0, 4.0], None),
            ([4.0, 5.0], None),
        ] {
            assert_eq!(laws.during(window_s, rate), law, "{window_s:?}");
        }
        let names: Vec<&str> = laws.names().collect();
        assert_eq!(names, ["pid", "hold"]);
    }

    #[test]
    fn a_law_that_takes_over_from_itself_is_listed_once() {
        let rate = Rate::new(1000.0).expect("a rate");
        let refused = change(
            3,
            20,
            ControllerFate::Refused {
                reason: String::new(),
            },
        );
        let laws = [lost(1, 10), joined(2, 10, "pid"), refused];
        assert_eq!(Laws::of("pid", &laws, |_| None).describe(rate), "pid");
        let at_once = [
            joined(2, 0, "hold"),
            joined(3, 7, "pid"),
            joined(4, 7, "hold"),
        ];
        assert_eq!(Laws::of("pid", &at_once, |_| None).describe(rate), "hold");
    }

    #[test]
    fn a_controller_with_other_values_or_program_is_described_and_has_no_published_figures() {
        let rate = Rate::new(1000.0).expect("a rate");
        let facts = |name: &str| {
            let fact = match name {
                "controller_blake3" | "controller_2_blake3" | "controller_4_blake3" => "0123456789",
                "controller_2_set" => r#"["controller.pid.gain=2", "controller.law=pid"]"#,
                "controller_3_blake3" => "abcdefghij",
                "controller_3_binary" => "/a/mine",
                _ => return None,
            };
            Some(fact.to_owned())
        };
        let laws = [
            joined(2, 1000, "pid"),
            joined(3, 2000, "pid"),
            joined(4, 3000, "pid"),
        ];
        let laws = Laws::of("pid", &laws, facts);
        assert_eq!(
            laws.describe(rate),
            "pid, pid (pid.gain=2) from 1 s, pid (mine abcdefgh) from 2 s, pid from 3 s"
        );
        for (window_s, law) in [
            ([0.0, 0.9], Some("pid")),
            ([1.0, 1.9], None),
            ([2.0, 2.9], None),
            ([3.0, 3.9], Some("pid")),
        ] {
            assert_eq!(laws.during(window_s, rate), law, "{window_s:?}");
        }
    }
}
