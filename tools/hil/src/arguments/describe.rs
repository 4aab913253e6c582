//! The command line of `hil describe`.

use std::path::PathBuf;

use clap::Args;

pub(super) const EXAMPLES: &str = "\
For an FMU it also shows which outputs depend directly on inputs, which inner signals can be
recorded, and what is left out and why. No code of an FMU is run, unless --load asks for it.
For a port file, which begins with `port = 1`, it shows the signals and each frame field by field.

Exit codes: 0 described; 2 no such file or name, not a program, a port file with mistakes, or an FMU that
cannot be run here.

Examples:
  hil describe drhas
  hil describe model.fmu
  hil describe controller.fmu --as controller
  hil describe model.fmu --load
  hil describe rig.port.toml
  hil describe target/release/plant-process --json";

/// Arguments of `hil describe`.
#[derive(Debug, Args)]
pub struct DescribeArguments {
    /// A plant or controller program, an FMU, a port file, or the name of a built-in plant or law
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Describe an FMU as this side; a program has its own side
    #[arg(long = "as", value_name = "SIDE", default_value = "plant")]
    pub side: DescribedSide,
    /// Load the library of an FMU too, which may run code of it, and list what it needs and lacks
    #[arg(long)]
    pub load: bool,
    /// Read an FMU's archive although it unpacks to more than 100 times its size
    #[arg(long)]
    pub trust_archive: bool,
    /// Describe an FMU although it says that it needs the tool it was made with
    #[arg(long)]
    pub allow_execution_tool: bool,
    /// Print the description as JSON
    #[arg(long)]
    pub json: bool,
}

/// Side of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DescribedSide {
    /// Inputs are commands, outputs are measured.
    Plant,
    /// Inputs are measured or reference signals, outputs are commands.
    Controller,
}
