//! LZ4 made for rows of 64-bit words that resemble the row before.
//!
//! Used by the [chunk](super::chunk) of a recording. Any LZ4 reader unpacks what comes out: one
//! [frame] of one [block]. A compressor that knows nothing of its input looks at every byte for
//! an earlier place with the same four; here only two places come into question for a word, and
//! both are known beforehand:
//!
//! - where it stood in the row before (constants, flags, the high bytes of what changes slowly), and
//! - where in its own row it stands already: its *echo* (what a sensor without fault shows of the
//!   truth). Echoes are looked up once a block, in its second row.
//!
//! Whatever matches neither is a literal, and a row of another length is one as a whole.
//!
//! [frame]: https://github.com/lz4/lz4/blob/dev/doc/lz4_Frame_format.md
//! [block]: https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md

use std::ops::Range;

use shared_types::zerocopy::IntoBytes;

/// Magic number; version 1, independent blocks, no checksums, no sizes; blocks of at most 4 MiB; and
/// the second byte of the `xxh32` of the two bytes before.
const FRAME_HEAD: [u8; 7] = [0x04, 0x22, 0x4d, 0x18, 0x60, 0x70, 0x73];
/// The block of size 0 that ends a frame.
const FRAME_END: [u8; 4] = [0; 4];
/// Bytes of a word.
const WORD: usize = size_of::<u64>();
/// The format's shortest match.
const MIN_MATCH: usize = 4;
/// A match of fewer bytes saves less than it costs to write down.
const WORTHWHILE: usize = 6;
/// A change below this leaves N bytes of a word alone.
const SLIGHT: u64 = 1 << (8 * (WORD - WORTHWHILE));
/// Literals of at most N bytes are copied as if they were N, which is quicker.
const STRIDE: usize = 32;
/// The format's longest way back.
const MAX_DISTANCE: usize = u16::MAX as usize;
/// No match reaches into the last bytes of a row: a block may end after any, and by its format its
/// last match starts 12 bytes before its end and its last 5 bytes are literals.
const TAIL_WORDS: usize = 2;

/// A frame in the making.
pub(super) struct Encoder {
    /// The frame so far. Longer than `end`, so that there is room to write without asking.
    frame: Vec<u8>,
    end: usize,
    /// Literals that wait for the match that ends them.
    literals: Vec<u8>,
    /// The last row.
    before: Vec<u64>,
    /// Bytes between the start of the last row and what comes next.
    distance: usize,
    /// Number of words before a word of a row at which the same word is expected; 0: nowhere.
    echoes: Vec<usize>,
    /// Rows of this length in this block so far.
    rows: usize,
    /// Bytes at the beginning of each row that only fill its first word.
    skipped: usize,
    is_finished: bool,
}

impl Encoder {
    /// An encoder of rows whose first bytes, fewer than a word, only fill up their first word and
    /// are left out.
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

    /// Begins a frame; whatever was in the last one is forgotten.
    pub(super) fn begin(&mut self) {
        self.end = FRAME_HEAD.len() + size_of::<u32>();
        self.make_room(0);
        self.frame[..FRAME_HEAD.len()].copy_from_slice(&FRAME_HEAD);
        self.literals.clear();
        self.before.clear();
        self.rows = 0;
        self.is_finished = false;
    }

    /// Takes in bytes as they are.
    pub(super) fn plain(&mut self, bytes: &[u8]) {
        self.literals.extend_from_slice(bytes);
        self.distance += bytes.len();
    }

    /// Takes in a row. The words left in `row` afterwards are of no use.
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

    /// Ends the frame, if it has not ended. Another one is begun with [`Encoder::begin`].
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

    /// Writes every match of a row; returns how many of its bytes are done.
    fn matches(&mut self, row: &[u64]) -> usize {
        // The last row is not needed any more: from here on, which of its bits changed.
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
                // The bytes that are as before begin in this word, or in the last one.
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

    /// Finds for each word that changed the nearest place before it in its row that holds the same.
    fn find_echoes(&mut self, row: &[u64]) {
        let before = &self.before;
        let reach = MAX_DISTANCE / WORD;
        let echo = |place: usize| {
            let nearest = (row[1..place].iter().rev().take(reach)).position(|w| *w == row[place]);
            let has_changed = row[place] != before[place];
            nearest.filter(|_| has_changed).map_or(0, |words| words + 1)
        };
        self.echoes.clear();
        // The first word may not be there as a whole.
        self.echoes.push(0);
        self.echoes.extend((1..row.len()).map(echo));
    }

    /// Writes what waits and a range of these bytes as literals, then a match.
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

    /// Writes the byte that says both lengths, as far as it can, and the rest of the first.
    fn token(&mut self, literals: usize, extra: usize) {
        let half = |count: usize| if count < 15 { count as u8 } else { 15 };
        self.byte(half(literals) << 4 | half(extra));
        self.rest(literals);
    }

    fn rest(&mut self, count: usize) {
        if count >= 15 {
            let mut left = count - 15;
            while left >= 255 {
                self.byte(255);
                left -= 255;
            }
            self.byte(left as u8);
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

    /// Makes room for N bytes of a row at its worst, after what waits.
    fn make_room(&mut self, bytes: usize) {
        let literals = self.literals.len() + bytes;
        // A sequence takes at most 3 bytes more than its literals and saves at least as many; the
        // lengths of literals take one byte in 255.
        let wanted = self.end + literals + literals / 255 + 64 + STRIDE;
        if self.frame.len() < wanted {
            self.frame.resize(wanted + wanted / 2, 0);
        }
    }
}

/// Counts the first items that are so, up to the first that is not.
fn length_of<T>(items: impl IntoIterator<Item = T>, is_so: impl Fn(&T) -> bool) -> usize {
    items.into_iter().take_while(is_so).count()
}

/// Bytes at the end of a word that do not change.
const fn high_bytes(change: u64) -> usize {
    change.leading_zeros() as usize / 8
}

/// Bytes at the beginning of a word that do not change.
const fn low_bytes(change: u64) -> usize {
    change.trailing_zeros() as usize / 8
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    /// Unpacks a frame by the reference implementation.
    fn unpacked(frame: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut decoder = lz4::Decoder::new(frame).expect("a frame");
        decoder.read_to_end(&mut bytes).expect("a whole frame");
        bytes
    }

    /// Words without any order (splitmix64).
    fn noise(seed: u64) -> u64 {
        let mixed = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A row of each of the ways in which a word can go on.
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
    fn the_reference_implementation_unpacks_what_was_packed() {
        for skipped in [0, 5] {
            let mut encoder = Encoder::new(skipped);
            for words in [1, 2, 3, 4, 13, 40, 118, 300, 9000] {
                for rows in [0, 1, 2, 3, 40] {
                    let mut expected = Vec::new();
                    for step in 0..rows {
                        let mut row = row(step, words);
                        // An echo of the first word must not be taken for one.
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
    fn only_words_that_are_new_take_place() {
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
        // Two bytes are new; saying that the other six are not takes three.
        assert!((490..=520).contains(&small), "{small}");
        // Half of the words, the two of the tail, and the echo of the first.
        assert!((424..=435).contains(&echoed), "{echoed}");
    }

    #[test]
    fn rows_of_changing_length_and_huge_ones_are_kept() {
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
