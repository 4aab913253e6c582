//! Decoding of model descriptions in the encodings that tools write, although the standard requires UTF-8.
//!
//! A byte-order mark takes precedence, then the encoding that the document declares, if the content is not plain
//! ASCII. Nothing is guessed: bytes that are invalid in the encoding are refused.

use super::DescriptionError;

/// Number of bytes within which the encoding must be declared.
const HEAD: usize = 200;
/// Characters 0x80 to 0x9f of windows-1252, which differ from ISO-8859-1; `\0` for an undefined byte.
const WINDOWS_1252: [char; 32] = [
    '\u{20ac}', '\0', '\u{201a}', '\u{192}', '\u{201e}', '\u{2026}', '\u{2020}', '\u{2021}',
    '\u{2c6}', '\u{2030}', '\u{160}', '\u{2039}', '\u{152}', '\0', '\u{17d}', '\0', '\0',
    '\u{2018}', '\u{2019}', '\u{201c}', '\u{201d}', '\u{2022}', '\u{2013}', '\u{2014}', '\u{2dc}',
    '\u{2122}', '\u{161}', '\u{203a}', '\u{153}', '\0', '\u{17e}', '\u{178}',
];
/// Characters of ISO-8859-15 that differ from ISO-8859-1.
const LATIN_9: [(u8, char); 8] = [
    (0xa4, '\u{20ac}'),
    (0xa6, '\u{160}'),
    (0xa8, '\u{161}'),
    (0xb4, '\u{17d}'),
    (0xb8, '\u{17e}'),
    (0xbc, '\u{152}'),
    (0xbd, '\u{153}'),
    (0xbe, '\u{178}'),
];

/// Decodes the text of a document.
///
/// # Errors
/// If the encoding is not supported, or the bytes are invalid in that encoding.
pub(super) fn decoded(bytes: &[u8]) -> Result<String, DescriptionError> {
    if let Some(rest) = bytes.strip_prefix(b"\xef\xbb\xbf") {
        return utf_8(rest);
    }
    match bytes {
        [0xff, 0xfe, rest @ ..] => return utf_16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => return utf_16(rest, u16::from_be_bytes),
        // Without a mark: the first character of every document.
        [b'<', 0, ..] => return utf_16(bytes, u16::from_le_bytes),
        [0, b'<', ..] => return utf_16(bytes, u16::from_be_bytes),
        _ => {}
    }
    let declared = declared(bytes).unwrap_or_default();
    let plain: String = (declared.chars())
        .filter(char::is_ascii_alphanumeric)
        .map(|c| c.to_ascii_lowercase())
        .collect();
    match plain.as_str() {
        _ if bytes.is_ascii() => utf_8(bytes),
        "" | "utf8" => utf_8(bytes),
        "iso88591" | "latin1" | "l1" => single(bytes, &declared, |byte| Some(byte.into())),
        "windows1252" | "cp1252" | "ansi" => single(bytes, &declared, |byte| match byte {
            0x80..=0x9f => Some(WINDOWS_1252[usize::from(byte - 0x80)]).filter(|c| *c != '\0'),
            byte => Some(byte.into()),
        }),
        "iso885915" | "latin9" => single(bytes, &declared, |byte| {
            let other = LATIN_9.iter().find(|(one, _)| *one == byte);
            Some(other.map_or(byte.into(), |(_, c)| *c))
        }),
        _ => Err(refused(&format!(
            "the encoding is {declared}, and the text is not ASCII; supported are UTF-8, UTF-16, ISO-8859-1, ISO-8859-15 and windows-1252"
        ))),
    }
}

fn refused(reason: &str) -> DescriptionError {
    DescriptionError::Xml(super::tree::shortened_to(reason, 200))
}

fn utf_8(bytes: &[u8]) -> Result<String, DescriptionError> {
    let text = std::str::from_utf8(bytes);
    text.map(str::to_owned).map_err(|error| {
        let at = error.valid_up_to();
        refused(&format!(
            "invalid UTF-8 at byte {at}, and no other encoding is declared"
        ))
    })
}

