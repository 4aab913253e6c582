//! The validity bits of a recording, which mark signals as invalid.
//!
//! Used by readers that judge or export recorded rows. For live records the layout provides the same information
//! ([`RecordLayout::validity`](shared_types::record::RecordLayout::validity)).

use super::RunReader;

impl RunReader {
    /// Finds the bit that marks a signal as invalid: the index of its first word, and the bit number; `None` for a
    /// signal without such a bit. `sent` lists the commands of a command frame in order, by their recorded names.
    #[must_use]
    pub fn invalid_bit(&self, name: &str, sent: &[String]) -> Option<(usize, usize)> {
        let recorded = self.columns();
        let number_in = |groups: &[&str]| {
            let is_of = |name: &str| groups.iter().any(|group| name.starts_with(group));
            let names = recorded.iter().map(|column| column.name.as_str());
            let mut of_groups = names.filter(|name| is_of(name));
            is_of(name).then(|| of_groups.position(|one| one == name))?
        };
        // An excerpt numbers only the bits of its own signals.
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
