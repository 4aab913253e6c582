//! `hil get` and `hil watch`: values of a running session's signals, as text or JSON.
//!
//! `get` queries the plant for its latest record, so it also works while the run is paused. `watch` continues as an
//! [`observer`](hil_facts::session::observer), which does not affect the loop.

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

/// Prints the newest values of signals.
///
/// # Errors
/// If there is no session or signal of that name, or no step has been executed yet.
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

/// Lists the values that can be changed while the session runs.
fn tunable(arguments: &GetArguments) -> Result<Exit, Failure> {
    let json = arguments.session.json;
    let answer =
        live::find(&arguments.session).and_then(|session| live::ask(&session, &Request::Tunable));
    let mut answer = answer.map_err(|error| error.tell(json))?;
    let Response::Tunable(tunable) = &mut answer else {
        return Err(RequestError::tell(live::unexpected(&answer), json));
    };
    let columns: Vec<Column> = (tunable.values.iter())
        .map(|one| Column {
            name: one.key.clone(),
            unit: one.unit.clone(),
        })
        .collect();
    let indices = select(&columns, &tunable.aliases(), &arguments.signals)?;
    tunable.values = indices
        .into_iter()
        .map(|place| Tunable {
            aliases: Vec::new(),
            ..tunable.values[place].clone()
        })
        .collect();
    if json {
        output::write(&live::to_json(&answer)?)?;
        return Ok(Exit::Pass);
    }
    let mut table = Table::new(0, [left(0), right(0), left(0), left(0)]);
    for one in &tunable.values {
        let note = match (one.is_changed, one.until_step) {
            (false, _) => String::new(),
            (true, None) => "changed".into(),
            (true, Some(step)) => format!("to {} at step {step}", exact(one.target)),
        };
        let value = match one.value.is_nan() {
            true => "not set".into(),
            false => exact(one.value),
        };
        table.row(&[&one.key, &value, &unit_shown(&one.unit), &note]);
    }
    output::write(&table.to_string())?;
    Ok(Exit::Pass)
}

/// Prints the values of signals repeatedly until the session ends.
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
            return Ok(Exit::Pass); // the session ended meanwhile
        }
        interruption.check()?;
        std::thread::sleep(LOOK); // the session has begun, but admits no observer yet
    };
    let every = Duration::from_secs_f64(arguments.every);
    let (mut printed, mut printed_at) = (values.step, Instant::now());
    loop {
        let is_there = session.is_there();
        observer.look(|seen| {
            if let Seen::Record(record, _) = seen {
                values.take(&record);
            }
        })?;
        // The last values of a run are printed without delay.
        if values.step != printed && (printed_at.elapsed() >= every || !is_there) {
            (printed, printed_at) = (values.step, Instant::now());
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

/// Returns the selected session, and the values of its newest record.
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

/// Values of the selected signals at a step.
struct Values {
    step: Step,
    time_s: f64,
    columns: Vec<Column>,
    /// Indices of the selected signals.
    chosen: Vec<usize>,
    /// Values of all signals.
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
            chosen: select(&columns, &named.aliases(), patterns)?,
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

    /// Formats the values as JSON; NaN and infinity become null.
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

    /// Formats a row for each signal.
    fn table(&self) -> String {
        let mut table = Table::new(0, [left(0), right(0), left(0)]);
        table.line(format!("step {} ({} s)", self.step, self.time_s));
        for (column, value) in self.chosen() {
            table.row(&[&column.name, &exact(value), &unit_shown(&column.unit)]);
        }
        table.to_string()
    }

    /// Formats all signals in one line.
    fn line(&self) -> String {
        let signals = self
            .chosen()
            .map(|(column, value)| format!("{} {}", column.name, exact_in(value, &column.unit)));
        let signals: Vec<String> = signals.collect();
        format!("{} s  {}\n", self.time_s, signals.join("  "))
    }
}

/// Returns the indices of the signals that match a pattern, in the order of the patterns; of all signals if there are
/// no patterns.
fn select(
    columns: &[Column],
    aliases: &[(String, String)],
    patterns: &[String],
) -> Result<Vec<usize>, Failure> {
    if patterns.is_empty() {
        return Ok((0..columns.len()).collect());
    }
    let mut indices = Vec::new();
    let names = columns.iter().map(|one| one.name.as_str());
    for text in &own_names(patterns, names, aliases) {
        let pattern = Pattern::new(text)
            .map_err(|error| Failure::usage(format!("signal `{text}`: {error}")))?;
        let fits = |name: &str| pattern.matches(name) || pattern.matches(&recorded_name(name));
        let before = indices.len();
        let fitting = columns
            .iter()
            .enumerate()
            .filter(|(_, one)| fits(&one.name));
        for (place, _) in fitting {
            if !indices.contains(&place) {
                indices.push(place);
            }
        }
        if indices.len() == before && !columns.iter().any(|one| fits(&one.name)) {
            let near = near(text, columns.iter().map(|one| one.name.as_str()));
            return Err(Failure::usage(format!(
                "the session has no signal `{text}`{near}"
            )));
        }
    }
    Ok(indices)
}
