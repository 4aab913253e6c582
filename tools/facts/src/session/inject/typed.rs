//! Refusals of the plant, translated to the options of the command line.
//!
//! The plant checks a fault like a fault of a scenario. Its refusal names the keys of the request's text, such as
//! `faults[0].effects[0].bias`, which the user has not typed.

use shared_types::live::Refusal;

use crate::arguments::inject::InjectArguments;
use crate::session::live::RequestError;

/// Replaces keys of the fault's text in a refusal by the options.
pub(super) fn as_typed(error: RequestError, arguments: &InjectArguments) -> RequestError {
    match error {
        RequestError::Refused(problems) => {
            let typed = |problem: Refusal| Refusal {
                message: in_options(&problem.message, arguments),
                expected: (problem.expected).map(|expected| in_options(&expected, arguments)),
                ..problem
            };
            RequestError::Refused(problems.into_iter().map(typed).collect())
        }
        failed @ RequestError::Failed(_) => failed,
    }
}

fn in_options(text: &str, arguments: &InjectArguments) -> String {
    // Names are enclosed in backticks, so every second part is one.
    let part = |(place, part): (usize, &str)| match place % 2 {
        1 => option(part, arguments).unwrap_or_else(|| part.to_owned()),
        _ => part.to_owned(),
    };
    let parts: Vec<String> = text.split('`').enumerate().map(part).collect();
    parts.join("`")
}

/// Returns the option for a key of the fault's text.
fn option(key: &str, arguments: &InjectArguments) -> Option<String> {
    let key = key.strip_prefix("faults[0].")?;
    let Some(effect) = key.strip_prefix("effects[") else {
        return Some(match key {
            "kind" => "KIND".into(),
            _ => format!("--{}", key.trim_end_matches("_s").replace('_', "-")),
        });
    };
    let (effect, key) = effect.split_once("].")?;
    let option = match key {
        "target" => "TARGET".into(),
        "skew_s" => "--skew".into(),
        _ if key.starts_with("profile") => course(arguments)?.into(),
        // In the form of `hil inject --list`.
        _ => format!("--{key}"),
    };
    let number: usize = effect.parse().ok()?;
    Some(match number {
        0 => option,
        _ => format!("{option} (target {})", number + 1),
    })
}

/// Returns the option that selects the profile.
fn course(arguments: &InjectArguments) -> Option<&'static str> {
    let courses = [
        ("--ramp", arguments.ramp.is_some()),
        ("--exponential", arguments.exponential.is_some()),
        ("--pulse", arguments.pulse.is_some()),
        ("--intermittent", arguments.intermittent.is_some()),
        ("--sine", arguments.sine.is_some()),
        ("--table", arguments.table.is_some()),
    ];
    let selected = courses.into_iter().find(|(_, is_asked)| *is_asked);
    selected.map(|(option, _)| option)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn problems_are_named_by_the_option_as_typed() {
        let arguments = InjectArguments {
            ramp: Some(-1.0),
            ..InjectArguments::default()
        };
        #[rustfmt::skip] // a table
        let cases = [
            ("`faults[0].effects[0].steps` is missing", "`--steps` is missing"),
            ("`faults[0].effects[1].bias` is not a number", "`--bias (target 2)` is not a number"),
            ("`faults[0].at_s` is past", "`--at` is past"),
            ("`faults[0].until_for_s` is x", "`--until-for` is x"),
            ("`faults[0].effects[0].skew_s` is x", "`--skew` is x"),
            ("`faults[0].effects[0].profile.duration_s` is -1", "`--ramp` is -1"),
            ("no signal `truth.x` in `a < b`", "no signal `truth.x` in `a < b`"),
            ("a single ` stays", "a single ` stays"),
        ];
        for (refusal, expected) in cases {
            assert_eq!(in_options(refusal, &arguments), expected);
        }
    }
}
