//! The compression setting of a recording; compressing is done in `chunk` and `lz4`.

/// Compression of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// None.
    None,
    /// Fast compression.
    Lz4,
    /// Small files.
    Zstd,
}
