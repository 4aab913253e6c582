//! Seals: data on the wire is encrypted and authenticated with keys known only to the two ends of one session.
//!
//! Noise (`NNpsk0`, Curve25519, ChaCha20-Poly1305, BLAKE2s) from the crate `snow`. The pre-shared key makes a
//! handshake with a stranger fail, the ephemeral keys make replayed handshakes useless, and the prologue binds the
//! facts about the session that both ends must agree on.

use rustix::rand::{GetRandomFlags, getrandom};
use snow::{Builder, HandshakeState, StatelessTransportState};

/// Size of a key in bytes.
const KEY_BYTES: usize = 32;
/// Size of an authentication tag in bytes.
const TAG_BYTES: usize = 16;
/// Size of a datagram's number in bytes.
const NUMBER_BYTES: usize = 8;
/// Maximum length of a handshake message: an ephemeral key and a tag.
const LONGEST_HANDSHAKE: usize = 48;
const PATTERN: &str = "Noise_NNpsk0_25519_ChaChaPoly_BLAKE2s";

/// Secret shared by both ends. Never shown, logged or written except to its own file.
#[derive(Clone)]
pub struct Key([u8; KEY_BYTES]);

/// Authentication failure: the other end has another key or another prologue, or the data was changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("authentication failed: the data is not from this session's other end")]
pub struct Unsealed;

impl Key {
    /// Creates a fresh key.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub(crate) fn random() -> std::io::Result<Self> {
        let mut key = [0; KEY_BYTES];
        let mut filled = 0;
        while filled < KEY_BYTES {
            filled += getrandom(&mut key[filled..], GetRandomFlags::empty())?;
        }
        Ok(Self(key))
    }

    /// Returns the key as hexadecimal digits, for its file or the channel.
    pub(crate) fn to_hex(&self) -> String {
        blake3::Hash::from_bytes(self.0).to_hex().to_string()
    }

    /// Parses a key of 64 hexadecimal digits.
    #[must_use]
    pub fn from_hex(digits: &str) -> Option<Self> {
        let key = blake3::Hash::from_hex(digits.trim()).ok()?;
        Some(Self(*key.as_bytes()))
    }
}

/// Handshake in progress.
pub struct Begun(HandshakeState);

/// Starts a handshake; also returns its first message.
///
/// # Errors
/// If the system has no random numbers.
pub fn begin(key: &Key, prologue: &[u8]) -> Result<(Begun, Vec<u8>), Unsealed> {
    let mut handshake = builder(key, prologue)?
        .build_initiator()
        .map_err(unsealed)?;
    let message = written(&mut handshake)?;
    Ok((Begun(handshake), message))
}

impl Begun {
    /// Completes the handshake with the other end's answer.
    ///
    /// # Errors
    /// If the other end has another key or another prologue.
    pub fn end(mut self, answer: &[u8]) -> Result<Seal, Unsealed> {
        self.0.read_message(answer, &mut []).map_err(unsealed)?;
        Seal::of(self.0)
    }
}

/// Completes a handshake from its first message; also returns the answer.
///
/// # Errors
/// If the other end has another key or another prologue.
pub fn answer(key: &Key, prologue: &[u8], first: &[u8]) -> Result<(Seal, Vec<u8>), Unsealed> {
    let mut handshake = builder(key, prologue)?
        .build_responder()
        .map_err(unsealed)?;
    handshake.read_message(first, &mut []).map_err(unsealed)?;
    let message = written(&mut handshake)?;
    Ok((Seal::of(handshake)?, message))
}

fn builder<'a>(key: &'a Key, prologue: &'a [u8]) -> Result<Builder<'a>, Unsealed> {
    let builder = Builder::new(PATTERN.parse().map_err(unsealed)?);
    let builder = builder.psk(0, &key.0).map_err(unsealed)?;
    builder.prologue(prologue).map_err(unsealed)
}

fn written(handshake: &mut HandshakeState) -> Result<Vec<u8>, Unsealed> {
    let mut message = vec![0; LONGEST_HANDSHAKE];
    let length = handshake
        .write_message(&[], &mut message)
        .map_err(unsealed)?;
    message.truncate(length);
    Ok(message)
}

fn unsealed(_: snow::Error) -> Unsealed {
    Unsealed
}

/// Keys of one end, one for each direction.
pub struct Seal(StatelessTransportState);

impl Seal {
    fn of(handshake: HandshakeState) -> Result<Self, Unsealed> {
        handshake
            .into_stateless_transport_mode()
            .map(Self)
            .map_err(unsealed)
    }

    /// Encrypts content into `sealed`, with a never-used number as nonce.
    ///
    /// # Errors
    /// If the content is longer than 65,519 bytes, a Noise message without its tag.
    pub fn close(&self, number: u64, content: &[u8], sealed: &mut Vec<u8>) -> Result<(), Unsealed> {
        let from = sealed.len();
        sealed.resize(from + content.len() + TAG_BYTES, 0);
        let written = self
            .0
            .write_message(number, content, &mut sealed[from..])
            .map_err(unsealed)?;
        sealed.truncate(from + written);
        Ok(())
    }

    /// Decrypts content sealed with this number, into `content`.
    ///
    /// # Errors
    /// If the data is not from the other end, or was changed.
    pub fn open(&self, number: u64, sealed: &[u8], content: &mut Vec<u8>) -> Result<(), Unsealed> {
        content.resize(sealed.len(), 0);
        let written = self
            .0
            .read_message(number, sealed, content)
            .map_err(unsealed)?;
        content.truncate(written);
        Ok(())
    }
}