fn utf_16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> Result<String, DescriptionError> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    let units = pairs.iter().map(|pair| unit(*pair));
    let text = char::decode_utf16(units).collect::<Result<String, _>>();
    text.ok()
        .filter(|_| rest.is_empty())
        .ok_or_else(|| refused("a UTF-16 byte-order mark, but invalid UTF-16"))
}

/// Decodes an encoding with one byte per character.
fn single(
    bytes: &[u8],
    name: &str,
    character: impl Fn(u8) -> Option<char>,
) -> Result<String, DescriptionError> {
    let text = bytes
        .iter()
        .map(|byte| character(*byte))
        .collect::<Option<String>>();
    text.ok_or_else(|| refused(&format!("bytes that are undefined in {name}")))
}

/// Returns the encoding that a document declares in its first line.
fn declared(bytes: &[u8]) -> Option<String> {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEAD)]);
    let declaration = head
        .trim_start()
        .strip_prefix("<?xml")?
        .split_once("?>")?
        .0
        .to_owned();
    let value = declaration
        .split_once("encoding")?
        .1
        .trim_start()
        .strip_prefix('=')?;
    let value = value.trim_start();
    let quote = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    Some(value[1..].split_once(quote)?.0.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn document(encoding: &str) -> String {
        format!("<?xml version=\"1.0\" encoding='{encoding}'?><a b=\"\u{e4}\u{b0}\"/>")
    }

    fn latin(text: &str) -> Vec<u8> {
        text.chars()
            .map(|c| u8::try_from(c).expect("latin"))
            .collect()
    }

    #[test]
    fn all_supported_encodings_give_the_same_text() {
        for name in [
            "ISO-8859-1",
            "iso-8859-1",
            "latin1",
            "windows-1252",
            "cp1252",
            "ISO-8859-15",
        ] {
            let text = document(name);
            assert_eq!(decoded(&latin(&text)).expect(name), text);
        }
        let text = document("UTF-8");
        assert_eq!(decoded(text.as_bytes()).as_deref(), Ok(&*text));
        assert_eq!(
            decoded(format!("\u{feff}{text}").as_bytes()).as_deref(),
            Ok(&*text)
        );
        let text = document("UTF-16");
        for unit in [u16::to_le_bytes, u16::to_be_bytes] {
            let bytes: Vec<u8> = text.encode_utf16().flat_map(unit).collect();
            assert_eq!(decoded(&bytes).as_deref(), Ok(&*text));
            let marked = [&unit(0xfeff)[..], &bytes].concat();
            assert_eq!(decoded(&marked).as_deref(), Ok(&*text));
            decoded(&marked[..marked.len() - 1]).expect_err("half a character");
        }
    }

    #[test]
    fn bytes_that_differ_between_encodings_follow_the_declared_one() {
        let with = |name: &str, byte: u8| {
            let mut bytes = format!("<?xml version=\"1.0\" encoding=\"{name}\"?>").into_bytes();
            bytes.push(byte);
            decoded(&bytes).map(|text| text.chars().next_back())
        };
        assert_eq!(with("ISO-8859-1", 0xa4), Ok(Some('\u{a4}')));
        assert_eq!(with("ISO-8859-15", 0xa4), Ok(Some('\u{20ac}')));
        assert_eq!(with("windows-1252", 0x80), Ok(Some('\u{20ac}')));
        assert_eq!(with("windows-1252", 0xb5), Ok(Some('\u{b5}')));
        for (name, byte) in [("windows-1252", 0x81), ("UTF-8", 0xb5), ("Shift_JIS", 0xb5)] {
            with(name, byte).expect_err(name);
        }
    }

    #[test]
    fn ascii_is_accepted_for_any_declared_encoding() {
        for name in ["US-ASCII", "Shift_JIS", "GB2312", "Klingon", "UTF-16"] {
            let text = format!("<?xml version=\"1.0\" encoding=\"{name}\"?><a/>");
            assert_eq!(decoded(text.as_bytes()).as_deref(), Ok(&*text));
        }
        for text in ["", "<a/>", "<?xml version=\"1.0\"?><a/>"] {
            assert_eq!(decoded(text.as_bytes()).as_deref(), Ok(text));
        }
    }
}
