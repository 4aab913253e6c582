//! Dates in a column of CSV: ISO 8601 with a time of day, such as `2026-11-28T05:00:00.123Z`.
//!
//! Between date and time of day stands a `T` or a space, behind them nothing, `Z`, ` UTC` or an offset such as `+01:00`.
//! A table counts from its first row, so no epoch takes digits away from the fractions.

use std::time::UNIX_EPOCH;

use super::Objection;

/// Forms of a date, for messages.
pub(super) const FORMS: &str =
    "dates such as 2026-11-28T05:00:00.123Z, 2026-11-28 05:00:00.123 or 2026-11-28T06:00:00+01:00";

/// Length of date and time of day without a fraction.
const WHOLE_SECONDS: usize = 19;

/// Date with a time of day.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Date {
    /// Nanoseconds since 1970, in UTC if the date has a zone.
    ns: i128,
    has_zone: bool,
}

impl Date {
    /// Reads a cell; `None` if it is no date with a time of day, or is before 1970.
    pub(super) fn parse(cell: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(cell).ok()?;
        // Most cells are numbers.
        if text.as_bytes().get(4) != Some(&b'-') {
            return None;
        }
        let (local, offset_minutes) = split_zone(text)?;
        // The parser ignores what stands behind the seconds.
        let (_, behind) = local.split_at_checked(WHOLE_SECONDS)?;
        let fraction = behind.strip_prefix(['.', ',']).unwrap_or(behind);
        let has_point = fraction.len() < behind.len();
        if has_point == fraction.is_empty() || !fraction.bytes().all(|c| c.is_ascii_digit()) {
            return None;
        }
        let time = humantime::parse_rfc3339_weak(&local.replacen(',', ".", 1)).ok()?;
        let ns = time.duration_since(UNIX_EPOCH).ok()?.as_nanos();
        let offset_ns = i128::from(offset_minutes.unwrap_or(0)) * 60_000_000_000;
        Some(Self {
            ns: i128::try_from(ns).ok()? - offset_ns,
            has_zone: offset_minutes.is_some(),
        })
    }

    /// Returns the seconds from this date to that of a cell of the column `name`.
    ///
    /// # Errors
    /// If the cell has no date, or has a zone where this date has none.
    pub(super) fn seconds_to(self, cell: &[u8], name: &str) -> Result<f64, Objection> {
        let text = || String::from_utf8_lossy(cell);
        let Some(date) = Self::parse(cell) else {
            return Err(Objection::new(
                format!(
                    "not a point: `{}` in `{name}` is not a date, but the first row has one",
                    text()
                ),
                format!("a date in every row or a number in every row; {FORMS}"),
            ));
        };
        if date.has_zone != self.has_zone {
            let (this, first) = match date.has_zone {
                true => ("a zone", "none"),
                false => ("no zone", "one"),
            };
            return Err(Objection::new(
                format!(
                    "not a point: `{}` in `{name}` has {this}, but the first row has {first}",
                    text()
                ),
                "a zone in every row or in none",
            ));
        }
        Ok((date.ns - self.ns) as f64 / 1e9)
    }
}

/// Splits a date from its zone, as the minutes ahead of UTC; `None` for an offset that cannot be read.
fn split_zone(text: &str) -> Option<(&str, Option<i32>)> {
    for utc in ["Z", "z", " UTC"] {
        if let Some(local) = text.strip_suffix(utc) {
            return Some((local, Some(0)));
        }
    }
    let behind = text.get(WHOLE_SECONDS..)?;
    let Some(at) = behind.find(['+', '-']) else {
        return Some((text, None));
    };
    let (local, offset) = text.split_at(WHOLE_SECONDS + at);
    let digits: String = offset[1..].chars().filter(|c| *c != ':').collect();
    let is_offset = matches!(digits.len(), 2 | 4) && digits.bytes().all(|c| c.is_ascii_digit());
    let (hours, minutes) = is_offset.then(|| digits.split_at(2))?;
    let minutes = match minutes {
        "" => 0,
        minutes => minutes.parse().ok()?,
    };
    let hours: i32 = hours.parse().ok()?;
    let offset_minutes = 60 * hours + minutes;
    let is_possible = minutes < 60 && hours < 24;
    is_possible.then_some((
        local.trim_end(),
        Some(match offset.starts_with('-') {
            true => -offset_minutes,
            false => offset_minutes,
        }),
    ))
}

/// Returns `true` if a cell resembles a date or a time of day in some other form.
pub(super) fn resembles_date(text: &str) -> bool {
    let count = |c: char| text.matches(c).count();
    text.starts_with(|c: char| c.is_ascii_digit())
        && (count(':') > 0 || count('/') > 1 || count('-') > 1 || count('.') > 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds of 28 November 2026, 05:00 UTC, as `date -u -d 2026-11-28T05:00:00Z +%s` prints them.
    const UTC_S: i128 = 1_795_842_000;

    #[test]
    fn every_form_of_one_instant_is_the_same_date() {
        for text in [
            "2026-11-28T05:00:00.123Z",
            "2026-11-28 05:00:00.123Z",
            "2026-11-28 05:00:00.123 UTC",
            "2026-11-28T05:00:00,123z",
            "2026-11-28T06:00:00.123+01:00",
            "2026-11-28 06:00:00.123 +0100",
            "2026-11-27T21:30:00.123-07:30",
            "2026-11-28T05:00:00.123000000+00",
        ] {
            let date = Date::parse(text.as_bytes());
            let expected = Date {
                ns: UTC_S * 1_000_000_000 + 123_000_000,
                has_zone: true,
            };
            assert_eq!(date, Some(expected), "{text}");
        }
        let local = Date::parse(b"2026-11-28 05:00:00").expect("a date");
        assert_eq!((local.ns, local.has_zone), (UTC_S * 1_000_000_000, false));
    }

    #[test]
    fn other_texts_are_no_dates() {
        for text in [
            "",
            "1.5",
            "2026-11-28",
            "05:00:00",
            "2026-13-28T05:00:00Z",
            "2026-11-31T05:00:00Z",
            "2026-11-28T25:00:00Z",
            "2026-11-28T05:00:00+1",
            "2026-11-28T05:00:00+01:60",
            "2026-11-28T05:00:00+24:00",
            "2026-11-28T05:00:00Zulu",
            "28.11.2026 05:00:00",
            "2026-11-28T05:00:0\u{e4}",
        ] {
            assert_eq!(Date::parse(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn milliseconds_are_as_exact_as_their_decimals() {
        let first = Date::parse(b"2026-11-28T23:59:59.900Z").expect("a date");
        let next = first.seconds_to(b"2026-11-29T00:00:00.001Z", "time");
        assert_eq!(next, Ok(0.101));
    }
}
