//! From the text of a scenario to its meaning.
//!
//! [`Scenario::check`](crate::scenario::Scenario::check) is the entry point. Each part of a scenario has its own file
//! below; a faulty part is reported and omitted, and the others are checked as far as possible without it. The order
//! follows the data: run, plant, law, stimuli, binding, expressions, faults. Faults and changes requested during a run
//! are [checked](RequestContext) by the same code.

mod analyses;
mod belonging;
mod binding;
mod bus;
mod changes;
mod connect;
mod controller;
mod csv;
mod data_sheet;
mod faults;
mod files;
mod inputs;
mod instruments;
mod model_settings;
mod panel;
mod parameters;
mod plant;
mod plots;
mod points;
mod port;
mod programs;
mod realtime;
mod requirements;
mod run;
mod signals;
mod stimuli;
mod tables;
mod waveforms;

use std::path::Path;

use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription, Settings};
use shared_types::table::Field;
use shared_types::time::Rate;

use crate::expression::{Columns, Expression, Group};
use crate::keys;
use crate::plan::{
    BusPlan, ControllerPlan, Definition, FaultEvent, Plan, Programs, Stimulus, driven,
};
use crate::problem::{ProblemKind, Problems};
use crate::reader::{Reader, Section};
use crate::scenario::{Scenario, root};
use crate::title::{TITLE, is_title};
use changes::ChangeContext;
use faults::{EventContext, Origin};
use inputs::Advice;
use run::Grid;

pub(crate) use faults::{groups, unit_of};

/// Run for which faults and changes of values are requested.
#[derive(Clone, Debug)]
pub struct RequestContext {
    /// Plant, without the commands that the scenario drives.
    pub plant: PlantDescription,
    /// Fault kinds on signals, links and timing.
    pub kinds: Vec<FaultKindDescription>,
    /// The plant's healthy parameters.
    pub parameters: Settings,
    /// Reference signals, and inputs of the plant with a course.
    pub stimuli: Vec<Stimulus>,
    /// Constant inputs of the plant.
    pub constants: Settings,
    /// Recorded inputs of sensors and of actuators.
    pub taps: [Vec<Field>; 2],
    /// The scenario's derived signals by name and definition.
    pub derived: Vec<(String, Definition)>,
    /// Number of networks of the bus; 1 without one.
    pub networks: u8,
    /// Steps per second.
    pub rate: Rate,
    /// Number of steps of the whole run.
    pub steps: u64,
    /// Names and numbers of the existing events: those of the scenario and live ones.
    pub names: Vec<(String, u32)>,
    /// Number of the first new event; all lower numbers are in use.
    pub first_id: u32,
}

impl RequestContext {
    /// Creates the context of a plan and its faults; `plant` lacks the commands that the scenario drives.
    #[must_use]
    pub fn of(plan: &Plan, plant: &PlantDescription, kinds: &[FaultKindDescription]) -> Self {
        let mut context = Self {
            plant: plant.clone(),
            kinds: kinds.to_vec(),
            parameters: plan.plant.parameters.clone(),
            stimuli: plan.stimuli.clone(),
            constants: plan.plant.inputs.clone(),
            taps: plan.tap_fields(plant),
            derived: plan.definitions(),
            networks: plan.bus.as_ref().map_or(1, |bus| bus.networks),
            rate: plan.run.rate,
            steps: plan.run.steps,
            names: Vec::new(),
            first_id: 1,
        };
        context.note(&plan.faults);
        context
    }

    /// Registers the names and numbers of these events.
    pub fn note(&mut self, events: &[FaultEvent]) {
        for event in events {
            (self.names).extend(event.name.iter().map(|name| (name.clone(), event.id)));
            self.first_id = self.first_id.max(event.id + 1);
        }
    }

