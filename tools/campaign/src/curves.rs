//! Curves of many cases: pictures, no results.
//!
//! A shard keeps the envelope of its cases, the curves of some draws, which stand for all, and those of the worst
//! cases. Rows, digest and comparisons know nothing of it: a shard whose curves are lost still has its result.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

use hil_facts::results::curve::{Curve, Grid};
use serde::{Deserialize, Serialize};

use crate::folder::Folder;
use crate::journal;
use crate::manifest::Manifest;
use crate::table::{CLASS, LOST, Row};

/// Name of the file in the folder of a shard.
pub(crate) const CURVES: &str = "curves.json";
/// Class of cases whose values grow beyond every scale.
const DIVERGED: &str = "diverged";
/// First part of the names of columns with margins.
const MARGIN: &str = "robustness.";

/// The case of the least margin.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Worst {
    /// Variant.
    pub variant: String,
    /// Requirement.
    pub requirement: String,
    /// Number of the case.
    pub case: u64,
    /// Margin.
    pub margin: f64,
    /// Curve.
    pub curve: Curve,
}

/// Shard that curves are of.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Identity of its campaign.
    pub campaign: String,
    /// Number of the shard.
    pub shard: u64,
}

/// Curves of a shard, or of several.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Curves {
    /// Least and greatest values of all cases of each variant.
    pub envelopes: BTreeMap<String, Curve>,
    /// Curves of the draws that stand for all, by case.
    pub sampled: BTreeMap<u64, Curve>,
    /// The worst case of each variant and requirement.
    pub worst: Vec<Worst>,
    /// Shard that they are of; none of several, and of files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
}

impl Curves {
    /// Takes the curve of a case by its row; tells whether anything is different now, so that it must be kept.
    /// Cases that diverged or have no result leave no curve: one of them would hide all others.
    pub(crate) fn take(&mut self, manifest: &Manifest, row: &Row, curve: &Curve) -> bool {
        let Some(grid) = manifest.curves.as_ref().filter(|grid| curve.fits(grid)) else {
            return false;
        };
        let cells = || manifest.columns.iter().zip(row);
        let cell = |name: &str| cells().find(|(column, _)| column.name == name);
        let text = |name: &str| cell(name).map_or("", |(_, cell)| cell.as_text());
        let count = |name: &str| cell(name).map_or(0, |(_, cell)| cell.as_count());
        if [DIVERGED, LOST].contains(&text(CLASS)) {
            return false;
        }
        let (case, variant) = (count("case"), text("variant"));
        let mut is_needed = self.widen(variant, curve);
        if count("draw").is_multiple_of(grid.every) {
            self.sampled.insert(case, curve.clone());
            is_needed = true;
        }
        for (column, cell) in cells() {
            let requirement = column.name.strip_prefix(MARGIN);
            let margin = cell.as_number().filter(|margin| margin.is_finite());
            if let Some((requirement, margin)) = requirement.zip(margin) {
                is_needed |= self.worse(Worst {
                    variant: variant.into(),
                    requirement: requirement.into(),
                    case,
                    margin,
                    curve: curve.clone(),
                });
            }
        }
        is_needed
    }

    /// Takes those of another shard.
    pub(crate) fn join(&mut self, other: Self) {
        for (variant, curve) in &other.envelopes {
            self.widen(variant, curve);
        }
        self.sampled.extend(other.sampled);
        for worst in other.worst {
            self.worse(worst);
        }
    }

    fn widen(&mut self, variant: &str, curve: &Curve) -> bool {
        match self.envelopes.get_mut(variant) {
            Some(known) => known.widen(curve),
            None => {
                self.envelopes.insert(variant.into(), curve.clone());
                true
            }
        }
    }

    /// Keeps a case if it is worse than the one that is known; of equal ones the first.
    fn worse(&mut self, new: Worst) -> bool {
        let is_of = |known: &&mut Worst| {
            (&known.variant, &known.requirement) == (&new.variant, &new.requirement)
        };
        match self.worst.iter_mut().find(is_of) {
            Some(known) => {
                let order = new.margin.total_cmp(&known.margin);
                let is_worse = order.then(new.case.cmp(&known.case)).is_lt();
                if is_worse {
                    *known = new;
                }
                is_worse
            }
            None => {
                self.worst.push(new);
                true
            }
        }
    }

    /// Returns `true` if they are of a shard: by the origin that they name, and by their cases.
    fn is_of(&self, folder: &Folder, number: u64) -> bool {
        let is_it =
            |origin: &Origin| origin.shard == number && folder.has_results_of(&origin.campaign);
        let known = folder.manifest().cases_of(number);
        let worst = self.worst.iter().map(|worst| worst.case);
        let mut cases = self.sampled.keys().copied().chain(worst);
        self.origin.as_ref().is_none_or(is_it) && cases.all(|case| known.contains(&case))
    }

    fn fits(&self, grid: &Grid) -> bool {
        let worst = self.worst.iter().map(|one| &one.curve);
        let all = self.envelopes.values().chain(self.sampled.values());
        all.chain(worst).all(|curve| curve.fits(grid))
    }

    /// Writes them into the folder of a shard, with its name.
    pub(crate) fn write(&mut self, shard: &Path, folder: &Folder, number: u64) -> io::Result<()> {
        self.origin = Some(Origin {
            campaign: folder.id().into(),
            shard: number,
        });
        let mut text = serde_json::to_string(self)?;
        text += &journal::sealed(&text);
        let part = journal::unfinished(shard)?;
        part.as_file().write_all(text.as_bytes())?;
        part.as_file().sync_all()?;
        let written = part.persist(shard.join(CURVES));
        written.map(|_| ()).map_err(|error| error.error)
    }

    /// Reads those of a shard; none if they are not there, not whole, or of another shard.
    pub(crate) fn read(
        shard: &Path,
        folder: &Folder,
        number: u64,
        grid: &Grid,
    ) -> io::Result<Option<Self>> {
        let text = match fs::read_to_string(shard.join(CURVES)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) if error.kind() == io::ErrorKind::InvalidData => return Ok(None),
            text => text?,
        };
        let read = journal::unsealed(&text).and_then(|json| serde_json::from_str(json).ok());
        Ok(read.filter(|curves: &Self| curves.fits(grid) && curves.is_of(folder, number)))
    }
}
