//! Choice of both programs, by arguments or a file, before they are asked for their descriptions.

use std::path::PathBuf;
use std::sync::Arc;

use hil_console::terminal::exit::Failure;
use hil_console::terminal::interruption::Interruption;

use super::beside_desk::BesideDesk;
use super::named::{CONTROLLER, Choice, Named, NamedBy, PLANT};
use super::reached::Reached;
use super::{Binaries, Binary};
use crate::arguments::BinaryArguments;

/// Binaries of a run, before they are asked for their descriptions.
#[derive(Clone, Debug, PartialEq)]
pub struct Choices {
    plant: Choice,
    controller: Choice,
    at: Option<Reached>,
    /// Controller that would run at this desk, if the controller runs on a target.
    at_desk: Option<Choice>,
}

impl Choices {
    /// Selects the binaries named by the arguments or a file.
    ///
    /// # Errors
    /// If a program named by a file must not be run.
    pub fn of(
        arguments: &BinaryArguments,
        named: &Named<'_>,
        at: Option<&Reached>,
    ) -> Result<Self, Failure> {
        Ok(Self {
            plant: named.choice(&PLANT, arguments.plant_bin.as_deref(), None)?,
            controller: named.choice(&CONTROLLER, arguments.controller_bin.as_deref(), at)?,
            at: at.cloned(),
            // A desk program that must not be run is not compared.
            at_desk: at.and_then(|_| named.choice(&CONTROLLER, None, None).ok()),
        })
    }

    /// Uses copies of both programs instead of those beside `hil`.
    pub fn copies([plant, controller]: [PathBuf; 2]) -> Self {
        let copy = |path| Choice::new(path, NamedBy::Nobody);
        Self {
            plant: copy(plant),
            controller: copy(controller),
            at: None,
            at_desk: None,
        }
    }

    /// Returns `true` if one of the programs was named in any way.
    pub fn names_one(&self) -> bool {
        [&self.plant, &self.controller]
            .iter()
            .any(|choice| choice.by != NamedBy::Nobody)
    }

    /// Asks both programs for their descriptions.
    ///
    /// # Errors
    /// If a program is missing, cannot be executed or does not speak the protocol.
    pub fn find(&self, interruption: &Interruption) -> Result<Arc<Binaries>, Failure> {
        let at = self.at.as_ref();
        let mut controller = Binary::of_controller(&self.controller, at, interruption)?;
        controller.beside_desk = self
            .at_desk
            .as_ref()
            .and_then(|desk| BesideDesk::of(&controller, desk, interruption));
        Ok(Arc::new(Binaries {
            plant: Binary::of_plant(&self.plant, interruption)?,
            controller,
        }))
    }
}
