//! `[[plots]]` of a scenario, written anew for plots that were arranged by hand.
//!
//! Used by the panel. The scenario's text is edited, so that everything else keeps its form and its comments, and so
//! does a plot that was there before. Plots that were not shown, such as spectra and those of other laws, follow
//! behind. Reads and writes no file.

use hil_recording::reader::Column;
use serde_json::json;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, Value, value};

use super::bounds::Bound;
use super::signal::recorded_name;
use super::{Plot, Subject, limit};

/// Key of the plots.
const PLOTS: &str = "plots";
/// Key that turns further plots off.
const FURTHER: &str = "further_plots";

/// Plot over time as arranged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Arranged {
    /// Title.
    pub title: String,
    /// Title of the plot of the scenario that it was.
    pub was: Option<String>,
    /// Signals as expressions name them.
    pub signals: Vec<String>,
    /// `true` for a logarithmic axis of magnitudes.
    pub is_log: bool,
}

/// All plots of an arrangement.
#[derive(Clone, Debug)]
pub(crate) struct Arrangement {
    pub plots: Vec<Arranged>,
    /// Titles of the plots of the scenario before: those that are not among `plots` were removed.
    pub titles_before: Vec<String>,
    /// `true` if no further plots may follow, because a signal was removed from all of them.
    pub is_all: bool,
    /// Law of the run: the law of plots with signals that only this law is known to have.
    pub law: String,
}

impl Arrangement {
    /// Returns the text of a scenario with these plots.
    ///
    /// # Errors
    /// If the text is not TOML, or its plots are no tables.
    pub(crate) fn in_scenario(&self, text: &str) -> Result<String, String> {
        Ok(self.document(text)?.to_string())
    }

    /// Returns the part of that text that has the plots.
    ///
    /// # Errors
    /// As [`in_scenario`](Self::in_scenario).
    pub(crate) fn alone(&self, text: &str) -> Result<String, String> {
        let mut document = self.document(text)?;
        document.retain(|key, _| [PLOTS, FURTHER].contains(&key));
        document.set_trailing("");
        Ok(format!("{}\n", document.to_string().trim()))
    }

    fn document(&self, text: &str) -> Result<DocumentMut, String> {
        let mut document: DocumentMut = text.parse().map_err(|error| format!("{error}"))?;
        let mut before: Vec<Option<Table>> = match document.get(PLOTS) {
            None => Vec::new(),
            Some(item) => match item.clone().into_array_of_tables() {
                Ok(tables) => tables.into_iter().map(Some).collect(),
                Err(_) => return Err("`plots` is no list of tables".into()),
            },
        };
        // Where the first of them stood, else behind every other table.
        let position = before.iter().flatten().find_map(Table::position);
        let position = position.unwrap_or(isize::MAX);
        let mut plots = ArrayOfTables::new();
        for one in &self.plots {
            let place = self.place_of(one, &before);
            let table = place.and_then(|place| before[place].take());
            plots.push(self.table(one, table));
        }
        let was_there = |table: &Table| {
            let title = title_of(table).filter(|_| self.is_of(table));
            title.is_some_and(|title| self.titles_before.contains(title))
        };
        (before.into_iter().flatten())
            .filter(|table| !was_there(table))
            .for_each(|table| plots.push(table));
        (plots.iter_mut()).for_each(|table| table.set_position(Some(position)));
        document.remove(PLOTS);
        if !plots.is_empty() {
            document.insert(PLOTS, Item::ArrayOfTables(plots));
        }
        if self.is_all {
            set(&mut document, FURTHER, false.into());
        }
        Ok(document)
    }

    /// Returns the place of the table of a plot: that of the plot which it was or, if an earlier arrangement wrote it,
    /// that of its title.
    fn place_of(&self, one: &Arranged, tables: &[Option<Table>]) -> Option<usize> {
        let place = |title: &String| {
            tables.iter().position(|table| {
                let table = table.as_ref().filter(|table| self.is_of(table));
                table.and_then(title_of) == Some(title) && self.titles_before.contains(title)
            })
        };
        one.was
            .as_ref()
            .and_then(place)
            .or_else(|| place(&one.title))
    }

