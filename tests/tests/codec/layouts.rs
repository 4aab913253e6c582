//! Random messages of a DBC file: numbers of any width, place and byte order, with and without sign, and floats.

use std::fmt::Write;

use shared_types::extremes::{larger, smaller};
use shared_types::random::RandomStream;

const MESSAGES: u32 = 24;
/// Most attempts to place a signal in a message; a row has at most 512 signals.
const MOST_ATTEMPTS: usize = 20;
/// Lengths of CAN, the longer ones of CAN FD.
const LENGTHS: [usize; 12] = [1, 2, 3, 5, 8, 8, 8, 12, 20, 32, 48, 64];

/// Returns a whole number from 0 to `end - 1`.
fn below(random: &mut RandomStream, end: usize) -> usize {
    ((random.uniform() * end as f64) as usize).min(end - 1)
}

/// Lists the bits of a signal, numbered as in a DBC file: a Motorola signal descends in a byte and goes on in the next.
fn bits(start: usize, width: usize, is_big: bool) -> Vec<usize> {
    let mut bit = start;
    let mut bits = vec![bit];
    while bits.len() < width {
        bit = match (is_big, bit % 8) {
            (false, _) => bit + 1,
            (true, 0) => bit + 15,
            (true, _) => bit - 1,
        };
        bits.push(bit);
    }
    bits
}

/// Writes a DBC file with random messages.
pub(super) fn random(seed: u64) -> String {
    let mut random = RandomStream::new(seed, "layouts");
    let mut text = "VERSION \"\"\n\nBS_:\n\nBU_: Rig Law\n".to_owned();
    let mut floats = String::new();
    for message in 0..MESSAGES {
        let length = LENGTHS[below(&mut random, LENGTHS.len())];
        let id = match message % 3 {
            0 => (1 << 31) + 0x1800_0000 + message,
            _ => 0x100 + message,
        };
        write!(text, "\nBO_ {id} Message{message}: {length} Rig\n").expect("text");
        let mut is_free = vec![true; length * 8];
        let (mut signal, mut attempt) = (0, 0);
        while signal == 0 || attempt < (3 * length).min(MOST_ATTEMPTS) {
            attempt += 1;
            let start = below(&mut random, length * 8);
            let is_big = random.uniform() < 0.5;
            let is_float = length >= 4 && random.uniform() < 0.1;
            let width = match (is_float, random.uniform() < 0.3) {
                (true, is_wide) => 32 + 32 * usize::from(is_wide),
                (false, true) => 1 + below(&mut random, 64),
                (false, false) => 1 + below(&mut random, 16),
            };
            let bits = bits(start, width, is_big);
            if !bits.iter().all(|bit| is_free.get(*bit) == Some(&true)) {
                continue;
            }
            for bit in bits {
                is_free[bit] = false;
            }
            let is_signed = is_float || (width > 1 && random.uniform() < 0.5);
            // Beyond 48 bits scale and value are powers of two, so that the value is exact.
            let (scale, offset) = match (is_float, width > 48) {
                (true, _) => (1.0, 0.0),
                (false, true) => ([1.0, 0.125, 4.0][below(&mut random, 3)], 0.0),
                (false, false) => {
                    let scale = [1.0, 0.1, -0.5, 1e-6, 0.3937, 25.0][below(&mut random, 6)];
                    (scale, scale * below(&mut random, 2000) as f64 - 7.25)
                }
            };
            let range: String = match is_float || width > 48 || random.uniform() < 0.5 {
                true => "0|0".into(),
                false => {
                    // The inner half of the raw numbers.
                    let end = (1_u64 << width) as f64;
                    let lowest = if is_signed { -end / 2.0 } else { 0.0 };
                    let raw = [lowest + (end / 4.0).floor(), lowest + (end * 0.75).floor()];
                    let [one, other] = raw.map(|raw| raw * scale + offset);
                    format!("{:?}|{:?}", smaller(one, other), larger(one, other))
                }
            };
            let name = format!("M{message}S{signal}");
            signal += 1;
            let (order, sign) = (u8::from(!is_big), if is_signed { '-' } else { '+' });
            writeln!(
                text,
                " SG_ {name} : {start}|{width}@{order}{sign} ({scale:?},{offset:?}) [{range}] \"\" Law"
            )
            .expect("text");
            if is_float {
                let kind = width / 32;
                writeln!(floats, "SIG_VALTYPE_ {id} {name} : {kind};").expect("text");
            }
        }
    }
    format!("{text}\n{floats}")
}
