//! Numbers in the form that the script of a page reads: bytes in Base64, which JSON readers need not parse.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::{Serialize, Serializer};

/// Double-precision numbers, little-endian.
#[derive(Debug, Default)]
pub(super) struct Numbers(pub(super) Vec<f64>);

/// Single-precision numbers, little-endian.
#[derive(Debug, Default)]
pub(super) struct Singles(pub(super) Vec<f32>);

/// One-byte codes.
#[derive(Debug, Default)]
pub(super) struct Codes(pub(super) Vec<u8>);

impl Serialize for Numbers {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.0.iter().flat_map(|one| one.to_le_bytes()).collect();
        to.serialize_str(&STANDARD.encode(bytes))
    }
}

impl Serialize for Singles {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = self.0.iter().flat_map(|one| one.to_le_bytes()).collect();
        to.serialize_str(&STANDARD.encode(bytes))
    }
}

impl Serialize for Codes {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&STANDARD.encode(&self.0))
    }
}
