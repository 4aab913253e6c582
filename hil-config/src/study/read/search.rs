//! Settings of searches: the table `[search]`, and the nominal values of what varies.

use super::super::{Search, Spread, Variant};
use super::Homes;
use crate::keys::{PROBES, RUNS, TOLERANCE};
use crate::problem::ProblemKind;
use crate::reader::{Reader, Section};

/// Reads the settings of a search, or their defaults.
pub(super) fn search(
    reader: &mut Reader,
    root: &Section<'_>,
    variants: &[Variant],
    homes: &mut Homes,
) -> Option<Search> {
    if root.table.get("search").is_none() {
        return Some(Search {
            requirement: None,
            variant: None,
            tolerance: TOLERANCE,
            probes: PROBES.cast_unsigned(),
            runs: RUNS.cast_unsigned(),
        });
    }
    let section = &reader.section(root, "search")?;
    reader.refuse_unknown(section, &[]);
    let variant = reader.text(section, "variant");
    if let Some(name) = variant
        && !variants.iter().any(|one| one.name == name)
    {
        let message = format!("there is no variant `{name}`");
        let names = variants.iter().map(|one| &*one.name);
        reader
            .report_at(section, "variant", ProblemKind::UnknownName, message)
            .one_of(name, names);
    }
    for key in ["requirement", "variant"] {
        homes.add(&format!("search.{key}"), section.place_of(key));
    }
    Some(Search {
        requirement: reader.text(section, "requirement").map(Into::into),
        variant: variant.map(Into::into),
        tolerance: reader.number(section, "tolerance")?,
        probes: reader.integer(section, "probes")?.cast_unsigned(),
        runs: reader.integer(section, "runs")?.cast_unsigned(),
    })
}

/// Reads the nominal value of a variation, which must lie in its range.
pub(super) fn nominal(reader: &mut Reader, section: &Section<'_>, spread: &Spread) -> Option<f64> {
    section.table.get("nominal")?;
    let nominal = reader.number(section, "nominal")?;
    let (Spread::Uniform { min, max }
    | Spread::Normal {
        within: [min, max], ..
    }
    | Spread::Lognormal {
        within: [min, max], ..
    }) = *spread
    else {
        let message = "a value without a range has no nominal value";
        reader
            .report_at(section, "nominal", ProblemKind::OutOfRange, message)
            .expected("nominal only for uniform, normal and lognormal values");
        return None;
    };
    if nominal < min || nominal > max {
        let message = format!("`{}` is {nominal}", section.path_of("nominal"));
        reader
            .report_at(section, "nominal", ProblemKind::OutOfRange, message)
            .expected(format!(
                "a number from {min} to {max}, the range of the value"
            ));
    }
    Some(nominal)
}