    /// Returns `true` for a plot over time, the only kind that can be arranged, that is for the law of the run.
    fn is_of(&self, table: &Table) -> bool {
        let is_over_time = (table.get("kind")).is_none_or(|kind| kind.as_str() == Some("time"));
        let laws = table.get("laws").and_then(Item::as_array);
        let is_law = |law: &Value| law.as_str() == Some(&self.law);
        is_over_time && laws.is_none_or(|laws| laws.is_empty() || laws.iter().any(is_law))
    }

    /// Returns the table of a plot, made of the one that it had.
    fn table(&self, one: &Arranged, table: Option<Table>) -> Table {
        let is_new = table.is_none();
        let mut table = table.unwrap_or_default();
        set(&mut table, "title", one.title.as_str().into());
        let names = |table: &Table| -> Option<Vec<String>> {
            let names = table.get("signals")?.as_array()?.iter();
            names.map(|name| name.as_str().map(Into::into)).collect()
        };
        let is_changed = is_new || names(&table).as_ref() != Some(&one.signals);
        if is_changed {
            let signals: Array = one.signals.iter().collect();
            set(&mut table, "signals", signals.into());
            let is_of_law = |name: &String| name.starts_with("internal.");
            if one.signals.iter().any(is_of_law) && !table.contains_key("laws") {
                let laws: Array = std::iter::once(self.law.as_str()).collect();
                set(&mut table, "laws", laws.into());
            }
        }
        let was_log = table.get("scale").and_then(Item::as_str) == Some("log");
        match (was_log, one.is_log) {
            (false, true) => set(&mut table, "scale", "log".into()),
            (true, false) => {
                table.remove("scale");
            }
            _ => {}
        }
        table
    }
}

/// Describes a signal to a page that arranges plots: name, unit and the limits of requirements on it.
pub(crate) fn signal_json(column: &Column, bounds: &[Bound]) -> serde_json::Value {
    let mut plot = Plot {
        signals: vec![recorded_name(&column.name)],
        ..Plot::default()
    };
    let bounds = bounds.to_vec();
    limit(
        &mut plot,
        &[Subject {
            bounds,
            ..Subject::default()
        }],
    );
    let mut signal = json!({ "name": column.name, "unit": column.unit });
    if !plot.limits.is_empty() {
        signal["limits"] = json!(plot.limits);
    }
    signal
}

fn title_of(table: &Table) -> Option<&String> {
    match table.get("title")?.as_value()? {
        Value::String(title) => Some(title.value()),
        _ => None,
    }
}

/// Sets a value and preserves the comments around it; an equal one keeps its form.
fn set(table: &mut Table, key: &str, mut new: Value) {
    match table.get_mut(key).and_then(Item::as_value_mut) {
        Some(before) if is_same(before, &new) => {}
        Some(before) => {
            *new.decor_mut() = before.decor().clone();
            *before = new;
        }
        None => {
            table.insert(key, value(new));
        }
    }
}

fn is_same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::String(a), Value::String(b)) => a.value() == b.value(),
        (Value::Boolean(a), Value::Boolean(b)) => a.value() == b.value(),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENARIO: &str = "\
schema = 1 # the first
name = 'x'

# A run.
[run]
duration_s = 1.0

# The position.
[[plots]]
title = 'Position' # in m
signals = ['reference.x_m', 'truth.x_m']

