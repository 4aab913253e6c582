//! Choice of a recording's compression. Compresses nothing: that is `chunk` and `lz4`.

/// Compression of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// None.
    None,
    /// Fast.
    Lz4,
    /// Small.
    Zstd,
}
