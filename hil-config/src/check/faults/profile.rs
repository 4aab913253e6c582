//! Course of an effect's size over time.

use std::path::Path;

use shared_types::describe::ProfileDescription;

use crate::check::{points, tables};
use crate::keys::PROFILES;
use crate::plan::Profile;
use crate::problem::{ProblemKind, listed};
use crate::quantity::Quantity;
use crate::reader::{Reader, Section};

/// Maximum number of points of a table. The record stream carries a fault in one piece, at the step at which the fault
/// takes effect, and reserves room for this size.
pub(super) const MOST_POINTS: usize = 10_000;

/// Returns the profile of an effect: its own, or else that of its fault kind, `own`, or else a step. At most `left_s`
/// remains from the effect's beginning to the end of the run.
pub(super) fn check(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    own: Option<&ProfileDescription>,
    left_s: f64,
) -> Option<Profile> {
    let speed = match own {
        Some(ProfileDescription::Exponential { speed }) => Some(speed),
        Some(ProfileDescription::Step) | None => None,
    };
    if section.table.get("profile").is_none() {
        let Some(speed) = speed else {
            return Some(Profile::Step);
        };
        let speed_per_s = match speed.default {
            Some(default) if section.table.get(&speed.name).is_none() => Some(default),
            _ => reader.described_number(section, &Quantity::from(speed)),
        };
        return speed_per_s.map(|speed_per_s| Profile::Exponential { speed_per_s });
    }
    let section_profile = reader.section(section, "profile")?;
    let profile = asked_for(reader, &section_profile, folder, left_s);
    if let Some(speed) = speed
        && section.table.get(&speed.name).is_some()
    {
        let path = section.path_of(&speed.name);
        let message =
            format!("`{path}` is the speed of the default course, which `profile` replaces");
        reader
            .report_at(section, &speed.name, ProblemKind::Mismatch, message)
            .expected(format!(
                "one of {}",
                listed([speed.name.as_str(), "profile"])
            ));
        return None;
    }
    profile
}

fn asked_for(
    reader: &mut Reader,
    section: &Section<'_>,
    folder: Option<&Path>,
    left_s: f64,
) -> Option<Profile> {
    let kinds = PROFILES.iter().map(|kind| (kind.name, kind.keys));
    let (name, section) = &reader.of_kind(section, "profile", kinds)?;
    // All numbers are read before a missing one is reported, so that every problem is.
    let mut number = |name| reader.number(section, name);
    let profile = match *name {
        "step" => Profile::Step,
        "ramp" => Profile::Ramp {
            duration_s: number("duration_s")?,
        },
        "exponential" => Profile::Exponential {
            speed_per_s: number("speed_per_s")?,
        },
        "pulse" => Profile::Pulse {
            duration_s: number("duration_s")?,
        },
        "intermittent" => {
            let (period_s, duty) = (number("period_s"), number("duty"));
            Profile::Intermittent {
                period_s: period_s?,
                duty: duty?,
            }
        }
        "sine" => {
            let (frequency_hz, phase_rad) = (number("frequency_hz"), number("phase_rad"));
            Profile::Sine {
                frequency_hz: frequency_hz?,
                phase_rad: phase_rad?,
            }
        }
        "table" => {
            let (time_s, values) = tables::of_profile(reader, section, folder, "a profile")?;
            if time_s.len() > MOST_POINTS {
                let message = format!("a profile of {} points", time_s.len());
                let place = section.place_of("kind");
                reader
                    .report(
                        ProblemKind::OutOfRange,
                        section.path.clone(),
                        place,
                        message,
                    )
                    .expected(format!("at most {MOST_POINTS} points"))
                    .help("use a stimulus of kind `table` for more points");
                return None;
            }
            let span = points::Span::of_effect(left_s);
            points::refuse_outside(reader, section, &time_s, &span)?;
            Profile::Table { time_s, values }
        }
        _ => unreachable!("every kind is read"),
    };
    Some(profile)
}
