//! The bits of a recording that mark signals as invalid.
//!
//! Used by whoever judges or exports recorded rows. Live records have a layout, which tells the same
//! ([`RecordLayout::validity`](shared_types::record::RecordLayout::validity)).

use super::RunReader;

impl RunReader {
    /// Finds the bit that marks a signal as invalid: the word from which it is counted, and its number;
    /// `None` of a signal that is never marked. `sent` are the commands of a command frame, in order, as
    /// the recording names them.
    #[must_use]
    pub fn invalid_bit(&self, name: &str, sent: &[String]) -> Option<(usize, usize)> {
        let recorded = self.columns();
        let number_in = |groups: &[&str]| {
            let is_of = |name: &str| groups.iter().any(|group| name.starts_with(group));
            let names = recorded.iter().map(|column| column.name.as_str());
            let mut of_groups = names.filter(|name| is_of(name));
            is_of(name).then(|| of_groups.position(|one| one == name))?
        };
        // An excerpt numbers the bits of what it keeps.
        let is_kept = |name: &&String| !self.is_excerpt() || self.place(name).is_some();
        let (word, bit) = if let Some(number) = number_in(&["measured.", "reference."]) {
            ("sample_invalid[0]", number)
        } else if let Some(number) = number_in(&["internal."]) {
            let commands = sent.iter().filter(is_kept).count();
            ("command_invalid[0]", commands + number)
        } else {
            let mut commands = sent.iter().filter(is_kept);
            let number = commands.position(|command| command == name)?;
            ("command_invalid[0]", number)
        };
        Some((self.place(word)?, bit))
    }
}
