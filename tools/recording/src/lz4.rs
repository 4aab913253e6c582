//! LZ4 compressor for rows of 64-bit words that resemble the previous row.
//!
//! Used by the [chunk](super::chunk) of a recording. The output is one [frame] of [blocks][block] that any LZ4 reader
//! unpacks. A general compressor searches for an earlier occurrence of every four bytes; here each word has only two
//! candidates, both known in advance:
//!
//! - the same position in the previous row (constants, flags, the high bytes of slowly changing values), and
//! - an earlier position in the same row with the same word, its *echo* (for example the truth behind a fault-free
//!   sensor). Echoes are searched for once per block, in its second row.
//!
//! Words without a match become literals, as do rows of a different length.
//!
//! [frame]: https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md
//! [block]: https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md

use std::ops::Range;

use shared_types::zerocopy::IntoBytes;

/// Magic number; version 1, independent blocks, no checksums, no sizes; blocks of at most 4 MiB; and the second byte of
/// the `xxh32` of the previous two bytes.
pub(super) const FRAME_HEAD: [u8; 7] = [0x04, 0x22, 0x4d, 0x18, 0x60, 0x70, 0x73];
/// Block of size 0 that ends a frame.
pub(super) const FRAME_END: [u8; 4] = [0; 4];
/// Size of a word, in bytes.
const WORD: usize = size_of::<u64>();
/// Shortest match of the format, in bytes.
const MIN_MATCH: usize = 4;
/// Shortest match that saves more bytes than its encoding takes.
const WORTHWHILE: usize = 6;
/// Limit of the XOR difference below which the high `WORTHWHILE` bytes of a word are unchanged.
const SLIGHT: u64 = 1 << (8 * (WORD - WORTHWHILE));
/// Size of a fixed copy of literals, which is faster than a copy of the exact length.
const STRIDE: usize = 32;
/// Longest match distance of the format.
const MAX_DISTANCE: usize = u16::MAX as usize;
/// Number of words at the end of a row that matches avoid: a block may end after any row, and the format requires its
/// last match to start at least 12 bytes, and its last literals to begin at least 5 bytes, before the end.
const TAIL_WORDS: usize = 2;

/// Encoder of a frame.
pub(super) struct Encoder {
    /// Frame under construction, longer than `end`, so that writing needs no bounds checks.
    frame: Vec<u8>,
    end: usize,
    /// Literals that precede the next match.
    literals: Vec<u8>,
    /// Previous row.
    before: Vec<u64>,
    /// Number of bytes from the start of the previous row to the next output.
    distance: usize,
    /// Distance in words from each word to its expected echo; 0 if the word has none.
    echoes: Vec<usize>,
    /// Number of rows of the current length in this block.
    rows: usize,
    /// Number of padding bytes at the beginning of each row.
    skipped: usize,
    is_finished: bool,
}

impl Encoder {
    /// Creates an encoder of rows whose first `skipped` bytes, fewer than a word, are padding and are omitted.
    pub(super) fn new(skipped: usize) -> Self {
        let mut encoder = Self {
            skipped,
            frame: Vec::new(),
            end: 0,
            literals: Vec::new(),
            before: Vec::new(),
            distance: 0,
            echoes: Vec::new(),
            rows: 0,
            is_finished: false,
        };
        encoder.begin();
        encoder
    }

    /// Begins a new frame, discarding the previous one.
    pub(super) fn begin(&mut self) {
        self.end = FRAME_HEAD.len() + size_of::<u32>();
        self.make_room(0);
        self.frame[..FRAME_HEAD.len()].copy_from_slice(&FRAME_HEAD);
        self.literals.clear();
        self.before.clear();
        self.rows = 0;
        self.is_finished = false;
    }

    /// Appends uncompressed bytes.
    pub(super) fn plain(&mut self, bytes: &[u8]) {
        self.literals.extend_from_slice(bytes);
        self.distance += bytes.len();
    }

    /// Appends a row. The contents of `row` are unspecified afterwards.
    pub(super) fn row(&mut self, row: &mut Vec<u64>) {
        let bytes = row.as_bytes();
        self.make_room(bytes.len());
        let alike = row.len() == self.before.len() && self.distance <= MAX_DISTANCE;
        let done = if alike {
            if self.rows == 1 {
                self.find_echoes(row);
            }
            self.rows += 1;
            self.matches(row)
        } else {
            self.rows = 1;
            self.skipped
        };
        self.literals.extend_from_slice(&bytes[done..]);
        self.distance = bytes.len() - self.skipped;
        std::mem::swap(&mut self.before, row);
    }

