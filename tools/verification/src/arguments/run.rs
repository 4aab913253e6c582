//! The command lines of `hil run` and `hil rerun`.

use std::path::PathBuf;

use clap::Args;
use hil_console::files::runs::run_path;
use hil_facts::arguments::checkpoint::FromArguments;
use hil_facts::arguments::run::RunOptions;

/// Text behind the options in the help of `hil run`.
pub const EXAMPLES: &str = "\
Examples:
  hil run scenarios/severe-leakage.toml
  hil run scenarios/severe-leakage.toml --set controller.law=pid --out runs/pid
  hil run scenarios/severe-leakage.toml --set 'faults[0].effects[1].speed_per_s=2'
  hil run scenarios/spring-mass.toml --pace 1
  hil run scenarios/spring-mass.toml --pace 1 --panel
  hil run scenarios/spring-mass.toml --clock realtime --set run.overrun=skip
  hil run scenarios/spring-mass.toml --pace 1 --plant-core 2 --controller-core 3 --priority 80 --prefault
  hil run my-scenario.toml --audit
  hil run scenarios/severe-leakage.toml --target me@board
  hil run scenarios/severe-leakage.toml --session demo --pause-at 7
  hil run scenarios/severe-leakage.toml --checkpoint-at 6.9 --out runs/severe
  hil run --from runs/severe/checkpoint-69000 --set 'faults[0].effects[0].coefficient_m3ps_per_sqrt_pa=2e-7'
  hil run scenarios/spring-mass.toml --controller-bin target/release/my-controller --json
  hil run my-scenario.toml --controller-bin target/debug/my-controller --controller external --wait-limit inf
      then, with the command that it prints: gdb --args COMMAND, or perf record -g COMMAND
  hil run scenarios/severe-leakage.toml --record 'truth.*' --record-every 100 --record-around-faults 0.1 0.5
  hil run scenarios/*.toml --repeat 3 --junit verdicts.xml --markdown verdicts.md
  hil run scenarios/*.toml --repeat 1000 --link in-process --no-record --out runs/many";

/// Arguments of `hil run`.
#[derive(Debug, Args)]
pub struct RunArguments {
    /// Scenario file; several files give one verdict table
    #[arg(value_name = "SCENARIO.toml", required_unless_present = "from")]
    pub scenarios: Vec<PathBuf>,
    /// Number of runs of each scenario; all runs of a scenario must have the same digest, except in real time
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeat: u32,
    /// Number of parallel runs, at most one per core [default: half the cores, as each run uses two; all
    /// cores with --link in-process, where a run uses one; 1 in real time, paced and on a target]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub jobs: Option<u32>,
    /// Write the verdicts as JUnit XML, for CI servers
    #[arg(long, value_name = "FILE")]
    pub junit: Option<PathBuf>,
    /// Write the verdicts as Markdown, for people
    #[arg(long, value_name = "FILE")]
    pub markdown: Option<PathBuf>,
    /// Checkpoint to continue from instead
    #[command(flatten)]
    pub from: FromArguments,
    /// Repeat the run under conditions that must not matter (other speeds, cores, busy cores, late sides) and
    /// compare the digests
    #[arg(long)]
    pub audit: bool,
    /// Panel
    #[command(flatten)]
    pub panel: RunPanelArguments,
    /// Options of the run
    #[command(flatten)]
    pub options: RunOptions,
}

/// Arguments of `hil rerun`.
#[derive(Debug, Args)]
pub struct RerunArguments {
    /// Folder of a run or its run.mcap; latest is the newest run below runs
    #[arg(value_name = "RUN", value_parser = run_path())]
    pub run: PathBuf,
    /// Options of the run
    #[command(flatten)]
    pub options: RunOptions,
}

/// Panel options of a run.
#[derive(Clone, Debug, Default, Args)]
pub struct RunPanelArguments {
    /// Show the run in a browser while it is running; see hil panel
    #[arg(long)]
    pub panel: bool,
    /// With --panel: print the address only; open no browser
    #[arg(long, requires = "panel")]
    pub no_open: bool,
    /// The process with which the run ends
    #[arg(long, value_name = "PID", hide = true, requires = "panel")]
    pub owner: Option<u32>,
}
