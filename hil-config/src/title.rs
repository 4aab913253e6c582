//! Names of scenarios, studies, ports and requirements, which become parts of folder names, and identifiers of
//! requirements in other documents. Never names of signals.

/// Rule for names of scenarios, studies and requirements.
pub(crate) const TITLE: &str = "1 to 64 letters, digits, - and _";

/// Returns `true` if a text is a valid name of a scenario, a study or a requirement.
pub(crate) fn is_title(name: &str) -> bool {
    let legal = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    (1..=64).contains(&name.len()) && name.chars().all(legal)
}

/// Rule for identifiers of requirements in other documents.
pub(crate) const IDENTIFIER: &str = "1 to 64 letters, digits, -, _ and .";

/// Returns `true` if a text is a valid identifier of a requirement in another document.
pub(crate) fn is_identifier(id: &str) -> bool {
    let legal = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    (1..=64).contains(&id.len()) && id.chars().all(legal)
}