    /// Ends the frame, unless it has ended. [`Encoder::begin`] starts another one.
    pub(super) fn finish(&mut self) -> &[u8] {
        if std::mem::replace(&mut self.is_finished, true) {
            return &self.frame[..self.end];
        }
        let literals = std::mem::take(&mut self.literals);
        self.make_room(literals.len());
        self.token(literals.len(), 0);
        self.copy(&literals);
        self.literals = literals;
        let head = FRAME_HEAD.len();
        let block = self.end - head - size_of::<u32>();
        self.frame[head..head + size_of::<u32>()].copy_from_slice(&(block as u32).to_le_bytes());
        self.copy(&FRAME_END);
        &self.frame[..self.end]
    }

    /// Writes all matches of a row; returns the number of bytes written.
    fn matches(&mut self, row: &[u64]) -> usize {
        // The previous row is no longer needed; its buffer now holds the bits that changed.
        let mut changes = std::mem::take(&mut self.before);
        for (change, word) in changes.iter_mut().zip(row) {
            *change ^= word;
        }
        let echoes = std::mem::take(&mut self.echoes);
        let bytes = row.as_bytes();
        let words = row.len().saturating_sub(TAIL_WORDS);
        let (changes_in_reach, echoes_in_reach) = (&changes[..words], &echoes[..words]);
        let mut done = self.skipped;
        let mut place = 0;
        while place < words {
            let change = changes_in_reach[place];
            let echo = echoes_in_reach[place];
            let (start, distance);
            if change < SLIGHT {
                // The unchanged bytes begin in this word or in the previous one.
                let last = if change == 0 && place > 0 {
                    high_bytes(changes[place - 1])
                } else {
                    0
                };
                (start, distance) = (
                    WORD * (place + 1) - high_bytes(change) - last,
                    self.distance,
                );
                place += 1;
                place += length_of(&changes_in_reach[place..], |change| **change == 0);
            } else if echo > 0 && row[place] == row[place - echo] {
                (start, distance) = (WORD * place, WORD * echo);
                let pairs = row[place..words].iter().zip(&row[place - echo..]);
                place += length_of(pairs, |(word, echo)| word == echo);
            } else {
                place += 1;
                continue;
            }
            let low = if change < SLIGHT && place < words {
                low_bytes(changes_in_reach[place])
            } else {
                0
            };
            let end = WORD * place + low;
            let start = if start > done { start } else { done };
            if end >= start + WORTHWHILE {
                self.sequence(bytes, done..start, distance, end - start);
                done = end;
            }
        }
        self.before = changes;
        self.echoes = echoes;
        done
    }

    /// Finds for each changed word the nearest earlier position in its row with the same value.
    fn find_echoes(&mut self, row: &[u64]) {
        let before = &self.before;
        let reach = MAX_DISTANCE / WORD;
        let echo = |place: usize| {
            let nearest = (row[1..place].iter().rev().take(reach)).position(|w| *w == row[place]);
            let has_changed = row[place] != before[place];
            nearest.filter(|_| has_changed).map_or(0, |words| words + 1)
        };
        self.echoes.clear();
        // The first word may be incomplete.
        self.echoes.push(0);
        self.echoes.extend((1..row.len()).map(echo));
    }

    /// Writes the pending literals and a range of these bytes as literals, followed by a match.
    fn sequence(&mut self, bytes: &[u8], literals: Range<usize>, distance: usize, length: usize) {
        let extra = length - MIN_MATCH;
        self.token(self.literals.len() + literals.len(), extra);
        if !self.literals.is_empty() {
            let waiting = std::mem::take(&mut self.literals);
            self.copy(&waiting);
            self.literals = waiting;
            self.literals.clear();
        }
        if literals.len() <= STRIDE && literals.start + STRIDE <= bytes.len() {
            let stride = &bytes[literals.start..literals.start + STRIDE];
            self.frame[self.end..self.end + STRIDE].copy_from_slice(stride);
            self.end += literals.len();
        } else {
            self.copy(&bytes[literals]);
        }
        self.copy(&(distance as u16).to_le_bytes());
        self.rest(extra);
    }

    /// Writes the token byte with both lengths, and the extension bytes of the literal length.
    fn token(&mut self, literals: usize, extra: usize) {
        let half = |count: usize| if count < 15 { count as u8 } else { 15 };
        self.byte(half(literals) << 4 | half(extra));
        self.rest(literals);
    }

    fn rest(&mut self, count: usize) {
        if count >= 15 {
            let mut remaining = count - 15;
            while remaining >= 255 {
                self.byte(255);
                remaining -= 255;
            }
            self.byte(remaining as u8);
        }
    }

    fn byte(&mut self, byte: u8) {
        self.frame[self.end] = byte;
        self.end += 1;
    }

