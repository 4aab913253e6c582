//! A plant behind a port: what a scenario cannot ask of it, because it is not simulated.

use shared_types::describe::PlantDescription;

use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Reports settings that only a simulated plant can have. Expressions that ask for the missing truth are refused where
/// their signals are found.
pub(super) fn check(reader: &mut Reader, root: &Section<'_>, plant: &PlantDescription) {
    if plant.port.is_none() {
        return;
    }
    let name = &plant.name;
    if let Some(run) = reader.section(root, "run")
        && let Some(clock) = reader
            .text(&run, "clock")
            .filter(|clock| *clock != "realtime")
    {
        let message = format!(
            "`run.clock` is \"{clock}\", and plant `{name}` is behind a port, which waits for nobody"
        );
        reader
            .report_at(&run, "clock", ProblemKind::Mismatch, message)
            .expected("\"realtime\"")
            .help("write `clock = \"realtime\"` in [run], or run with --clock realtime");
    }
}