/// Datagrams of one end: each is numbered, sealed by itself, and accepted once.
pub struct Datagrams {
    seal: Seal,
    sent: u64,
    window: Window,
    sealed: Vec<u8>,
    content: Vec<u8>,
}

impl Datagrams {
    /// Creates the datagrams of a session.
    #[must_use]
    pub const fn new(seal: Seal) -> Self {
        Self {
            seal,
            sent: 0,
            window: Window::NEW,
            sealed: Vec::new(),
            content: Vec::new(),
        }
    }

    /// Seals content as the next datagram.
    ///
    /// # Errors
    /// If the content is too long.
    pub fn close(&mut self, content: &[u8]) -> Result<&[u8], Unsealed> {
        self.sent += 1;
        self.sealed.clear();
        self.sealed.extend(self.sent.to_le_bytes());
        self.seal.close(self.sent, content, &mut self.sealed)?;
        Ok(&self.sealed)
    }

    /// Opens a datagram; also returns `true` if it has the highest number so far.
    ///
    /// # Errors
    /// If the datagram is not from the other end, was changed, or is a replay.
    pub fn open(&mut self, datagram: &[u8]) -> Result<(&[u8], bool), Unsealed> {
        let (number, sealed) = datagram.split_at_checked(NUMBER_BYTES).ok_or(Unsealed)?;
        let number = u64::from_le_bytes(number.try_into().map_err(|_| Unsealed)?);
        if !self.window.is_new(number) {
            return Err(Unsealed);
        }
        self.seal.open(number, sealed, &mut self.content)?;
        let is_newest = self.window.note(number);
        Ok((&self.content, is_newest))
    }
}

/// Numbers of received datagrams, back to the latest acceptable one.
struct Window {
    highest: u64,
    /// Bit `i` is set if `highest - i` was received.
    came: u128,
}

impl Window {
    const NEW: Self = Self {
        highest: 0,
        came: 1,
    };

    const fn is_new(&self, number: u64) -> bool {
        if number > self.highest {
            return true;
        }
        let age = self.highest - number;
        age < 128 && self.came >> age & 1 == 0
    }

    /// Records an authentic datagram; returns `true` if it is the latest.
    const fn note(&mut self, number: u64) -> bool {
        if number > self.highest {
            let newer = number - self.highest;
            self.came = if newer < 128 {
                self.came << newer | 1
            } else {
                1
            };
            self.highest = number;
            return true;
        }
        self.came |= 1 << (self.highest - number);
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(keys: [&Key; 2], prologues: [&[u8]; 2]) -> Result<[Datagrams; 2], Unsealed> {
        let (begun, first) = begin(keys[0], prologues[0])?;
        let (theirs, second) = answer(keys[1], prologues[1], &first)?;
        Ok([Datagrams::new(begun.end(&second)?), Datagrams::new(theirs)])
    }

    fn same() -> [Datagrams; 2] {
        let key = Key::random().expect("random");
        pair([&key, &key], [b"a", b"a"]).expect("one key")
    }

    #[test]
    fn another_key_or_another_prologue_is_refused() {
        let keys = [
            Key::random().expect("random"),
            Key::random().expect("random"),
        ];
        assert!(pair([&keys[0], &keys[1]], [b"a", b"a"]).is_err());
        assert!(pair([&keys[0], &keys[0]], [b"a", b"b"]).is_err());
    }

    #[test]
    fn a_key_round_trips_through_its_digits_and_invalid_digits_are_refused() {
        let key = Key::random().expect("random");
        let read = Key::from_hex(&format!("{}\n", key.to_hex())).expect("its digits");
        assert!(read.0 == key.0);
        for wrong in ["", "00", "zz", &"0".repeat(63), &"0".repeat(65)] {
            assert!(Key::from_hex(wrong).is_none(), "{wrong}");
        }
    }

    #[test]
    fn a_datagram_is_accepted_once_unchanged_and_only_by_the_other_end() {
        let [mut desk, mut target] = same();
        let first = desk.close(b"first").expect("sealed").to_vec();
        let second = desk.close(b"second").expect("sealed").to_vec();
        for place in 0..first.len() {
            let mut changed = first.clone();
            changed[place] ^= 1;
            assert!(target.open(&changed).is_err(), "byte {place}");
        }
        for length in 0..first.len() {
            assert!(target.open(&first[..length]).is_err(), "cut to {length}");
        }
        assert_eq!(target.open(&second), Ok((&b"second"[..], true)));
        assert_eq!(target.open(&first), Ok((&b"first"[..], false)));
        assert!(target.open(&first).is_err(), "again");
        assert!(target.open(&second).is_err(), "again");
        assert!(desk.open(&first).is_err(), "back to who sent it");
        let [_, mut other] = same();
        assert!(other.open(&first).is_err(), "of another session");
    }

    #[test]
    fn a_datagram_that_is_too_late_is_refused() {
        let [mut desk, mut target] = same();
        let all: Vec<Vec<u8>> = (0..200)
            .map(|_| desk.close(b"x").expect("sealed").to_vec())
            .collect();
        assert!(target.open(&all[199]).is_ok());
        assert!(target.open(&all[71]).is_err(), "128 before");
        assert!(target.open(&all[72]).is_ok(), "127 before");
        assert!(target.open(&all[72]).is_err(), "again");
    }
}
