//! Faults that the cases of a study try: their targets, which follow from the plant, those that are not possible, and
//! those that the study leaves out.

use std::collections::{BTreeMap, HashMap};

use hil_config::live_requests::RequestContext;
use hil_config::plan::{FaultEvent, Plan};
use hil_config::problem::Problems;
use hil_config::study::{FaultTable, Study, TriedFault};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;

use super::super::study_text::with_targets;
use super::Cases;
use crate::draws::Draws;
use crate::manifest::{FaultPlan, Untried};

/// Group of targets that are tried only by name: a plant may have hundreds.
const PARAMETERS: &str = "parameter.";

/// Every kind of fault that the plant and its link offer, with its targets.
type Offered = Vec<(String, Vec<String>)>;

impl Cases {
    /// Completes the targets that the study leaves open.
    ///
    /// # Errors
    /// If a kind is unknown, or can act on nothing.
    pub(super) fn with_targets(self) -> Result<Self, Failure> {
        let study = self.study();
        let Some(table) = &study.faults else {
            return Ok(self);
        };
        let offered = self.offered()?;
        let mut targets = Vec::new();
        for (number, one) in table.kinds.iter().enumerate() {
            let known = offered.iter().find(|(kind, _)| *kind == one.kind);
            let Some((_, all)) = known else {
                return Err(unknown_kind(study, number, &offered));
            };
            targets.push(match &one.targets {
                Some(_) => None,
                None => Some(default_targets(study, number, all)?),
            });
        }
        if table.is_complete() {
            return Ok(self);
        }
        let text = with_targets(study.text(), &targets)
            .ok_or_else(|| Failure::usage("the tables [[faults.kinds]] cannot be completed"))?;
        let complete = Study::parse(&text, study.path())?;
        Ok(Self {
            draws: Draws::new(complete)?,
            ..self
        })
    }

    /// Lists the faults that the study does not try, and the cases that are not possible; `None` for a study without a
    /// table of faults.
    ///
    /// # Errors
    /// If a case is refused for another reason than its fault, or if a size, an onset or a named target is refused in
    /// every case.
    pub(in crate::command) fn fault_plan(
        &self,
        interruption: &Interruption,
    ) -> Result<Option<FaultPlan>, Failure> {
        let Some(table) = &self.study().faults else {
            return Ok(None);
        };
        let mut impossible = BTreeMap::new();
        let mut refusals = BTreeMap::new();
        let of_each = self.cases_of_each(table);
        // Case of each fault for each combination of the other values.
        let mut known = HashMap::new();
        for case in 0..self.study().cases() {
            interruption.check()?;
            match self.possible(case)? {
                Ok(fault) => {
                    let fault = serde_json::to_string(&fault).map_err(Failure::infrastructure)?;
                    if let Some(earlier) = known.insert((case % of_each, fault), case) {
                        return Err(self.same_fault(table, earlier, case));
                    }
                }
                Err((reason, refused)) => {
                    impossible.insert(case, reason);
                    refusals.insert(case, refused);
                }
            }
        }
        self.refuse_without_case(table, refusals)?;
        Ok(Some(FaultPlan {
            untried: untried(table, &self.offered()?),
            impossible,
        }))
    }

    /// Returns the fault of a case; or the reason for which it is not possible, with the whole refusal.
    fn possible(&self, case: u64) -> Result<Result<FaultEvent, (String, Failure)>, Failure> {
        let refused = match self.check(case) {
            Ok(plan) => {
                let fault = plan.faults.into_iter().next_back();
                let fault = fault.ok_or_else(|| Failure::infrastructure("a case has no fault"))?;
                return Ok(Ok(fault));
            }
            Err(refused) => refused,
        };
        // Refused without the fault, too: that is a mistake of study or scenario.
        self.checked(self.draws.healthy_flags(case))
            .map_err(|mistake| self.of_alarm(case, mistake))?;
        let reason = match &refused {
            Failure::Usage(text) => text.lines().next().unwrap_or_default(),
            _ => return Err(refused),
        };
        let reason = reason.trim_start_matches("error: ").to_owned();
        Ok(Err((reason, refused)))
    }

    /// Adds the variant and a remedy to the refusal of a case without its fault, if the metric of detection causes it.
    fn of_alarm(&self, case: u64, mistake: Failure) -> Failure {
        let study = self.study();
        let variant = (case % study.variants.len() as u64) as usize;
        let timing = study.timing_flag(variant, false);
        let mut flags = self.draws.healthy_flags(case);
        flags.retain(|flag| Some(flag) != timing.as_ref());
        match (mistake, self.checked(flags)) {
            (Failure::Usage(text), Ok(_)) => Failure::Usage(format!(
                "{text}\nin variant `{}`; a variant whose law lacks a signal of the alarm has `detected = \"none\"` in its [[variants]], one with another alarm that expression",
                study.variants[variant].name
            )),
            (mistake, _) => mistake,
        }
    }

