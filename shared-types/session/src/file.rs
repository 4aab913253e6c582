//! Hash that identifies a program's file, on this machine and on a target.

use std::fs::File;
use std::io;
use std::path::Path;

/// Computes the BLAKE3 hash of a file, in hexadecimal digits.
///
/// # Errors
/// If the file cannot be read.
pub fn hash(path: &Path) -> io::Result<String> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(hasher.finalize().to_hex().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_the_published_hash_of_its_content() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("empty");
        File::create(&path).expect("made");
        // The test vector of BLAKE3 for no input.
        let empty = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";
        assert_eq!(hash(&path).expect("reads"), empty);
        assert!(hash(&folder.path().join("absent")).is_err());
    }
}
