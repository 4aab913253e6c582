//! Refusals of the system, told once, with the command that mends each.

use std::fmt::{self, Display};

use hil_doctor::rights::LIMITS;
use shared_types::realtime::Report;

/// Refusals, one after another.
#[derive(Debug, Default)]
pub(super) struct Refusals(Vec<Refusal>);

#[derive(Debug)]
struct Refusal {
    /// Names of the sides that asked; all got the same answer.
    who: Vec<&'static str>,
    setting: &'static str,
    reason: String,
    mend: Option<String>,
}

impl Refusals {
    /// Returns true if there are no refusals.
    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Notes that somebody was refused a setting.
    pub(super) fn add(
        &mut self,
        who: &'static str,
        setting: &'static str,
        reason: &str,
        mend: Option<&str>,
    ) {
        let mut known = self.0.iter_mut();
        match known.find(|known| known.setting == setting && known.reason == reason) {
            Some(known) => known.who.push(who),
            None => self.0.push(Refusal {
                who: vec![who],
                setting,
                reason: reason.into(),
                mend: mend.map(str::to_owned),
            }),
        }
    }

    /// Notes what a side was refused.
    pub(super) fn add_side(&mut self, side: &'static str, report: &Report) {
        let wait = report.wait.reason.as_deref();
        let locked = report.lock_memory.refusal(&false);
        let fetched = report.prefault.refusal(&false);
        for (setting, reason, mend) in [
            ("core", report.core.refusal(&None), None),
            ("priority", report.priority.refusal(&0), Some(LIMITS)),
            ("lock_memory", locked, Some(LIMITS)),
            ("prefault", fetched, Some(LIMITS)),
            ("wait", wait, None),
        ] {
            if let Some(reason) = reason {
                self.add(side, setting, reason, mend);
            }
        }
    }
}

/// A line for each, then each command that mends some of them.
impl Display for Refusals {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut mends: Vec<&str> = Vec::new();
        let mut end = "";
        for refusal in &self.0 {
            let (who, setting, reason) =
                (refusal.who.join(" and "), refusal.setting, &refusal.reason);
            write!(
                f,
                "{end}warning: {who}: {setting} was not granted: {reason}"
            )?;
            end = "\n";
            mends.extend(refusal.mend.as_deref().filter(|mend| !mends.contains(mend)));
        }
        for mend in mends {
            write!(f, "\n  mend: {mend}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_refusal_and_the_same_mend_are_told_once() {
        let mut refusals = Refusals::default();
        assert!(refusals.is_empty());
        refusals.add("plant", "priority", "no", Some("ask"));
        refusals.add("plant", "lock_memory", "too much", Some("ask"));
        refusals.add("controller", "priority", "no", Some("ask"));
        refusals.add("controller", "lock_memory", "nothing at all", Some("ask"));
        refusals.add("recorder", "core", "gone", None);
        assert_eq!(
            refusals.to_string(),
            "warning: plant and controller: priority was not granted: no\n\
             warning: plant: lock_memory was not granted: too much\n\
             warning: controller: lock_memory was not granted: nothing at all\n\
             warning: recorder: core was not granted: gone\n  mend: ask"
        );
    }
}
