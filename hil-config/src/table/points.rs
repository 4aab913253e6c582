//! Rows of a table: in the scenario's text as lists, or in a packed file that the text names.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::quantity::toml_float;

/// Largest order of a derivative that a table has.
pub const MOST_DERIVATIVES: usize = 5;
/// Ending of a packed file.
pub const PACKED: &str = "points";
/// First bytes of a packed file: name and version of the format.
const MAGIC: &[u8; 8] = b"HILPTS01";
/// Numbers that are written or read at once.
const BLOCK: usize = 1 << 13;

/// Times and columns of the same length: the values, then their derivatives in rising order. Copies share the numbers.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Points {
    time_s: Arc<[f64]>,
    columns: Arc<[Vec<f64>]>,
    /// Packed file that the scenario's text and the plant's job name instead of the numbers.
    file: Option<PathBuf>,
}

/// Points as in the scenario and in the plant's job.
#[derive(Clone, Serialize, Deserialize)]
struct Written {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    file: Option<PathBuf>,
    #[serde(flatten)]
    lists: BTreeMap<String, Vec<f64>>,
}

/// Reason why a file of points cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Unpackable {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The file is not of this format.
    #[error("not a packed points file")]
    Form,
    /// The file's content has changed since it was named.
    #[error("the content has changed: the hash is now {0}")]
    Changed(String),
}

impl PartialEq for Points {
    /// Compares the numbers, wherever they are stored.
    fn eq(&self, other: &Self) -> bool {
        self.time_s == other.time_s && self.columns == other.columns
    }
}

/// Returns the key of a list: the times, or the column of a derivative's order.
pub(crate) fn list_key(order: usize) -> String {
    match order {
        0 => "values".into(),
        order => format!("values_d{order}"),
    }
}

impl From<Points> for Written {
    fn from(points: Points) -> Self {
        let mut lists = BTreeMap::new();
        if points.file.is_none() {
            lists.insert("time_s".into(), points.time_s.to_vec());
            for (order, column) in points.columns.iter().enumerate() {
                lists.insert(list_key(order), column.clone());
            }
        }
        Self {
            file: points.file,
            lists,
        }
    }
}

impl TryFrom<Written> for Points {
    type Error = String;

    fn try_from(mut written: Written) -> Result<Self, String> {
        if let Some(file) = written.file {
            return Self::read(&file).map_err(|error| format!("{}: {error}", file.display()));
        }
        let times = written.lists.remove("time_s").unwrap_or_default();
        let columns =
            (0..=MOST_DERIVATIVES).map_while(|order| written.lists.remove(&list_key(order)));
        Self::new(times, columns.collect())
            .ok_or_else(|| "a table's lists do not fit together".into())
    }
}

impl Points {
    /// Joins times with columns; `None` unless there is a row and all are of one length.
    #[must_use]
    pub fn new(time_s: Vec<f64>, columns: Vec<Vec<f64>>) -> Option<Self> {
        let is_even = columns.iter().all(|column| column.len() == time_s.len());
        let count = columns.len();
        let is_legal = !time_s.is_empty() && (1..=1 + MOST_DERIVATIVES).contains(&count);
        (is_even && is_legal).then(|| Self {
            time_s: time_s.into(),
            columns: columns.into(),
            file: None,
        })
    }

    /// Returns the times in s, strictly ascending.
    #[must_use]
    pub fn time_s(&self) -> &[f64] {
        &self.time_s
    }

    /// Returns the values, or their derivative of an order.
    ///
    /// # Panics
    /// If there is no column for the order.
    #[must_use]
    pub fn column(&self, order: usize) -> &[f64] {
        &self.columns[order]
    }

    /// Returns the number of columns of derivatives.
    #[must_use]
    pub fn derivatives(&self) -> usize {
        self.columns.len() - 1
    }

    /// Returns the packed file that the text names, if it does not have the numbers themselves.
    #[must_use]
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Names a packed file, which has or will have these points, in place of the numbers.
    pub fn refer_to(&mut self, file: PathBuf) {
        self.file = Some(file);
    }

