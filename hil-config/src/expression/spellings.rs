//! Spellings of other languages: what a symbol, operator or function is called here.
//!
//! Asked where a text is refused anyway, so that no name of a signal is ever taken for one of them.

/// Symbols of other languages and their names here; longer ones first.
const SYMBOLS: [(&str, &str); 20] = [
    ("&&", "and"),
    ("||", "or"),
    ("=<", "<="),
    ("<->", "=="),
    ("<>", "!="),
    ("~=", "!="),
    ("->", "implies"),
    ("\u{2264}", "<="),
    ("\u{2265}", ">="),
    ("\u{2260}", "!="),
    ("\u{2227}", "and"),
    ("\u{2228}", "or"),
    ("\u{00ac}", "not"),
    ("\u{2192}", "implies"),
    ("\u{21d2}", "implies"),
    ("\u{00d7}", "*"),
    ("\u{2212}", "-"),
    ("&", "and"),
    ("!", "not"),
    ("=", "=="),
];

/// Operators and words of other languages and their names here.
const OPERATORS: [(&str, &str); 24] = [
    ("G", "always"),
    ("globally", "always"),
    ("Globally", "always"),
    ("alw", "always"),
    ("box", "always"),
    ("F", "eventually"),
    ("finally", "eventually"),
    ("Finally", "eventually"),
    ("ev", "eventually"),
    ("diamond", "eventually"),
    ("H", "historically"),
    ("O", "once"),
    ("P", "once"),
    ("rising", "rise"),
    ("falling", "fall"),
    ("U", "until"),
    ("S", "since"),
    ("then", "implies"),
    ("AND", "and"),
    ("OR", "or"),
    ("NOT", "not"),
    ("ALWAYS", "always"),
    ("EVENTUALLY", "eventually"),
    ("IMPLIES", "implies"),
];

/// Functions of other languages and their names here.
const FUNCTIONS: [(&str, &str); 13] = [
    ("average", "mean"),
    ("avg", "mean"),
    ("fabs", "abs"),
    ("magnitude", "abs"),
    ("norm", "abs"),
    ("peak", "max_abs"),
    ("first", "initial"),
    ("start", "initial"),
    ("last", "final"),
    ("end", "final"),
    ("int", "integral"),
    ("trapz", "integral"),
    ("root", "sqrt"),
];

/// Figures of ready-made analyses, without their units, and the kind of metric that has them.
const FIGURES: [(&str, &str); 16] = [
    ("rise_time", "step-response"),
    ("overshoot", "step-response"),
    ("peak_time", "step-response"),
    ("settling_time", "step-response"),
    ("steady_state_error", "step-response"),
    ("low_frequency_gain", "frequency-response"),
    ("bandwidth", "frequency-response"),
    ("peak_gain", "frequency-response"),
    ("peak_frequency", "frequency-response"),
    ("phase_lag_90_frequency", "frequency-response"),
    ("time_to_detect", "detection"),
    ("missed", "detection"),
    ("false_alarms", "detection"),
    ("time_to_recover", "detection"),
    ("peak_effect", "detection"),
    ("rms_effect", "detection"),
];

/// The message for a symbol of another language at the beginning of a text, and the length that it speaks of.
pub(super) fn of_symbol(text: &str) -> Option<(usize, String)> {
    if text.starts_with("!=") || text.starts_with("==") {
        return None;
    }
    if text.starts_with("=>") {
        let message = "unknown operator `=>`; write `>=` for at least, or `implies`";
        return Some((2, message.into()));
    }
    if text.starts_with("**") || text.starts_with('^') {
        let length = if text.starts_with('^') { 1 } else { 2 };
        let symbol = &text[..length];
        let message = format!("there is no operator `{symbol}`; multiply, as in `x * x`");
        return Some((length, message));
    }
    let is_or = text.starts_with("||");
    if let Some(inside) = text.strip_prefix('|').filter(|_| !is_or) {
        return Some(match inside.split_once('|') {
            Some((inside, rest)) if !rest.starts_with('|') => {
                let length = inside.len() + 2;
                (
                    length,
                    format!("write `abs({})` for a magnitude", inside.trim()),
                )
            }
            _ => (
                1,
                "unknown operator `|`; write `or`, or `abs(x)` for a magnitude".into(),
            ),
        });
    }
    let (symbol, name) = SYMBOLS
        .iter()
        .find(|(symbol, _)| text.starts_with(symbol))?;
    Some((
        symbol.len(),
        format!("unknown operator `{symbol}`; write `{name}`"),
    ))
}

/// The name here of an operator of another language.
pub(crate) fn of_operator(name: &str) -> Option<&'static str> {
    named(&OPERATORS, name)
}

/// The message for a function of another language, or a figure of an analysis.
pub(crate) fn of_function(name: &str) -> Option<String> {
    if let Some(known) = named(&FUNCTIONS, name) {
        return Some(format!("unknown function `{name}`; write `{known}(..)`"));
    }
    if matches!(name, "pow" | "power" | "square" | "sqr") {
        return Some(format!(
            "unknown function `{name}`; multiply, as in `x * x`"
        ));
    }
    let stem = ["_s", "_hz"]
        .iter()
        .find_map(|unit| name.strip_suffix(unit));
    let kind = named(&FIGURES, stem.unwrap_or(name))?;
    Some(format!(
        "`{name}` is no function but a figure of a metric; write a [[metrics]] with kind = \"{kind}\""
    ))
}

fn named(names: &[(&str, &'static str)], name: &str) -> Option<&'static str> {
    let (_, known) = names.iter().find(|(foreign, _)| *foreign == name)?;
    Some(known)
}
