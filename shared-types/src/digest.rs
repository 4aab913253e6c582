//! The digest of a run: one hash over everything that must be reproducible and nothing else.
//!
//! For each record in order: the value changes and fault events that take effect at its step, then the record's words
//! up to the timing (step, validity, truth, measured, reference, command, applied, internals and, if there are any,
//! driven inputs), all little-endian. An
//! event is the byte length of its text as a 64-bit word followed by the text: for a fault
//! `step kind target parameter course`; for a change `step change ramp_steps` and, each preceded by a space,
//! `key=value` for every key and `clear:key` for every reference signal that follows its stimulus again. Any reader of
//! a recording can recompute it.

use zerocopy::IntoBytes;

use crate::number::exact;
use crate::record::{ChangedValue, Event, FaultBegun, ValueChange};

/// Bytes hashed at once: small pieces cost several times as much.
const BATCH: usize = 1 << 16;

/// Digest under construction.
#[derive(Clone, Debug)]
pub struct Digest {
    hasher: blake3::Hasher,
    pending: Vec<u8>,
}

impl Default for Digest {
    fn default() -> Self {
        Self {
            hasher: blake3::Hasher::new(),
            pending: Vec::with_capacity(2 * BATCH),
        }
    }
}

impl Digest {
    /// Adds a fault event, which precedes the record of its step. A fault that only costs time does not count.
    pub fn fault(&mut self, fault: &FaultBegun) {
        if fault.wall_only {
            return;
        }
        let FaultBegun {
            step,
            kind,
            target,
            parameter,
            canonical,
            ..
        } = fault;
        self.text(&format!("{step} {kind} {target} {parameter} {canonical}"));
    }

    /// Adds a change of values, which precedes the record of its step.
    pub fn change(&mut self, change: &ValueChange) {
        let mut text = format!("{} change {}", change.step, change.ramp_steps);
        for ChangedValue { key, value, .. } in &change.set {
            text += &format!(" {key}={}", exact(*value));
        }
        for key in &change.clear {
            text += &format!(" clear:{key}");
        }
        self.text(&text);
    }

    /// Adds an event, unless it is irrelevant to the digest.
    pub fn event(&mut self, event: &Event) {
        match event {
            Event::Fault(taken) => self.fault(taken),
            Event::Change(change) => self.change(change),
            _ => {}
        }
    }

    fn text(&mut self, text: &str) {
        self.pending.extend((text.len() as u64).to_le_bytes());
        self.pending.extend(text.as_bytes());
    }

    /// Adds the hashed words of a record.
    pub fn record(&mut self, hashed: &[u64]) {
        self.pending.extend(hashed.as_bytes());
        if self.pending.len() >= BATCH {
            // Whole batches only: the hash is a tree, and pieces that end inside a node cost more.
            let whole = self.pending.len() - self.pending.len() % BATCH;
            self.hasher.update(&self.pending[..whole]);
            self.pending.drain(..whole);
        }
    }

    /// Returns the digest as hexadecimal text.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.hasher.update(&self.pending);
        self.hasher.finalize().to_hex().to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(records: &[[u64; 3]]) -> String {
        let mut digest = Digest::default();
        records.iter().for_each(|record| digest.record(record));
        digest.finish()
    }

    #[test]
    fn batching_does_not_change_the_digest() {
        let records: Vec<[u64; 3]> = (0..10_000).map(|k| [k, k * k, !k]).collect();
        let whole = records.as_flattened().as_bytes();
        assert_eq!(of(&records), blake3::hash(whole).to_hex().as_str());
    }

    #[test]
    fn a_flipped_bit_in_a_record_changes_the_digest() {
        let mut records: Vec<[u64; 3]> = (0..1000).map(|k| [k, 7, 9]).collect();
        let before = of(&records);
        records[500][2] ^= 1;
        assert_ne!(of(&records), before);
    }

    #[test]
    fn a_change_counts_with_its_step_ramp_and_values() {
        let change = ValueChange {
            id: 1,
            step: 2,
            ramp_steps: 3,
            live: false,
            set: vec![ChangedValue {
                key: "plant.parameters.mass_kg".into(),
                unit: "kg".into(),
                value: 0.1,
            }],
            clear: vec!["reference.position_m".into()],
        };
        let of = |change: &ValueChange| {
            let mut digest = Digest::default();
            digest.event(&Event::Change(change.clone()));
            digest.finish()
        };
        let text = "2 change 3 plant.parameters.mass_kg=0.1 clear:reference.position_m";
        let mut bytes = (text.len() as u64).to_le_bytes().to_vec();
        bytes.extend(text.as_bytes());
        assert_eq!(of(&change), blake3::hash(&bytes).to_hex().as_str());
        let others = ValueChange {
            id: 7,
            live: true,
            ..change.clone()
        };
        assert_eq!(of(&others), of(&change), "numbers and origin do not count");
    }

    #[test]
    fn a_fault_event_counts() {
        let mut digest = Digest::default();
        digest.fault(&FaultBegun {
            id: 1,
            step: 2,
            kind: "leakage".into(),
            target: "actuator1".into(),
            parameter: "p".into(),
            canonical: "size=1".into(),
            effect: 0,
            wall_only: false,
        });
        assert_ne!(digest.finish(), Digest::default().finish());
    }
}
