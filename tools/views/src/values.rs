//! `hil get` and `hil watch`: values of a running session's signals, as text or JSON.
//!
//! `get` asks the plant for its newest record, so it also answers while the run is held. `watch` then
//! goes on as an [`observer`](hil_facts::session::observer), which the loop does not notice.

use std::time::{Duration, Instant};

use glob::Pattern;
use hil_config::evaluation::Evaluation;
use hil_config::expression::Columns;
use hil_config::plan::Plan;
use hil_console::terminal::exit::{Exit, Failure};
use hil_console::terminal::interruption::Interruption;
use hil_console::terminal::output;
use hil_console::terminal::table::{Table, left, right};
use hil_facts::arguments::SessionChoice;
use hil_facts::session::live::{self, RequestError};
use hil_facts::session::observer::{Observer, Seen};
use hil_recording::reader::Column;
use hil_session::session::SessionInfo;
use serde_json::{Value, json};
use shared_types::live::{Request, Response, Tunable};
use shared_types::number::{exact, exact_in, unit_shown};
use shared_types::record::{RecordLayout, RecordView, Validity};
use shared_types::table::near;
use shared_types::time::Step;

use super::monitor::{LOOK, notice};
use super::plots::columns_of;
use super::plots::signal::{own_names, recorded_name};
use crate::arguments::values::{GetArguments, WatchArguments};

/// Tells the newest values of signals.
///
/// # Errors
/// If there is no session to ask, no such signal, or no step was executed yet.
pub fn get(arguments: &GetArguments) -> Result<Exit, Failure> {
    if arguments.tunable {
        return tunable(arguments);
    }
    let interruption = Interruption::listen()?;
    let json = arguments.session.json;
    let (_, values) = asked(&arguments.session, &arguments.signals, &interruption)?;
    output::write(&if json {
        live::to_json(&values.json())?
    } else {
        values.table()
    })?;
    Ok(Exit::Pass)
}

/// Lists what can be changed while the session runs.
fn tunable(arguments: &GetArguments) -> Result<Exit, Failure> {
    let json = arguments.session.json;
    let answer =
        live::find(&arguments.session).and_then(|session| live::ask(&session, &Request::Tunable));
    let mut answer = answer.map_err(|error| error.tell(json))?;
    let Response::Tunable(shown) = &mut answer else {
        return Err(RequestError::tell(live::unexpected(&answer), json));
    };
    let columns: Vec<Column> = (shown.values.iter())
        .map(|one| Column {
            name: one.key.clone(),
            unit: one.unit.clone(),
        })
        .collect();
    let chosen = chosen(&columns, &shown.aliases(), &arguments.signals)?;
    shown.values = chosen
        .into_iter()
        .map(|place| Tunable {
            aliases: Vec::new(),
            ..shown.values[place].clone()
        })
        .collect();
    if json {
        output::write(&live::to_json(&answer)?)?;
        return Ok(Exit::Pass);
    }
    let mut table = Table::new(0, [left(0), right(0), left(0), left(0)]);
    for one in &shown.values {
        let note = match (one.is_changed, one.until_step) {
            (false, _) => String::new(),
            (true, None) => "changed".into(),
            (true, Some(step)) => format!("to {} at step {step}", exact(one.target)),
        };
        table.row(&[&one.key, &exact(one.value), &unit_shown(&one.unit), &note]);
    }
    output::write(&table.to_string())?;
    Ok(Exit::Pass)
}

/// Tells the values of signals again and again, until the session ends.
///
/// # Errors
/// If there is no session to watch or no such signal, or if it is interrupted.
pub fn watch(arguments: &WatchArguments) -> Result<Exit, Failure> {
    let interruption = Interruption::listen()?;
    let json = arguments.session.json;
    let (session, mut values) = asked(&arguments.session, &arguments.signals, &interruption)?;
    let mut lines = arguments.count.unwrap_or(u64::MAX);
    let mut tell = |values: &Values| -> Result<bool, Failure> {
        output::write(&if json {
            live::to_json(&values.json())?
        } else {
            values.line()
        })?;
        lines -= 1;
        Ok(lines == 0)
    };
    if tell(&values)? {
        return Ok(Exit::Pass);
    }
    let mut observer = loop {
        if let Some(observer) = Observer::attach(&session)? {
            break observer;
        }
        if !session.is_there() {
            return Ok(Exit::Pass); // it ended meanwhile
        }
        interruption.check()?;
        std::thread::sleep(LOOK); // it has begun, and admits nobody yet
    };
    let every = Duration::from_secs_f64(arguments.every);
    let (mut told, mut told_at) = (values.step, Instant::now());
    loop {
        let is_there = session.is_there();
        observer.look(|seen| {
            if let Seen::Record(record, _) = seen {
                values.take(&record);
            }
        })?;
        // The last values of a run are told without a wait.
        if values.step != told && (told_at.elapsed() >= every || !is_there) {
            (told, told_at) = (values.step, Instant::now());
            if tell(&values)? {
                return Ok(Exit::Pass);
            }
        }
        if !is_there {
            return Ok(Exit::Pass);
        }
        interruption.check()?;
        std::thread::sleep(observer.nap().max(Duration::from_millis(1)));
    }
}

