//! Converts a fault on the command line to the `[[faults]]` text of a scenario.
//!
//! Uses the words and the list of possible faults, so that keys may be abbreviated and values may be given in order.
//! Checks only names and the number of values: the plant checks the fault itself like a fault of a scenario.

mod text;

use shared_types::describe::{
    ActsOn, FaultDescription, FaultKindDescription, ListDescription, ProfileDescription,
};
use shared_types::live::{Possible, Refusal};
use shared_types::number::counted;
use shared_types::table::{Field, listed, nearest};

use crate::arguments::inject::{InjectArguments, nearest_options};
use crate::session::live::{closest, refusal};
use text::{float, head, profile, rows, string, values};

/// Kind of fault, as needed for the command line.
struct FaultKind<'a> {
    name: &'a str,
    target: TargetKey<'a>,
    fields: Vec<&'a Field>,
    list: Option<&'a ListDescription>,
}

/// Form in which an effect of a kind refers to its target.
#[derive(Clone, Copy, PartialEq, Eq)]
enum TargetKey<'a> {
    /// Number of a part of the plant, `actuator = 1`.
    Selector(&'a str),
    /// Name, `target = "link.sample"`; contains the only target of the kind if it has just one.
    Name(Option<&'static str>),
    /// No target key: the target is the plant.
    Plant,
}

/// Meaning of a key on the command line.
#[derive(Clone, Copy)]
enum Key<'a> {
    Selector,
    Field(&'a Field),
    List(&'a ListDescription),
}

/// Words sorted by meaning.
#[derive(Default)]
struct Sorted<'a> {
    targets: Vec<String>,
    /// Values of each parameter: a common value, or one for each target.
    values: Vec<(&'a Field, Vec<String>)>,
    list: Option<(&'a ListDescription, String)>,
}

/// Returns the requested fault as the text of a scenario.
///
/// # Errors
/// All words that cannot be understood.
pub fn toml(arguments: &InjectArguments, possible: &Possible) -> Result<String, Vec<Refusal>> {
    let kind = FaultKind::find(arguments.kind.as_deref().unwrap_or_default(), possible)?;
    let sorted = kind.sort(arguments)?;
    let mut refusals = Vec::new();
    let profile = profile(arguments).unwrap_or_else(|refusal| {
        refusals.push(refusal);
        None
    });
    let count = sorted.targets.len();
    let mut check_count = |name: &str, number: usize| {
        if number != 1 && number != count {
            let values = if count == 1 {
                "1 value".into()
            } else {
                format!("1 value for all, or {count}")
            };
            let targets = if count == 1 { "target" } else { "targets" };
            let number = counted(number as u64, "value");
            let message = format!("`{name}` has {number} for {count} {targets}");
            refusals.push(refusal(name, message, values));
        }
    };
    for (field, values) in &sorted.values {
        check_count(&field.name, values.len());
    }
    if !arguments.skew.is_empty() {
        check_count("skew", arguments.skew.len());
    }
    if !refusals.is_empty() {
        return Err(refusals);
    }
    let mut text = head(kind.name, arguments);
    for (index, target) in sorted.targets.iter().enumerate() {
        text += "[[faults.effects]]\n";
        match kind.target {
            TargetKey::Selector(selector) => text += &format!("{selector} = {target}\n"),
            TargetKey::Plant => {}
            TargetKey::Name(_) => text += &format!("target = {}\n", string(target)),
        }
        for (field, values) in &sorted.values {
            text += &format!("{} = {}\n", field.name, values[index % values.len()]);
        }
        if let Some((list, rows)) = &sorted.list {
            text += &format!("{} = {rows}\n", list.key);
        }
        if let Some(profile) = &profile {
            text += &format!("profile = {profile}\n");
        }
        if !arguments.skew.is_empty() {
            let skew_s = arguments.skew[index % arguments.skew.len()];
            text += &format!("skew_s = {}\n", float(skew_s));
        }
    }
    Ok(text)
}

impl<'a> FaultKind<'a> {
    fn find(name: &str, possible: &'a Possible) -> Result<Self, Vec<Refusal>> {
        let own = possible.plant.faults.iter().map(Self::of_plant);
        let shared = possible.kinds.iter().map(Self::shared);
        let mut kinds: Vec<Self> = own.chain(shared).collect();
        if let Some(place) = kinds.iter().position(|kind| kind.name == name) {
            return Ok(kinds.swap_remove(place));
        }
        let names = kinds.iter().map(|kind| kind.name);
        let message = format!("plant `{}` has no fault `{name}`", possible.plant.name);
        let expected = "a kind that `hil inject --list` shows";
        Err(vec![Refusal {
            nearest: closest(name, names),
            ..refusal("kind", message, expected.into())
        }])
    }

    fn of_plant(described: &'a FaultDescription) -> Self {
        let mut fields: Vec<&Field> = described.sizes.iter().collect();
        if let ProfileDescription::Exponential { speed } = &described.profile {
            fields.push(speed);
        }
        Self {
            name: &described.kind,
            target: match &described.selector {
                Some(selector) => TargetKey::Selector(selector),
                None => TargetKey::Plant,
            },
            fields,
            list: None,
        }
    }

    fn shared(described: &'a FaultKindDescription) -> Self {
        let only = (described.acts_on == ActsOn::Controller).then_some("controller");
        Self {
            name: &described.kind,
            target: TargetKey::Name(only),
            fields: described.parameters.iter().collect(),
            list: described.list.as_ref(),
        }
    }

    /// Separates keys, targets and values.
    fn sort(&self, arguments: &InjectArguments) -> Result<Sorted<'a>, Vec<Refusal>> {
        let mut refusals = Vec::new();
        let mut sorted = Sorted::default();
        let mut words = arguments.words.iter().peekable();
        for (key, value) in &arguments.parameter {
            let result = match self.key(key) {
                Ok(Key::Selector) if sorted.targets.is_empty() => {
                    self.targets(value).map(|targets| sorted.targets = targets)
                }
                Ok(Key::Field(field))
                    if sorted
                        .values
                        .iter()
                        .all(|(other, _)| other.name != field.name) =>
                {
                    values(field, value).map(|values| sorted.values.push((field, values)))
                }
                Ok(Key::List(list)) if sorted.list.is_none() => {
                    rows(list, value).map(|rows| sorted.list = Some((list, rows)))
                }
                Ok(_) => Err(Refusal {
                    key: key.clone(),
                    ..Refusal::new(format!("`--{key}` is given twice"))
                }),
                Err(refusal) => Err(refusal),
            };
            refusals.extend(result.err());
        }
        if sorted.targets.is_empty() {
            // The only target of a kind may be omitted.
            let only = match self.target {
                TargetKey::Name(only) => only,
                TargetKey::Plant => Some("plant"),
                TargetKey::Selector(_) => None,
            };
            let word = match only {
                Some(only) => words
                    .next_if(|word| *word == only)
                    .map_or(only, String::as_str),
                None => words.next().map_or("", String::as_str),
            };
            match self.targets(word) {
                Ok(targets) => sorted.targets = targets,
                Err(refusal) => refusals.push(refusal),
            }
        }
        let words: Vec<&String> = words.collect();
        if let Some(other) = words.first()
            && self.is_other_target(other)
        {
            let kind = self.name;
            let message = format!("`{kind}` does not act on `{other}`");
            let expected = match self.target {
                TargetKey::Name(Some(only)) => {
                    format!("`{only}`, or no target, because it is the only one")
                }
                _ => "no target, because it acts on the plant".into(),
            };
            refusals.push(refusal("target", message, expected));
            return Err(refusals);
        }
        let is_open = |field: &&&'a Field| {
            sorted
                .values
                .iter()
                .all(|(other, _)| other.name != field.name)
        };
        let open: Vec<&'a Field> = self.fields.iter().filter(is_open).copied().collect();
        if words.len() > open.len() {
            let names: Vec<&str> = open.iter().map(|field| field.name.as_str()).collect();
            let (count, name) = (words.len(), self.name);
            let message = format!(
                "`{name}` expects {} more, not {count}: {}",
                counted(open.len() as u64, "value"),
                listed(&words)
            );
            let expected = if names.is_empty() {
                "no additional value".to_owned()
            } else {
                format!("values for {}", listed(&names))
            };
            refusals.push(refusal("", message, expected));
        }
        for (field, word) in open.into_iter().zip(words) {
            match values(field, word) {
                Ok(values) => sorted.values.push((field, values)),
                Err(refusal) => refusals.push(refusal),
            }
        }
        let place = |field: &Field| self.fields.iter().position(|one| one.name == field.name);
        sorted.values.sort_by_key(|(field, _)| place(field));
        if refusals.is_empty() {
            Ok(sorted)
        } else {
            Err(refusals)
        }
    }

    /// Returns `true` if a word at the beginning of the values is a target, for a kind with only one target.
    fn is_other_target(&self, word: &str) -> bool {
        let has_one = matches!(self.target, TargetKey::Name(Some(_)) | TargetKey::Plant);
        let names = ["plant", "controller"];
        let groups = ["measured.", "reference.", "command.", "parameter.", "link."];
        has_one && (names.contains(&word) || groups.iter().any(|group| word.starts_with(group)))
    }

    /// Finds the key by its name, or by its first words if they are unambiguous.
    fn key(&self, typed: &str) -> Result<Key<'a>, Refusal> {
        let mut keys: Vec<(&str, Key<'a>)> = Vec::new();
        if let TargetKey::Selector(selector) = self.target {
            keys.push((selector, Key::Selector));
        }
        keys.extend(
            self.fields
                .iter()
                .map(|field| (field.name.as_str(), Key::Field(field))),
        );
        keys.extend(self.list.map(|list| (list.key.as_str(), Key::List(list))));
        if let Some((_, key)) = keys.iter().find(|(name, _)| *name == typed) {
            return Ok(*key);
        }
        let begins = |name: &str| {
            name.strip_prefix(typed)
                .is_some_and(|rest| rest.starts_with('_'))
        };
        let candidates: Vec<_> = keys.iter().filter(|(name, _)| begins(name)).collect();
        if let [(_, key)] = candidates[..] {
            return Ok(*key);
        }
        let names = |keys: &[&(&str, Key<'_>)]| {
            keys.iter()
                .map(|(name, _)| (*name).to_owned())
                .collect::<Vec<_>>()
        };
        let kind = self.name;
        Err(if candidates.is_empty() {
            let all = names(&keys.iter().collect::<Vec<_>>());
            let option = nearest_options(typed).into_iter().next();
            // Suggests an option if none of the keys is closer.
            let option = option.filter(|option| {
                let option = option["--".len()..].replace('-', "_");
                let names = all.iter().map(String::as_str).chain([option.as_str()]);
                nearest(typed, names).first() == Some(&option.as_str())
            });
            let near = closest(typed, all.iter().map(String::as_str));
            let message =
                format!("`{kind}` has no key `{typed}`, and hil has no option `--{typed}`");
            let expected = if all.is_empty() {
                "no key".to_owned()
            } else {
                format!("one of {}", listed(&all))
            };
            Refusal {
                nearest: option.into_iter().chain(near).collect(),
                ..refusal(typed, message, expected)
            }
        } else {
            let message = format!("`--{typed}` matches more than one key of `{kind}`");
            refusal(
                typed,
                message,
                format!("one of {}", listed(&names(&candidates))),
            )
        })
    }

    /// Parses the targets in a word; for a kind with a selector, `1` and `actuator1` are equivalent.
    fn targets(&self, word: &str) -> Result<Vec<String>, Refusal> {
        let kind = self.name;
        let targets = word.split(',').map(str::trim);
        let TargetKey::Selector(selector) = self.target else {
            let targets: Vec<String> = targets.map(Into::into).collect();
            return if targets.iter().any(String::is_empty) {
                let expected = format!("a target that `hil inject --list --kind {kind}` shows");
                let message = format!("`{kind}` needs a target");
                Err(refusal("target", message, expected))
            } else {
                Ok(targets)
            };
        };
        let number = |target: &str| {
            let number = target.strip_prefix(selector).unwrap_or(target);
            number.parse::<u32>().ok().map(|number| number.to_string())
        };
        targets.map(number).collect::<Option<_>>().ok_or_else(|| {
            let message = if word.is_empty() {
                format!("`{kind}` needs `--{selector}`")
            } else {
                format!("`{word}` is not a valid {selector}")
            };
            let expected = format!("numbers, for example `--{selector} 1,2`");
            refusal(selector, message, expected)
        })
    }
}

#[cfg(test)]
pub(crate) mod tests;
