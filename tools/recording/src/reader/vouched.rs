//! Content without a checksum, in a truncated recording or in one recovered from such a file.

use super::RunReader;
use super::content::FileEnd;

/// Fact with the number of records that checksums covered when the file was recovered; present only if some were not
/// covered.
pub(crate) const VOUCHED: &str = "vouched_records";
/// Fact that describes the content without a checksum at the time of recovery.
pub const UNVOUCHED: &str = "unvouched";

/// Part of a recording without a checksum.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unvouched {
    /// Number of records before this part.
    pub records: u64,
    /// Description of the part for a person.
    pub text: String,
}

impl RunReader {
    /// Returns a warning about a recording that its writer did not complete: how to recover it, and which content lacks
    /// a checksum even then; known at the end.
    #[must_use]
    pub fn caveat(&self) -> Option<String> {
        let (path, records) = (self.path.display(), self.records);
        let doubt = self.unvouched().map(|unvouched| unvouched.text);
        if !matches!(self.content.end(), Some(FileEnd::Torn(_))) {
            return doubt.map(|description| format!("{path} was recovered: {description}"));
        }
        let doubt = doubt.map_or_else(String::new, |description| format!(" ({description})"));
        Some(format!(
            "{path} was cut off after {records} records{doubt}; complete it with `hil recover {path}`"
        ))
    }

    /// Returns the part without a checksum, now or at the time of recovery; known at the end, or at the damage.
    #[must_use]
    pub fn unvouched(&self) -> Option<Unvouched> {
        let before = || {
            Some(Unvouched {
                records: self.fact(VOUCHED)?.parse().ok()?,
                text: self.fact(UNVOUCHED)?.to_owned(),
            })
        };
        let now = || {
            let description = match self.vouched {
                None => "no checksum covers its records or its facts about the run".into(),
                Some(0) => "no checksum covers its records".into(),
                Some(records) if records < self.records => {
                    format!("checksums cover only its first {records} records")
                }
                Some(_) => "no checksum covers the content after its last record".into(),
            };
            let records = self.vouched.unwrap_or_default();
            (!self.is_vouched && !self.is_whole()).then_some(Unvouched {
                records,
                text: description,
            })
        };
        let both = [before(), now()].into_iter().flatten();
        both.min_by_key(|unvouched| unvouched.records)
    }
}