    /// Returns the number of cases of each tried fault.
    fn cases_of_each(&self, table: &FaultTable) -> u64 {
        self.study().cases() / table.tried().len().max(1) as u64
    }

    /// Refuses a fault that an earlier case has in another spelling.
    fn same_fault(&self, table: &FaultTable, earlier: u64, later: u64) -> Failure {
        let of_each = self.cases_of_each(table);
        let tried = table.tried();
        let [earlier, later] = [earlier, later].map(|case| &tried[(case / of_each) as usize]);
        let problem = self.study().problem_of(
            &format!("faults.kinds[{}]", later.place),
            &format!("{later} is the same fault as {earlier}"),
            "each fault once: numbers count by their values, however they are written",
        );
        Problems(vec![problem]).into()
    }

    /// Refuses sizes, onsets and named targets that no case can have.
    fn refuse_without_case(
        &self,
        table: &FaultTable,
        mut refusals: BTreeMap<u64, Failure>,
    ) -> Result<(), Failure> {
        let tried = table.tried();
        let of_each = self.cases_of_each(table);
        let cases = |fault: usize| {
            let first = fault as u64 * of_each;
            first..first + of_each
        };
        let is_possible = |fault: usize| cases(fault).any(|case| !refusals.contains_key(&case));
        let mut without = None;
        for (number, fault) in tried.iter().enumerate() {
            let has_case = |is_same: &dyn Fn(&TriedFault) -> bool| {
                let same = |other: &TriedFault| other.place == fault.place && is_same(other);
                (0..tried.len()).any(|other| same(&tried[other]) && is_possible(other))
            };
            let is_named = self.named_targets[fault.place];
            let is_refused = !has_case(&|other| other.size == fault.size)
                || !has_case(&|other| other.onset_s.to_bits() == fault.onset_s.to_bits())
                || (is_named && !has_case(&|other| other.target == fault.target));
            if is_refused {
                without = cases(number).next();
                break;
            }
        }
        match without.and_then(|case| Some((case, refusals.remove(&case)?))) {
            None => Ok(()),
            Some((case, refused)) => Err(Failure::Usage(format!("{refused}\nin case {case}"))),
        }
    }

    /// Returns the plan of the scenario as the first variant has it, without a tried fault.
    fn healthy(&self) -> Result<Plan, Failure> {
        let study = self.study();
        let mut flags = study.set.clone();
        flags.extend(study.variants[0].set.iter().cloned());
        self.planned(flags)
    }

    fn offered(&self) -> Result<Offered, Failure> {
        let plan = self.healthy()?;
        let binaries = self.binaries_with(&plan.programs)?;
        let (plants, _, kinds) = self.described(binaries.as_deref());
        let plant = plan.plant_among(plants);
        let plant =
            plant.ok_or_else(|| Failure::infrastructure("the plant of the cases is missing"))?;
        let context = RequestContext::of(&plan, &plant, kinds);
        Ok(context.targets())
    }
}

/// Returns the targets of a kind for which the study names none.
fn default_targets(study: &Study, number: usize, all: &[String]) -> Result<Vec<String>, Failure> {
    let targets = all.iter().filter(|one| !one.starts_with(PARAMETERS));
    let targets: Vec<String> = targets.cloned().collect();
    if targets.is_empty() {
        let problem = study.problem_of(
            &format!("faults.kinds[{number}]"),
            "this kind acts on nothing in this scenario unless a parameter is named",
            "name `targets`; `hil inject --list` shows what a kind acts on",
        );
        return Err(Problems(vec![problem]).into());
    }
    Ok(targets)
}

fn unknown_kind(study: &Study, number: usize, offered: &Offered) -> Failure {
    let kind = study
        .faults
        .as_ref()
        .map(|table| &*table.kinds[number].kind);
    let kinds: Vec<&str> = offered.iter().map(|(kind, _)| kind.as_str()).collect();
    let problem = study.problem_of(
        &format!("faults.kinds[{number}]"),
        &format!(
            "plant and link of the scenario offer no fault `{}`",
            kind.unwrap_or_default()
        ),
        &format!("possible: {}", kinds.join(", ")),
    );
    Problems(vec![problem]).into()
}

/// Lists the kinds of faults with the targets that the study does not try.
fn untried(table: &FaultTable, offered: &Offered) -> Vec<Untried> {
    let rest = offered.iter().map(|(kind, targets)| {
        let same_kind = table.kinds.iter().filter(|one| one.kind == *kind);
        let tried: Vec<&String> = same_kind
            .flat_map(|one| one.targets.iter().flatten())
            .collect();
        let rest = targets.iter().filter(|target| !tried.contains(target));
        Untried {
            kind: kind.clone(),
            targets: rest.cloned().collect(),
        }
    });
    rest.filter(|one| !one.targets.is_empty()).collect()
}
