//! The dynamic section of a shared library: the libraries that it needs, and the symbols that others must define.
//!
//! Parses the sections of a 64-bit ELF file (System V ABI, chapters 4 and 5) without trusting any number in it.

use std::path::Path;

/// Sizes of a section header, a symbol and an entry of the dynamic section, in bytes.
const SECTION_BYTES: usize = 64;
const SYMBOL_BYTES: usize = 24;
const ENTRY_BYTES: usize = 16;
/// Section types.
const DYNAMIC: u32 = 6;
const SYMBOLS: u32 = 11;
/// Tags of the dynamic section.
const NEEDED: u64 = 1;
const PATH: u64 = 15;
const RUN_PATH: u64 = 29;
/// Binding of a symbol that must be defined.
const GLOBAL: u8 = 1;

/// Contents of a library's dynamic section.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Dynamic {
    /// Libraries that the library needs.
    pub(super) needs: Vec<String>,
    /// Symbols that other libraries must define.
    pub(super) undefined: Vec<String>,
    /// Set if the needed libraries are also searched for in the library's own folder.
    pub(super) looks_beside_itself: bool,
}

impl Dynamic {
    /// Parses the file at a path; `None` if the file is not a library with sections.
    pub(super) fn read(path: &Path) -> Option<Self> {
        Self::of(&std::fs::read(path).ok()?)
    }

    fn of(bytes: &[u8]) -> Option<Self> {
        if !bytes.starts_with(b"\x7fELF\x02\x01") {
            return None;
        }
        let sections = number(bytes, 40, 8)?;
        let count = number(bytes, 60, 2)?;
        let section = |index: usize| {
            let at = sections.checked_add(index.checked_mul(SECTION_BYTES)?)?;
            let kind = u32::try_from(number(bytes, at + 4, 4)?).ok()?;
            let (offset, size) = (number(bytes, at + 24, 8)?, number(bytes, at + 32, 8)?);
            let content = bytes
                .get(offset..offset.checked_add(size)?)
                .unwrap_or_default();
            Some((kind, content, number(bytes, at + 40, 4)?))
        };
        let mut dynamic = Self::default();
        for index in 0..count {
            let (kind, content, link) = section(index)?;
            let texts = || section(link).map_or(&[][..], |(_, content, _)| content);
            match kind {
                DYNAMIC => dynamic.take_entries(content, texts()),
                SYMBOLS => dynamic.take_symbols(content, texts()),
                _ => {}
            }
        }
        Some(dynamic)
    }

    fn take_entries(&mut self, content: &[u8], texts: &[u8]) {
        for entry in content.chunks_exact(ENTRY_BYTES) {
            let tag = number(entry, 0, 8).unwrap_or_default() as u64;
            let text = || text(texts, number(entry, 8, 8)?);
            match tag {
                NEEDED => self.needs.extend(text()),
                PATH | RUN_PATH => {
                    self.looks_beside_itself |= text().is_some_and(|path| {
                        path.split(':')
                            .any(|one| matches!(one, "$ORIGIN" | "${ORIGIN}"))
                    });
                }
                _ => {}
            }
        }
    }

    fn take_symbols(&mut self, content: &[u8], texts: &[u8]) {
        for symbol in content.chunks_exact(SYMBOL_BYTES) {
            let is_undefined = symbol[6..8] == [0, 0];
            if is_undefined && symbol[4] >> 4 == GLOBAL {
                let name = number(symbol, 0, 4).and_then(|at| text(texts, at));
                self.undefined.extend(name.filter(|name| !name.is_empty()));
            }
        }
    }
}

/// Reads a little-endian number of `count` bytes.
fn number(bytes: &[u8], at: usize, count: usize) -> Option<usize> {
    let part = bytes.get(at..at.checked_add(count)?)?;
    let mut all = [0; 8];
    all[..count].copy_from_slice(part);
    usize::try_from(u64::from_le_bytes(all)).ok()
}

/// Reads the text at an offset.
fn text(texts: &[u8], at: usize) -> Option<String> {
    let text = texts.get(at..)?;
    let end = text.iter().position(|byte| *byte == 0)?;
    Some(shared_types::text::line(&String::from_utf8_lossy(
        &text[..end],
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn this_program_needs_the_c_library_and_its_malloc() {
        let path = std::env::current_exe().expect("its path");
        let dynamic = Dynamic::read(&path).expect("an ELF file");
        assert!(dynamic.needs.iter().any(|name| name.starts_with("libc.")));
        assert!(dynamic.undefined.iter().any(|name| name == "malloc"));
    }

    #[test]
    fn a_damaged_file_causes_no_panic() {
        let bytes = std::fs::read(std::env::current_exe().expect("its path")).expect("read");
        for length in (0..bytes.len()).step_by(bytes.len() / 40) {
            let _ = Dynamic::of(&bytes[..length]); // any result is fine
        }
        let mut wild = bytes[..64].to_vec();
        wild[40..64].fill(0xff);
        assert_eq!(Dynamic::of(&wild), None);
        assert_eq!(Dynamic::of(b"no library"), None);
    }
}
