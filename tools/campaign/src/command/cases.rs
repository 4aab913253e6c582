//! The cases of a study: the plan of each case, and the row that results from running it.

mod faults;
mod own;
mod rows;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use crate::draws::Draws;
use crate::folder::Folder;
use hil_config::plan::{Plan, Programs, Realtime};
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;
use hil_config::study::{Item, Spread, Study};
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::Binaries;
use hil_facts::programs::binaries::host::ModelKind;
use hil_facts::results::curve::Grid;
use hil_facts::tables::FORMATS;
use hil_run::alone;
use hil_run::kept::Kept;
use hil_session::asking;
use shared_types::describe::{Description, FaultKindDescription, LawDescription, PlantDescription};
use shared_types::lockstep::OnLoss;
use shared_types::record::RecordLayout;

use super::result::CaseResult;
use own::{ExternalPrograms, choices, keys_of_fmus};

/// Cases that can be planned and run.
pub(super) struct Cases {
    pub(super) draws: Draws,
    scenario: Scenario,
    rig: Rig,
    /// Copies of point tables, by the names that the scenario and the study use.
    tables: BTreeMap<String, String>,
    /// Scenario keys that refer to such tables, with the names.
    files: Vec<(String, String)>,
    /// Grid of the curves, if they are recorded.
    grid: Option<Arc<Grid>>,
    /// For each kind of fault that the study tries, `true` if the study names its targets.
    named_targets: Vec<bool>,
}

/// Plant and controller of the cases.
enum Rig {
    /// Plants and laws that are built into `hil`.
    BuiltIn(Box<[Description; 2]>),
    /// External programs.
    External(Box<ExternalPrograms>),
}

/// Descriptions against which scenarios are checked.
type Descriptions<'a> = (
    &'a [PlantDescription],
    &'a [LawDescription],
    &'a [FaultKindDescription],
);

impl Cases {
    /// Combines a study with the scenario and the programs to which it refers.
    ///
    /// # Errors
    /// If the study, the scenario or a program is invalid.
    pub(super) fn of_study(
        study: Study,
        binaries: &BinaryArguments,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        refuse_programs(&study)?;
        Self::of_scenario(study.read_scenario()?, study, binaries, interruption)
    }

    /// Combines a study with a scenario in place of its own.
    ///
    /// # Errors
    /// See [`of_study`](Self::of_study).
    pub(super) fn of_scenario(
        scenario: Scenario,
        study: Study,
        binaries: &BinaryArguments,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        asking::allow_seconds(study.wait_limit_s);
        let scenario = scenario.with_formats(FORMATS);
        let draws = Draws::new(study)?;
        let named = scenario.programs();
        let rig = match choices(&scenario, binaries, &named, named.clone())?.names_one() {
            true => {
                let first = scenario.clone().set(&draws.flags(0));
                let of_first = first.programs();
                let binaries = binaries.clone();
                Rig::External(Box::new(ExternalPrograms::new(
                    &first,
                    of_first,
                    binaries,
                    named,
                    interruption,
                )?))
            }
            false => Rig::BuiltIn(Box::new(alone::built_in())),
        };
        Self::new(draws, scenario, rig, BTreeMap::new()).with_targets()
    }

    /// Loads the cases of a campaign from the copies in its folder.
    ///
    /// # Errors
    /// If a copy has changed.
    pub(super) fn of_folder(folder: &Folder, interruption: &Interruption) -> Result<Self, Failure> {
        let study = folder.path().join(&folder.manifest().study.path);
        Self::by_folder(Study::read(study)?, folder, interruption)
    }

    /// Creates the cases of a study with the scenario, programs and tables of a campaign folder.
    ///
    /// # Errors
    /// If a copy has changed.
    pub(super) fn by_folder(
        study: Study,
        folder: &Folder,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        asking::allow_seconds(study.wait_limit_s);
        let (manifest, path) = (folder.manifest(), folder.path());
        let scenario = Scenario::read(path.join(&manifest.scenario.path))?.with_formats(FORMATS);
        let copies = manifest.tables.iter();
        let tables = copies.map(|(name, copy)| (name.clone(), copy.path.clone()));
        let tables: BTreeMap<String, String> = tables.collect();
        let draws = Draws::new(study)?;
        let rig = match (&manifest.plant, &manifest.controller) {
            (Some(plant), Some(controller)) => {
                let arguments = BinaryArguments {
                    plant_bin: Some(path.join(&plant.path)),
                    controller_bin: Some(path.join(&controller.path)),
                };
                // The program files are replaced by the copies, but their settings are kept.
                let first = scenario.clone().set(&draws.flags(0));
                let of_first = own::with_copies(&first, first.programs(), &tables);
                let named = Programs::default();
                Rig::External(Box::new(ExternalPrograms::new(
                    &first,
                    of_first,
                    arguments,
                    named,
                    interruption,
                )?))
            }
            _ => Rig::BuiltIn(Box::new(alone::built_in())),
        };
        let grid = manifest.curves.clone().map(Arc::new);
        Ok(Self {
            grid,
            ..Self::new(draws, scenario, rig, tables)
        })
    }