[[plots]]
title = \"Force\"
signals = [\"internal.v\"]
laws = [\"other\"]

[[plots]]
title = \"Force\"
kind = \"time\"
scale = \"log\"
lines = [1.0]
signals = [\"command.u_n\"]

[[plots]]
title = \"Force\"
kind = \"spectrum\"
signals = [\"command.u_n\"]

# Judged at the end.
[[requirements]]
name = \"r\"
";

    fn plot(title: &str, was: Option<&str>, signals: &[&str], is_log: bool) -> Arranged {
        Arranged {
            title: title.into(),
            was: was.map(Into::into),
            signals: signals.iter().map(|name| (*name).to_owned()).collect(),
            is_log,
        }
    }

    fn arrangement(plots: Vec<Arranged>) -> Arrangement {
        Arrangement {
            plots,
            titles_before: vec!["Position".into(), "Force".into()],
            is_all: false,
            law: "pid".into(),
        }
    }

    #[test]
    fn plots_get_their_order_and_everything_else_keeps_its_form() {
        let arranged = arrangement(vec![
            plot("Force", Some("Force"), &["command.u_n"], true),
            plot("Estimate", None, &["internal.z", "truth.x_m"], false),
            plot(
                "Position",
                Some("Position"),
                &["reference.x_m", "truth.x_m"],
                false,
            ),
        ]);
        let text = arranged.in_scenario(SCENARIO).expect("TOML");
        let expected = "\
schema = 1 # the first
name = 'x'

# A run.
[run]
duration_s = 1.0

[[plots]]
title = \"Force\"
kind = \"time\"
scale = \"log\"
lines = [1.0]
signals = [\"command.u_n\"]

[[plots]]
title = \"Estimate\"
signals = [\"internal.z\", \"truth.x_m\"]
laws = [\"pid\"]

# The position.
[[plots]]
title = 'Position' # in m
signals = ['reference.x_m', 'truth.x_m']

[[plots]]
title = \"Force\"
signals = [\"internal.v\"]
laws = [\"other\"]

[[plots]]
title = \"Force\"
kind = \"spectrum\"
signals = [\"command.u_n\"]

# Judged at the end.
[[requirements]]
name = \"r\"
";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_removed_plot_goes_and_what_was_never_shown_stays() {
        let mut arranged = arrangement(vec![plot("Place", Some("Position"), &["truth.x_m"], true)]);
        arranged.is_all = true;
        let text = arranged.alone(SCENARIO).expect("TOML");
        let expected = "\
further_plots = false

# The position.
[[plots]]
title = \"Place\" # in m
signals = [\"truth.x_m\"]
scale = \"log\"

[[plots]]
title = \"Force\"
signals = [\"internal.v\"]
laws = [\"other\"]

[[plots]]
title = \"Force\"
kind = \"spectrum\"
signals = [\"command.u_n\"]
";
        assert_eq!(text, expected);
        let text = arranged.in_scenario(SCENARIO).expect("TOML");
        assert!(
            text.starts_with(
                "schema = 1 # the first\nname = 'x'\nfurther_plots = false\n\n# A run.\n[run]\n"
            ),
            "{text}"
        );
    }

    #[test]
    fn a_scenario_without_plots_gets_them_behind_everything_and_loses_them_again() {
        let plain = "schema = 1\n\n[run]\nduration_s = 1.0 # s\n";
        let mut arranged = arrangement(vec![plot("A", None, &["truth.x_m"], false)]);
        let text = arranged.in_scenario(plain).expect("TOML");
        assert_eq!(
            text,
            format!("{plain}\n[[plots]]\ntitle = \"A\"\nsignals = [\"truth.x_m\"]\n")
        );
        arranged.titles_before = vec!["A".into()];
        // Written before by this hand: it is found by its title.
        assert_eq!(arranged.in_scenario(&text).expect("TOML"), text);
        arranged.plots.clear();
        assert_eq!(arranged.in_scenario(&text).expect("TOML"), plain);
        let inline = "plots = [{ title = \"A\", signals = [\"truth.x_m\"] }]\n";
        let text = arranged.in_scenario(inline).expect("TOML");
        assert_eq!(text, "");
        assert!(arranged.in_scenario("plots = 3").is_err());
        assert!(arranged.in_scenario("plots = [").is_err());
    }
}