/// The session that is meant, and the values of its newest record.
fn asked(
    choice: &SessionChoice,
    patterns: &[String],
    interruption: &Interruption,
) -> Result<(SessionInfo, Values), Failure> {
    let session = live::find(choice).map_err(|error| error.tell(choice.json))?;
    let plan = notice(&session, interruption)?.plan()?;
    let answer = live::ask(&session, &Request::Record);
    match answer.map_err(|error| error.tell(choice.json))? {
        Response::Record { layout, words } if words.len() == layout.words() => {
            let mut values = Values::new(&plan, &layout, patterns)?;
            values.take(&layout.view(&words));
            Ok((session, values))
        }
        other => Err(RequestError::tell(live::unexpected(&other), choice.json)),
    }
}

/// Values of the chosen signals at a step.
struct Values {
    step: Step,
    time_s: f64,
    columns: Vec<Column>,
    /// Places of the chosen ones.
    chosen: Vec<usize>,
    /// The values of all.
    row: Vec<f64>,
    validity: Validity,
    evaluation: Evaluation,
    plan: Plan,
}

impl Values {
    fn new(plan: &Plan, layout: &RecordLayout, patterns: &[String]) -> Result<Self, Failure> {
        let plan = plan.clone().without_judgement();
        let named = Columns::from(layout);
        let evaluation = Evaluation::new(&plan, &named);
        let columns = columns_of(layout, &plan.derived);
        Ok(Self {
            step: Step(0),
            time_s: 0.0,
            chosen: chosen(&columns, &named.aliases(), patterns)?,
            row: vec![f64::NAN; columns.len()],
            columns,
            validity: layout.validity(),
            evaluation: evaluation.map_err(Failure::infrastructure)?,
            plan,
        })
    }

    fn take(&mut self, record: &RecordView<'_>) {
        self.step = Step(record.step);
        self.time_s = self.plan.run.rate.seconds(self.step);
        let recorded = record.values.len();
        self.row[..recorded].copy_from_slice(record.values);
        for place in self.validity.invalid(record.hashed) {
            self.row[place] = f64::NAN;
        }
        let invalid = self.validity.invalid(record.hashed);
        (self.evaluation).observe(self.step, record.values, invalid);
        self.row[recorded..].copy_from_slice(self.evaluation.derived());
    }

    fn chosen(&self) -> impl Iterator<Item = (&Column, f64)> {
        self.chosen
            .iter()
            .map(|&at| (&self.columns[at], self.row[at]))
    }

    /// For a machine; what is no number is null.
    fn json(&self) -> Value {
        let signals = self.chosen().map(
            |(column, value)| json!({ "name": column.name, "value": value, "unit": column.unit }),
        );
        json!({
            "step": self.step.0,
            "time_s": self.time_s,
            "signals": signals.collect::<Vec<_>>(),
        })
    }

    /// A row for each signal.
    fn table(&self) -> String {
        let mut table = Table::new(0, [left(0), right(0), left(0)]);
        table.line(format!("step {} ({} s)", self.step, self.time_s));
        for (column, value) in self.chosen() {
            table.row(&[&column.name, &exact(value), &unit_shown(&column.unit)]);
        }
        table.to_string()
    }

    /// All signals in one line.
    fn line(&self) -> String {
        let signals = self
            .chosen()
            .map(|(column, value)| format!("{} {}", column.name, exact_in(value, &column.unit)));
        let signals: Vec<String> = signals.collect();
        format!("{} s  {}\n", self.time_s, signals.join("  "))
    }
}

/// Places of the signals that fit a pattern, in the order of the patterns; all without any.
fn chosen(
    columns: &[Column],
    aliases: &[(String, String)],
    patterns: &[String],
) -> Result<Vec<usize>, Failure> {
    if patterns.is_empty() {
        return Ok((0..columns.len()).collect());
    }
    let mut chosen = Vec::new();
    let names = columns.iter().map(|one| one.name.as_str());
    for text in &own_names(patterns, names, aliases) {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("signal `{text}`: {error}")))?;
        let fits = |name: &str| pattern.matches(name) || pattern.matches(&recorded_name(name));
        let before = chosen.len();
        let fitting = columns
            .iter()
            .enumerate()
            .filter(|(_, one)| fits(&one.name));
        for (place, _) in fitting {
            if !chosen.contains(&place) {
                chosen.push(place);
            }
        }
        if chosen.len() == before && !columns.iter().any(|one| fits(&one.name)) {
            let near = near(text, columns.iter().map(|one| one.name.as_str()));
            return Err(Failure::usage(format!(
                "the session has no signal `{text}`{near}"
            )));
        }
    }
    Ok(chosen)
}
