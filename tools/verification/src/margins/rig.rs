//! Programs of a measurement: plants and laws built into `hil` run in this thread, any other programs in a pair of
//! processes that is kept from run to run.

use std::cell::RefCell;
use std::sync::Arc;

use hil_config::plan::{Plan, Realtime};
use hil_config::scenario::Scenario;
use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;
use hil_facts::arguments::BinaryArguments;
use hil_facts::programs::binaries::named::Named;
use hil_facts::programs::binaries::{Binaries, Choices};
use hil_run::alone;
use hil_run::kept::Kept;
use shared_types::describe::{Description, FaultKindDescription, LawDescription, PlantDescription};
use shared_types::lockstep::OnLoss;
use shared_types::record::{RecordLayout, RunEnd};
use shared_types::stream::RecordSink;

/// Time in s that a side of a run may take to answer.
const WAIT_LIMIT_S: f64 = 5.0;

/// Programs that run a scenario.
pub(super) enum Rig {
    /// Plants and laws built into `hil`.
    BuiltIn(Box<[Description; 2]>),
    /// Programs in processes.
    External(Arc<Binaries>, Box<RefCell<Kept>>),
}

impl Rig {
    /// Selects the programs that the arguments, the environment or the scenario name, if any.
    ///
    /// # Errors
    /// If a named program must not be run, is missing or does not speak the protocol.
    pub(super) fn of(
        arguments: &BinaryArguments,
        scenario: &Scenario,
        interruption: &Interruption,
    ) -> Result<Self, Failure> {
        let choices = Choices::of(arguments, &Named::by(scenario), None)?;
        Ok(match choices.names_one() {
            true => Self::External(
                choices.find(interruption)?,
                Box::new(RefCell::new(Kept::new(WAIT_LIMIT_S))),
            ),
            false => Self::BuiltIn(Box::new(alone::built_in())),
        })
    }

    /// Returns the descriptions against which a scenario is checked: plants, laws and fault kinds.
    pub(super) fn described(
        &self,
    ) -> (
        &[PlantDescription],
        &[LawDescription],
        &[FaultKindDescription],
    ) {
        match self {
            Self::BuiltIn(both) => (&both[0].plants, &both[1].laws, &both[0].faults),
            Self::External(binaries, _) => binaries.described(),
        }
    }

    /// Executes a plan; its records go to the sink that `sink` creates for their layout.
    ///
    /// # Errors
    /// If a side refuses its job or died, or the run was interrupted.
    pub(super) fn observe<S: RecordSink>(
        &self,
        plan: &Plan,
        sink: impl Fn(&RecordLayout) -> S,
        interruption: &Interruption,
    ) -> Result<(RunEnd, S), Failure> {
        match self {
            Self::BuiltIn(described) => alone::observe(plan, described, sink, interruption),
            Self::External(binaries, processes) => {
                let mut plan = plan.clone();
                plan.run.on_controller_loss = OnLoss::Abort;
                plan.realtime = Realtime {
                    wait: plan.realtime.wait,
                    ..Realtime::default()
                };
                (processes.borrow_mut()).observe(&plan, binaries, sink, interruption)
            }
        }
    }
}
