//! Progress of a run on standard error: simulated time, speed, remaining time, and pauses.

use std::io::Write as _;
use std::time::{Duration, SystemTime};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use shared_types::time::{Rate, Step};

use crate::terminal::output;

/// Progress bar, drawn only on a terminal.
pub struct Progress {
    bar: ProgressBar,
    rate: Rate,
    pause: Option<Pause>,
    /// Step of the latest announced pause.
    told_pause: Option<Step>,
    is_shown: bool,
}

/// Pause that was requested before the run.
struct Pause {
    step: Step,
    notice: String,
}

impl Progress {
    /// Creates a bar for `steps` steps; `is_shown` is `false` if several runs share the terminal.
    #[must_use]
    pub fn new(steps: u64, rate: Rate, is_shown: bool) -> Self {
        let is_drawn = is_shown && output::person_watches();
        let bar = if is_drawn {
            ProgressBar::new(steps)
        } else {
            ProgressBar::hidden()
        };
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
        let template = "{wide_bar} {simulated} {speed} {eta} {msg}";
        // A bar without the style is better than no run.
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(
                style
                    .with_key("simulated", simulated)
                    .with_key("speed", speed),
            );
        }
        if is_drawn {
            bar.enable_steady_tick(Duration::from_millis(200));
        }
        Self {
            bar,
            rate,
            pause: None,
            told_pause: None,
            is_shown,
        }
    }

    /// Schedules a notice for the step at which the run will pause.
    pub fn announce_pause(&mut self, pause_at_s: f64, session: &str) {
        let step = self.rate.step_at_or_after(pause_at_s);
        let time_s = self.rate.seconds(step);
        self.pause = Some(Pause {
            step,
            notice: format!("paused at step {step} ({time_s} s); hil resume --session {session}"),
        });
    }

    /// Reports that the run is paused before a step, unless this pause was announced.
    pub fn tell_pause(&mut self, step: u64, since: SystemTime, session: &str) {
        let step = Step(step);
        self.bar.set_message("paused");
        if self.told_pause.replace(step) != Some(step) {
            let time_s = self.rate.seconds(step);
            let since = humantime::format_rfc3339_seconds(since);
            self.tell(&format!(
                "paused at step {step} ({time_s} s) since {since}; hil resume --session {session}"
            ));
        }
    }

    /// Prints a line above the bar.
    pub fn tell(&self, text: &str) {
        self.bar.suspend(|| output::tell(text));
    }

    /// Updates the bar: all steps before this one are done.
    pub fn set(&mut self, next_step: u64) {
        if self.bar.position() != next_step {
            self.bar.set_message("");
            self.told_pause = None;
        }
        self.bar.set_position(next_step);
        if let Some(pause) = self.pause.take_if(|pause| next_step >= pause.step.0) {
            self.told_pause = Some(pause.step);
            self.tell(&pause.notice);
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if self.is_shown && crate::terminal::output::person_watches() {
            // Ctrl-C prints `^C` in the bar's line without the bar's knowledge.
            let _ = write!(std::io::stderr(), "\r\x1b[2K"); // fails only if the terminal is gone
        }
    }
}
