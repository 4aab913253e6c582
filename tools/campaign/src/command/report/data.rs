//! Data for the script of a campaign's page: classes, varied values, margins and metrics by columns, as JSON with
//! base64-encoded numbers.

use crate::folder::Folder;
use crate::shard::missing;
use crate::shard::part::Part;
use crate::table::{ColumnKind, Values};
use hil_config::study::Study;
use serde::Serialize;

use super::envelopes::Envelopes;
use super::numbers::{Codes, Numbers, Singles};
use crate::command::answers::{Answers, CLASSES, classes_in_words, margin, place_of};
use crate::command::quoted;

/// Maximum number of values on a page; with four bytes each in base64, the page stays below 20 MB.
const MOST_NUMBERS: u64 = 3_500_000;
/// Number of columns before the varied values: case, draw, variant, seed.
const HEAD: usize = 4;
/// Number of different texts that a one-byte code can distinguish.
const MOST_TEXTS: usize = 256;

/// Data of the page.
#[derive(Debug, Serialize)]
pub(super) struct Data {
    /// Command that runs a case, without the case number.
    command: String,
    variants: Vec<String>,
    classes: [&'static str; CLASSES.len()],
    /// Names of the classes as displayed.
    words: [&'static str; CLASSES.len()],
    /// Stride between the included draws; 1 if all are included.
    every: u64,
    /// Case numbers; `None` if they are consecutive from 0.
    cases: Option<Numbers>,
    /// Class of each case, as an index into `classes`.
    class: Codes,
    columns: Vec<ColumnData>,
    /// Indices of the two varied values with the strongest correlations with margins.
    axes: Vec<usize>,
    /// Curves over time, if the campaign records them.
    pub(super) envelopes: Option<Envelopes>,
    /// Index of the class column in the table, and of each other column.
    #[serde(skip)]
    class_place: usize,
    #[serde(skip)]
    places: Vec<usize>,
}

#[derive(Debug, Serialize)]
struct ColumnData {
    name: String,
    unit: String,
    /// `varied`, `margin` or `metric`.
    role: &'static str,
    /// Texts to which the codes refer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    texts: Vec<String>,
    #[serde(flatten)]
    values: ColumnValues,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum ColumnValues {
    Numbers(Singles),
    Codes(Codes),
}

impl Data {
    /// Creates the data without cases.
    pub(super) fn new(folder: &Folder, study: &Study) -> Self {
        let manifest = folder.manifest();
        let class_place = HEAD + study.varied.len();
        let (places, columns): (Vec<_>, Vec<_>) = columns(folder, class_place).unzip();
        let results = manifest.columns.iter();
        let requirements = results.filter(|column| column.name.starts_with("verdict."));
        let rows = manifest.cases - manifest.count(&missing(folder));
        let every = (rows * columns.len() as u64).div_ceil(MOST_NUMBERS);
        Self {
            command: format!("hil campaign case {} ", quoted(folder.path())),
            variants: study.variants.iter().map(|one| one.name.clone()).collect(),
            classes: CLASSES,
            words: classes_in_words(requirements.count()),
            every: every.clamp(1, u64::MAX),
            cases: Some(Numbers::default()),
            class: Codes::default(),
            columns,
            axes: Vec::new(),
            envelopes: None,
            class_place,
            places,
        }
    }

    /// Adds the cases of a part.
    pub(super) fn take(&mut self, part: &Part) {
        let table = part.results();
        let classes = &table[self.class_place];
        let variants = self.variants.len() as u64;
        // Whole draws are included or skipped, so that variants are compared on the same values.
        let rows = part.cases().iter().enumerate();
        let rows = rows.filter(|(_, case)| (*case / variants).is_multiple_of(self.every));
        let (rows, cases): (Vec<usize>, Vec<f64>) =
            rows.map(|(row, case)| (row, *case as f64)).unzip();
        self.cases.iter_mut().for_each(|of| of.0.extend(&cases));
        let codes = rows.iter().map(|row| place_of(classes.text(*row)) as u8);
        self.class.0.extend(codes);
        for (column, place) in self.columns.iter_mut().zip(&self.places) {
            let verdicts = (column.role == "margin").then(|| &table[*place - 1]);
            for row in &rows {
                column.push(&table[*place], verdicts, classes, *row);
            }
        }
    }

    /// Adds the data that need all cases.
    pub(super) fn complete(&mut self, answers: &Answers, envelopes: Option<Envelopes>) {
        let is_counted = |cases: &mut Numbers| {
            let mut places = (0_u64..).zip(&cases.0);
            places.all(|(place, case)| place as f64 == *case)
        };
        self.cases.take_if(is_counted);
        self.axes = axes(answers, &self.columns);
        self.envelopes = envelopes;
    }

    /// Returns the number of included cases.
    pub(super) const fn rows(&self) -> usize {
        self.class.0.len()
    }

    /// Returns the stride between the included draws; 1 if all are included.
    pub(super) const fn every(&self) -> u64 {
        self.every
    }

    /// Returns the command that runs a case, without the case number.
    pub(super) fn command(&self) -> &str {
        &self.command
    }
}

impl ColumnData {
    fn push(&mut self, values: &Values, verdicts: Option<&Values>, classes: &Values, row: usize) {
        let number = match values {
            Values::Numbers(numbers) => numbers[row],
            Values::Counts(counts) => counts[row] as f64,
            Values::Texts(_) => self.code(values.text(row)) as f64,
        };
        let number = match verdicts {
            Some(verdicts) => margin(verdicts.text(row), classes.text(row), number),
            None => number,
        };
        match &mut self.values {
            ColumnValues::Numbers(to) => to.0.push(number as f32),
            ColumnValues::Codes(to) => to.0.push(number as u8),
        }
    }

    /// Returns the code of a text, adding new texts; texts beyond the limit share the last code.
    fn code(&mut self, text: &str) -> usize {
        let earlier = self.texts.iter().position(|earlier| earlier == text);
        earlier.unwrap_or_else(|| {
            match self.texts.len() {
                MOST_TEXTS => self.texts[MOST_TEXTS - 1] = "others".into(),
                _ => self.texts.push(text.to_owned()),
            }
            self.texts.len() - 1
        })
    }
}

/// Lists the plotted columns, with their indices in the table.
fn columns(folder: &Folder, class: usize) -> impl Iterator<Item = (usize, ColumnData)> {
    let all = folder.manifest().columns.iter().enumerate();
    all.filter_map(move |(place, column)| {
        let margin = column.name.strip_prefix("robustness.");
        let role = match (column.kind, margin) {
            _ if (HEAD..class).contains(&place) => "varied",
            (ColumnKind::Number, Some(_)) => "margin",
            (ColumnKind::Number, None) if place > class => "metric",
            _ => return None,
        };
        let values = match column.kind {
            ColumnKind::Text => ColumnValues::Codes(Codes::default()),
            ColumnKind::Number | ColumnKind::Count => ColumnValues::Numbers(Singles::default()),
        };
        let name = match role {
            "margin" => margin.unwrap_or_default(),
            _ => &column.name,
        };
        let data = ColumnData {
            name: name.to_owned(),
            unit: column.unit.clone(),
            role,
            texts: Vec::new(),
            values,
        };
        Some((place, data))
    })
}

/// Finds the two varied values with the strongest correlation with any margin; the first two if there are no
/// correlations.
fn axes(answers: &Answers, columns: &[ColumnData]) -> Vec<usize> {
    let requirements = answers.variants.iter().flat_map(|one| &one.requirements);
    let correlations: Vec<&(String, f64)> =
        requirements.flat_map(|one| &one.correlations).collect();
    let strength = |name: &str| {
        let of = correlations.iter().filter(|(key, _)| key == name);
        let sizes = of.map(|(_, rho)| rho.abs());
        sizes.max_by(f64::total_cmp).unwrap_or_default()
    };
    let varied = columns.iter().filter(|column| column.role == "varied");
    let strengths: Vec<f64> = varied.map(|column| strength(&column.name)).collect();
    let mut places: Vec<usize> = (0..strengths.len()).collect();
    places.sort_by(|a, b| strengths[*b].total_cmp(&strengths[*a]));
    places.truncate(2);
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts() -> ColumnData {
        ColumnData {
            name: "table".into(),
            unit: String::new(),
            role: "varied",
            texts: Vec::new(),
            values: ColumnValues::Codes(Codes::default()),
        }
    }

    #[test]
    fn texts_beyond_the_range_of_a_byte_share_the_last_code() {
        let mut column = texts();
        let codes: Vec<usize> = (0..300).map(|n| column.code(&n.to_string())).collect();
        assert_eq!(codes[..256], (0..256).collect::<Vec<_>>());
        assert!(codes[256..].iter().all(|code| *code == 255));
        assert_eq!(column.texts.len(), MOST_TEXTS);
        assert_eq!(column.code("7"), 7);
    }

    #[test]
    fn an_unknown_class_counts_as_lost() {
        let names = ["pass", "fail", "diverged", "undecided", "lost", "vacuous"];
        assert_eq!(names.map(place_of), [0, 1, 2, 3, 4, 5]);
        assert_eq!(["not-possible", "?"].map(place_of), [6, 4]);
    }
}