    fn copy(&mut self, bytes: &[u8]) {
        self.frame[self.end..self.end + bytes.len()].copy_from_slice(bytes);
        self.end += bytes.len();
    }

    /// Reserves space for a row of `bytes` bytes in the worst case, in addition to the pending literals.
    fn make_room(&mut self, bytes: usize) {
        let literals = self.literals.len() + bytes;
        // A sequence takes at most 3 bytes more than its literals and saves at least as many; the lengths of literals
        // take one byte in 255.
        let size = self.end + literals + literals / 255 + 64 + STRIDE;
        if self.frame.len() < size {
            self.frame.resize(size + size / 2, 0);
        }
    }
}

/// Counts the leading items that satisfy a predicate.
fn length_of<T>(items: impl IntoIterator<Item = T>, is_so: impl Fn(&T) -> bool) -> usize {
    items.into_iter().take_while(is_so).count()
}

/// Counts the unchanged bytes at the end of a word.
const fn high_bytes(change: u64) -> usize {
    change.leading_zeros() as usize / 8
}

/// Counts the unchanged bytes at the beginning of a word.
const fn low_bytes(change: u64) -> usize {
    change.trailing_zeros() as usize / 8
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// Unpacks a frame with the reference implementation.
    fn unpacked(frame: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut decoder = lz4::Decoder::new(frame).expect("a frame");
        decoder.read_to_end(&mut bytes).expect("a whole frame");
        bytes
    }

    /// Returns pseudo-random words (splitmix64).
    fn noise(seed: u64) -> u64 {
        let mixed = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// Returns a row with every kind of change between rows.
    fn row(step: u64, words: u64) -> Vec<u64> {
        let word = |place: u64| match place % 13 {
            0 => step,
            1..=4 => 7 * place,
            5 => noise(1000 * step + 1),
            6 => 1000 * step * step,
            7 => (0.001 * step as f64 + place as f64).to_bits(),
            8 => noise(1000 * step + 1),
            9 if step.is_multiple_of(5) => noise(step),
            10 => noise(1000 * step + place) << 40,
            _ => 0,
        };
        (0..words).map(word).collect()
    }

    #[test]
    fn the_reference_implementation_unpacks_the_output() {
        for skipped in [0, 5] {
            let mut encoder = Encoder::new(skipped);
            for words in [1, 2, 3, 4, 13, 40, 118, 300, 9000] {
                for rows in [0, 1, 2, 3, 40] {
                    let mut expected = Vec::new();
                    for step in 0..rows {
                        let mut row = row(step, words);
                        // An echo of the padded first word must not be used.
                        row[0] <<= 8 * skipped;
                        *row.last_mut().expect("a word") = row[0];
                        row[words as usize / 2] = row[0];
                        expected.extend_from_slice(&row.as_bytes()[skipped..]);
                        encoder.row(&mut row);
                        if step % 7 == 3 {
                            let text = vec![step as u8; 50 * step as usize];
                            expected.extend_from_slice(&text);
                            encoder.plain(&text);
                        }
                    }
                    let frame = encoder.finish();
                    assert!(unpacked(frame) == expected, "{rows} rows of {words} words");
                    encoder.begin();
                }
            }
        }
    }

    #[test]
    fn only_new_words_take_space() {
        let packed = |word: fn(u64, u64) -> u64| {
            let mut encoder = Encoder::new(0);
            for step in 0..1000 {
                encoder.row(&mut (0..100).map(|place| word(step, place)).collect());
            }
            encoder.finish().len() / 1000
        };
        let none = packed(|_, place| place);
        let all = packed(|step, place| noise(100 * step + place));
        let small = packed(|step, place| noise(100 * step + place) >> 48);
        let echoed = packed(|step, place| noise(100 * step + place % 50));
        assert!(none < 30, "{none}");
        assert!((800..=810).contains(&all), "{all}");
        // Two bytes are new; a match for the other six takes three.
        assert!((490..=520).contains(&small), "{small}");
        // Half of the words, the two at the end, and the echo of the first.
        assert!((424..=435).contains(&echoed), "{echoed}");
    }

    #[test]
    fn rows_of_varying_and_of_huge_length_are_encoded() {
        let mut encoder = Encoder::new(0);
        let mut expected = Vec::new();
        for words in [10, 10, 11, 11, 10, 3, 3, 20_000, 20_000, 20_000, 1, 1] {
            let mut row: Vec<u64> = (0..words).collect();
            expected.extend_from_slice(row.as_bytes());
            encoder.row(&mut row);
        }
        assert!(unpacked(encoder.finish()) == expected);
    }
}
