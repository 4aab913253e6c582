//! Spellings of other languages: the equivalents of foreign symbols, operators and functions.
//!
//! Consulted only for a text that is refused anyway, so that no signal name is mistaken for foreign syntax.

/// Symbols of other languages and their equivalents, the longer ones first.
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

/// Operators and words of other languages and their equivalents.
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

/// Functions of other languages and their equivalents.
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

/// Figures of predefined analyses, without their units, and the metric kind that provides them.
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

const NO_REMAINDER: &str = "there is no operator `%` for a remainder";

/// Returns the message for a leading symbol of another language, and the length of the text concerned. Bars denote a
/// magnitude where an operand is expected.
pub(super) fn of_symbol(text: &str, expects_operand: bool) -> Option<(usize, String)> {
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
    if text.starts_with('%') {
        return Some((1, NO_REMAINDER.into()));
    }
    if expects_operand && let Some((length, call)) = magnitude(text) {
        return Some((length, format!("write `{call}` for a magnitude")));
    }
    if text.starts_with('|') && !text.starts_with("||") {
        let message = "unknown operator `|`; write `or`, or `abs(x)` for a magnitude";
        return Some((1, message.into()));
    }
    let (symbol, name) = SYMBOLS
        .iter()
        .find(|(symbol, _)| text.starts_with(symbol))?;
    Some((
        symbol.len(),
        format!("unknown operator `{symbol}`; write `{name}`"),
    ))
}

/// Returns the message for two dots after a number, or for two dots alone, and the length of the text concerned.
pub(super) fn of_range(text: &str) -> Option<(usize, String)> {
    let belongs = |c: char| c.is_alphanumeric() || matches!(c, '.' | '%');
    let word = &text[..text.find(|c| !belongs(c)).unwrap_or(text.len())];
    let (from, _) = word.split_once("..")?;
    let rest = &text[from.len() + "..".len()..];
    let behind = rest.trim_start_matches(['.', '=']);
    let to = &behind[..behind.find(|c| !belongs(c)).unwrap_or(behind.len())];
    if from.is_empty() || to.is_empty() {
        let message = "unknown `..`; write `,` between the ends of a window";
        return Some((from.len() + 2, message.into()));
    }
    let length = text.len() - behind.len() + to.len();
    let range = &text[..length];
    let message = format!("unknown range `{range}`; write `{from}, {to}`");
    Some((length, message))
}

/// Returns the remaining factors of a unit that begins with a percent sign, if any: `m` of `% m`.
pub(super) fn of_percentage(symbol: &str) -> Option<&str> {
    let factors = symbol.strip_prefix('%')?;
    let factors = factors.trim_start_matches([' ', '\u{b7}', '\u{22c5}']);
    let is_quotient = factors.starts_with('/');
    (!factors.is_empty() && !is_quotient).then_some(factors)
}

/// Converts a leading magnitude between bars into a call of `abs`, and returns its length. Bars may be nested: a bar
/// closes a magnitude after an operand and opens one elsewhere.
fn magnitude(text: &str) -> Option<(usize, String)> {
    text.strip_prefix('|')?;
    let mut call = String::new();
    let mut open = Vec::new();
    for (at, c) in text.char_indices() {
        match c {
            '|' if !ends_operand(&call) => {
                open.push('|');
                call += "abs(";
            }
            '|' | ')' => {
                let opened = if c == '|' { '|' } else { '(' };
                open.pop().filter(|last| *last == opened)?;
                call.truncate(call.trim_end().len());
                call.push(')');
            }
            ' ' if call.ends_with('(') => {}
            _ => {
                open.extend(Some(c).filter(|c| *c == '('));
                call.push(c);
            }
        }
        if open.is_empty() {
            return Some((at + c.len_utf8(), call));
        }
    }
    None
}

/// Returns `true` if a text ends with a number, a name or a closing parenthesis, but not with a conjunction.
fn ends_operand(text: &str) -> bool {
    let text = text.trim_end();
    let is_of_word = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.' | '%' | '\u{b0}');
    let word = text.rsplit(|c| !is_of_word(c)).next().unwrap_or_default();
    match word {
        "" => text.ends_with(')'),
        _ => !matches!(word, "and" | "or" | "not"),
    }
}

/// Returns the equivalent of an operator of another language.
pub(crate) fn of_operator(name: &str) -> Option<&'static str> {
    named(&OPERATORS, name)
}

/// Returns the message for a function of another language, or a figure of an analysis.
pub(crate) fn of_function(name: &str) -> Option<String> {
    if let Some(equivalent) = named(&FUNCTIONS, name) {
        return Some(format!(
            "unknown function `{name}`; write `{equivalent}(..)`"
        ));
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
        "`{name}` is not a function but a figure of a metric; add a [[metrics]] with kind = \"{kind}\""
    ))
}

fn named(names: &[(&str, &'static str)], name: &str) -> Option<&'static str> {
    let (_, equivalent) = names.iter().find(|(foreign, _)| *foreign == name)?;
    Some(equivalent)
}
