//! Progress of a run on standard error: simulated time, speed and time left.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use shared_types::time::{Rate, Step};

/// A progress bar; silent where no person watches.
pub struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A bar for so many steps.
    #[must_use]
    pub fn new(steps: u64, rate: Rate) -> Self {
        let bar = ProgressBar::new(steps);
        if !crate::person_watches() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let total_s = rate.seconds(Step(steps));
        let simulated = move |state: &ProgressState, text: &mut dyn std::fmt::Write| {
            let _ = write!(
                text,
                "{:.2} of {total_s} s",
                rate.seconds(Step(state.pos()))
            );
        };
        let speed = move |state: &ProgressState, text: &mut dyn std::fmt::Write| {
            let _ = write!(text, "{:.1}x", state.per_sec() / rate.hz());
        };
        let template = "{wide_bar} {simulated} {speed} {eta}";
        // A bar without the style is better than no run.
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(
                style
                    .with_key("simulated", simulated)
                    .with_key("speed", speed),
            );
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { bar }
    }

    /// So many steps are done.
    pub fn set(&self, steps: u64) {
        self.bar.set_position(steps);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if crate::person_watches() {
            // Ctrl-C shows as `^C` in the bar's line, which the bar does not know of.
            eprint!("\r\x1b[2K");
        }
    }
}