    /// Lists every kind of fault with the targets on which it can act: names, keys of parts of the plant such as
    /// `actuator = 1`, or an empty text for the plant itself. Kinds without a target are left out.
    #[must_use]
    pub fn targets(&self) -> Vec<(String, Vec<String>)> {
        let reference: Vec<Field> = self.stimuli.iter().flat_map(Stimulus::fields).collect();
        let inputs = driven(&self.stimuli);
        let context = EventContext {
            plant: Some(&self.plant),
            kinds: &self.kinds,
            healthy: None,
            reference: Some(&reference),
            inputs: Some(&inputs),
            advice: Advice {
                stimuli: &self.stimuli,
                constants: &self.constants,
            },
            networks: self.networks,
            columns: None,
            grid: None,
            origin: Origin::Live {
                names: &self.names,
                first_id: self.first_id,
            },
        };
        faults::targets(&context)
    }

    const fn grid(&self) -> Grid {
        Grid {
            rate: self.rate,
            steps: self.steps,
        }
    }

    /// Checks `[[faults]]` against the run, whose law has these internal signals.
    ///
    /// An event without a trigger takes effect [at once](crate::plan::Trigger::Now).
    ///
    /// # Errors
    /// All problems found.
    pub fn check(&self, toml: &str, internals: &[Field]) -> Result<Vec<FaultEvent>, Problems> {
        let scenario = Scenario::parse(toml, "request")?;
        let mut reader = Reader::new(scenario.sources.clone(), Vec::new());
        let root = root(&scenario).with_keys(keys::REQUEST);
        let reference: Vec<Field> = self.stimuli.iter().flat_map(Stimulus::fields).collect();
        let mut columns = Columns::of(&self.plant, &self.stimuli, internals);
        columns.push_taps(self.taps.each_ref());
        for (name, definition) in &self.derived {
            let expression = match definition {
                Definition::Expression(text) => Expression::parse(text).ok(),
                Definition::Table(_) => None,
            };
            let typed = expression.as_ref().map(|expression| (expression, &columns));
            let unit = signals::implied_unit(typed, name).unwrap_or_default();
            columns.push_with_unit(Group::Derived, name, &unit);
        }
        let context = EventContext {
            plant: Some(&self.plant),
            kinds: &self.kinds,
            healthy: Some(&self.parameters),
            reference: Some(&reference),
            inputs: Some(&driven(&self.stimuli)),
            advice: Advice {
                stimuli: &self.stimuli,
                constants: &self.constants,
            },
            networks: self.networks,
            columns: Some(&columns),
            grid: Some(self.grid()),
            origin: Origin::Live {
                names: &self.names,
                first_id: self.first_id,
            },
        };
        reader.refuse_unknown(&root, &[]);
        let events = faults::check(&mut reader, &root, &context);
        if events.is_empty() && reader.problems.is_empty() {
            reader.missing(&root, "faults", "at least one fault event".into());
        }
        reader.finish(Some(events))
    }
}

impl Scenario {
    /// Returns the programs named by the scenario, before their descriptions are known; faulty names are reported by
    /// the [check](Self::check).
    #[must_use]
    pub fn programs(&self) -> Programs {
        let mut reader = Reader::new(self.sources.clone(), Vec::new());
        programs::check(&mut reader, &root(self), folder(self))
    }

    /// Checks the scenario against the available plants, laws and fault kinds.
    ///
    /// # Errors
    /// All problems found.
    pub fn check(
        &self,
        plants: &[PlantDescription],
        laws: &[LawDescription],
        kinds: &[FaultKindDescription],
    ) -> Result<Plan, Problems> {
        let mut reader = Reader::new(self.sources.clone(), self.problems.clone());
        reader.formats = self.formats;
        check(self, reader, plants, laws, kinds)
    }
}

