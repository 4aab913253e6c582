//! State shared by the pages of a session: its model, its actions and its end.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glob::Pattern;
use hil_config::plan::Clock;
use hil_facts::session::inject;
use hil_facts::session::live::{RequestError, refused_text};
use hil_recording::reader::RECORDING;
use hil_session::live;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::live::{Possible, Request, Response};
use shared_types::record::RecordLayout;
use tungstenite::Message;

use super::backdrop::Backdrop;
use super::branches::{Branches, Trunk};
use super::keeper::Keeper;
use super::kept;
use super::kept_records::KeptRecords;
use super::message::{Action, ClientMessage};
use crate::monitor::SharedModel;
use crate::monitor::asking::{LIMIT, ask_faults, in_one_line, met};
use crate::monitor::model::Model;
use crate::monitor::prepared::{self, PreparedFault};
use crate::plots::arranged::signal_json;
use crate::plots::bounds::bounds;
use crate::plots::signal::own_names;

/// Button that injects a fault.
pub(crate) struct Button {
    /// Label.
    pub label: String,
    /// Fault.
    pub fault: PreparedFault,
}

/// State shared by the pages of a session.
pub(crate) struct Board {
    pub(super) session: SessionInfo,
    pub(super) model: SharedModel,
    /// Newest records, for searches.
    pub(super) kept: KeptRecords,
    pub(super) buttons: Vec<Button>,
    /// Background of the curves.
    backdrop: Option<Backdrop>,
    /// Initial width of the time axis in s.
    pub(super) window_s: f64,
    /// Runs that branch from this one.
    pub(super) branches: Arc<Branches>,
    /// Writer of arranged plots.
    pub(super) keeper: Keeper,
    /// Faults and signals of the session, once it has answered.
    possible: OnceLock<(Possible, RecordLayout)>,
    /// Serialises actions.
    doing: Mutex<()>,
    is_over: AtomicBool,
}

impl Board {
    pub(crate) fn new(
        session: SessionInfo,
        (model, kept): (SharedModel, KeptRecords),
        buttons: Vec<Button>,
        window_s: f64,
        backdrop: Option<Backdrop>,
    ) -> Self {
        let recording = session
            .run_dir
            .as_ref()
            .map(|folder| folder.join(RECORDING));
        let recording = recording.filter(|recording| recording.exists());
        let branches = Branches::of(Trunk {
            recording: recording.clone(),
            is_live: true,
        });
        Self {
            session,
            model,
            kept,
            buttons,
            backdrop,
            window_s,
            branches,
            keeper: Keeper::of(recording),
            possible: OnceLock::new(),
            doing: Mutex::new(()),
            is_over: AtomicBool::new(false),
        }
    }

    /// Marks the end of the service.
    pub(super) fn end(&self) {
        self.is_over.store(true, Ordering::Release);
    }

    pub(super) fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Acquire)
    }

    /// Returns the faults that the session supports, querying the session on the first call.
    ///
    /// # Errors
    /// If the session does not answer.
    pub(super) fn ask_possible(&self) -> Result<&(Possible, RecordLayout), RequestError> {
        if let Some(cached) = self.possible.get() {
            return Ok(cached);
        }
        let layout = prepared::layout(&self.session)?;
        let possible = inject::possible(&self.session)?;
        Ok(self.possible.get_or_init(|| (possible, layout)))
    }

    /// Describes the session; `None` until its signals are known.
    pub(super) fn about(&self) -> Option<Value> {
        let model = self.model.lock();
        model.drawn().next()?;
        let plan = model.plan();
        let places: Vec<usize> = model.drawn().map(|(place, _)| place).collect();
        let (bounds, _) = bounds(plan, model.seconds(plan.run.steps));
        let signals = model.drawn().map(|(_, one)| signal_json(one, &bounds));
        let plots = model.plots().iter().map(|plot| {
            let mut object = json!(plot);
            // Indices among the drawn signals.
            let of = |signal: &usize| places.iter().position(|place| place == signal);
            object["signals"] = plot.signals.iter().filter_map(of).collect();
            object
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
        let mut about = json!({
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
            "signals": signals.collect::<Vec<_>>(),
            "plots": plots.collect::<Vec<_>>(),
            "readings": (!readings.is_empty()).then_some(readings),
            "window_s": self.window_s,
            "over": null,
            "buttons": self.buttons.iter().map(|one| json!({"label": one.label, "words": one.fault.words})).collect::<Vec<_>>(),
        });
        if let Some(backdrop) = &self.backdrop {
            backdrop.describe(&names(&model), &mut about);
        }
        Some(about)
    }

    /// Answers a page that looks back or measures; `None` if there is nothing to answer.
    pub(super) fn answer(&self, message: &ClientMessage) -> Option<Message> {
        let model = self.model.lock();
        if let (true, Some(backdrop)) = (message.is_of_other_run(), &self.backdrop) {
            let names = names(&model);
            drop(model);
            return backdrop.answer(message, &names);
        }
        kept::answer(&model, message)
    }

    /// Describes the faults that the session supports.
    pub(crate) fn faults(&self) -> Option<Value> {
        let (possible, _) = self.ask_possible().ok()?;
        let listed = inject::listed(possible);
        Some(json!({ "tell": "faults", "faults": listed }))
    }

    /// Describes the tunable values that the panel shows.
    pub(crate) fn tunable(&self) -> Option<Value> {
        let answer = live::ask(&self.session, &Request::Tunable, LIMIT);
        let Ok(Response::Tunable(tunable)) = answer else {
            return None;
        };
        let aliases = tunable.aliases();
        let mut values = tunable.values;
        let names = self.model.lock().plan().panel.tune.clone();
        if !names.is_empty() {
            let keys = values.iter().map(|one| one.key.as_str());
            let patterns: Vec<Pattern> = own_names(&names, keys, &aliases)
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

    /// Carries out an action on the session and returns the result as text.
    ///
    /// # Errors
    /// If the action was not carried out; the error states the reason.
    pub(super) fn act(&self, action: &Action) -> Result<String, String> {
        let _alone = self.doing.lock().unwrap_or_else(PoisonError::into_inner);
        let request = match (action.request(), action) {
            (Some(request), _) => request,
            (None, Action::Inject { words }) => self.fault(words)?,
            (None, _) => return Err("nothing to do".into()),
        };
        let result = met(&self.session, &self.model, &request);
        // Updates the faults at once, without waiting for the next poll.
        ask_faults(&self.session, &self.model, LIMIT);
        result
    }

    /// Builds the request for a fault from its words.
    fn fault(&self, words: &str) -> Result<Request, String> {
        let in_words = |error: RequestError| match error {
            RequestError::Failed(failure) => failure.to_string(),
            RequestError::Refused(problems) => in_one_line(&refused_text(&problems)),
        };
        // Pages must not read files of this machine.
        let mut split = shlex::split(words).unwrap_or_default().into_iter();
        if split.any(|word| word.starts_with("--tab")) {
            return Err("--table reads a file, which the panel cannot; use `hil inject`".into());
        }
        let (possible, layout) = self.ask_possible().map_err(in_words)?;
        let plan = self.model.lock().plan().clone();
        let prepared = prepared::one(words, possible, &plan, layout);
        let prepared = prepared.map_err(|problems| in_words(RequestError::Refused(problems)))?;
        Ok(Request::Inject {
            toml: prepared.toml,
        })
    }
}

/// Returns the names of the signals in the order in which pages know them.
fn names(model: &Model) -> Vec<String> {
    model.drawn().map(|(_, one)| one.name.clone()).collect()
}
