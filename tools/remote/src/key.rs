//! Key files, and the handshake of a connection without `ssh`.

use std::fs;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::message::PROTOCOL;
use crate::seal::{Key, Seal};

/// Size of the length field before a handshake message in bytes.
const LENGTH_BYTES: usize = size_of::<u16>();
/// Maximum length of a handshake message in bytes.
const LONGEST: usize = 256;

/// Unusable key file.
#[derive(Debug, thiserror::Error)]
pub enum KeyError {
    /// Error of the operating system.
    #[error("key file {}: {error}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Error.
        error: io::Error,
    },
    /// The file exists, and a new key must not replace an existing one.
    #[error("key file {} already exists and is not overwritten; name another, or remove it", .0.display())]
    Exists(PathBuf),
    /// The file is readable by others, or belongs to another user.
    #[error("key file {} can be read by others, or is not yours: `chmod 600 {}`", .0.display(), .0.display())]
    Open(PathBuf),
    /// The content is not a key.
    #[error("key file {} holds no key; create one with `hil target key FILE`", .0.display())]
    NoKey(PathBuf),
}

/// Creates a new key file that nobody else can read.
///
/// # Errors
/// If the file exists, or cannot be created.
pub fn make_key(path: &Path) -> Result<(), KeyError> {
    let failed = |error| KeyError::Io {
        path: path.into(),
        error,
    };
    let key = Key::random().map_err(failed)?;
    let mut options = fs::OpenOptions::new();
    let mut file = options
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)
        .map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => KeyError::Exists(path.into()),
            _ => failed(error),
        })?;
    writeln!(file, "{}", key.to_hex())
        .and_then(|()| file.sync_all())
        .map_err(failed)
}

/// Reads a key file.
///
/// # Errors
/// If others can read the file, or it holds no key.
pub(crate) fn read_key(path: &Path) -> Result<Key, KeyError> {
    let failed = |error| KeyError::Io {
        path: path.into(),
        error,
    };
    let file = fs::File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    let own = rustix::process::geteuid().as_raw();
    if !metadata.is_file() {
        return Err(KeyError::NoKey(path.into()));
    }
    if metadata.mode() & 0o077 != 0 || ![own, 0].contains(&metadata.uid()) {
        return Err(KeyError::Open(path.into()));
    }
    let mut digits = String::new();
    file.take(1024)
        .read_to_string(&mut digits)
        .map_err(|_| KeyError::NoKey(path.into()))?;
    Key::from_hex(&digits).ok_or_else(|| KeyError::NoKey(path.into()))
}

pub(crate) fn prologue() -> Vec<u8> {
    format!("hil-target {PROTOCOL} serve").into_bytes()
}

pub(crate) fn put(into: &mut impl Write, message: &[u8]) -> io::Result<()> {
    let mut bytes = (message.len() as u16).to_le_bytes().to_vec();
    bytes.extend(message);
    into.write_all(&bytes)
}

/// Nonce of the message that ends a handshake; later messages count from 0.
const PROOF: u64 = 1 << 62;

/// Proves to the other end that this end completed the handshake, which an attacker who only replays messages
/// cannot do.
///
/// # Errors
/// If the connection failed.
pub(crate) fn prove(into: &mut impl Write, seal: &Seal) -> io::Result<()> {
    let mut proof = Vec::new();
    seal.close(PROOF, b"here", &mut proof)
        .map_err(io::Error::other)?;
    put(into, &proof)
}

/// Checks the other end's proof that it completed the handshake.
///
/// # Errors
/// If the proof is invalid.
pub(crate) fn check_proof(proof: &[u8], seal: &Seal) -> io::Result<()> {
    let opened = seal.open(PROOF, proof, &mut Vec::new());
    opened.map_err(io::Error::other)
}

/// Describes the failure of a handshake, with a possible cause of silence.
pub(crate) fn no_handshake(error: &io::Error, limit: Duration, silence: &str) -> String {
    use io::ErrorKind::{BrokenPipe, ConnectionReset, TimedOut, UnexpectedEof, WouldBlock};
    match error.kind() {
        WouldBlock | TimedOut => format!("no handshake within {} s{silence}", limit.as_secs()),
        UnexpectedEof | ConnectionReset | BrokenPipe => {
            "no handshake: the other end closed the connection, which it does if it has another key or another \
             version, or waited too long"
                .into()
        }
        _ => format!("no handshake ({error}): another key or another version"),
    }
}

/// Connection with a deadline for all reads together.
pub(crate) struct Until<'a>(pub(crate) &'a TcpStream, pub(crate) Instant);

impl Read for Until<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let remaining = self.1.saturating_duration_since(Instant::now());
        if remaining.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.0.set_read_timeout(Some(remaining))?;
        self.0.read(buffer)
    }
}

/// Waits for a handshake message.
pub(crate) fn get(from: &mut impl Read) -> io::Result<Vec<u8>> {
    let message = PartialMessage::default().read(from)?;
    message.ok_or_else(|| io::ErrorKind::WouldBlock.into())
}

/// Handshake message received so far. No bytes after it are read.
#[derive(Default)]
pub(crate) struct PartialMessage(Vec<u8>);

impl PartialMessage {
    /// Reads available bytes; returns the message once it is complete.
    ///
    /// # Errors
    /// If the connection failed or was closed, or the message is too long.
    pub(crate) fn read(&mut self, from: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
        let mut buffer = [0; LENGTH_BYTES + LONGEST];
        loop {
            let length = self.0.first_chunk().copied().map(u16::from_le_bytes);
            let whole = LENGTH_BYTES + length.map_or(0, usize::from);
            if whole > buffer.len() {
                let text = "handshake too long";
                return Err(io::Error::new(io::ErrorKind::InvalidData, text));
            }
            if length.is_some() && self.0.len() == whole {
                return Ok(Some(std::mem::take(&mut self.0).split_off(LENGTH_BYTES)));
            }
            match from.read(&mut buffer[..whole - self.0.len()]) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.0.extend(&buffer[..count]),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    #[test]
    fn a_failed_handshake_reports_the_reason() {
        use io::ErrorKind::{ConnectionReset, Other, TimedOut, UnexpectedEof, WouldBlock};
        for (kinds, begin) in [
            (
                &[WouldBlock, TimedOut][..],
                "no handshake within 10 s; busy",
            ),
            (
                &[UnexpectedEof, ConnectionReset],
                "no handshake: the other end closed",
            ),
            (&[Other], "no handshake ("),
        ] {
            for kind in kinds {
                let reason = no_handshake(&(*kind).into(), Duration::from_secs(10), "; busy");
                assert!(reason.starts_with(begin), "{reason}");
            }
        }
    }

    #[test]
    fn a_key_is_read_unless_it_is_invalid_or_readable_by_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("board.key");
        make_key(&path).expect("made");
        read_key(&path).expect("a key");
        assert!(matches!(make_key(&path), Err(KeyError::Exists(_))));
        for mode in [0o640, 0o604] {
            fs::set_permissions(&path, fs::Permissions::from_mode(mode)).expect("set");
            assert!(
                matches!(read_key(&path), Err(KeyError::Open(_))),
                "{mode:o}"
            );
        }
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).expect("set");
        fs::write(&path, "no key").expect("written");
        for none in [path.as_path(), folder.path()] {
            assert!(matches!(read_key(none), Err(KeyError::NoKey(_))));
        }
    }
}