    fn new(draws: Draws, scenario: Scenario, rig: Rig, tables: BTreeMap<String, String>) -> Self {
        let files = scenario.files();
        let table = draws.study().faults.as_ref();
        let kinds = table.into_iter().flat_map(|table| &table.kinds);
        Self {
            named_targets: kinds.map(|one| one.targets.is_some()).collect(),
            draws,
            scenario,
            rig,
            tables,
            files,
            grid: None,
        }
    }

    /// Returns the study.
    pub(super) const fn study(&self) -> &Study {
        self.draws.study()
    }

    /// Returns the text of the scenario.
    pub(super) const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// Returns the external programs, if any, as described for the first case.
    pub(super) fn binaries(&self) -> Option<&Binaries> {
        match &self.rig {
            Rig::BuiltIn(_) => None,
            Rig::External(own) => Some(&own.first),
        }
    }

    /// Returns the port file of the controller, if it is behind a port.
    ///
    /// # Errors
    /// If the far end keeps a clock of its own: equal cases would have other results, and no case could be repeated.
    pub(super) fn port(&self) -> Result<Option<&Path>, Failure> {
        let controller = self.binaries().map(|both| &both.controller);
        let host = controller.and_then(|one| Some((one, one.host.as_ref()?)));
        match host.filter(|(_, host)| host.kind == ModelKind::Port) {
            None => Ok(None),
            Some((controller, host)) if host.is_repeatable => Ok(Some(&controller.path)),
            Some(_) => Err(Failure::usage(
                "a campaign needs cases that can be repeated, and the far end of this port keeps a clock of its own (`exchange = \"free\"` or `repeatable = false`); use `hil run --set`, one run after another",
            )),
        }
    }

    /// Returns the external programs, if any, with the permissions and settings of a case.
    ///
    /// # Errors
    /// If a program rejects the settings.
    pub(super) fn binaries_with(
        &self,
        programs: &Programs,
    ) -> Result<Option<Arc<Binaries>>, Failure> {
        match &self.rig {
            Rig::BuiltIn(_) => Ok(None),
            Rig::External(own) => own.with(&self.scenario, programs).map(Some),
        }
    }

    fn described<'a>(&'a self, own: Option<&'a Binaries>) -> Descriptions<'a> {
        match (&self.rig, own) {
            (Rig::BuiltIn(both), _) => {
                let [plant, controller] = &**both;
                (&plant.plants, &controller.laws, &plant.faults)
            }
            (Rig::External(known), own) => own.unwrap_or(&known.first).described(),
        }
    }

    /// Lists the point tables to which the scenario and the study refer.
    pub(super) fn named_tables(&self) -> Vec<String> {
        let study = self.study();
        let variants = study.variants.iter().flat_map(|variant| &variant.set);
        let set = study.set.iter().chain(variants).filter_map(|flag| {
            let (key, value) = flag.split_once('=')?;
            names_file(key).then(|| unquoted(value))
        });
        let varied = study
            .varied
            .iter()
            .filter(|one| one.key.as_deref().is_some_and(names_file));
        let items = varied.flat_map(|one| match &one.spread {
            Spread::Choice(items) => items.iter().collect(),
            _ => Vec::new(),
        });
        let items = items.filter_map(|item| match item {
            Item::Text(name) => Some(name.clone()),
            _ => None,
        });
        let mut all: Vec<String> = self.files.iter().map(|(_, name)| name.clone()).collect();
        all.extend(set.chain(items));
        all.extend(own::relative_files(
            &self.scenario,
            &self.scenario.programs(),
        ));
        all.sort();
        all.dedup();
        all
    }

