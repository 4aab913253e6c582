//! The command line of `hil doctor`.

use clap::Args;
use hil_console::terminal::duration::seconds;

/// Text behind the options in the help of `hil doctor`.
pub const EXAMPLES: &str = "\
Exit codes: 0 fit for timing claims; 1 unfit: a grade is poor; 2 wrong usage.

Examples:
  hil doctor
  hil doctor --quick --json
  sudo chrt -R -f 80 \"$(command -v hil)\" doctor --cores 2,3 --seconds 60";

/// Arguments of `hil doctor`.
#[derive(Debug, Args)]
pub struct DoctorArguments {
    /// Two cores to judge [default: isolated cores, or the last two that share no physical core]
    #[arg(long, value_name = "A,B", value_parser = two_cores)]
    pub cores: Option<[u32; 2]>,
    /// Duration of each measurement
    #[arg(long, value_name = "SECONDS", default_value = "2", value_parser = measurable)]
    pub seconds: f64,
    /// Only read information from the kernel; measure nothing
    #[arg(long, conflicts_with = "seconds")]
    pub quick: bool,
    /// Print as JSON
    #[arg(long)]
    pub json: bool,
}

fn two_cores(text: &str) -> Result<[u32; 2], String> {
    let core = |text: &str| text.trim().parse::<u32>().ok();
    match text.split_once(',').map(|(a, b)| (core(a), core(b))) {
        Some((Some(a), Some(b))) if a != b => Ok([a, b]),
        _ => Err("expected two different cores, for example 2,3".into()),
    }
}

/// Parses a duration, from enough for a hundred wake-ups up to an hour.
fn measurable(text: &str) -> Result<f64, String> {
    let length = seconds(text)?;
    if (0.1..=3600.0).contains(&length) {
        Ok(length)
    } else {
        Err("expected 0.1 to 3600 s".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_different_cores_are_accepted() {
        assert_eq!(two_cores("2,3"), Ok([2, 3]));
        assert_eq!(two_cores("7, 0"), Ok([7, 0]));
        for text in ["", "2", "2,2", "2,3,4", "-1,2", "a,b"] {
            assert!(two_cores(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_measurement_lasts_from_0_1_s_to_an_hour() {
        assert_eq!(measurable("100ms"), Ok(0.1));
        assert_eq!(measurable("3600"), Ok(3600.0));
        for text in ["0", "0.09", "3601", "nan", "long"] {
            assert!(measurable(text).is_err(), "{text}");
        }
    }
}
