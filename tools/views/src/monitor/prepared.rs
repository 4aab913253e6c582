//! Faults injected with a key: the words after `--inject`, checked before the view opens.
//!
//! The words have the syntax of `hil inject` and become the same request. They are checked here as the plant will check
//! them, so that a mistake is refused at the start and not in the middle of a run.

use std::ffi::OsString;
use std::time::{Duration, Instant};

use clap::Parser;
use hil_config::live_requests::RequestContext;
use hil_config::plan::Plan;
use hil_console::terminal::exit::Failure;
use hil_facts::arguments::inject::arrange;
use hil_facts::arguments::inject::{InjectCommand, InjectLine};
use hil_facts::session::inject;
use hil_facts::session::live::RequestError;
use hil_session::session::SessionInfo;
use hil_session::stream::LAYOUT_FILE;
use shared_types::live::{Possible, Refusal};
use shared_types::record::RecordLayout;

/// Maximum number of prepared faults: one per key.
const MOST: usize = 9;
/// Time limit for a session to report which faults it supports.
const START_LIMIT: Duration = Duration::from_secs(20);
/// Interval between two attempts.
const LOOK: Duration = Duration::from_millis(10);

/// Fault that is ready to be injected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PreparedFault {
    /// Words as typed.
    pub words: String,
    /// Text of the request.
    pub toml: String,
}

/// Prepares faults for a session; queries the session only if there are any.
///
/// # Errors
/// If the session would refuse one of them.
pub(crate) fn all(
    texts: &[String],
    session: &SessionInfo,
    plan: &Plan,
) -> Result<Vec<PreparedFault>, RequestError> {
    if texts.is_empty() {
        return Ok(Vec::new());
    }
    if texts.len() > MOST {
        let message = format!(
            "{} faults are prepared, but there are only {MOST} keys; omit some",
            texts.len()
        );
        return Err(Refusal::new(message).into());
    }
    let layout = layout(session)?;
    let possible = inject::possible(session)?;
    let prepared = texts.iter().map(|text| {
        one(text, &possible, plan, &layout).map_err(|problems| {
            RequestError::Refused(
                problems
                    .into_iter()
                    .map(|problem| Refusal {
                        message: format!("prepared fault '{text}': {}", problem.message),
                        ..problem
                    })
                    .collect(),
            )
        })
    });
    prepared.collect()
}

/// Returns the signals of a session, which are available once both sides are connected.
///
/// # Errors
/// If the session ends earlier.
pub(crate) fn layout(session: &SessionInfo) -> Result<RecordLayout, RequestError> {
    let since = Instant::now();
    loop {
        if let Ok(layout) = session.read_file(LAYOUT_FILE) {
            return Ok(layout);
        }
        if !session.is_there() || since.elapsed() > START_LIMIT {
            let name = &session.name;
            return Err(Failure::infrastructure(format!(
                "session `{name}` has ended or does not start"
            ))
            .into());
        }
        std::thread::sleep(LOOK);
    }
}

/// Prepares a fault from its words.
///
/// # Errors
/// All problems of the words.
pub(crate) fn one(
    text: &str,
    possible: &Possible,
    plan: &Plan,
    layout: &RecordLayout,
) -> Result<PreparedFault, Vec<Refusal>> {
    let refused = |message: String| vec![Refusal::new(message)];
    let words = shlex::split(text).ok_or_else(|| refused("a quote is not closed".into()))?;
    let typed = ["hil", "inject"]
        .map(str::to_owned)
        .into_iter()
        .chain(words);
    let command_line = InjectLine::try_parse_from(arrange(typed.map(OsString::from)));
    let command_line = command_line.map_err(|error| {
        let reason = error.to_string();
        let first = reason.lines().next().unwrap_or_default();
        refused(first.trim_start_matches("error: ").to_owned())
    })?;
    let InjectCommand::Inject(arguments) = command_line.command;
    if arguments.kind.is_none() || arguments.session.session.is_some() || arguments.session.json {
        return Err(refused(
            "expected a kind of fault and its target, without --list, --active, --clear, --session and --json"
                .into(),
        ));
    }
    let toml = inject::toml(&arguments, possible)?;
    let context = RequestContext {
        // Faults injected by others before this one have lower numbers.
        first_id: u32::MAX / 2,
        ..RequestContext::of(plan, &possible.plant, &possible.kinds)
    };
    (context.check(&toml, &layout.internal))
        .map_err(|problems| problems.0.iter().map(Refusal::from).collect::<Vec<_>>())?;
    Ok(PreparedFault {
        words: text.into(),
        toml,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::model::tests::{layout, plan, possible};

    fn prepared(text: &str) -> Result<PreparedFault, String> {
        let plan = plan();
        one(text, &possible(&plan), &plan, &layout(&plan)).map_err(|problems| {
            let messages: Vec<String> = problems.into_iter().map(|one| one.message).collect();
            messages.join("; ")
        })
    }

    #[test]
    fn valid_inject_words_are_prepared_and_invalid_ones_refused_at_once() {
        for text in [
            "bias measured.surface_angle_rad 0.01 --ramp 2s",
            "leakage --actuator 1,2 --coefficient 5e-7,1e-7 --speed 10,0.5",
            "dropout measured.surface_angle_rad --when 'abs(truth.surface_angle_rad) > 0.1'",
        ] {
            let prepared = prepared(text).expect(text);
            assert_eq!(prepared.words, text);
            let kind = text.split(' ').next().expect("a word");
            assert!(
                prepared.toml.contains(&format!("kind = \"{kind}\"")),
                "{prepared:?}"
            );
        }
        for (text, fragment) in [
            ("", "required"),
            ("leek --actuator 1", "leek"),
            ("leakage --actuator 9 --coefficient 1e-7 --speed 1", "9"),
            ("leakage --actuator 1 --coefficient -1 --speed 1", "-1"),
            (
                "bias measured.surface_angle_rad 1 --when 'truth.x > 1'",
                "truth.x",
            ),
            ("bias 'measured.surface_angle_rad 1", "quote"),
            ("--list", "a kind of fault"),
            (
                "bias measured.surface_angle_rad 1 --session demo",
                "--session",
            ),
        ] {
            let message = prepared(text).expect_err(text);
            assert!(message.contains(fragment), "{text}: {message}");
        }
    }
}
