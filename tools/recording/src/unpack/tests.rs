//! Unpacking of chunks from the reference implementations, complete and truncated.

use std::io::Write;

use super::*;

/// Text with literals of every length, and with near, distant and overlapping matches.
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

/// Packs with the reference implementations.
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
fn a_chunk_is_unpacked_unchanged() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        let mut output = Vec::new();
        whole(compression, &packed, content.len(), &mut output).expect(compression);
        assert!(output == content, "{compression}");
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
fn a_truncated_chunk_yields_the_bytes_before_the_truncation() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        let mut longest = 0;
        for cut in (0..packed.len()).step_by(97).chain([packed.len()]) {
            let mut output = Vec::new();
            torn(compression, &packed[..cut], usize::MAX >> 1, &mut output);
            assert!(output.len() >= longest, "{compression} cut at {cut}");
            assert!(content.starts_with(&output), "{compression} cut at {cut}");
            longest = output.len();
        }
        assert_eq!(longest, content.len(), "{compression}");
    }
}

#[test]
fn a_truncated_lz4_block_is_unpacked_up_to_its_last_bytes() {
    // The content has no repetitions, so every byte before the truncation is available.
    let content: Vec<u8> = (0..=u8::MAX).collect();
    let packed = packed("lz4", &content);
    let mut output = Vec::new();
    torn("lz4", &packed[..packed.len() - 100], 1 << 20, &mut output);
    assert!(output.len() > 140, "{} bytes", output.len());
    assert!(content.starts_with(&output));
}

#[test]
fn damaged_input_never_yields_more_than_the_limit() {
    let content = content();
    for compression in ["", "lz4", "zstd"] {
        let packed = packed(compression, &content);
        for place in (0..packed.len()).step_by(13) {
            for bit in [0, 3, 7] {
                let mut wrong = packed.clone();
                wrong[place] ^= 1 << bit;
                for limit in [100, content.len()] {
                    let mut output = Vec::new();
                    torn(compression, &wrong, limit, &mut output);
                    assert!(
                        output.len() <= limit,
                        "{compression}, byte {place}, bit {bit}"
                    );
                }
                let mut output = Vec::new();
                let _ = whole(compression, &wrong, content.len(), &mut output); // both results are fine
                assert!(output.len() <= content.len() + 1);
            }
        }
    }
}

#[test]
fn the_only_block_of_the_recorder_is_unpacked_in_place() {
    let content = content();
    let mut encoder = crate::lz4::Encoder::new(0);
    encoder.plain(&content);
    let packed = encoder.finish().to_vec();
    assert!(only_block(&packed).is_some());
    // What was there before, longer or shorter, is replaced.
    for before in [0, 10, 2 * content.len()] {
        let mut output = vec![7; before];
        whole("lz4", &packed, content.len(), &mut output).expect("a whole chunk");
        assert!(output == content);
    }
    let cut = &packed[..packed.len() - FRAME_END.len() - 1];
    for (packed, size) in [
        (&packed[..], content.len() - 1),
        (&packed, content.len() + 1),
        (&packed, 1 << 40),
        (cut, content.len()),
    ] {
        let mut output = vec![7; 10];
        whole("lz4", packed, size, &mut output).expect_err("another size");
        assert!(output.is_empty() && output.capacity() < 2 * content.len() + (1 << 20));
    }
}
