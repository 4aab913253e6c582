//! `[panel]`: existing signals and keys.

use super::changes::{self, ChangeContext};
use crate::expression::Columns;
use crate::plan::Panel;
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Returns the panel and reports its problems. Names are looked up if all valid names are known; a pattern may match
/// nothing, for example with another law.
pub(super) fn check(
    reader: &mut Reader,
    root: &Section<'_>,
    columns: Option<&Columns>,
    changed: &ChangeContext<'_>,
) -> Panel {
    let Some(section) = reader.section(root, "panel") else {
        return Panel::default();
    };
    reader.refuse_unknown(&section, &[]);
    let window_s = reader.number(&section, "window_s");
    let own = |name: &str| {
        columns
            .map_or(name, |columns| columns.own_name(name))
            .to_owned()
    };
    let signals: Option<Vec<String>> =
        columns.map(|columns| columns.names().map(Into::into).collect());
    let keys = changes::tunable(changed);
    let own_key = |name: &str| {
        let mut all = keys.iter().flatten();
        let is_alias =
            |(_, aliases): &&(String, Vec<String>)| aliases.iter().any(|one| one == name);
        all.find(is_alias)
            .map_or(name, |(key, _)| key.as_str())
            .to_owned()
    };
    let own_keys = (keys.as_ref()).map(|keys| keys.iter().map(|(key, _)| key.clone()).collect());
    let readings = names(
        reader,
        &section,
        "readings",
        signals,
        "is not a signal of this run",
        own,
    );
    let tune = names(
        reader,
        &section,
        "tune",
        own_keys,
        "cannot be changed during this run",
        own_key,
    );
    let inject = names(reader, &section, "inject", None, "", str::to_owned);
    Panel {
        window_s: window_s.unwrap_or_else(|| Panel::default().window_s),
        readings,
        tune,
        inject,
    }
}

fn names(
    reader: &mut Reader,
    section: &Section<'_>,
    key: &str,
    all_names: Option<Vec<String>>,
    what: &str,
    own: impl Fn(&str) -> String,
) -> Vec<String> {
    if section.table.get(key).is_none() {
        return Vec::new();
    }
    let texts = reader.texts(section, key).unwrap_or_default();
    for (path, place, name) in &texts {
        let is_pattern = name.contains(['*', '?', '[']);
        let Some(all_names) = all_names
            .as_deref()
            .filter(|all_names| !is_pattern && !all_names.contains(&own(name)))
        else {
            continue;
        };
        let message = format!("`{path}` is `{name}`, which {what}");
        let problem = reader.report(ProblemKind::UnknownName, path, place, message);
        problem.nearest(name, all_names.iter().map(String::as_str));
    }
    texts.into_iter().map(|(_, _, name)| own(name)).collect()
}
