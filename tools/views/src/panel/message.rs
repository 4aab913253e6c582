//! Messages between a page and its server: JSON in both directions, and points as bytes.
//!
//! Nothing from a page is trusted: unknown messages are refused, and numbers are bounded before use. Points of a signal
//! are the minimum and maximum of equal time intervals, so that no spike is lost however few they are.

use serde::Deserialize;
use serde_json::{Value, json};
use shared_types::live::{ChangeRequest, Request};
use shared_types::time::Rate;

use crate::monitor::history::Range;
use crate::monitor::line;
use crate::monitor::log::Log;
use crate::monitor::model::Model;

/// Maximum length of a page's message in bytes.
pub const LONGEST: usize = 16 << 10;
/// Maximum number of intervals sent to a page at a time; a window has at least half as many.
const STRETCHES: u64 = 800;
/// Maximum number of events in a message.
const EVENTS: usize = 1000;
/// Minimum and maximum window of a page in s.
const WINDOWS_S: [f64; 2] = [1e-6, 1e6];
/// Maximum number of stretches in an answer to a page.
pub(super) const MOST_STRETCHES: u64 = 2048;
/// Maximum number of signals in a request of a page.
const SIGNALS: usize = 64;
/// Maximum number of plots in a request of a page.
const MOST_PLOTS: usize = 200;
/// Maximum length of a plot's title in characters.
const LONGEST_TITLE: usize = 400;
/// Last step that a page may name.
const LAST_STEP: u64 = 1 << 40;
/// First byte of a message with points.
const POINTS: u64 = 1;

/// First message of a page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Greeting {
    /// Secret from the address.
    pub secret: String,
}

/// Message of a page.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "ask", rename_all = "kebab-case", deny_unknown_fields)]
pub enum ClientMessage {
    /// Sets the width of the time axis.
    View {
        /// Number of the view, repeated in its points.
        number: u32,
        /// Width in simulated time.
        window_s: f64,
    },
    /// Acknowledges points.
    Seen {
        /// Number of the points.
        number: u32,
    },
    /// Requests signals over a part of the run.
    Read {
        /// Number, repeated in the answer.
        number: u32,
        /// First step.
        from: u64,
        /// Last step.
        to: u64,
        /// Maximum number of stretches: the page has room for so many.
        most: u64,
        /// Indices of the signals.
        signals: Vec<usize>,
        /// `true` for the run that is laid over the other.
        #[serde(default)]
        over: bool,
    },
    /// Requests figures of signals between two steps.
    Measure {
        /// Number, repeated in the answer.
        number: u32,
        /// First step.
        from: u64,
        /// Last step.
        to: u64,
        /// Indices of the signals.
        signals: Vec<usize>,
        /// `true` for the run that is laid over the other.
        #[serde(default)]
        over: bool,
    },
    /// Requests the times at which a formula of requirements holds.
    Where {
        /// Number, repeated in the answer.
        number: u32,
        /// Formula.
        formula: String,
    },
    /// Requests a new run that repeats this one up to a step and is held there.
    Branch {
        /// Step before which the new run is held.
        step: u64,
    },
    /// Requests the `[[plots]]` of the plots as arranged.
    Keep {
        /// Number, repeated in the answer.
        number: u32,
        /// Plots in order.
        plots: Vec<ArrangedPlot>,
        /// `true` to write them to the scenario's file.
        #[serde(default)]
        write: bool,
    },
    /// Requests an action on the session.
    Do {
        /// Number, repeated in the answer.
        number: u32,
        /// Action.
        action: Action,
    },
}

impl ClientMessage {
    /// Returns `true` if the request is about the run that is laid over the other.
    pub(super) const fn is_of_other_run(&self) -> bool {
        matches!(
            self,
            Self::Read { over: true, .. } | Self::Measure { over: true, .. }
        )
    }
}

/// Plot as arranged on a page.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArrangedPlot {
    /// Title.
    pub title: String,
    /// Title of the plot of the scenario that it was.
    pub was: Option<String>,
    /// Indices of the signals.
    pub signals: Vec<usize>,
    /// `true` for a logarithmic axis.
    pub log: bool,
}

