//! Curves of many cases, which serve only for plots.
//!
//! A shard stores the envelope of its cases, the curves of a sample of draws, and those of the worst cases. Rows,
//! digest and comparisons do not depend on curves: a shard whose curves are lost still has its result.

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

/// Name of the curves file in the folder of a shard.
pub(crate) const CURVES: &str = "curves.json";
/// Class of cases whose values diverge.
const DIVERGED: &str = "diverged";
/// Prefix of the names of margin columns.
const MARGIN: &str = "robustness.";

/// Case with the smallest margin.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Worst {
    /// Name of the variant.
    pub variant: String,
    /// Name of the requirement.
    pub requirement: String,
    /// Number of the case.
    pub case: u64,
    /// Margin of the case.
    pub margin: f64,
    /// Curve of the case.
    pub curve: Curve,
}

/// Shard from which curves come.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Origin {
    /// Identity of the campaign.
    pub campaign: String,
    /// Number of the shard.
    pub shard: u64,
}

/// Curves of one or more shards.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Curves {
    /// Minimum and maximum values of all cases of each variant.
    pub envelopes: BTreeMap<String, Curve>,
    /// Curves of the sampled draws, by case.
    pub sampled: BTreeMap<u64, Curve>,
    /// Worst case of each variant and requirement.
    pub worst: Vec<Worst>,
    /// Shard of the curves; `None` for joined shards, and in files of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<Origin>,
}

impl Curves {
    /// Adds the curve of a case, given its row; returns `true` if the curves changed, so that the curve must be
    /// journaled. Ignores cases that diverged or have no result, because a single such case would hide all others.
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

    /// Adds the curves of another shard.
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

    /// Retains a case if it is worse than the current worst case; of equal cases, the first is kept.
    fn worse(&mut self, new: Worst) -> bool {
        let is_of = |current: &&mut Worst| {
            (&current.variant, &current.requirement) == (&new.variant, &new.requirement)
        };
        match self.worst.iter_mut().find(is_of) {
            Some(current) => {
                let order = new.margin.total_cmp(&current.margin);
                let is_worse = order.then(new.case.cmp(&current.case)).is_lt();
                if is_worse {
                    *current = new;
                }
                is_worse
            }
            None => {
                self.worst.push(new);
                true
            }
        }
    }

    /// Returns `true` if the curves belong to the shard, judging by their origin and by their cases.
    fn is_of(&self, folder: &Folder, number: u64) -> bool {
        let is_it =
            |origin: &Origin| origin.shard == number && folder.has_results_of(&origin.campaign);
        let expected = folder.manifest().cases_of(number);
        let worst = self.worst.iter().map(|worst| worst.case);
        let mut cases = self.sampled.keys().copied().chain(worst);
        self.origin.as_ref().is_none_or(is_it) && cases.all(|case| expected.contains(&case))
    }

    fn fits(&self, grid: &Grid) -> bool {
        let worst = self.worst.iter().map(|one| &one.curve);
        let all = self.envelopes.values().chain(self.sampled.values());
        all.chain(worst).all(|curve| curve.fits(grid))
    }

    /// Writes the curves into the folder of a shard, with their origin.
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
        let result = part.persist(shard.join(CURVES));
        result.map(|_| ()).map_err(|error| error.error)
    }

    /// Reads the curves of a shard; `None` if they are missing, damaged or of another shard.
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
