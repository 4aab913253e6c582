//! Content that no check sum vouches for, in a recording that broke off and in one that was made of such a file.

use super::RunReader;
use super::content::FileEnd;

/// The fact that says how many records check sums vouched for when the file was recovered; only if that is
/// not all.
pub(crate) const VOUCHED: &str = "vouched_records";
/// The fact that says what they did not vouch for then.
pub const UNVOUCHED: &str = "unvouched";

/// Part of a recording that no check sum vouches for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unvouched {
    /// Records before it.
    pub records: u64,
    /// Names the part that nobody vouches for, for a person.
    pub told: String,
}

impl RunReader {
    /// Returns the warning about a recording that its writer did not finish: what mends the recording,
    /// and what nobody vouches for, also after that; known at the end.
    #[must_use]
    pub fn caveat(&self) -> Option<String> {
        let (path, records) = (self.path.display(), self.records);
        let doubt = self.unvouched().map(|unvouched| unvouched.told);
        if !matches!(self.content.end(), Some(FileEnd::Torn(_))) {
            return doubt.map(|told| format!("{path} was recovered: {told}"));
        }
        let doubt = doubt.map_or_else(String::new, |told| format!(" ({told})"));
        Some(format!(
            "{path} broke off after {records} records{doubt}; `hil recover {path}` makes a whole file of it"
        ))
    }

    /// Returns the part that no check sum vouches for, now or when the recording was recovered; known at
    /// the end, or at the damage.
    #[must_use]
    pub fn unvouched(&self) -> Option<Unvouched> {
        let before = || {
            Some(Unvouched {
                records: self.fact(VOUCHED)?.parse().ok()?,
                told: self.fact(UNVOUCHED)?.to_owned(),
            })
        };
        let now = || {
            let told = match self.vouched {
                None => {
                    "no check sum vouches for its records or for what it says of the run".into()
                }
                Some(0) => "no check sum vouches for its records".into(),
                Some(records) if records < self.records => {
                    format!("check sums vouch for its first {records} records only")
                }
                Some(_) => "no check sum vouches for what it says after its last record".into(),
            };
            let records = self.vouched.unwrap_or_default();
            (!self.is_vouched && !self.is_whole()).then_some(Unvouched { records, told })
        };
        let both = [before(), now()].into_iter().flatten();
        both.min_by_key(|unvouched| unvouched.records)
    }
}
