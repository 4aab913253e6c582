//! Chunks that were packed by others come out again, from a torn chunk as far as it goes.

use std::io::Write;

use super::*;

/// Text with literals of every length and with matches near, far and into themselves.
fn content() -> Vec<u8> {
    let mut content = Vec::new();
    let mut state = 1_u32;
    for length in 0..600 {
        for _ in 0..length % 37 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            content.push((state >> 24) as u8);
        }
        content.extend(std::iter::repeat_n(length as u8, length));
        let from = content.len() / 2;
        content.extend_from_within(from..from + length / 3);
    }
    content
}

/// Packed by the reference implementations.
fn packed(compression: &str, content: &[u8]) -> Vec<u8> {
    match compression {
        "lz4" => {
            let mut encoder = lz4::EncoderBuilder::new()
                .block_size(lz4::BlockSize::Max4MB)
                .build(Vec::new())
                .expect("an encoder");
            encoder.write_all(content).expect("packed");
            let (packed, done) = encoder.finish();
            done.map(|()| packed).expect("packed")
        }
        "zstd" => zstd::bulk::compress(content, 1).expect("packed"),
        _ => content.to_vec(),
    }
}

#[test]
fn a_chunk_comes_out_as_it_went_in() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        let mut found = Vec::new();
        whole(compression, &packed, content.len(), &mut found).expect(compression);
        assert!(found == content, "{compression}");
        for (packed, size) in [
            (&packed[..packed.len() / 2], content.len()),
            (&packed, content.len() - 1),
            (&packed, content.len() + 1),
        ] {
            let refused = whole(compression, packed, size, &mut Vec::new());
            assert!(refused.is_err(), "{compression}: {size} bytes");
        }
    }
    assert!(whole("gzip", &[], 0, &mut Vec::new()).is_err());
}

#[test]
fn a_torn_chunk_gives_what_lies_before_the_tear() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        let mut longest = 0;
        for cut in (0..packed.len()).step_by(97).chain([packed.len()]) {
            let mut found = Vec::new();
            torn(compression, &packed[..cut], usize::MAX >> 1, &mut found);
            assert!(found.len() >= longest, "{compression} cut at {cut}");
            assert!(content.starts_with(&found), "{compression} cut at {cut}");
            longest = found.len();
        }
        assert_eq!(longest, content.len(), "{compression}");
    }
}

#[test]
fn a_torn_lz4_block_is_unpacked_up_to_its_last_bytes() {
    // Nothing in it repeats: every byte before the tear is there.
    let content: Vec<u8> = (0..=u8::MAX).collect();
    let packed = packed("lz4", &content);
    let mut found = Vec::new();
    torn("lz4", &packed[..packed.len() - 100], 1 << 20, &mut found);
    assert!(found.len() > 140, "{} bytes", found.len());
    assert!(content.starts_with(&found));
}

#[test]
fn wrong_bytes_give_no_more_than_was_asked_for() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        for place in (0..packed.len()).step_by(13) {
            for bit in [0, 3, 7] {
                let mut wrong = packed.clone();
                wrong[place] ^= 1 << bit;
                for limit in [100, content.len()] {
                    let mut found = Vec::new();
                    torn(compression, &wrong, limit, &mut found);
                    assert!(
                        found.len() <= limit,
                        "{compression}, byte {place}, bit {bit}"
                    );
                }
                let mut found = Vec::new();
                let _ = whole(compression, &wrong, content.len(), &mut found); // either may be
                assert!(found.len() <= content.len() + 1);
            }
        }
    }
}