impl ArrangedPlot {
    /// Returns `true` if the plot has a title in one line, and few enough signals.
    fn is_valid(&self) -> bool {
        let is_line = |text: &String| {
            let length = text.chars().count();
            (1..=LONGEST_TITLE).contains(&length) && !text.chars().any(char::is_control)
        };
        is_line(&self.title)
            && self.was.iter().all(is_line)
            && (1..=SIGNALS).contains(&self.signals.len())
    }
}

/// Action on a session.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Action {
    /// Pause before the next step.
    Pause {},
    /// Resume.
    Resume {},
    /// Execute some steps, then pause.
    Step {
        /// Number of steps.
        steps: u64,
    },
    /// Set a mark.
    Mark {
        /// Text of the mark.
        text: String,
    },
    /// Change values.
    Set {
        /// Values, and their start time.
        change: ChangeRequest,
    },
    /// Inject a fault.
    Inject {
        /// Words in the syntax of `hil inject`.
        words: String,
    },
    /// End faults.
    Clear {
        /// Number of the fault; `None` for all.
        fault: Option<u32>,
    },
}

impl Action {
    /// Returns the request to the plant; `None` for a fault, whose words must be parsed first.
    #[must_use]
    pub fn request(&self) -> Option<Request> {
        Some(match self {
            Self::Pause {} => Request::Pause,
            Self::Resume {} => Request::Resume,
            Self::Step { steps } => Request::Advance { steps: *steps },
            Self::Mark { text } => Request::Mark { text: text.clone() },
            Self::Clear { fault } => Request::Clear { id: *fault },
            Self::Set { change } => Request::Set(change.clone()),
            Self::Inject { .. } => return None,
        })
    }
}

/// Parses a message of a page.
///
/// # Errors
/// If the message is malformed.
pub fn parse(text: &str) -> Result<ClientMessage, String> {
    let message =
        serde_json::from_str(text).map_err(|error| format!("malformed message: {error}"))?;
    match message {
        ClientMessage::View { window_s, .. }
            if !(WINDOWS_S[0]..=WINDOWS_S[1]).contains(&window_s) =>
        {
            Err("invalid time window".into())
        }
        ClientMessage::Read {
            from,
            to,
            most,
            ref signals,
            ..
        } if !is_span(from, to, signals) || !(1..=MOST_STRETCHES).contains(&most) => {
            Err("invalid part of the run".into())
        }
        ClientMessage::Measure {
            from,
            to,
            ref signals,
            ..
        } if !is_span(from, to, signals) => Err("invalid part of the run".into()),
        ClientMessage::Keep { ref plots, .. }
            if plots.len() > MOST_PLOTS || !plots.iter().all(ArrangedPlot::is_valid) =>
        {
            Err("invalid plots".into())
        }
        ClientMessage::Branch { step } if step > LAST_STEP => Err("invalid step".into()),
        message => Ok(message),
    }
}

/// Returns `true` if the steps are in order and the signals are few enough.
fn is_span(from: u64, to: u64, signals: &[usize]) -> bool {
    from <= to && to <= LAST_STEP && signals.len() <= SIGNALS
}

/// Encodes the result of an action.
pub(super) fn answer(number: u32, result: &Result<String, String>) -> String {
    let (is_done, text) = match result {
        Ok(text) => (true, text),
        Err(text) => (false, text),
    };
    json!({ "tell": "answer", "number": number, "is_done": is_done, "text": text }).to_string()
}

/// Encodes the last message to a page.
pub(super) fn over(text: &str) -> String {
    json!({ "tell": "over", "text": text }).to_string()
}

/// Encodes events not yet sent to a page; `None` if there are none. `sent` has the edition of the log and the number of
/// events sent.
pub(super) fn log(log: &Log, sent: &mut (u32, usize)) -> Option<Value> {
    let edition = log.edition();
    let (of, from) = *sent;
    let from = if of == edition { from } else { 0 };
    let rest = &log.list()[from..];
    let events = &rest[..rest.len().min(EVENTS)];
    *sent = (edition, from + events.len());
    (!events.is_empty())
        .then(|| json!({ "tell": "log", "edition": edition, "from": from, "events": events }))
}

