//! Names as text, and those that are nearest to an unknown one.

use shared_types::table::nearest;

/// Names as text: `` `a`, `b` ``.
pub fn listed<S: AsRef<str>>(names: &[S]) -> String {
    let names: Vec<String> = names
        .iter()
        .map(|name| format!("`{}`", name.as_ref()))
        .collect();
    names.join(", ")
}

/// The names closest to an unknown one, to be put behind what is said of it; empty if none is close.
pub(crate) fn near<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> String {
    let near = nearest(name, names);
    match near.is_empty() {
        true => String::new(),
        false => format!("; nearest: {}", listed(&near)),
    }
}
