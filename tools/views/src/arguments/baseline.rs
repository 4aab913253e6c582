//! The choice of a baseline whose band lies behind curves, in `hil panel` and `hil report`.

use std::path::PathBuf;

use clap::Args;

/// Baseline behind the curves.
#[derive(Clone, Debug, Args)]
pub struct BaselineChoice {
    /// Shade the band of this named run behind the curves: its signals within their tolerances
    #[arg(long, value_name = "NAME")]
    pub baseline: Option<String>,
    /// File of named runs
    #[arg(long, value_name = "FILE", default_value = "baselines.toml")]
    pub baselines: PathBuf,
}