/// Encodes the state of the session, without its signals and its log.
pub(super) fn state(model: &Model, now_ns: u64) -> Value {
    let mut state = line::json(model, now_ns);
    state["tell"] = "state".into();
    state["signals"] = Value::Null; // sent as points
    state["law"] = model.law().into();
    state["told"] = json!(model.ending().map(|ending| line::ended(model, ending)));
    state
}

/// Time intervals shown by a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct View {
    number: u32,
    /// Length of an interval in steps, as a power of two.
    shift: u32,
    /// First interval that was not sent completely.
    next: u64,
}

impl View {
    /// Creates a view of which nothing was sent.
    pub(super) fn new(number: u32, window_s: f64, rate: Rate) -> Self {
        let steps = rate.step_at_or_after(window_s).0;
        let shift = (0..u64::BITS - 11).find(|shift| steps >> shift < STRETCHES);
        Self {
            number,
            shift: shift.unwrap_or(0),
            next: 0,
        }
    }

    /// Encodes points from the last sent ones on, or for a whole window; `None` if there are no new points.
    pub(super) fn points(&mut self, model: &Model, number: u32) -> Option<Vec<u8>> {
        let newest = model.seen()?;
        let last = newest >> self.shift;
        let earliest = last.saturating_sub(STRETCHES);
        let first = if self.next < earliest {
            earliest
        } else {
            self.next
        };
        let count = (last + 1).checked_sub(first)?;
        // The newest interval is incomplete and sent again.
        self.next = last;
        let signals = model.histories().count();
        let words = 7 + signals + signals * count as usize;
        let mut bytes = Vec::with_capacity(8 * words);
        let kind = POINTS | (u64::from(self.number) << 32);
        bytes.extend(kind.to_le_bytes());
        bytes.extend(u64::from(number).to_le_bytes());
        for number in [newest, first, count, 1 << self.shift, signals as u64] {
            bytes.extend((number as f64).to_le_bytes());
        }
        for (value, _) in model.histories() {
            bytes.extend(value.to_le_bytes());
        }
        for (_, history) in model.histories() {
            for range in history.stretches(first, count, self.shift) {
                let Range { min, max } = range.unwrap_or(Range::of(f64::NAN));
                bytes.extend((min as f32).to_le_bytes());
                bytes.extend((max as f32).to_le_bytes());
            }
        }
        Some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_facts::session::happening::Happening;

    #[test]
    fn a_page_can_send_only_the_listed_messages() {
        for text in [
            r#"{"ask":"view","number":1,"window_s":5}"#,
            r#"{"ask":"seen","number":7}"#,
            r#"{"ask":"read","number":3,"from":0,"to":100,"most":800,"signals":[0,7]}"#,
            r#"{"ask":"read","number":3,"from":0,"to":0,"most":1,"signals":[],"over":true}"#,
            r#"{"ask":"measure","number":3,"from":5,"to":100,"signals":[1]}"#,
            r#"{"ask":"where","number":3,"formula":"abs(truth.x_m) < 1"}"#,
            r#"{"ask":"branch","step":1500}"#,
            r#"{"ask":"keep","number":4,"plots":[{"title":"x","was":null,"signals":[3],"log":true}]}"#,
            r#"{"ask":"keep","number":4,"plots":[],"write":true}"#,
            r#"{"ask":"do","number":1,"action":{"kind":"pause"}}"#,
            r#"{"ask":"do","number":2,"action":{"kind":"clear","fault":null}}"#,
            r#"{"ask":"do","number":2,"action":{"kind":"set","change":{"set":[{"key":"plant.parameters.mass_kg","value":1.2}],"ramp_s":0.5}}}"#,
            r#"{"ask":"do","number":2,"action":{"kind":"set","change":{"set":[{"key":"controller.pid.command_limit_n","value":"inf"}]}}}"#,
            r#"{"ask":"do","number":2,"action":{"kind":"set","change":{"clear":["reference.position_m"]}}}"#,
            r#"{"ask":"do","number":3,"action":{"kind":"inject","words":"bias measured.x_m 1"}}"#,
        ] {
            parse(text).expect(text);
        }
        for text in [
            "",
            "null",
            r#"{"ask":"view","number":1,"window_s":1e9}"#,
            r#"{"ask":"view","number":-1,"window_s":5}"#,
            r#"{"ask":"do","number":1,"action":{"kind":"swap"}}"#,
            r#"{"ask":"do","number":1,"action":{"kind":"set","change":{"set":{"plant.parameters.mass_kg":1.2}}}}"#,
            r#"{"ask":"do","number":1,"action":{"kind":"set","change":{"set":[],"file":"x"}}}"#,
            r#"{"ask":"do","number":1,"action":{"kind":"pause","at":3}}"#,
            r#"{"ask":"run","program":"sh"}"#,
            r#"{"ask":"read","number":3,"from":9,"to":8,"most":800,"signals":[0]}"#,
            r#"{"ask":"read","number":3,"from":0,"to":8,"most":0,"signals":[0]}"#,
            r#"{"ask":"read","number":3,"from":0,"to":8,"most":5000,"signals":[0]}"#,
            r#"{"ask":"read","number":3,"from":0,"to":2000000000000,"most":800,"signals":[0]}"#,
            r#"{"ask":"read","number":3,"from":0,"to":8,"most":800,"signals":[-1]}"#,
            r#"{"ask":"measure","number":3,"from":9,"to":8,"signals":[0]}"#,
            r#"{"ask":"where","number":3,"formula":"x < 1","file":"/etc/passwd"}"#,
            r#"{"ask":"branch","step":-1}"#,
            r#"{"ask":"keep","number":4,"plots":[],"file":"/etc/passwd"}"#,
            r#"{"ask":"keep","number":4,"plots":[{"title":"","was":null,"signals":[3],"log":true}]}"#,
            r#"{"ask":"keep","number":4,"plots":[{"title":"a\nb","was":null,"signals":[3],"log":true}]}"#,
            r#"{"ask":"keep","number":4,"plots":[{"title":"x","was":null,"signals":[],"log":true}]}"#,
            r#"{"ask":"branch","step":2000000000000}"#,
            r#"{"ask":"branch","step":5,"out":"/tmp"}"#,
        ] {
            parse(text).expect_err(text);
        }
    }

    #[test]
    fn a_log_is_sent_in_parts_and_again_from_the_start_in_a_new_edition() {
        let mark = |step| Happening {
            step,
            text: format!("mark at step {step}"),
            label: None,
            key: None,
        };
        let mut log = Log::default();
        let mut sent = (0, 0);
        assert_eq!(super::log(&log, &mut sent), None);
        (10..12 + EVENTS as u64)
            .map(mark)
            .for_each(|one| log.see(one));
        for (from, first, count) in [(0, 10, EVENTS), (EVENTS, 10 + EVENTS, 2)] {
            let part = super::log(&log, &mut sent).expect("a part");
            assert_eq!(part["from"], from);
            assert_eq!(part["events"][0]["step"], first);
            assert_eq!(part["events"].as_array().map(Vec::len), Some(count));
        }
        assert_eq!(super::log(&log, &mut sent), None);
        log.hear(vec![mark(3)]);
        let part = super::log(&log, &mut sent).expect("all of it");
        assert_eq!((&part["edition"], &part["from"]), (&json!(1), &json!(0)));
        assert_eq!(part["events"][0]["step"], 3);
    }

    #[test]
    fn a_window_has_between_half_and_all_of_the_intervals() {
        let rate = Rate::new(10_000.0).expect("a rate");
        for window_s in [0.2, 1.0, 5.0, 30.0, 3600.0, 86_400.0] {
            let view = View::new(0, window_s, rate);
            let stretches = (window_s * 10_000.0) as u64 >> view.shift;
            assert!(
                (STRETCHES / 2..STRETCHES).contains(&stretches),
                "{window_s}: {stretches}"
            );
        }
        assert_eq!(View::new(0, 1e-3, rate).shift, 0, "a step is the least");
        View::new(0, WINDOWS_S[1], Rate::new(Rate::MAX_HZ).expect("a rate"));
    }
}