    /// Returns the flags of a case with tables replaced by their copies.
    fn flags(&self, flags: Vec<String>) -> Vec<String> {
        let copy = |name: &str| self.tables.get(name).map(|path| toml_string(path));
        let mut all: Vec<String> = flags
            .into_iter()
            .map(|flag| match flag.split_once('=') {
                Some((key, value)) if names_file(key) => {
                    let copied = copy(&unquoted(value));
                    copied.map_or(flag.clone(), |path| format!("{key}={path}"))
                }
                _ => flag,
            })
            .collect();
        for (key, name) in &self.files {
            if let Some(path) = copy(name)
                && !all
                    .iter()
                    .any(|flag| flag.split_once('=').is_some_and(|(set, _)| set == key))
            {
                all.push(format!("{key}={path}"));
            }
        }
        all
    }

    /// Builds the plan of a case.
    ///
    /// # Errors
    /// All errors of the case, located at the entries of the study that cause them.
    pub(super) fn plan(&self, case: u64) -> Result<Plan, Failure> {
        self.planned(self.draws.flags(case))
    }

    /// Builds the plan of a case with the given flags.
    ///
    /// # Errors
    /// See [`plan`](Self::plan).
    pub(super) fn planned(&self, flags: Vec<String>) -> Result<Plan, Failure> {
        let at_home = |problem| self.study().at_home(problem);
        let plan = self.read(flags)?;
        Ok(plan.map_err(|all| Problems(all.0.into_iter().map(at_home).collect()))?)
    }

    /// Builds the plan with the given flags, or returns the problems of the scenario with them.
    ///
    /// # Errors
    /// If a program rejects its settings.
    pub(super) fn read(&self, flags: Vec<String>) -> Result<Result<Plan, Problems>, Failure> {
        let scenario = self.scenario.clone().set(&self.flags(flags));
        let programs = own::with_copies(&scenario, scenario.programs(), &self.tables);
        let binaries = self.binaries_with(&programs)?;
        if let (None, Some(key)) = (&binaries, keys_of_fmus(&programs).next()) {
            return Err(Failure::usage(format!(
                "the plants and laws inside hil are not FMUs, so `{key}` has no effect"
            )));
        }
        let (plants, laws, kinds) = self.described(binaries.as_deref());
        let plan = scenario.check(plants, laws, kinds);
        Ok(plan.map(|plan| match binaries {
            Some(binaries) => Plan {
                programs: binaries.programs(),
                ..plan
            },
            None => plan,
        }))
    }

    /// Builds the plan of a case and has plant and law validate it, as far as that starts no process.
    ///
    /// # Errors
    /// See [`plan`](Self::plan); also an objection of the plant or the law.
    pub(super) fn check(&self, case: u64) -> Result<Plan, Failure> {
        self.checked(self.draws.flags(case))
    }

    /// Builds the plan of a case with the given flags and validates it as [`check`](Self::check) does.
    ///
    /// # Errors
    /// See [`check`](Self::check).
    pub(super) fn checked(&self, flags: Vec<String>) -> Result<Plan, Failure> {
        let plan = self.planned(flags)?;
        if let Rig::External(own) = &self.rig
            && (plan.whole_plant_among(own.first.described().0))
                .is_some_and(|plant| plant.port.is_some())
        {
            return Err(Failure::usage(
                "the plant is behind a port: there is one of it, and it does not repeat; use `hil run`",
            ));
        }
        alone::refuse_clock(&plan)?;
        if let Rig::BuiltIn(described) = &self.rig {
            alone::check(&plan, described)?;
        }
        Ok(plan)
    }

    /// Returns the layout of the records of a plan.
    ///
    /// # Errors
    /// If the plan does not belong to these cases.
    pub(super) fn record_layout(&self, plan: &Plan) -> Result<RecordLayout, Failure> {
        let binaries = self.binaries_with(&plan.programs)?;
        let (plants, laws, _) = self.described(binaries.as_deref());
        let both = plan.plant_among(plants).zip(plan.law_among(laws));
        both.map(|(plant, law)| plan.record_layout(&plant, &law))
            .ok_or_else(|| Failure::infrastructure("the plant or law of a case is missing"))
    }

    /// Formats a plan as a complete scenario.
    ///
    /// # Errors
    /// If the plan does not belong to these cases.
    pub(super) fn scenario_text(&self, plan: &Plan) -> Result<String, Failure> {
        let binaries = self.binaries_with(&plan.programs)?;
        let (plants, laws, kinds) = self.described(binaries.as_deref());
        hil_config::show::show(plan, plants, laws, kinds).map_err(Failure::usage)
    }

