//! Readers of tables that scenarios name, beyond CSV: recordings of `hil`, ROS 2 messages in MCAP, and Parquet. They
//! choose no columns and check no time base.
//!
//! Passed to a scenario where it is read, because `hil-config`, which checks the scenario, knows no recordings.

mod mcap;
mod parquet;

use hil_config::table_file::Format;

/// Formats beyond CSV.
pub const FORMATS: &[Format] = &[
    Format {
        ending: "mcap",
        open: mcap::open,
    },
    Format {
        ending: "parquet",
        open: parquet::open,
    },
];

#[cfg(test)]
mod tests;
