//! State that the pages of a session share: its model, what can be done to it, and its end.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use glob::Pattern;
use hil_config::plan::Clock;
use hil_facts::session::inject;
use hil_facts::session::live::{RequestError, refused_text};
use hil_session::live;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::live::{Possible, Request, Response};
use shared_types::record::RecordLayout;

use super::message::Deed;
use crate::monitor::SharedModel;
use crate::monitor::asking::{LIMIT, ask_faults, in_one_line, met};
use crate::monitor::prepared::{self, PreparedFault};
use crate::plots::signal::own_names;

/// A button for a fault.
pub(crate) struct Button {
    /// Text on it.
    pub label: String,
    /// Fault.
    pub fault: PreparedFault,
}

/// Board that the pages of a session share.
pub(crate) struct Board {
    pub(super) session: SessionInfo,
    pub(super) model: SharedModel,
    pub(super) buttons: Vec<Button>,
    /// Width of the time axis that a page begins with, in s.
    pub(super) window_s: f64,
    /// Faults that the session can take, and its signals, once it was asked.
    possible: OnceLock<(Possible, RecordLayout)>,
    /// Deeds go one after the other.
    doing: Mutex<()>,
    is_over: AtomicBool,
}

impl Board {
    pub(crate) fn new(
        session: SessionInfo,
        model: SharedModel,
        buttons: Vec<Button>,
        window_s: f64,
    ) -> Self {
        Self {
            session,
            model,
            buttons,
            window_s,
            possible: OnceLock::new(),
            doing: Mutex::new(()),
            is_over: AtomicBool::new(false),
        }
    }

    /// Nothing will come any more.
    pub(crate) fn end(&self) {
        self.is_over.store(true, Ordering::Release);
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    /// Asks the session which faults it can take, unless that is known.
    ///
    /// # Errors
    /// If it does not answer.
    pub(super) fn ask_possible(&self) -> Result<&(Possible, RecordLayout), RequestError> {
        if let Some(known) = self.possible.get() {
            return Ok(known);
        }
        let layout = prepared::layout(&self.session)?;
        let possible = inject::possible(&self.session)?;
        Ok(self.possible.get_or_init(|| (possible, layout)))
    }

    /// Describes the session; `None` as long as its signals are not known.
    pub(super) fn about(&self) -> Option<Value> {
        let model = self.model.lock();
        model.drawn().next()?;
        let plan = model.plan();
        let places: Vec<usize> = model.drawn().map(|(place, _)| place).collect();
        let signals = model.drawn().map(|(_, column)| column);
        let plots = model.plots().iter().map(|plot| {
            let mut told = json!(plot);
            // Places among those that are drawn.
            let of = |signal: &usize| places.iter().position(|place| place == signal);
            told["signals"] = plot.signals.iter().filter_map(of).collect();
            told
        });
        let readings: Vec<usize> = model
            .readings()
            .iter()
            .filter_map(|one| places.iter().position(|place| place == one))
            .collect();
        let pace = match plan.run.clock {
            Clock::Paced { factor } => Some(factor),
            _ => None,
        };
        Some(json!({
            "tell": "about",
            "session": self.session.name,
            "scenario": plan.name,
            "description": plan.description,
            "plant": plan.plant.model,
            "clock": plan.run.clock.name(),
            "pace": pace,
            "rate_hz": model.rate().hz(),
            "steps": plan.run.steps,
            "duration_s": model.seconds(plan.run.steps),
            "signals": signals.map(|one| json!({"name": one.name, "unit": one.unit})).collect::<Vec<_>>(),
            "plots": plots.collect::<Vec<_>>(),
            "readings": (!readings.is_empty()).then_some(readings),
            "window_s": self.window_s,
            "buttons": self.buttons.iter().map(|one| json!({"label": one.label, "words": one.fault.words})).collect::<Vec<_>>(),
        }))
    }

    /// Describes the faults that the session can take.
    pub(crate) fn faults(&self) -> Option<Value> {
        let (possible, _) = self.ask_possible().ok()?;
        let listed = inject::listed(possible);
        Some(json!({ "tell": "faults", "faults": listed }))
    }

    /// Describes the values that can be changed, of those that the panel is to show.
    pub(crate) fn tunable(&self) -> Option<Value> {
        let asked = live::ask(&self.session, &Request::Tunable, LIMIT);
        let Ok(Response::Tunable(tunable)) = asked else {
            return None;
        };
        let aliases = tunable.aliases();
        let mut values = tunable.values;
        let wanted = self.model.lock().plan().panel.tune.clone();
        if !wanted.is_empty() {
            let keys = values.iter().map(|one| one.key.as_str());
            let patterns: Vec<Pattern> = own_names(&wanted, keys, &aliases)
                .iter()
                .filter_map(|text| Pattern::new(text).ok())
                .collect();
            values.retain(|one| patterns.iter().any(|pattern| pattern.matches(&one.key)));
        }
        for one in &mut values {
            one.aliases.clear();
        }
        Some(
            json!({ "tell": "tunable", "values": values, "law_does": tunable.law_does, "left": tunable.left }),
        )
    }

    /// Does something to the session, and tells what came of it.
    ///
    /// # Errors
    /// Reason for which it was not done.
    pub(super) fn act(&self, deed: &Deed) -> Result<String, String> {
        let _alone = self.doing.lock().unwrap_or_else(PoisonError::into_inner);
        let request = match (deed.request(), deed) {
            (Some(request), _) => request,
            (None, Deed::Inject { words }) => self.fault(words)?,
            (None, _) => return Err("nothing to do".into()),
        };
        let told = met(&self.session, &self.model, &request);
        // Seen at once, not at the next look.
        ask_faults(&self.session, &self.model, LIMIT);
        told
    }

    /// The request for a fault, from its words.
    fn fault(&self, words: &str) -> Result<Request, String> {
        let told = |error: RequestError| match error {
            RequestError::Failed(failure) => failure.to_string(),
            RequestError::Refused(problems) => in_one_line(&refused_text(&problems)),
        };
        // No page reads files of this machine.
        let mut split = shlex::split(words).unwrap_or_default().into_iter();
        if split.any(|word| word.starts_with("--tab")) {
            return Err("--table reads a file, which `hil inject` does and no page".into());
        }
        let (possible, layout) = self.ask_possible().map_err(told)?;
        let plan = self.model.lock().plan().clone();
        let prepared = prepared::one(words, possible, &plan, layout);
        let prepared = prepared.map_err(|problems| told(RequestError::Refused(problems)))?;
        Ok(Request::Inject {
            toml: prepared.toml,
        })
    }
}