    /// Runs a plan. External programs run in persistent processes, unless the study requests fresh ones or the scenario
    /// replaces a lost controller, which starts new processes anyway.
    ///
    /// # Errors
    /// If the run did not end by itself, so that it has no result.
    pub(super) fn run(
        &self,
        plan: &Plan,
        processes: &mut Kept,
        interruption: &Interruption,
    ) -> Result<CaseResult, Failure> {
        match &self.rig {
            Rig::External(own) if self.keeps_processes(plan) => {
                let began = Instant::now();
                let (ended, is_to_check) =
                    processes.run(plan, &own.first, self.grid.clone(), interruption)?;
                let mut result = CaseResult::of_ended(ended, began)?;
                result.is_to_check = is_to_check;
                Ok(result)
            }
            _ => self.run_fresh(plan, interruption),
        }
    }

    /// Returns `true` if a case may run in persistent processes, which must not retain settings of the case.
    pub(super) fn keeps_processes(&self, plan: &Plan) -> bool {
        let is_first = match &self.rig {
            Rig::BuiltIn(_) => false,
            Rig::External(own) => plan.programs == own.first.programs(),
        };
        // A port that is kept would hold the wire that its successor needs.
        let has_port = self.binaries().is_some_and(|both| {
            let host = both.controller.host.as_ref();
            host.is_some_and(|host| host.kind == ModelKind::Port)
        });
        let of_processes = Realtime {
            wait: plan.realtime.wait,
            ..Realtime::default()
        };
        is_first
            && !has_port
            && !self.study().fresh_processes
            && plan.run.on_controller_loss == OnLoss::Abort
            && plan.realtime == of_processes
    }

    /// Runs a plan in new processes, or inside this one.
    ///
    /// # Errors
    /// See [`run`](Self::run).
    pub(super) fn run_fresh(
        &self,
        plan: &Plan,
        interruption: &Interruption,
    ) -> Result<CaseResult, Failure> {
        let began = Instant::now();
        match &self.rig {
            Rig::BuiltIn(described) => CaseResult::of_ended(
                alone::run(plan, described, self.grid.clone(), interruption)?,
                began,
            ),
            Rig::External(own) => {
                let binaries = own.with(&self.scenario, &plan.programs)?;
                let with = (self.study().wait_limit_s, self.grid.clone());
                CaseResult::in_processes(plan, &binaries, with, interruption, began)
            }
        }
    }
}

/// Refuses studies that set programs, because all cases of a campaign share them.
fn refuse_programs(study: &Study) -> Result<(), Failure> {
    let variants = study.variants.iter().flat_map(|variant| &variant.set);
    let set = study.set.iter().chain(variants);
    let set = set
        .filter_map(|flag| flag.split_once('='))
        .map(|(key, _)| key);
    let varied = study.varied.iter().filter_map(|one| one.key.as_deref());
    let names =
        |key: &&str| key.starts_with("plant.program") || key.starts_with("controller.program");
    match set.chain(varied).find(names) {
        None => Ok(()),
        Some(key) => Err(Failure::usage(format!(
            "{key} cannot be set in a study, because all cases share the same programs; set it in the scenario, or with --plant-bin and --controller-bin, and compare two campaigns with hil campaign compare"
        ))),
    }
}

/// Returns `true` if a key names a table of points or a file of an FMU.
fn names_file(key: &str) -> bool {
    let of_fmu = ["plant.files.", "controller.files."];
    key.rsplit('.').next() == Some("file") || of_fmu.iter().any(|table| key.starts_with(table))
}

/// Removes the quotes of a TOML string; text without quotes is returned unchanged.
fn unquoted(value: &str) -> String {
    let parsed: Result<toml_edit::Value, _> = value.trim().parse();
    let text = parsed
        .ok()
        .and_then(|value| value.as_str().map(str::to_owned));
    text.unwrap_or_else(|| value.trim().into())
}

fn toml_string(text: &str) -> String {
    toml_edit::Value::from(text).to_string()
}

/// Refuses a path that is not valid UTF-8 and thus cannot be stored as text.
pub(super) fn text_of(path: &Path) -> Result<&str, Failure> {
    let path_text = path.display();
    path.to_str().ok_or_else(|| {
        Failure::usage(format!(
            "{path_text}: the path is stored as text, so it must be valid UTF-8"
        ))
    })
}
