//! The plants, laws and kinds of faults of the shipped programs, as they describe themselves.

use std::sync::OnceLock;

use hil_config::plan::Plan;
use hil_config::problem::Problems;
use hil_config::scenario::Scenario;
use plant_process::faults::kinds;
use shared_types::describe::{FaultKindDescription, LawDescription, PlantDescription};

/// All plants, laws and kinds of faults.
pub struct Rig {
    /// The plants.
    pub plants: Vec<PlantDescription>,
    /// The laws.
    pub laws: Vec<LawDescription>,
    /// The kinds of faults.
    pub kinds: Vec<FaultKindDescription>,
}

/// Returns the rig, which is described only once.
pub fn rig() -> &'static Rig {
    static RIG: OnceLock<Rig> = OnceLock::new();
    RIG.get_or_init(|| Rig {
        plants: (plant_process::models::all().into_iter())
            .map(|plant| plant.description)
            .collect(),
        laws: (controller_process::laws::all().into_iter())
            .map(|law| law.description)
            .collect(),
        kinds: (kinds::all().into_iter())
            .map(|kind| kind.description)
            .collect(),
    })
}

impl Rig {
    /// Plans the text of a scenario with flags. It cannot refer to files next to it.
    ///
    /// # Errors
    /// All problems found.
    pub fn plan(&self, text: &str, flags: &[&str]) -> Result<Plan, Problems> {
        Scenario::parse(text, "/nowhere/fuzzed.toml")?
            .set(flags)
            .check(&self.plants, &self.laws, &self.kinds)
    }
}

/// Returns the plan of the small scenario of the corpus, with a longer duration.
///
/// # Panics
/// If it is wrong.
pub fn small_plan() -> &'static Plan {
    static PLAN: OnceLock<Plan> = OnceLock::new();
    PLAN.get_or_init(|| {
        let text = include_str!("../../corpus/scenario/small.toml");
        let plan = rig().plan(text, &["run.duration_s=10"]);
        plan.unwrap_or_else(|problems| panic!("{problems}"))
    })
}
