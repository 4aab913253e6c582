//! Curve of a case: minimum and maximum of each signal in each time bin.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Size of a bin in bytes.
const BIN: usize = 2 * size_of::<f32>();

/// Signals and bins of a campaign's curves.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Names and units of the signals.
    pub signals: Vec<(String, String)>,
    /// Each signal in words; empty in a campaign of an earlier version.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<String>,
    /// Number of bins.
    pub bins: usize,
    /// Width of a bin, in s.
    pub bin_s: f64,
    /// Number of draws of which one has its curves recorded.
    pub every: u64,
}

/// Minimum and maximum of each signal in each bin; NaN for missing values.
#[derive(Clone, Debug)]
pub struct Curve(Vec<[f32; 2]>);

impl Curve {
    /// Creates the curve of a case without records.
    #[must_use]
    pub fn new(grid: &Grid) -> Self {
        Self(vec![[f32::NAN; 2]; grid.signals.len() * grid.bins])
    }

    /// Adds the value of a signal to a bin; NaN changes nothing.
    #[inline]
    pub fn take(&mut self, grid: &Grid, signal: usize, bin: usize, value: f64) {
        let value = value as f32;
        widen(&mut self.0[signal * grid.bins + bin], [value; 2]);
    }

    /// Merges another curve; returns `true` if the curve changed.
    pub fn widen(&mut self, other: &Self) -> bool {
        let mut is_wider = false;
        for (bin, other) in self.0.iter_mut().zip(&other.0) {
            is_wider |= widen(bin, *other);
        }
        is_wider
    }

    /// Returns the minimum and maximum of a signal in each bin.
    #[must_use]
    pub fn signal(&self, grid: &Grid, signal: usize) -> &[[f32; 2]] {
        &self.0[signal * grid.bins..(signal + 1) * grid.bins]
    }

    /// Returns `true` if the curve has as many values as the grid asks for.
    pub fn fits(&self, grid: &Grid) -> bool {
        self.0.len() == grid.signals.len() * grid.bins
    }
}

/// Widens a bin; returns `true` if the bin changed.
#[inline]
fn widen([least, greatest]: &mut [f32; 2], [low, high]: [f32; 2]) -> bool {
    // Comparisons with NaN are false.
    let (is_lower, is_higher) = (
        low < *least || (least.is_nan() && !low.is_nan()),
        high > *greatest || (greatest.is_nan() && !high.is_nan()),
    );
    if is_lower {
        *least = low;
    }
    if is_higher {
        *greatest = high;
    }
    is_lower || is_higher
}

impl Serialize for Curve {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let values = self.0.iter().flatten();
        let bytes: Vec<u8> = values.flat_map(|value| value.to_le_bytes()).collect();
        to.serialize_str(&STANDARD.encode(bytes))
    }
}

impl<'de> Deserialize<'de> for Curve {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        let bytes = STANDARD.decode(text).map_err(D::Error::custom)?;
        if bytes.len() % BIN != 0 {
            return Err(D::Error::custom("a curve ends within a bin"));
        }
        let (values, _) = bytes.as_chunks::<{ size_of::<f32>() }>();
        let values: Vec<f32> = values.iter().map(|one| f32::from_le_bytes(*one)).collect();
        Ok(Self(values.as_chunks().0.to_vec()))
    }
}
