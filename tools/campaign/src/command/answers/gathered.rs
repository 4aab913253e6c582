//! Columns that the evaluation needs of each case, gathered while the parts of a campaign are read.

use crate::folder::Folder;
use crate::manifest::Manifest;
use crate::shard::part::Part;
use crate::table::{CLASS, Column, ColumnKind};
use hil_config::study::Study;

use super::outcomes::Outcomes;
use super::{CLASSES, margin, place_of};

/// Cases of one variant, by columns.
#[derive(Default)]
pub(super) struct Cases {
    pub(super) case: Vec<u64>,
    pub(super) classes: [u64; CLASSES.len()],
    pub(super) diverged: Vec<u64>,
    /// Varied numbers.
    pub(super) varied: Vec<Vec<f64>>,
    /// For each requirement, the number of cases that meet it.
    pub(super) holds: Vec<u64>,
    /// For each requirement, the margin of each case.
    pub(super) margins: Vec<Vec<f64>>,
}

/// Cases of a campaign.
pub(in crate::command) struct Gathered<'a> {
    pub(super) manifest: &'a Manifest,
    pub(super) study: &'a Study,
    /// Columns of varied numbers.
    pub(super) varied: Vec<&'a Column>,
    /// Requirements by name and unit.
    pub(super) requirements: Vec<(String, String)>,
    pub(super) variants: Vec<Cases>,
    /// Table of faults, of a campaign that tries some.
    pub(super) outcomes: Option<Outcomes<'a>>,
    places: Places,
}

/// Indices of columns in the table of results.
struct Places {
    class: usize,
    varied: Vec<usize>,
    /// Columns of verdict and robustness of each requirement.
    requirements: Vec<[usize; 2]>,
}

impl<'a> Gathered<'a> {
    /// Creates the columns without any cases.
    pub(in crate::command) fn new(folder: &'a Folder, study: &'a Study) -> Self {
        let manifest = folder.manifest();
        let columns = &manifest.columns;
        let is_varied = |column: &Column| {
            column.kind == ColumnKind::Number
                && study.varied.iter().any(|one| one.name == column.name)
        };
        let varied = columns.iter().enumerate();
        let varied = varied.filter(|(_, column)| is_varied(column));
        let (places_varied, varied): (Vec<usize>, Vec<&Column>) = varied.unzip();
        let required = columns
            .iter()
            .enumerate()
            .filter_map(|(robustness, column)| {
                let name = column.name.strip_prefix("robustness.")?;
                let verdict = manifest
                    .place(&format!("verdict.{name}"))
                    .unwrap_or_default();
                Some((
                    (name.to_owned(), column.unit.clone()),
                    [verdict, robustness],
                ))
            });
        let (requirements, places_requirements): (Vec<_>, Vec<_>) = required.unzip();
        let empty = || Cases {
            varied: vec![Vec::new(); varied.len()],
            holds: vec![0; requirements.len()],
            margins: vec![Vec::new(); requirements.len()],
            ..Cases::default()
        };
        Self {
            manifest,
            study,
            variants: study.variants.iter().map(|_| empty()).collect(),
            varied,
            requirements,
            outcomes: Outcomes::new(folder, study),
            places: Places {
                class: manifest.place(CLASS).unwrap_or_default(),
                varied: places_varied,
                requirements: places_requirements,
            },
        }
    }

    /// Adds the cases of a part.
    pub(in crate::command) fn take(&mut self, part: &Part) {
        self.outcomes.iter_mut().for_each(|table| table.take(part));
        let columns = part.results();
        let Places {
            class,
            varied,
            requirements,
        } = &self.places;
        let variants = self.variants.len() as u64;
        for (row, case) in part.cases().iter().enumerate() {
            let variant = usize::try_from(case % variants).unwrap_or_default();
            let of = &mut self.variants[variant];
            let class = columns[*class].text(row);
            of.classes[place_of(class)] += 1;
            of.case.push(*case);
            let has_diverged = class == "diverged";
            if has_diverged {
                of.diverged.push(*case);
            }
            for (values, place) in of.varied.iter_mut().zip(varied) {
                values.push(columns[*place].number(row));
            }
            let margins = of.holds.iter_mut().zip(&mut of.margins);
            for ((holds, margins), [verdict, robustness]) in margins.zip(requirements) {
                let verdict = columns[*verdict].text(row);
                *holds += u64::from(verdict == "pass" && !has_diverged);
                margins.push(margin(verdict, class, columns[*robustness].number(row)));
            }
        }
    }
}