fn check(
    scenario: &Scenario,
    mut reader: Reader,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Result<Plan, Problems> {
    let root = root(scenario);
    let plan = if root.table.get("schema").is_some() && reader.integer(&root, "schema").is_none() {
        // Every key may have another meaning there; further messages would only mislead.
        None
    } else {
        parts(&mut reader, &root, scenario, plants, laws, kinds)
    };
    reader.finish(plan)
}

fn parts(
    reader: &mut Reader,
    root: &Section<'_>,
    scenario: &Scenario,
    plants: &[PlantDescription],
    laws: &[LawDescription],
    kinds: &[FaultKindDescription],
) -> Option<Plan> {
    reader.integer(root, "schema");
    reader.refuse_unknown(root, &[]);
    let name = name(reader, root, scenario);
    let description = reader.text(root, "description").unwrap_or_default();

    let (grid, run) = run::check(reader, root);
    let realtime = realtime::check(reader, root);
    let plant_section = reader.section(root, "plant");
    let whole_plant = plant_section
        .as_ref()
        .and_then(|section| plant::find(reader, section, plants, &scenario.advice.plant));
    let inputs = inputs::check(reader, root, plant_section.as_ref(), whole_plant);
    // The plant as the law commands it: everything else sees it without the inputs that the scenario drives.
    let commanded = whole_plant.map(|plant| inputs.commanded(plant));
    let plant = commanded.as_ref();
    let plant_plan = plant_section
        .as_ref()
        .and_then(|section| plant::check(reader, section, plant, &inputs.constants));
    if let Some(plant) = plant {
        port::check(reader, root, plant);
    }

    let controller_section = reader.section(root, "controller");
    // Plant that selects among laws of the same name.
    let made_for = controller_section
        .as_ref()
        .and_then(|section| reader.text(section, "made_for"));
    let home = made_for.or(plant.map(|plant| plant.name.as_str()));
    let law = controller_section
        .as_ref()
        // An unreadable name selects none.
        .filter(|section| made_for.is_some() || section.table.get("made_for").is_none())
        .and_then(|section| controller::find(reader, section, laws, home, &scenario.advice.law));
    let folder = folder(scenario);
    let programs = programs::check(reader, root, folder);
    let stimuli = stimuli::check(reader, root, folder, grid, (law, whole_plant));
    let controller_plan = controller_section.as_ref().and_then(|section| {
        let nominal = plant_plan.as_ref().map(|plan| &plan.parameters);
        controller::check(reader, section, laws, (law, home), plant, nominal, grid)
    });
    let plants = { plant.zip(whole_plant) }
        .map(|(commanded, whole)| instruments::Plants { commanded, whole });
    let instruments = instruments::check(reader, root, plants, grid);
    let reference: Option<Vec<Field>> =
        (stimuli.as_deref()).map(|stimuli| stimuli.iter().flat_map(Stimulus::fields).collect());
    let driven_inputs = stimuli.as_deref().map(driven);
    let connect = reader.list(root, "connect");
    let (mut connections, mut connected) = (None, None);
    if let (Some(section), Some(law), Some(plant), Some(whole)) =
        (&controller_section, law, plant, whole_plant)
    {
        let ends = connect::Ends {
            law,
            laws,
            plant,
            driven: (whole, &inputs),
            reference: reference.as_deref(),
        };
        connections = connect::check(reader, &connect, &ends).map(|mut all| {
            let reference = reference.as_deref().unwrap_or_default();
            let added = binding::by_aliases(reader, section, law, plant, reference, &all);
            all.extend(added);
            all
        });
        connected = (connections.as_ref()).and_then(|all| law.connected(all).ok());
        if let Some(law) = &connected {
            let has_inputs =
                { plant_section.iter() }.any(|section| section.table.get("inputs").is_some());
            binding::check(reader, section, law, plant, stimuli.as_deref(), has_inputs);
            inputs.refuse_commanded(reader, law, whole);
        }
    }

    let mut columns = match (plant, law, &stimuli) {
        (Some(plant), Some(law), Some(stimuli)) => {
            Some(Columns::of(plant, stimuli, &law.internals))
        }
        _ => None,
    };
    if let (Some(columns), Some(plant), Some((sensors, actuators)), Some(grid)) =
        (&mut columns, plant, &instruments, grid)
    {
        let both = [&sensors[..], &actuators[..]];
        instruments::refuse_indistinguishable(reader, root, plant, both, grid.rate);
        columns.push_possible_taps(plant, both, grid.rate);
    }
    let ends = bus::Ends {
        plant,
        law: connected.as_ref(),
        reference: reference.as_deref(),
        grid,
    };
    let bus = bus::check(reader, root, folder, &ends);
    let networks = bus.as_ref().map_or(BusPlan::MOST_NETWORKS, |bus| {
        bus.as_ref().map_or(1, |bus| bus.networks)
    });
    let (derived, metrics, analysed) = signals::check(reader, root, &mut columns, grid, folder);
    let requirements = requirements::check(reader, root, columns.as_ref(), &derived, grid);
    let context = EventContext {
        plant,
        kinds,
        healthy: plant_plan.as_ref().map(|plan| &plan.parameters),
        reference: reference.as_deref(),
        inputs: driven_inputs.as_deref(),
        advice: Advice {
            stimuli: stimuli.as_deref().unwrap_or_default(),
            constants: &inputs.constants,
        },
        networks,
        columns: columns.as_ref(),
        grid,
        origin: Origin::Scenario { folder },
    };
    let changed = ChangeContext {
        plant,
        law: law.map(|law| (law.name.as_str(), &law.parameters[..])),
        stimuli: stimuli.as_deref(),
        constants: &inputs.constants,
        grid,
    };
    let changes = changes::check(reader, root, &changed);
    let problems = reader.problems.len();
    let faults = faults::check(reader, root, &context);
    let context = analyses::AnalysisContext {
        columns: columns.as_ref(),
        grid,
        stimuli: stimuli.as_deref(),
        faults: (reader.problems.len() == problems).then_some(&faults),
    };
    let analyses = analyses::check(reader, &analysed, &context);
    let name_of_law = law.map(|law| law.name.as_str());
    let plots = {
        let responses = analysed.iter();
        let responses = responses.filter(|one| one.kind == "frequency-response");
        let context = plots::PlotContext {
            columns: columns.as_ref(),
            law: name_of_law,
            laws,
            responses: responses.map(|one| one.name).collect(),
        };
        context.check(reader, root)
    };
    let further_plots = reader.boolean(root, "further_plots");
    let panel = panel::check(reader, root, columns.as_ref(), &changed);
    let owners = belonging::Owners {
        plant,
        law,
        stimuli: stimuli.as_deref().unwrap_or_default(),
        kinds,
    };
    belonging::advise(reader, root.table, &owners);
    let (sensors, actuators) = instruments?;
    let mut plan = Plan {
        name,
        description: description.into(),
        run: run?,
        realtime: realtime?,
        plant: plant_plan?,
        controller: ControllerPlan {
            connections: connections?,
            ..controller_plan?
        },
        stimuli: stimuli?,
        sensors,
        actuators,
        bus: bus?,
        faults,
        changes,
        derived,
        metrics,
        analyses,
        requirements,
        plots,
        further_plots: further_plots?,
        panel,
        programs,
        probes: Vec::new(),
    };
    plan.tap_named(plant?);
    Some(plan)
}

/// Returns the folder to which paths in a scenario are relative.
fn folder(scenario: &Scenario) -> &Path {
    let own = scenario.path.parent().unwrap_or(Path::new(""));
    scenario.home.as_deref().unwrap_or(own)
}

/// Returns the scenario's name, which becomes part of folder names.
fn name(reader: &mut Reader, root: &Section<'_>, scenario: &Scenario) -> String {
    let stem = scenario
        .path
        .file_stem()
        .map(|stem| stem.to_string_lossy().into_owned())
        .unwrap_or_default();
    let text = reader.text(root, "name");
    let name = text.map_or(stem, Into::into);
    if !is_title(&name) {
        let message = match text {
            Some(_) => format!("`name` is `{name}`"),
            None => {
                format!("`name` is missing, and the file's name `{name}` cannot replace it")
            }
        };
        reader
            .report_at(root, "name", ProblemKind::OutOfRange, message)
            .expected(TITLE);
    }
    name
}