    /// Returns the length of the points in a scenario's text in bytes, counted up to a limit.
    #[must_use]
    pub fn text_bytes(&self, limit: usize) -> usize {
        /// Sign, 17 digits, point, exponent, comma and space.
        const LONGEST_NUMBER: usize = 26;
        let count = self.time_s.len() * (1 + self.columns.len());
        if count * LONGEST_NUMBER <= limit {
            return count * LONGEST_NUMBER;
        }
        let mut bytes = 0;
        let columns = self.columns.iter().flatten();
        for number in self.time_s.iter().chain(columns) {
            bytes += toml_float(*number).len() + ", ".len();
            if bytes > limit {
                break;
            }
        }
        bytes
    }

    /// Returns the name of the packed file: the hash of its content, and the ending.
    #[must_use]
    pub fn packed_name(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        // A hasher takes everything.
        let _ = self.write(&mut hasher);
        format!("{}.{PACKED}", hasher.finalize().to_hex())
    }

    /// Writes the packed form: `MAGIC`, the number of rows and of columns as 64 bits, the times and each column; all
    /// numbers with the lowest byte first.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, to: &mut impl Write) -> io::Result<()> {
        to.write_all(MAGIC)?;
        for count in [self.time_s.len(), self.columns.len()] {
            to.write_all(&(count as u64).to_le_bytes())?;
        }
        let mut bytes = Vec::with_capacity(8 * BLOCK);
        let lists = std::iter::once(&*self.time_s).chain(self.columns.iter().map(|one| &one[..]));
        for block in lists.flat_map(|list| list.chunks(BLOCK)) {
            bytes.clear();
            bytes.extend(block.iter().flat_map(|number| number.to_le_bytes()));
            to.write_all(&bytes)?;
        }
        Ok(())
    }

    /// Reads a packed file. If the file is named by a hash, its content must match that hash.
    ///
    /// # Errors
    /// If it cannot be read, or is not such a file.
    pub fn read(path: &Path) -> Result<Self, Unpackable> {
        let length = std::fs::metadata(path)?.len();
        let mut file = std::fs::File::open(path)?;
        let mut hasher = blake3::Hasher::new();
        let mut head = [0; 24];
        file.read_exact(&mut head)?;
        hasher.update(&head);
        let number = |at: usize| head[at..at + 8].try_into().map(u64::from_le_bytes);
        let (rows, count) = (number(8), number(16));
        let (Ok(rows), Ok(count), true) = (rows, count, head[..8] == *MAGIC) else {
            return Err(Unpackable::Form);
        };
        let is_fitting = count <= 1 + MOST_DERIVATIVES as u64
            && rows.checked_mul(8 * (1 + count)).map(|bytes| bytes + 24) == Some(length);
        if !is_fitting {
            return Err(Unpackable::Form);
        }
        let mut list = || -> io::Result<Vec<f64>> {
            let mut numbers = Vec::with_capacity(rows as usize);
            let mut bytes = vec![0; 8 * BLOCK];
            let mut left = rows as usize;
            while left > 0 {
                let block = &mut bytes[..8 * left.min(BLOCK)];
                file.read_exact(block)?;
                hasher.update(block);
                let words = block.as_chunks::<8>().0;
                numbers.extend(words.iter().map(|word| f64::from_le_bytes(*word)));
                left -= words.len();
            }
            Ok(numbers)
        };
        let times = list()?;
        let columns = (0..count).map(|_| list()).collect::<io::Result<Vec<_>>>()?;
        let hash = hasher.finalize().to_hex().to_string();
        let stem = path.file_stem().and_then(|stem| stem.to_str());
        let is_hash = |name: &&str| name.len() == 64 && name.bytes().all(|b| b.is_ascii_hexdigit());
        if stem.filter(is_hash).is_some_and(|name| name != hash) {
            return Err(Unpackable::Changed(hash));
        }
        let all = || columns.iter().chain([&times]).flatten();
        let is_rising = times.windows(2).all(|pair| pair[0] < pair[1]);
        if !is_rising || !all().all(|number| number.is_finite()) {
            return Err(Unpackable::Form);
        }
        let mut points = Self::new(times, columns).ok_or(Unpackable::Form)?;
        points.refer_to(path.to_owned());
        Ok(points)
    }
}
