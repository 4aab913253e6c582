//! Settings refused by the operating system, each reported once, with the command that fixes it.

use std::fmt::{self, Display};

use hil_doctor::rights::LIMITS;
use shared_types::realtime::Report;

/// List of refusals.
#[derive(Debug, Default)]
pub(super) struct Refusals(Vec<Refusal>);

#[derive(Debug)]
struct Refusal {
    /// Refused sides, all for the same reason.
    who: Vec<&'static str>,
    setting: &'static str,
    reason: String,
    mend: Option<String>,
}

impl Refusals {
    /// Returns `true` if there are no refusals.
    pub(super) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds a refused setting of a side.
    pub(super) fn add(
        &mut self,
        who: &'static str,
        setting: &'static str,
        reason: &str,
        mend: Option<&str>,
    ) {
        let mut existing = self.0.iter_mut();
        match existing.find(|existing| existing.setting == setting && existing.reason == reason) {
            Some(existing) => existing.who.push(who),
            None => self.0.push(Refusal {
                who: vec![who],
                setting,
                reason: reason.into(),
                mend: mend.map(str::to_owned),
            }),
        }
    }

    /// Adds the refusals in a side's report.
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

/// Formats a line for each refusal, followed by each command that fixes some of them.
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
            write!(f, "\n  fix: {mend}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_refusals_and_equal_fixes_are_reported_once() {
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
             warning: recorder: core was not granted: gone\n  fix: ask"
        );
    }
}
